"""The shapes of a body file as one triangle mesh per link, in the link's frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import rotate
from retarget.types import FloatArray

ROUND = 24
"""Corners of a circle."""
SHARP = float(np.radians(40.0))
"""Faces that are turned by more than this, rad, meet in an edge that looks sharp."""
THIN, GROUND = 0.002, 2.0
"""Least radius that is seen, and half the side of the piece of a half-space that is, m."""

PRIMITIVES = {
    "mjGEOM_BOX": ShapeKind.BOX,
    "mjGEOM_CYLINDER": ShapeKind.CYLINDER,
    "mjGEOM_CAPSULE": ShapeKind.CAPSULE,
}
"""Kinds of geoms in MuJoCo that are shapes of a scene, too."""


Mesh = tuple[FloatArray, NDArray[np.uint32]]
"""Vertices (v, 3) m and faces (f, 3)."""


def link_meshes(model: Any) -> dict[int, Mesh]:
    """Make the meshes of a compiled `mujoco.MjModel`, by the numbers of its bodies, in their frames. Planes and height
    fields are left out, and links that have nothing else.

    Where a link has shapes for looking at (which collide with nothing) and others, the others are left out.
    """
    found = {}
    for link in range(1, model.nbody):
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == link]
        meshes = {g: mesh for g in geoms if (mesh := _geom_mesh(model, g)) is not None}
        shown = [g for g in meshes if not model.geom_contype[g] and not model.geom_conaffinity[g]]
        if meshes:
            found[link] = _joined([meshes[g] for g in shown or meshes])
    return found


def shape_mesh(kind: int, size: Sequence[float]) -> Mesh:
    """A canonical shape of `scene_shapes`, in its own frame; of a half-space a piece of its surface."""
    from trimesh import creation

    x, y, z = (float(value) for value in size)
    if kind == ShapeKind.CAPSULE:
        return _plain(creation.capsule(height=2.0 * y, radius=max(x, THIN), count=[ROUND, ROUND]))
    if kind == ShapeKind.CYLINDER:
        return _creased(creation.cylinder(radius=x, height=2.0 * y, sections=ROUND))
    half = (x, y, z) if kind == ShapeKind.BOX else (GROUND, GROUND, THIN)
    return _creased(creation.box(extents=2.0 * np.array(half)))


def _joined(parts: list[Mesh]) -> Mesh:
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [triangles + np.uint32(start) for (_, triangles), start in zip(parts, first, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def _geom_mesh(model: Any, geom: int) -> Mesh | None:
    """A geom in the frame of its link; None for planes and height fields."""
    import mujoco
    from trimesh import Trimesh

    types = mujoco.mjtGeom
    size, kind = np.asarray(model.geom_size[geom]), types(model.geom_type[geom])
    if kind == types.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        shape = _creased(Trimesh(vertices, model.mesh_face[face : face + model.mesh_facenum[mesh]], process=False))
    elif kind == types.mjGEOM_ELLIPSOID:
        vertices, faces = shape_mesh(ShapeKind.CAPSULE, (1.0, 0.0, 0.0))
        shape = vertices * size, faces
    elif kind == types.mjGEOM_SPHERE:
        shape = shape_mesh(ShapeKind.CAPSULE, (size[0], 0.0, 0.0))
    elif kind.name in PRIMITIVES:
        shape = shape_mesh(PRIMITIVES[kind.name], size.tolist())
    else:
        return None
    turn = np.asarray(model.geom_quat[geom], dtype=np.float64)
    return rotate(turn, shape[0]) + model.geom_pos[geom], shape[1]


def _creased(mesh: Any) -> Mesh:
    """The triangles of a `trimesh.Trimesh`, with corners of their own along edges that are to look sharp."""
    from trimesh import graph

    return _plain(graph.smooth_shade(mesh, angle=SHARP))


def _plain(mesh: Any) -> Mesh:
    return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.uint32)
