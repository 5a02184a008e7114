"""Shapes around a link: its geometry as balls, the smallest capsule and a small box around them.

    minimise   pi R^2 |b - a| + 4/3 pi R^3     over the segment a b and the radius R
    subject to |c_i - [a b]| + r_i <= R        for every ball (c_i, r_i)

The problem has several local minima: many axes are ranked by the best capsule along each, which has a closed form for
a given line and radius, and the best few are polished as smooth programs (SLSQP) of seven variables. The radius
is then taken exactly from the balls, so that enclosure never depends on the optimiser.
"""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from retarget.errors import InputError
from retarget.rotations import from_matrix, to_matrix
from retarget.types import FloatArray

MIN_RADIUS = 1e-4
"""[m] thinner geometry gets this radius."""
POLISHED = 4
LATTICE = 60
RADII = np.array([1.0, 1.02, 1.05, 1.1, 1.15, 1.22, 1.3, 1.45, 1.7, 2.0])  # of the smallest along a line
WORKING = 60
ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Capsule:
    """start, end (3,) and radius, m. A ball where start equals end."""

    start: FloatArray
    end: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Length of the segment, m."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def volume(self) -> float:
        """m^3."""
        return float(np.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius))

    @property
    def is_ball(self) -> bool:
        """Whether the segment is a point."""
        return self.length == 0.0

    def support(self, directions: FloatArray) -> FloatArray:
        """How far (n,), m, it reaches along unit vectors (n, 3)."""
        return np.asarray(np.max(directions @ np.stack([self.start, self.end]).T, axis=1) + self.radius)

    def as_geom(self) -> dict[str, Any]:
        """The geom, as keywords of `mujoco.MjSpec`'s `add_geom`."""
        size = [self.radius, 0.0, 0.0]
        if self.is_ball:
            return {"type": _geom_type("SPHERE"), "pos": self.start, "size": size}
        return {"type": _geom_type("CAPSULE"), "fromto": np.concatenate([self.start, self.end]), "size": size}


def _geom_type(name: str) -> Any:
    import mujoco

    return getattr(mujoco.mjtGeom, f"mjGEOM_{name}")


def enclosing_capsule(centres: FloatArray, radii: FloatArray, *, axes: FloatArray | None = None) -> Capsule:
    """The smallest capsule around balls with centres (k, 3) and radii (k,), m, a ball where that is no larger.

    axes (j, 3): directions that are tried besides those of the balls' own spread.
    """
    middle = (centres.max(axis=0) + centres.min(axis=0)) / 2.0
    scale = float(np.max(np.linalg.norm(centres - middle, axis=1) + radii))
    if scale < MIN_RADIUS:
        return Capsule(middle, middle.copy(), MIN_RADIUS)
    points, sizes = (centres - middle) / scale, radii / scale
    starts = sorted((_along(u, points, sizes) for u in _directions(points, axes)), key=lambda found: found.volume)
    polished = [_polish(start, points, sizes) for start in starts[:POLISHED]]
    best = min([*starts[:1], *polished], key=lambda found: found.volume)
    ball = _ball(points, sizes)
    if ball.volume <= best.volume * (1.0 + 1e-6):
        best = ball
    start, end = best.start * scale + middle, best.end * scale + middle
    return Capsule(start, end, max(MIN_RADIUS, _needed_radius(start, end, centres, radii)))


def distances_to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distances (k,) of points (k, 3) from a segment, m."""
    return np.asarray(np.linalg.norm(_from_segment(points, start, end)[0], axis=1))


def _needed_radius(start: FloatArray, end: FloatArray, centres: FloatArray, radii: FloatArray) -> float:
    return float(np.max(distances_to_segment(centres, start, end) + radii))


def _from_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vectors (k, 3) from the closest points of the segment, and their share (k,) of the way from start to end."""
    along = end - start
    length2 = float(along @ along)
    share = np.zeros(len(points)) if length2 == 0.0 else np.clip((points - start) @ along / length2, 0.0, 1.0)
    return points - start - share[:, None] * along, share


def _directions(points: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Unit vectors (n, 3): the balls' principal axes, the given ones, and a lattice over the half sphere."""
    spread = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    z = (np.arange(LATTICE) + 0.5) / LATTICE
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(LATTICE)
    flat = np.sqrt(1.0 - z**2)
    lattice = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
    given = np.zeros((0, 3)) if axes is None else axes
    return np.concatenate([spread, np.eye(3), given, lattice])


def _along(u: FloatArray, points: FloatArray, sizes: FloatArray) -> Capsule:
    """The best capsule along direction u (3,), its line through the middle of the balls' shadow."""
    across = np.linalg.svd(u[None])[2][1:]
    shadow = points @ across.T
    middle = across.T @ ((shadow + sizes[:, None]).max(axis=0) + (shadow - sizes[:, None]).min(axis=0)) / 2.0
    smallest = float(np.max(np.linalg.norm(shadow - across @ middle, axis=1) + sizes))
    tries = [_on_line(middle, u, radius, points, sizes) for radius in smallest * RADII]
    return min(tries, key=lambda found: found.volume)


def _on_line(origin: FloatArray, u: FloatArray, radius: float, points: FloatArray, sizes: FloatArray) -> Capsule:
    """The shortest capsule of a radius on a line: each ball needs a point of the segment within radius - r_i."""
    height = (points - origin) @ u
    off2 = np.sum((points - origin - height[:, None] * u) ** 2, axis=1)
    reach = np.sqrt(np.maximum((radius - sizes) ** 2 - off2, 0.0))
    low, high = float(np.min(height + reach)), float(np.max(height - reach))
    if low >= high:
        low = high = (low + high) / 2.0
    start, end = origin + low * u, origin + high * u
    return Capsule(start, end, _needed_radius(start, end, points, sizes))


def _polish(start: Capsule, points: FloatArray, sizes: FloatArray) -> Capsule:
    """A local minimum near `start`, on a working set of balls that grows by those that stick out."""
    x = np.array([*start.start, *start.end, start.radius])
    working = np.argsort(sizes + distances_to_segment(points, x[:3], x[3:6]))[-WORKING:]
    best = start
    for _ in range(ROUNDS):
        x = _local_minimum(x, points[working], sizes[working])
        a, b = x[:3], x[3:6]
        found = Capsule(a, b, _needed_radius(a, b, points, sizes))
        length = found.length
        if length > 1e-9:
            found = _on_line(a, (b - a) / length, found.radius, points, sizes)
        best = min(best, found, key=lambda capsule: capsule.volume)
        outside = sizes + distances_to_segment(points, a, b) - x[6]
        if outside.max() < 1e-10:
            break
        working = np.union1d(working, np.argsort(outside)[-WORKING // 3 :])
    return best


def _local_minimum(x: FloatArray, points: FloatArray, sizes: FloatArray) -> FloatArray:
    def volume(x: FloatArray) -> tuple[float, FloatArray]:
        along, radius = x[3:6] - x[:3], x[6]
        length = float(np.sqrt(along @ along + 1e-20))
        side = np.pi * radius**2 * along / length
        value = np.pi * radius**2 * (length + 4.0 / 3.0 * radius)
        return float(value), np.array([*-side, *side, 2.0 * np.pi * radius * length + 4.0 * np.pi * radius**2])

    def room(x: FloatArray) -> FloatArray:
        return np.asarray(x[6] - sizes - distances_to_segment(points, x[:3], x[3:6]))

    def room_slope(x: FloatArray) -> FloatArray:
        away, share = _from_segment(points, x[:3], x[3:6])
        normal = away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]
        return np.hstack([normal * (1.0 - share)[:, None], normal * share[:, None], np.ones((len(points), 1))])

    found = minimize(
        volume,
        x,
        jac=True,
        method="SLSQP",
        constraints={"type": "ineq", "fun": room, "jac": room_slope},
        options={"maxiter": 100, "ftol": 1e-13},
    )
    return np.array(found.x) if np.all(np.isfinite(found.x)) else x


def _ball(points: FloatArray, sizes: FloatArray) -> Capsule:
    """The smallest ball around balls, a convex problem; growing working sets are not needed for its four variables."""

    def room(x: FloatArray) -> FloatArray:
        return np.asarray(x[3] - sizes - np.linalg.norm(points - x[:3], axis=1))

    def room_slope(x: FloatArray) -> FloatArray:
        away = points - x[:3]
        normal = away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]
        return np.hstack([normal, np.ones((len(points), 1))])

    found = minimize(
        lambda x: (x[3], np.array([0.0, 0.0, 0.0, 1.0])),
        np.array([0.0, 0.0, 0.0, 1.0]),
        jac=True,
        method="SLSQP",
        constraints={"type": "ineq", "fun": room, "jac": room_slope},
        options={"maxiter": 100, "ftol": 1e-14},
    )
    centre = np.array(found.x[:3])
    return Capsule(centre, centre.copy(), _needed_radius(centre, centre, points, sizes))


# The volume of each link of a compiled body, as the convex hull of balls in the link's own frame.
#
# Spheres, capsules, boxes and meshes are such hulls exactly. Cylinders and ellipsoids lie inside theirs, which is
# larger
# by 0.1 % and 0.5 %, so that what encloses the balls always encloses the geom.

RIM_POINTS = 64
BALL_POINTS = 800
MAX_LINKS = 200
"""A profile holds no more observers."""
_NAME = re.compile(r"[^\s/\\]{1,80}")  # as `schema.Name`


@dataclass(frozen=True)
class Lone:
    """The only geom of a link, a box or a cylinder with a name. pos (3,) m, quat wxyz, size: half sizes as MuJoCo's."""

    kind: str
    geom: str
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    size: tuple[float, ...]

    @property
    def volume(self) -> float:
        """m^3."""
        if self.kind == "box":
            return 8.0 * math.prod(self.size)
        return 2.0 * math.pi * self.size[0] ** 2 * self.size[1]

    def as_geom(self) -> dict[str, Any]:
        """The geom, as keywords of `mujoco.MjSpec`'s `add_geom`."""
        return {"type": _geom_type(self.kind.upper()), "pos": self.pos, "quat": self.quat, "size": self.size}


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """centres (k, 3) and radii (k,) of the balls, m; axes (j, 3, 3): orientations of the link's geoms, as columns.

    link, name: index and name. lone: its only geom, where that is a named box or cylinder.
    """

    link: int
    name: str
    centres: FloatArray
    radii: FloatArray
    axes: FloatArray
    lone: Lone | None

    def hull_volume(self) -> float:
        """Volume of the convex hull, m^3; 0 where it is flat."""
        surface = np.concatenate(
            [self.centres[self.radii == 0.0]]
            + [c + r * _BALL for c, r in zip(self.centres, self.radii, strict=True) if r > 0.0]
        )
        hull = _hull(surface)
        return 0.0 if hull is None else float(hull.volume)


def link_geometries(model: Any) -> tuple[tuple[LinkGeometry, ...], tuple[str, ...]]:
    """The geometry of every link that has some, in the model's order, and notes on what is left out.

    Raises InputError: no link has geometry, or more have than a profile holds observers.
    """
    found, notes = [], []
    for link in range(1, model.nbody):
        name = model.body(link).name
        geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == link]
        solid = [(geom, balls) for geom in geoms if (balls := _balls(model, geom)) is not None]
        if len(solid) < len(geoms):
            notes.append(f"{name or f'link {link}'}: planes and height fields are left out")
        if solid and not _usable(name):
            notes.append(f"link {link} has no name that a profile can hold, so no observer: {name!r}")
        elif solid:
            found.append(_geometry(model, link, name, solid))
    if not found:
        raise InputError(
            "no link has geometry", allowed="geoms (MJCF) or <collision> shapes (URDF)", next_step="Add simple shapes"
        )
    if len(found) > MAX_LINKS:
        raise InputError("too many links with geometry", found=str(len(found)), allowed=f"at most {MAX_LINKS}")
    return tuple(found), tuple(notes)


def _usable(name: str) -> bool:
    """Whether a profile can hold a name."""
    return _NAME.fullmatch(name) is not None


def _geometry(model: Any, link: int, name: str, solid: list[tuple[int, tuple[FloatArray, float]]]) -> LinkGeometry:
    centres, radii, axes = [], [], []
    for geom, (points, radius) in solid:
        turn = to_matrix(model.geom_quat[geom])
        centres.append(points @ turn.T + model.geom_pos[geom])
        radii.append(np.full(len(points), radius))
        axes.append(turn)
    return LinkGeometry(
        link=link,
        name=name,
        centres=np.concatenate(centres),
        radii=np.concatenate(radii),
        axes=np.array(axes),
        lone=_lone(model, solid[0][0]) if len(solid) == 1 else None,
    )


def _lone(model: Any, geom: int) -> Lone | None:
    import mujoco

    kinds = {int(mujoco.mjtGeom.mjGEOM_BOX): "box", int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder"}
    kind, name = kinds.get(int(model.geom_type[geom])), model.geom(geom).name
    if kind is None or not _usable(name):
        return None
    pos, quat, size = (tuple(map(float, row[geom])) for row in (model.geom_pos, model.geom_quat, model.geom_size))
    return Lone(kind, name, pos, quat, size)


def _balls(model: Any, geom: int) -> tuple[FloatArray, float] | None:
    """Centres (k, 3) in the geom's frame and their common radius, m; None for what has no volume."""
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
        hull = _hull(points)
        return (points if hull is None else points[hull.vertices]), 0.0
    return None


def directions() -> FloatArray:
    """Evenly spread unit vectors (n, 3)."""
    return _BALL


def solid_geoms(model: Any, link: int) -> list[int]:
    """The geoms of a link that have a volume: no planes, no height fields."""
    return [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == link and _balls(model, geom) is not None]


def _hull(points: FloatArray) -> Any:
    """Convex hull, or None where the points are flat."""
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def _sphere_points(count: int) -> FloatArray:
    """Evenly spread unit vectors (count, 3): a Fibonacci lattice."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


_BALL = _sphere_points(BALL_POINTS)
# Blown up until its faces touch the unit ball from outside: equations are n.x + offset = 0 with offset < 0.
_AROUND_BALL = _BALL / float(-ConvexHull(_BALL).equations[:, 3].max())


# A small box around a link's geometry: the best of the orientations that the geometry itself suggests.

MIN_HALF = 1e-4
"""[m] flat geometry gets this half size."""


@dataclass(frozen=True, eq=False)
class Box:
    """pos (3,) m and quat (4,) wxyz in the link's frame, half sizes (3,) m."""

    pos: FloatArray
    quat: FloatArray
    size: FloatArray

    @property
    def volume(self) -> float:
        """m^3."""
        return float(8.0 * np.prod(self.size))

    def support(self, directions: FloatArray) -> FloatArray:
        """How far (n,), m, it reaches along unit vectors (n, 3)."""
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        corners = self.pos + (signs * self.size) @ to_matrix(self.quat).T
        return np.asarray(np.max(directions @ corners.T, axis=1))

    def as_geom(self) -> dict[str, Any]:
        """The geom, as keywords of `mujoco.MjSpec`'s `add_geom`."""
        return {"type": _geom_type("BOX"), "pos": self.pos, "quat": self.quat, "size": self.size}


def enclosing_box(geometry: LinkGeometry) -> Box:
    """The smallest box along the link's own axes, its geoms' or the principal ones; in doubt the earlier of these."""
    centres = geometry.centres
    principal = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=True)[2].T
    best: Box | None = None
    for turn in (np.eye(3), *geometry.axes, principal):
        box = _box_along(turn if np.linalg.det(turn) > 0.0 else turn * [1.0, 1.0, -1.0], geometry)
        if best is None or box.volume < best.volume * (1.0 - 1e-6):
            best = box
    assert best is not None
    return best


def _box_along(turn: FloatArray, geometry: LinkGeometry) -> Box:
    local, radii = geometry.centres @ turn, geometry.radii[:, None]
    low, high = (local - radii).min(axis=0), (local + radii).max(axis=0)
    size = np.maximum((high - low) / 2.0, MIN_HALF)
    return Box(turn @ ((low + high) / 2.0), from_matrix(turn), size)
