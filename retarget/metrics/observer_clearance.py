"""How near a body's observers came to each other and to a scene: on their own shapes, by the solver's own distances."""

import numpy as np

from retarget import _solver
from retarget.body import BodyModel, IntArray
from retarget.observer_pairs import placed
from retarget.observers import Observers
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState

__all__ = ["Side", "observer_clearance", "shape_rows"]

Side = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""kinds (n,), sizes (n, 3), positions (n, 3) m and orientations (n, 4) wxyz of canonical frames."""


def observer_clearance(
    body: BodyModel, observers: Observers, q: FloatArray, *, scene: SceneState | None, times: FloatArray
) -> tuple[float | None, float | None, float | None]:
    """Smallest distance (m, negative inside) in postures q (T, nq) at `times` (T,): of pairs that are looked at, to any
    obstacle, and to the ground. None: nothing to look at."""
    if not len(q):
        return None, None, None
    position, quat = placed(body, observers, q)
    first, second = observers.pairs.T
    own = _least(_side(observers, position, quat, first), _side(observers, position, quat, second))
    if scene is None or not scene.shapes.names:
        return own, None, None
    poses = [scene.at(max(float(time), 0.0)) for time in times]
    there = np.stack([pose.position for pose in poses]), np.stack([pose.quat for pose in poses])  # (T, k, ...)
    shapes, (around, _) = scene.shapes, observers.around(scene.shapes)

    def least_to(ground: bool) -> float | None:
        who, what = around[shapes.ground[around[:, 1]] == ground].T
        obstacles = shape_rows(shapes.kinds[what], shapes.sizes[what], there[0][:, what], there[1][:, what])
        return _least(_side(observers, position, quat, who), obstacles)

    return own, least_to(False), least_to(True)


def _side(observers: Observers, position: FloatArray, quat: FloatArray, which: IntArray) -> Side:
    return shape_rows(observers.kinds[which], observers.sizes[which], position[:, which], quat[:, which])


def shape_rows(kinds: IntArray, sizes: FloatArray, position: FloatArray, quat: FloatArray) -> Side:
    """One row for each shape (n,) of each posture (T,)."""
    postures = len(position)
    return (
        np.tile(kinds, postures),
        np.tile(sizes, (postures, 1)),
        np.ascontiguousarray(position).reshape(-1, 3),
        np.ascontiguousarray(quat).reshape(-1, 4),
    )


def _least(a: Side, b: Side) -> float | None:
    """The smallest distance of rows of a and b: looked at exactly only where a lower bound leaves it open."""
    if not len(a[0]):
        return None
    bound = _solver.shape_gaps_at_least(*a, *b)
    order = np.argsort(bound)
    least, at = np.inf, 0
    while at < len(order) and bound[order[at]] < least:
        chosen = order[at : at + 4096]
        near, far = _chosen(a, chosen), _chosen(b, chosen)
        distance = _solver.shape_distances(*near, *far)[0]
        least, at = min(least, float(distance.min())), at + 4096
    return least


def _chosen(side: Side, rows: IntArray) -> Side:
    kinds, sizes, position, quat = side
    return kinds[rows], sizes[rows], position[rows], quat[rows]
