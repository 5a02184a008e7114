"""The shapes of a body file as one triangle mesh per link, in the link's frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import rotate
from retarget.types import FloatArray

ROUND = 24
"""Corners of a circle."""
SHARP = float(np.cos(np.radians(40.0)))
THIN, GROUND = 0.002, 2.0
"""Least radius that is seen, and half the side of the piece of a half-space that is, m."""


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """link: index of the body, 0 the world. vertices (v, 3) m in its frame; faces (f, 3)."""

    link: int
    vertices: FloatArray
    faces: NDArray[np.uint32]


def link_meshes(model: Any) -> tuple[LinkMesh, ...]:
    """Of a compiled `mujoco.MjModel`. Planes and height fields are left out, and links that have nothing else.

    Where a link has shapes for looking at (which collide with nothing) and others, the others are left out.
    """
    found = []
    for link in range(1, model.nbody):
        shapes = [g for g in range(model.ngeom) if model.geom_bodyid[g] == link and _shape(model, g) is not None]
        shown = [g for g in shapes if not model.geom_contype[g] and not model.geom_conaffinity[g]]
        parts = [part for g in shown or shapes if (part := _placed(model, g)) is not None]
        if parts:
            found.append(_joined(link, parts))
    return tuple(found)


Mesh = tuple[FloatArray, NDArray[np.uint32]]
"""Vertices (v, 3) m and faces (f, 3)."""


def shape_mesh(kind: int, size: Sequence[float], *, more: float = 0.0) -> Mesh:
    """A canonical shape of `scene_shapes`, in its own frame, larger by `more` m on all sides."""
    x, y, z = (float(value) for value in size)
    if kind == ShapeKind.CAPSULE:
        return _lathe(_rounded(max(x + more, THIN), y))
    if kind == ShapeKind.CYLINDER:
        return _lathe(np.array([[x + more, -y - more], [x + more, y + more]]))
    if kind == ShapeKind.BOX:
        return _box(np.array([x, y, z]) + more)
    return _box(np.array([GROUND, GROUND, THIN]))  # a half-space: its surface


def _placed(model: Any, geom: int) -> Mesh | None:
    mesh = _shape(model, geom)
    if mesh is None:
        return None
    turned = rotate(np.asarray(model.geom_quat[geom], dtype=np.float64), mesh[0])
    return turned + model.geom_pos[geom], mesh[1]


def _joined(link: int, parts: list[Mesh]) -> LinkMesh:
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [triangles + np.uint32(start) for (_, triangles), start in zip(parts, first, strict=True)]
    return LinkMesh(link, np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces))


def _shape(model: Any, geom: int) -> Mesh | None:
    """A shape in its own frame."""
    import mujoco

    size, kind = np.asarray(model.geom_size[geom], dtype=np.float64), mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _of_file(model, int(model.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _box(size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _lathe(np.array([[size[0], -size[1]], [size[0], size[1]]]))
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE):
        half = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        return _lathe(_rounded(size[0], half))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        vertices, faces = _lathe(_rounded(1.0, 0.0))
        return vertices * size, faces
    return None


def _box(half: FloatArray) -> Mesh:
    return _lathe(np.array([[1.0, -half[2]], [1.0, half[2]]]), corners=4, across=half[:2])


def _of_file(model: Any, mesh: int) -> Mesh:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return creased(
        np.array(model.mesh_vert[first : first + count], dtype=np.float64),
        np.array(model.mesh_face[face : face + faces], dtype=np.uint32),
    )


def creased(vertices: FloatArray, faces: NDArray[np.uint32]) -> Mesh:
    """The same mesh with edges that look sharp: a face that is turned away from the mean of those round its corner
    gets a corner of its own, which no shading smooths."""
    corners = vertices[faces]  # (f, 3, 3)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # as long as the face is large
    mean = np.zeros_like(vertices)
    for place in range(3):
        np.add.at(mean, faces[:, place], across)
    size = np.linalg.norm(across, axis=1)[:, None] * np.linalg.norm(mean, axis=1)[faces]
    sharp = np.einsum("fk,fpk->fp", across, mean[faces]) < SHARP * size
    own = faces.copy()
    own[sharp] = len(vertices) + np.arange(np.count_nonzero(sharp), dtype=np.uint32)
    return np.concatenate([vertices, corners[sharp]]), own


def _rounded(radius: float, half: float) -> FloatArray:
    """Radius and height of the rings of a capsule (r, 2)."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * (ROUND // 4) + 2)
    lift = np.where(np.arange(len(angle)) < len(angle) // 2, -half, half)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle) + lift])


def _lathe(rings: FloatArray, *, corners: int = ROUND, across: FloatArray | None = None) -> Mesh:
    """Rings of (radius, height) about z, closed below and above. across (2,): half sizes of a box instead."""
    angle = 2.0 * np.pi * (np.arange(corners) + (0.5 if across is not None else 0.0)) / corners
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    if across is not None:
        circle = np.sign(circle) * across
    sides = [np.column_stack([radius * circle, np.full(corners, height)]) for radius, height in rings]
    # The caps have rings of their own: their edge is sharp.
    vertices = np.concatenate([*sides, [[0.0, 0.0, rings[0, 1]], [0.0, 0.0, rings[-1, 1]]], sides[0], sides[-1]])
    here, count = np.arange(corners), len(rings)
    there = (here + 1) % corners
    faces = []
    for ring in range(count - 1):
        low, high = ring * corners, (ring + 1) * corners
        faces += [np.column_stack([here + low, there + low, there + high])]
        faces += [np.column_stack([here + low, there + high, here + high])]
    bottom, top, cap = count * corners, count * corners + 1, count * corners + 2
    faces += [np.column_stack([there + cap, here + cap, np.full(corners, bottom)])]
    faces += [np.column_stack([here + cap + corners, there + cap + corners, np.full(corners, top)])]
    mesh = vertices, np.concatenate(faces).astype(np.uint32)
    return mesh if across is None else creased(*mesh)
