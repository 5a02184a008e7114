"""The shapes of a body file as one triangle mesh per link, in the link's frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import to_matrix

ROUND = 24
"""Corners of a circle."""
SHARP = float(np.radians(40.0))
"""Faces that are turned by more than this, rad, meet in an edge that looks sharp."""
THIN, GROUND = 0.002, 2.0
"""Least radius that is seen, and half the side of the piece of a half-space that is, m."""

PRIMITIVES = {
    "mjGEOM_SPHERE": ShapeKind.CAPSULE,
    "mjGEOM_CAPSULE": ShapeKind.CAPSULE,
    "mjGEOM_CYLINDER": ShapeKind.CYLINDER,
    "mjGEOM_BOX": ShapeKind.BOX,
}
"""Kinds of geoms in MuJoCo that are shapes of a scene, too, with the same sizes."""


Mesh = Any
"""A `trimesh.Trimesh`, m, with corners of their own along edges that are to look sharp."""


def link_meshes(model: Any) -> dict[int, Mesh]:
    """Make the meshes of a compiled `mujoco.MjModel`, by the numbers of its bodies, in their frames. Planes and height
    fields are left out, and links that have nothing else.

    Where a link has shapes for looking at (which collide with nothing) and others, the others are left out.
    """
    from trimesh import util

    found = {}
    for link in range(1, model.nbody):
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == link]
        meshes = {g: mesh for g in geoms if (mesh := _geom_mesh(model, g)) is not None}
        shown = [g for g in meshes if not model.geom_contype[g] and not model.geom_conaffinity[g]]
        if meshes:
            found[link] = util.concatenate([meshes[g] for g in shown or meshes])
    return found


def shape_mesh(kind: int, size: Sequence[float]) -> Mesh:
    """A canonical shape of `scene_shapes`, in its own frame; of a half-space a piece of its surface."""
    from trimesh import creation

    x, y, z = (float(value) for value in size)
    if kind == ShapeKind.CAPSULE:
        return creation.capsule(height=2.0 * y, radius=max(x, THIN), count=[ROUND, ROUND])
    if kind == ShapeKind.CYLINDER:
        return _creased(creation.cylinder(radius=x, height=2.0 * y, sections=ROUND))
    half = (x, y, z) if kind == ShapeKind.BOX else (GROUND, GROUND, THIN)
    return _creased(creation.box(extents=2.0 * np.array(half)))


def _geom_mesh(model: Any, geom: int) -> Mesh | None:
    """A geom in the frame of its link; None for planes and height fields."""
    import mujoco
    from trimesh import Trimesh

    types = mujoco.mjtGeom
    size, kind = np.asarray(model.geom_size[geom]), types(model.geom_type[geom])
    if kind == types.mjGEOM_MESH:
        number = model.geom_dataid[geom]
        first, face = model.mesh_vertadr[number], model.mesh_faceadr[number]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[number]]
        mesh = _creased(Trimesh(vertices, model.mesh_face[face : face + model.mesh_facenum[number]], process=False))
    elif kind == types.mjGEOM_ELLIPSOID:
        mesh = shape_mesh(ShapeKind.CAPSULE, (1.0, 0.0, 0.0)).apply_scale(size)
    elif kind.name in PRIMITIVES:
        mesh = shape_mesh(PRIMITIVES[kind.name], size.tolist())
    else:
        return None
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = to_matrix(np.asarray(model.geom_quat[geom], dtype=np.float64)), model.geom_pos[geom]
    return mesh.apply_transform(place)


def _creased(mesh: Mesh) -> Mesh:
    from trimesh import graph

    return graph.smooth_shade(mesh, angle=SHARP)
