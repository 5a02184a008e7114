"""Meshes of a body as capsules and boxes: what is left of them in a body file that stands by itself."""

from typing import Any

from retarget.fitting.box import Box
from retarget.fitting.capsule import Capsule
from retarget.fitting.geometry import LinkGeometry, Lone
from retarget.fitting.proposals import Zones, propose

__all__ = ["replace_meshes"]

ZONES = Zones(influence=0.03, margin=0.005)


def replace_meshes(spec: Any, model: Any, geometries: tuple[LinkGeometry, ...]) -> int:
    """Put one shape around the geometry of each link that has a mesh, in place of all its geoms; how many."""
    import mujoco

    mesh = mujoco.mjtGeom.mjGEOM_MESH
    meshes = [geom for geom in range(model.ngeom) if model.geom_type[geom] == mesh]
    links = {model.body(int(model.geom_bodyid[geom])).name for geom in meshes}
    count = 0
    for proposal in propose(tuple(one for one in geometries if one.name in links), ZONES):
        body = spec.body(proposal.link_name)
        for geom in list(body.geoms):
            spec.delete(geom)
        _add(body, proposal.shape, f"{proposal.link_name}_shell")
        count += 1
    for geom in list(spec.geoms):  # of links that no profile can name
        if geom.type == mesh:
            spec.delete(geom)
    return count


def _add(body: Any, shape: Capsule | Box | Lone, name: str) -> None:
    import mujoco

    kinds = mujoco.mjtGeom
    if isinstance(shape, Capsule) and shape.is_ball:
        body.add_geom(name=name, type=kinds.mjGEOM_SPHERE, size=[shape.radius, 0, 0], pos=shape.start)
    elif isinstance(shape, Capsule):
        ends = [*map(float, shape.start), *map(float, shape.end)]
        body.add_geom(name=name, type=kinds.mjGEOM_CAPSULE, size=[shape.radius, 0, 0], fromto=ends)
    elif isinstance(shape, Box):
        body.add_geom(name=name, type=kinds.mjGEOM_BOX, size=shape.size, pos=shape.pos, quat=shape.quat)
    else:
        kind = kinds.mjGEOM_BOX if shape.kind == "box" else kinds.mjGEOM_CYLINDER
        body.add_geom(name=name, type=kind, size=shape.size, pos=shape.pos, quat=shape.quat)
