"""The volume of each link of a compiled body, as the convex hull of balls in the link's own frame.

Spheres, capsules, boxes and meshes are such hulls exactly. Cylinders and ellipsoids lie inside theirs, which is larger
by 0.1 % and 0.5 %, so that what encloses the balls always encloses the geom.
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from retarget.errors import InputError
from retarget.rotations import FloatArray, to_matrix

__all__ = ["LinkGeometry", "Lone", "directions", "link_geometries", "solid_geoms"]

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
