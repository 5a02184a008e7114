"""Shapes around a link: its geometry as balls, the smallest capsule or a small box around them, and which is proposed.

    minimise   pi R^2 |b - a| + 4/3 pi R^3     over the segment a b and the radius R
    subject to |c_i - [a b]| + r_i <= R        for every ball (c_i, r_i)

The problem has several local minima: it is solved as a smooth program (SLSQP) from a ball and from the smallest
of the capsules along the axes that the geometry suggests. The radius is then taken exactly from the balls, so that
enclosure never depends on the optimiser.
"""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from retarget.errors import InputError, UsageError
from retarget.model.observers import ShapeRow
from retarget.model.scene_shapes import ShapeKind, canonical
from retarget.rotations import from_matrix, normalise, to_matrix
from retarget.schema.shapes import SolidShape
from retarget.types import FloatArray

MIN_RADIUS = 1e-4
"""[m] thinner geometry gets this radius, or this half size of a box."""
DIGITS = 5
"""Decimals of lengths in m: shapes are rounded outwards to them, so that what is written still encloses."""
ROUNDED = 1e-3
"""Share of a volume that rounding may change."""
STARTS = 4
"""Capsules from which the smallest one is searched."""


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
        """Volume, m^3."""
        return float(np.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius))

    @property
    def is_ball(self) -> bool:
        """Whether the segment is a point."""
        return self.length == 0.0

    @property
    def entry(self) -> dict[str, Any]:
        """The shape as a profile holds it, for `retarget.schema.profile_parts.Shape`."""
        if self.is_ball:
            return {"sphere": {"at": self.start.tolist(), "radius": self.radius}}
        return {"capsule": {"from": self.start.tolist(), "to": self.end.tolist(), "radius": self.radius}}

    def support(self, directions: FloatArray) -> FloatArray:
        """How far (n,), m, it reaches along unit vectors (n, 3)."""
        return np.asarray(np.max(directions @ np.stack([self.start, self.end]).T, axis=1) + self.radius)


def enclosing_capsule(centres: FloatArray, radii: FloatArray, *, axes: FloatArray | None = None) -> Capsule:
    """The smallest capsule around balls with centres (k, 3) and radii (k,), m, a ball where that is no larger.

    axes (j, 3): directions that are tried besides those of the balls' own spread.
    """
    middle = (centres.max(axis=0) + centres.min(axis=0)) / 2.0
    scale = float(np.max(np.linalg.norm(centres - middle, axis=1) + radii))
    if scale < MIN_RADIUS:
        return Capsule(middle, middle.copy(), MIN_RADIUS)
    points, sizes = (centres - middle) / scale, radii / scale
    outer = np.unique(np.argmax(DIRECTIONS[::4] @ points.T + sizes, axis=1))
    points, sizes = points[outer], sizes[outer]
    spread = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    given = np.zeros((0, 3)) if axes is None else axes
    along = sorted((_along(u, points, sizes) for u in (*spread, *np.eye(3), *given)), key=lambda found: found.volume)
    starts = [np.array([*start.start, *start.end, start.radius]) for start in along[:STARTS]]
    best = min((_local_minimum(start, points, sizes) for start in starts), key=lambda found: found.volume)
    middle_of_best = 0.5 * (best.start + best.end)
    ball = _local_minimum(np.array([*middle_of_best, best.radius + 0.5 * best.length]), points, sizes)
    if ball.volume <= best.volume * (1.0 + ROUNDED):
        best = ball
    return _around(best.start * scale + middle, best.end * scale + middle, centres, radii)


def distances_to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distances (k,) of points (k, 3) from a segment, m."""
    along = end - start
    length2 = float(along @ along)
    share = np.zeros(len(points)) if length2 == 0.0 else np.clip((points - start) @ along / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * along, axis=1))


def _around(start: FloatArray, end: FloatArray, centres: FloatArray, radii: FloatArray) -> Capsule:
    """The capsule on a segment that just holds the balls."""
    return Capsule(start, end, max(MIN_RADIUS, float(np.max(distances_to_segment(centres, start, end) + radii))))


def _along(u: FloatArray, points: FloatArray, sizes: FloatArray) -> Capsule:
    """A capsule along direction u (3,), its line through the middle of the balls' shadow."""
    height = points @ u
    shadow = points - height[:, None] * u
    middle = 0.5 * (shadow.max(axis=0) + shadow.min(axis=0))
    radius = float(np.max(np.linalg.norm(shadow - middle, axis=1) + sizes))
    low, high = float(np.min(height - sizes)) + radius, float(np.max(height + sizes)) - radius
    if low >= high:  # nearly a ball
        low, high = 0.5 * (low + high) - 0.05, 0.5 * (low + high) + 0.05
    return _around(middle + low * u, middle + high * u, points, sizes)


def _local_minimum(x: FloatArray, points: FloatArray, sizes: FloatArray) -> Capsule:
    """The smallest capsule near x: start, end and radius (7,), or centre and radius of a ball (4,)."""
    found = minimize(
        lambda x: Capsule(x[:3], x[-4:-1], x[-1]).volume,
        x,
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: x[-1] - sizes - distances_to_segment(points, x[:3], x[-4:-1])},
        options={"maxiter": 100, "ftol": 1e-12},
    )
    ends = [x, found.x] if np.all(np.isfinite(found.x)) else [x]
    return min((_around(x[:3], x[-4:-1], points, sizes) for x in ends), key=lambda found: found.volume)


# The volume of each link of a compiled body, as the convex hull of balls in the link's own frame.
#
# Spheres, capsules, boxes and meshes are such hulls exactly. Cylinders and ellipsoids lie inside theirs, which is
# larger by 0.1 % and 0.5 %, so that what encloses the balls always encloses the geom.

RIM_POINTS = 64
BALL_POINTS = 800
MAX_LINKS = 200
"""A profile holds no more observers."""
NAME = re.compile(r"[^\s/\\]{1,80}")
"""Names of links that a profile can hold, as `schema.Name`."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A box, or a cylinder along z, in the link's frame: pos (3,) m, quat (4,) wxyz, size (3,) m as MuJoCo's.

    kind: box or cylinder.
    geom: name of the link's own geom that it is, else empty.
    """

    kind: str
    pos: FloatArray
    quat: FloatArray
    size: FloatArray
    geom: str = ""

    @property
    def volume(self) -> float:
        """Volume, m^3."""
        if self.kind == "box":
            return float(8.0 * np.prod(self.size))
        return float(2.0 * np.pi * self.size[0] ** 2 * self.size[1])

    @property
    def entry(self) -> dict[str, Any]:
        """The shape as a profile holds it, for `retarget.schema.profile_parts.Shape`."""
        if self.geom:
            return {"geom": self.geom}
        turn = {} if abs(self.quat[0]) > 1.0 - 1e-12 else {"quat": self.quat.tolist()}
        return {"box": {"pos": self.pos.tolist(), **turn, "size": self.size.tolist()}}

    def support(self, directions: FloatArray) -> FloatArray:
        """How far (n,), m, a box reaches along unit vectors (n, 3)."""
        along = np.abs(directions @ to_matrix(self.quat)) @ self.size
        return np.asarray(directions @ self.pos + along)


def canonical_shape(shape: Capsule | Solid) -> ShapeRow:
    """Code, sizes (3,) m, position (3,) m and quat (4,) wxyz of a shape, as the solver and MuJoCo take them."""
    if isinstance(shape, Solid):
        return ShapeKind[shape.kind.upper()], tuple(shape.size.tolist()), shape.pos, shape.quat
    kind, sizes, pose = canonical(SolidShape.model_validate(shape.entry))
    return kind, sizes, np.array(pose.position), np.array(pose.quat)


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """centres (k, 3) and radii (k,) of the balls, m; axes (j, 3, 3): orientations of the link's geoms, as columns.

    link, name: index and name. geoms: numbers of its geoms with a volume. lone: the only one of these, where that is a
    named box or cylinder.
    """

    link: int
    name: str
    centres: FloatArray
    radii: FloatArray
    axes: FloatArray
    geoms: tuple[int, ...]
    lone: Solid | None

    def hull_volume(self) -> float:
        """Volume of the convex hull, m^3; 0 where it is flat."""
        hull = hull_of_balls(self.centres, self.radii, DIRECTIONS)
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
        if solid and not NAME.fullmatch(name):
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


def _geometry(model: Any, link: int, name: str, solid: list[tuple[int, tuple[FloatArray, float]]]) -> LinkGeometry:
    geoms = tuple(geom for geom, _ in solid)
    turns = [to_matrix(model.geom_quat[geom]) for geom in geoms]
    balls = zip(solid, turns, strict=True)
    return LinkGeometry(
        link=link,
        name=name,
        centres=np.concatenate([points @ turn.T + model.geom_pos[geom] for (geom, (points, _)), turn in balls]),
        radii=np.concatenate([np.full(len(points), radius) for _, (points, radius) in solid]),
        axes=np.array(turns),
        geoms=geoms,
        lone=_lone(model, geoms[0]) if len(geoms) == 1 else None,
    )


def _lone(model: Any, number: int) -> Solid | None:
    import mujoco

    geom = model.geom(number)
    kind = mujoco.mjtGeom(geom.type.item()).name.removeprefix("mjGEOM_").lower()
    if kind not in ("box", "cylinder") or not NAME.fullmatch(geom.name):
        return None
    return Solid(kind, geom.pos.copy(), geom.quat.copy(), geom.size.copy(), geom.name)


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
        hull = convex_hull(points)
        return (points if hull is None else points[hull.vertices]), 0.0
    return None


def convex_hull(points: FloatArray) -> ConvexHull | None:
    """Convex hull of points (k, 2) or (k, 3) m, or None where they are flat."""
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def hull_of_balls(centres: FloatArray, radii: FloatArray, ball: FloatArray) -> ConvexHull | None:
    """Convex hull of balls with centres (k, 3) and radii (k,), each as the unit vectors `ball` (n, 3); None: flat."""
    round_ones = [c + r * ball for c, r in zip(centres, radii, strict=True) if r > 0.0]
    return convex_hull(np.concatenate([centres[radii == 0.0], *round_ones]))


def _sphere_points(count: int) -> FloatArray:
    """Evenly spread unit vectors (count, 3): a Fibonacci lattice."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


DIRECTIONS = _sphere_points(BALL_POINTS)
"""Evenly spread unit vectors (n, 3)."""
# Blown up until its faces touch the unit ball from outside: equations are n.x + offset = 0 with offset < 0.
_AROUND_BALL = DIRECTIONS / float(-ConvexHull(DIRECTIONS).equations[:, 3].max())


# A small box around a link's geometry: the best of the orientations that the geometry itself suggests.


def enclosing_box(geometry: LinkGeometry) -> Solid:
    """The smallest box along the link's own axes, its geoms' or the principal ones; in doubt the earlier of these.

    It is rounded outwards to DIGITS.
    """
    centres = geometry.centres
    principal = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=True)[2].T
    boxes = [
        _box_along(turn if np.linalg.det(turn) > 0.0 else turn * [1.0, 1.0, -1.0], geometry)
        for turn in (np.eye(3), *geometry.axes, principal)
    ]
    smallest = min(box.volume for box in boxes)
    return next(box for box in boxes if box.volume <= smallest * (1.0 + ROUNDED))


def _box_along(turn: FloatArray, geometry: LinkGeometry) -> Solid:
    local, radii = geometry.centres @ turn, geometry.radii[:, None]
    middle = 0.5 * ((local - radii).min(axis=0) + (local + radii).max(axis=0))
    pos, quat = _round(turn @ middle), np.round(from_matrix(turn), 9)
    reach = np.abs((geometry.centres - pos) @ to_matrix(normalise(quat))) + radii
    size = [round_up(max(half, MIN_RADIUS)) for half in reach.max(axis=0).tolist()]
    return Solid("box", pos, quat, np.array(size))


# Proposed observers: a capsule per link, or a flat shape where a capsule is far too large.

FAR_TOO_LARGE = 3.0
"""A capsule of so many times the other shape's volume gives way to it."""
SOMEWHAT_LARGE = 2.0
"""A capsule of so many times its volume gives way if it also stands out of the geometry by more than the influence."""


@dataclass(frozen=True)
class Zones:
    """influence: distance at which the observers act, margin: distance that they keep, m."""

    influence: float
    margin: float

    def __post_init__(self) -> None:
        """Raise UsageError for zones that no profile may have."""
        if not (math.isfinite(self.influence) and self.influence > 0.0):
            raise UsageError(
                "no usable influence", where="--influence", found=f"{self.influence} m", allowed="more than 0 m"
            )
        if not 0.0 <= self.margin < self.influence:
            allowed = f"0 m to less than the influence, {self.influence} m"
            raise UsageError("no usable margin", where="--margin", found=f"{self.margin} m", allowed=allowed)


@dataclass(frozen=True, eq=False)
class Proposal:
    """An observer `name` on `link` (its index and its name).

    ratio: volume of the shape over that of the geometry's convex hull, None where that is flat. stands_out: how far
    the shape reaches beyond the hull, m. why: why it is no capsule, else empty.
    """

    link: int
    link_name: str
    name: str
    shape: Capsule | Solid
    ratio: float | None
    stands_out: float
    why: str


def propose(geometries: tuple[LinkGeometry, ...], zones: Zones) -> tuple[Proposal, ...]:
    """An observer for every link, named for it, without an ending `_link` where that leaves names different."""
    names = [geometry.name for geometry in geometries]
    short = [name.removesuffix("_link") or name for name in names]
    if len(set(short)) == len(short):
        names = short
    return tuple(_propose(geometry, name, zones) for geometry, name in zip(geometries, names, strict=True))


def flattened(proposal: Proposal, geometry: LinkGeometry, why: str) -> Proposal:
    """The same observer as a box or a cylinder, and why it is none of a capsule."""
    flat = geometry.lone or enclosing_box(geometry)
    return _proposal(geometry, proposal.name, flat, f"{flat.kind}: {why}")


def _propose(geometry: LinkGeometry, name: str, zones: Zones) -> Proposal:
    axes = geometry.axes.transpose(0, 2, 1).reshape(-1, 3)
    exact = enclosing_capsule(geometry.centres, geometry.radii, axes=axes)
    start, end = _round(exact.start), _round(exact.end)
    radius = _around(start, end, geometry.centres, geometry.radii).radius
    capsule = Capsule(start, end, round_up(radius))
    round_one = _proposal(geometry, name, capsule, "")
    flat = geometry.lone or enclosing_box(geometry)
    times, out = capsule.volume / flat.volume, round_one.stands_out
    if times < FAR_TOO_LARGE and not (times >= SOMEWHAT_LARGE and out > zones.influence):
        return round_one
    why = f"the smallest capsule is {times:.1f} times as large and stands out by {1e3 * out:.0f} mm"
    return flattened(round_one, geometry, why)


def _proposal(geometry: LinkGeometry, name: str, shape: Capsule | Solid, why: str) -> Proposal:
    """With the largest difference of the support functions: for nested convex bodies, how far the outer reaches out."""
    hull, stands_out = geometry.hull_volume(), 0.0
    if shape is not geometry.lone:
        inner = np.max(DIRECTIONS @ geometry.centres.T + geometry.radii, axis=1)
        stands_out = float(max(np.max(shape.support(DIRECTIONS) - inner), 0.0))
    ratio = shape.volume / hull if hull > 0.0 else None
    return Proposal(geometry.link, geometry.name, name, shape, ratio, stands_out, why)


def _round(values: FloatArray) -> FloatArray:
    return np.round(values, DIGITS) + 0.0  # no -0.0


def round_up(value: float) -> float:
    """Round to DIGITS decimals, never below; a value within 1e-12 above a decimal counts as that decimal."""
    return round(math.ceil(value * 10.0**DIGITS - 10.0 ** (DIGITS - 12)) / 10.0**DIGITS, DIGITS)
