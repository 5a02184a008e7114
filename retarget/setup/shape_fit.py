"""A simple shape around each link of a body: the smaller one of a capsule and a box."""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from retarget.arithmetic import norm
from retarget.errors import InputError
from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import from_matrix, normalise, rotate, shortest_arc, to_matrix
from retarget.types import FloatArray

MIN_RADIUS = 1e-4
"""Smallest radius, and half size of a box, m."""
DIGITS = 5
"""Decimals of lengths in m, to which shapes are rounded outwards."""
ROUNDED = 1e-3
"""Share of a volume that rounding may change."""
WIDER = (1.0, 1.05, 1.12, 1.25)
"""Factors on the smallest radius of a capsule that are tried: a thicker one may be shorter."""


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A capsule (a ball if it has no length) or a box around a link, in the frame of the link.

    size (3,), pos (3,), m, quat (4,), wxyz: as in MuJoCo. ratio: its volume over that of the geometry's convex hull,
    None for a flat hull. around_mesh: True if a mesh is part of the geometry.
    """

    link: int
    link_name: str
    kind: ShapeKind
    size: FloatArray
    pos: FloatArray
    quat: FloatArray
    ratio: float | None = None
    around_mesh: bool = False

    @property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Ends (3,), m, of the segment of a capsule."""
        half = rotate(self.quat, np.array([0.0, 0.0, self.size[1]]))
        return self.pos - half, self.pos + half

    @property
    def entry(self) -> dict[str, Any]:
        """The shape for a profile, see `retarget.schema.profile_parts.Shape`."""
        if self.kind is ShapeKind.BOX:
            turn = {} if abs(self.quat[0]) > 1.0 - 1e-12 else {"quat": self.quat.tolist()}
            return {"box": {"pos": self.pos.tolist(), **turn, "size": self.size.tolist()}}
        if not self.size[1]:
            return {"sphere": {"at": self.pos.tolist(), "radius": float(self.size[0])}}
        start, end = (_round(end).tolist() for end in self.ends)
        return {"capsule": {"from": start, "to": end, "radius": float(self.size[0])}}


def enclosing_capsule(centres: FloatArray, radii: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return start (3,), end (3,) and radius, m, of a small capsule around balls, centres (k, 3) and radii (k,), m.

    It is the smallest of those along the frame's axes, `axes` (j, 3) and the principal axes.
    """
    found = []
    for u in (*np.eye(3), *principal_axes(centres), *axes):
        height = centres @ u
        shadow = centres - height[:, None] * u
        middle = 0.5 * (shadow.max(axis=0) + shadow.min(axis=0))
        beside = np.linalg.norm(shadow - middle, axis=1)
        thinnest = max(float((beside + radii).max()), MIN_RADIUS)
        for radius in np.array(WIDER) * thinnest:
            # A ball is inside if the segment meets this much of the line around its height.
            reach = np.sqrt(np.maximum((radius - radii) ** 2 - beside**2, 0.0))
            low, high = float((height + reach).min()), float((height - reach).max())
            low, high = (low, high) if low < high else (0.5 * (low + high),) * 2
            volume = _capsule_volume(radius, high - low)
            found.append((volume, middle + low * u, middle + high * u))
    _, start, end = min(found, key=lambda one: one[0])
    start, end = _round(start), _round(end)
    radius = float((distances_to_segment(centres, start, end) + radii).max())
    return start, end, round_up(max(radius, MIN_RADIUS))


def principal_axes(points: FloatArray) -> FloatArray:
    """Principal axes (3, 3) of points (k, 3) as rows, the one of the largest spread first."""
    # All of U would be (k, k); V has three rows without it, except of one or two points.
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), full_matrices=len(points) < 3)[2])


def _capsule_volume(radius: float, length: float) -> float:
    return math.pi * radius**2 * (length + 4.0 / 3.0 * radius)


def distances_to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distances (k,) of points (k, 3) from a segment, m."""
    along = end - start
    length2 = float(along @ along)
    share = np.zeros(len(points)) if length2 == 0.0 else np.clip((points - start) @ along / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * along, axis=1))


def enclosing_box(geometry: "LinkGeometry") -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return size (3,), position (3,), m, and quat (4,) of the smallest box along the axes of the link, of its geoms,
    or the principal ones, rounded outwards to DIGITS."""
    centres, radii = geometry.centres, geometry.radii[:, None]
    principal = principal_axes(centres).T
    boxes = []
    for axes in (np.eye(3), *geometry.axes, principal):
        turn = axes if np.linalg.det(axes) > 0.0 else axes * [1.0, 1.0, -1.0]
        local = centres @ turn
        pos = _round(turn @ (0.5 * ((local - radii).min(axis=0) + (local + radii).max(axis=0))))
        quat = np.round(from_matrix(turn), 9)
        reach = (np.abs((centres - pos) @ to_matrix(normalise(quat))) + radii).max(axis=0)
        boxes.append((np.array([round_up(max(half, MIN_RADIUS)) for half in reach.tolist()]), pos, quat))
    smallest = min(float(size.prod()) for size, _, _ in boxes)
    return next(box for box in boxes if box[0].prod() <= smallest * (1.0 + ROUNDED))


def fitted_shape(geometry: "LinkGeometry") -> LinkShape:
    """The smaller one of a capsule and a box around a link."""
    size, pos, quat = enclosing_box(geometry)
    kind, volume = ShapeKind.BOX, 8.0 * float(size.prod())
    start, end, radius = enclosing_capsule(
        geometry.centres, geometry.radii, geometry.axes.transpose(0, 2, 1).reshape(-1, 3)
    )
    length = norm(end - start)
    if _capsule_volume(radius, length) <= volume * (1.0 + ROUNDED):
        kind, volume, size = ShapeKind.CAPSULE, _capsule_volume(radius, length), np.array([radius, 0.5 * length, 0.0])
        pos, quat = 0.5 * (start + end), np.array([1.0, 0.0, 0.0, 0.0])
        quat = shortest_arc(np.array([0.0, 0.0, 1.0]), end - start) if length else quat
    hull = hull_of_balls(geometry.centres, geometry.radii, DIRECTIONS)
    ratio = volume / float(hull.volume) if hull is not None and hull.volume > 0.0 else None
    return LinkShape(geometry.link, geometry.name, kind, size, pos, quat, ratio, geometry.around_mesh)


def fitted_shapes(model: Any, *, source: str) -> tuple[LinkShape, ...]:
    """Fit a shape around each link of a `mujoco.MjModel` with geometry. source: for messages. Raises InputError if no
    link has geometry, more than MAX_LINKS have, or a name is invalid."""
    geometries = link_geometries(model)
    nameless = [geometry for geometry in geometries if not NAME.fullmatch(geometry.name)]
    if not geometries:
        raise InputError(
            "the body has no shapes, so neither soles nor collisions can be found",
            where=source,
            allowed="geoms (MJCF), <collision> or <visual> shapes (URDF)",
            next_step="Export it with its meshes, or use the robot's MJCF where it has one",
        )
    if nameless:
        found = f"link {nameless[0].link}: {nameless[0].name!r}"
        raise InputError("a link without a name that a profile can hold", where=source, found=found)
    if len(geometries) > MAX_LINKS:
        allowed = f"at most {MAX_LINKS}"
        raise InputError("too many links with geometry", where=source, found=str(len(geometries)), allowed=allowed)
    return tuple(fitted_shape(geometry) for geometry in geometries)


# The geometry of each link as balls. Their convex hull is exact for spheres, capsules, boxes and meshes, and larger by
# 0.1 % for cylinders and 0.5 % for ellipsoids.

RIM_POINTS = 64
BALL_POINTS = 800
MOST_AXES = 50
"""Most orientations of geoms that are tried, a millisecond each."""
MAX_LINKS = 200
"""Most observers of a profile."""
NAME = re.compile(r"[^\s/\\]{1,80}")
"""Names of links that a profile accepts, as `schema.Name`."""


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """Balls of a link, centres (k, 3) and radii (k,), m, and axes (j, 3, 3): distinct orientations of its geoms, axes
    as columns. around_mesh: True if one of the geoms is a mesh."""

    link: int
    name: str
    centres: FloatArray
    radii: FloatArray
    axes: FloatArray
    around_mesh: bool = False


def link_geometries(model: Any) -> tuple[LinkGeometry, ...]:
    """The geometry of each link that has any, in the model's order: its colliding geoms, else all."""
    import mujoco

    found, collides = [], (model.geom_contype | model.geom_conaffinity) != 0
    for link in range(1, model.nbody):
        geoms = np.flatnonzero(model.geom_bodyid == link)
        geoms = geoms[collides[geoms]] if collides[geoms].any() else geoms
        solid = [(geom, balls) for geom in geoms.tolist() if (balls := _balls(model, geom)) is not None]
        if not solid:
            continue
        turns = [to_matrix(model.geom_quat[geom]) for geom, _ in solid]
        parts = list(zip(solid, turns, strict=True))
        sided = [turn for (geom, _), turn in parts if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_SPHERE]
        axes = np.array(sided).reshape(-1, 3, 3)
        _, first = np.unique(axes.round(4), axis=0, return_index=True)
        found.append(
            LinkGeometry(
                link=link,
                name=model.body(link).name,
                centres=np.concatenate([points @ turn.T + model.geom_pos[geom] for (geom, (points, _)), turn in parts]),
                radii=np.concatenate([np.full(len(points), radius) for _, (points, radius) in solid]),
                axes=axes[np.sort(first)[:MOST_AXES]],
                around_mesh=any(model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH for geom, _ in solid),
            )
        )
    return tuple(found)


def _balls(model: Any, geom: int) -> tuple[FloatArray, float] | None:
    """Centres (k, 3) in the geom's frame and their common radius, m; None for a plane or height field."""
    import mujoco

    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), np.array(model.geom_size[geom])
    ends = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return ends * size[1], float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.array(np.meshgrid(*[[-half, half] for half in size])).reshape(3, -1).T, 0.0
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angles = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
        outside = size[0] / np.cos(np.pi / RIM_POINTS)  # polygon around the circle, not in it
        rim = outside * np.stack([np.cos(angles), np.sin(angles), np.zeros(RIM_POINTS)], axis=1)
        return np.concatenate([rim + end * size[1] for end in ends]), 0.0
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return _AROUND_BALL * size, 0.0
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        points = np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], dtype=np.float64)
        hull = convex_hull(points)
        return (points if hull is None else points[hull.vertices]), 0.0
    return None


def convex_hull(points: FloatArray) -> ConvexHull | None:
    """Convex hull of points (k, 2) or (k, 3), None if they are flat."""
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def hull_of_balls(centres: FloatArray, radii: FloatArray, ball: FloatArray) -> ConvexHull | None:
    """Convex hull of balls, centres (k, 3) and radii (k,), sampled along unit vectors `ball` (n, 3), None if flat."""
    round_ones = [c + r * ball for c, r in zip(centres, radii, strict=True) if r > 0.0]
    return convex_hull(np.concatenate([centres[radii == 0.0], *round_ones]))


def _sphere_points(count: int) -> FloatArray:
    """Fibonacci lattice of unit vectors (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


DIRECTIONS = _sphere_points(BALL_POINTS)
"""Evenly spread unit vectors (n, 3)."""
# Scaled so that its faces touch the unit ball from outside: equations are n.x + offset = 0 with offset < 0.
_AROUND_BALL = DIRECTIONS / float(-ConvexHull(DIRECTIONS).equations[:, 3].max())


def _round(values: FloatArray) -> FloatArray:
    return np.round(values, DIGITS) + 0.0  # no -0.0


def round_up(value: float) -> float:
    """Round up to DIGITS decimals. A value within 1e-12 above a decimal counts as that decimal."""
    return round(math.ceil(value * 10.0**DIGITS - 10.0 ** (DIGITS - 12)) / 10.0**DIGITS, DIGITS)
