"""How close a body came to itself and to a scene, on the geoms of its own file: an independent look at what was sent.

Distances are MuJoCo's own between two geoms (exact, inside too), not those of its contacts, which a margin makes rough.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.body_file import Root, compile_body, compile_body_text
from retarget.metrics.closest_pairs import Closest, Distances, closest_pairs
from retarget.metrics.geom_distance import geom_distances
from retarget.metrics.link_pairs import LeftOut, compared_pairs
from retarget.metrics.moving_geoms import MovingGeoms, moving_geoms, travelled
from retarget.metrics.scene_model import ObstacleTracks, obstacle_tracks, scene_model
from retarget.rotations import FloatArray
from retarget.scene_motion import SceneState

__all__ = ["DEEP_M", "TOUCH_M", "Clearance", "PlacedBody", "place_body", "scene_clearance", "self_clearance"]

TOUCH_M = 1e-6
"""Deeper than this, m, counts as penetration."""
DEEP_M = 1e-3
"""Deeper than this, m, is more than a touch."""
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Clearance:
    """smallest: distance, m, negative inside; None: nothing to compare. penetrating: number of postures.

    pair: the two links, or the link and the obstacle, that came closest; row: in which posture. deep: how many of the
    penetrating postures are deeper than 1 mm. left_out: pairs of links that were not compared.
    """

    smallest: float | None
    penetrating: int
    pair: tuple[str, str] | None
    row: int | None = None
    deep: int = 0
    left_out: tuple[LeftOut, ...] = ()

    @property
    def deepest(self) -> float:
        """Depth of the deepest penetration, m; 0 without one."""
        return max(0.0, -(self.smallest or 0.0))


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body in T postures, to be looked at in more than one way. rows (T,): their numbers among those given."""

    model: Any
    geoms: MovingGeoms
    rows: IntArray

    def to_itself(self, *, neutral: FloatArray, ignored: Iterable[tuple[str, str]] = ()) -> Clearance:
        """See `self_clearance`."""
        geoms = self.geoms
        pairs, left_out = compared_pairs(self.model, geoms.links, geoms.geoms, neutral=neutral, ignored=ignored)
        if not len(self.rows) or not len(pairs):
            return Clearance(None, 0, None, left_out=left_out)
        seen = geoms.within(0)
        way = travelled(seen.position, seen.matrix, seen.radius)
        measure = geom_distances(
            self.model, geoms.geoms[pairs], geoms=geoms.geoms, position=geoms.position, matrix=geoms.matrix
        )
        found = closest_pairs(measure, way[:, pairs[:, 0]] + way[:, pairs[:, 1]], tolerances=(TOUCH_M, DEEP_M))
        first, second = (self._name(geom) for geom in pairs[found.pair])
        return _clearance(found, (first, second), self.rows, left_out)

    def to_scene(self, scene: SceneState, times: FloatArray) -> Clearance:
        """See `scene_clearance`; times: one for every posture that was given. The ground is left out."""
        return self._to_obstacles(scene, times, ~scene.shapes.ground[None] & np.ones((len(self.geoms.links), 1), bool))

    def to_ground(self, scene: SceneState, times: FloatArray, *, soles: Iterable[str]) -> Clearance:
        """The same between the ground of the scene and all links but those named in `soles`."""
        standing = [self.model.body(name).id for name in soles]
        return self._to_obstacles(scene, times, scene.shapes.ground & ~np.isin(self.geoms.links, standing)[:, None])

    def _to_obstacles(self, scene: SceneState, times: FloatArray, looks: NDArray[np.bool_]) -> Clearance:
        """looks (g, k): which geom is compared with which obstacle."""
        if not len(self.rows) or not looks.any():
            return Clearance(None, 0, None)
        geoms, obstacles = self.geoms, obstacle_tracks(scene, times[self.rows])
        pairs = np.argwhere(looks)
        measure = self._distances(obstacles, scene, pairs)
        way = travelled(geoms.position, geoms.matrix, geoms.radius)[:, pairs[:, 0]]
        way += travelled(obstacles.position, obstacles.matrix, obstacles.radius)[:, pairs[:, 1]]
        found = closest_pairs(measure, way, tolerances=(TOUCH_M, DEEP_M))
        link, obstacle = pairs[found.pair]
        return _clearance(found, (self._name(link), scene.shapes.names[obstacle]), self.rows, ())

    def scene_distances(self, scene: SceneState, times: FloatArray) -> FloatArray:
        """Distance (T, k) m to each obstacle in each posture, of the geom that is nearest: all are looked at."""
        count, obstacles = len(self.rows), obstacle_tracks(scene, times[self.rows])
        shape = len(self.geoms.geoms), len(scene.shapes.names)
        pairs = np.indices(shape).reshape(2, -1).T
        rows, which = np.indices((count, len(pairs))).reshape(2, -1)
        distances = self._distances(obstacles, scene, pairs)(rows, which).reshape(count, *shape)
        return np.asarray(distances.min(axis=1))

    def part(self, rows: IntArray, which: IntArray) -> "PlacedBody":
        """Some of the geoms in some of the postures, by number; the postures are numbered anew."""
        return PlacedBody(self.model, self.geoms.chosen(rows, which), np.arange(len(rows)))

    def _distances(self, obstacles: ObstacleTracks, scene: SceneState, pairs: IntArray) -> Distances:
        """How the distances of pairs (p, 2) of geom and obstacle are measured."""
        geoms = self.geoms
        both = scene_model(self.model, geoms.geoms, scene.shapes)
        position, matrix = both.placed(geoms)
        return geom_distances(
            both.model,
            np.column_stack([both.body[pairs[:, 0]], both.obstacles[pairs[:, 1]]]),
            geoms=np.concatenate([both.body, both.obstacles]),
            position=np.concatenate([position, obstacles.position], axis=1),
            matrix=np.concatenate([matrix, obstacles.matrix], axis=1),
        )

    def _name(self, geom: int) -> str:
        """Of the geom's link."""
        return str(self.model.body(int(self.geoms.links[geom])).name)


def place_body(body: Path | str, postures: FloatArray, *, root: Root | None = None) -> PlacedBody:
    """The body of a file, or of MJCF text, in postures (T, nq); those that are not finite take no part.

    root: as in `compile_body`. Raises InputError.
    """
    if isinstance(body, Path):
        model = compile_body(body, root=root).model
    else:
        model = compile_body_text(body, source="the body", root=root).model
    rows = np.flatnonzero(np.isfinite(postures).all(axis=1))
    return PlacedBody(model, moving_geoms(model, postures[rows]), rows)


def self_clearance(
    body: Path | str,
    postures: FloatArray,
    *,
    root: Root | None = None,
    neutral: FloatArray,
    ignored: Iterable[tuple[str, str]] = (),
) -> Clearance:
    """Look at every posture (T, nq) of a body: a file, or MJCF text.

    Not compared: geoms of one link, of a link and its parent, of `ignored` pairs of links, of pairs that the file
    excludes, and of pairs that already touch in the posture `neutral` (nq,).
    """
    return place_body(body, postures, root=root).to_itself(neutral=neutral, ignored=ignored)


def scene_clearance(
    body: Path | str, postures: FloatArray, *, root: Root | None = None, scene: SceneState, times: FloatArray
) -> Clearance:
    """The same between every geom of a body and every obstacle of a scene, at times (T,) s on the scene's clock."""
    return place_body(body, postures, root=root).to_scene(scene, times)


def _clearance(found: Closest, pair: tuple[str, str], rows: IntArray, left_out: tuple[LeftOut, ...]) -> Clearance:
    penetrating, deep = found.deeper
    return Clearance(found.smallest, penetrating, pair, int(rows[found.row]), deep, left_out)
