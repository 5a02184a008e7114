"""How near observers came to each other and to obstacles that stand still, in postures of a body."""

from dataclasses import dataclass

import numpy as np

from retarget import _solver
from retarget.model.body import BodyModel
from retarget.model.observers import Observers, placed
from retarget.model.scene_state import SceneState
from retarget.schema.scene import Scene
from retarget.types import FloatArray, IntArray

Side = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""kinds (n,), sizes (n, 3), positions (T, n, 3) m and orientations (T, n, 4) wxyz of canonical frames."""


@dataclass(frozen=True, eq=False)
class ObservedDistances:
    """Signed distances, m, negative inside. own (T, p): of the pairs that are looked at; scene (T, n, k): of each
    observer to each obstacle."""

    names: tuple[str, ...]
    own: FloatArray
    scene: FloatArray

    @property
    def least_own(self) -> FloatArray:
        """Of all pairs (T,); infinite without any."""
        return np.asarray(self.own.min(axis=1, initial=np.inf))

    @property
    def least_scene(self) -> FloatArray:
        """Of all observers and obstacles (T,); infinite without any."""
        return np.asarray(self.scene.min(axis=(1, 2), initial=np.inf))

    def of(self, name: str) -> FloatArray:
        """Of one observer to the nearest obstacle (T,)."""
        return np.asarray(self.scene[:, self.names.index(name)].min(axis=1, initial=np.inf))


def observed_distances(
    body: BodyModel, observers: Observers, q: FloatArray, scene: Scene | None = None
) -> ObservedDistances:
    """In postures q (T, nq), by the solver's own distances but outside of it."""
    position, quat = placed(body, observers, q)
    frames, count = len(q), len(observers.names)
    first, second = observers.pairs[:, 0], observers.pairs[:, 1]
    own = _between(
        (observers.kinds[first], observers.sizes[first], position[:, first], quat[:, first]),
        (observers.kinds[second], observers.sizes[second], position[:, second], quat[:, second]),
    )
    to_scene = np.zeros((frames, count, 0))
    if scene is not None:
        state = SceneState(scene)
        shapes, poses = state.shapes, state.at(0.0)
        columns = [
            _between(
                (observers.kinds, observers.sizes, position, quat),
                (
                    np.full(count, shapes.kinds[k]),
                    np.tile(shapes.sizes[k], (count, 1)),
                    np.broadcast_to(poses.position[k], position.shape),
                    np.broadcast_to(poses.quat[k], quat.shape),
                ),
            )
            for k in range(len(shapes.names))
        ]
        to_scene = np.stack(columns, axis=-1) if columns else to_scene
    return ObservedDistances(observers.names, own, to_scene)


def _between(a: Side, b: Side) -> FloatArray:
    """Distances (T, n)."""
    frames, count = a[2].shape[:2]
    if frames * count == 0:
        return np.zeros((frames, count))
    return np.asarray(_solver.shape_distances(*_rows(a), *_rows(b))[0]).reshape(frames, count)


def _rows(side: Side) -> Side:
    """One row for each shape of each posture."""
    kinds, sizes, position, quat = side
    frames = len(position)
    return (
        np.tile(kinds, frames),
        np.tile(sizes, (frames, 1)),
        np.ascontiguousarray(position).reshape(-1, 3),
        np.ascontiguousarray(quat).reshape(-1, 4),
    )
