"""Our observers as collision shapes for peers, one for one: URDF text, and geoms of a MuJoCo model."""

from __future__ import annotations

from collections import defaultdict
from typing import Any
from xml.sax.saxutils import quoteattr

import mujoco

from benchmarks.bodies import Floats
from benchmarks.observed_body import Watched
from benchmarks.urdf import place, text
from retarget.model.scene_shapes import ShapeKind

THIN = 1e-7
"""Radius of a line, m: peers have no shape without one."""
PREFIX = "observer_"
"""Before an observer's name."""


def urdf_shapes(watched: Watched) -> dict[str, str]:
    """XML of the collision shapes on each link, by the link's name. Pinocchio calls them LINK_0, LINK_1, ..."""
    seen, texts = watched.observers, defaultdict(list)
    for k, name in enumerate(seen.names):
        link = watched.body.model.body_names[seen.links[k]]
        label = quoteattr(PREFIX + name)
        shape = _urdf_shape(ShapeKind(seen.kinds[k]), seen.sizes[k])
        origin = place(seen.positions[k], seen.quats[k])
        texts[link].append(f"<collision name={label}>{origin}<geometry>{shape}</geometry></collision>")
        if _is_capsule(seen.kinds[k], seen.sizes[k]):  # how Pinocchio distinguishes a capsule from a cylinder
            texts[link].append(f"<collision_checking><capsule name={label}/></collision_checking>")
    return {link: "".join(parts) for link, parts in texts.items()}


def urdf_names(watched: Watched) -> list[str]:
    """What Pinocchio calls the shape of each observer."""
    count: dict[str, int] = defaultdict(int)
    names = []
    for index in watched.observers.links:
        link = watched.body.model.body_names[index]
        names.append(f"{link}_{count[link]}")
        count[link] += 1
    return names


def mujoco_model(watched: Watched) -> Any:
    """The peers' MuJoCo model with a geom `observer_NAME` for every observer, and no other geom."""
    body, seen = watched.body, watched.observers
    spec = body.reduced_spec()
    for geom in list(spec.geoms):
        spec.delete(geom)
    for k, name in enumerate(seen.names):
        geom = spec.body(body.model.body_names[seen.links[k]]).add_geom(name=PREFIX + name)
        geom.type, geom.size = _mujoco_shape(ShapeKind(seen.kinds[k]), seen.sizes[k])
        geom.pos, geom.quat, geom.mass = seen.positions[k], seen.quats[k], 0.0
        geom.contype, geom.conaffinity = 1, 1
    return spec.compile()


def _is_capsule(kind: int, size: Floats) -> bool:
    return kind == ShapeKind.CAPSULE and bool(size[1] > 0.0)


def _urdf_shape(kind: ShapeKind, size: Floats) -> str:
    if kind == ShapeKind.BOX:
        return f"<box size='{text(2.0 * size)}'/>"
    radius = max(float(size[0]), THIN)
    if kind == ShapeKind.CAPSULE and not _is_capsule(kind, size):
        return f"<sphere radius='{radius:.17g}'/>"
    return f"<cylinder radius='{radius:.17g}' length='{2.0 * size[1]:.17g}'/>"


def _mujoco_shape(kind: ShapeKind, size: Floats) -> tuple[Any, list[float]]:
    if kind == ShapeKind.BOX:
        return mujoco.mjtGeom.mjGEOM_BOX, size.tolist()
    radius = max(float(size[0]), THIN)
    if kind == ShapeKind.CAPSULE and not _is_capsule(kind, size):
        return mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0.0, 0.0]
    kinds = {ShapeKind.CAPSULE: mujoco.mjtGeom.mjGEOM_CAPSULE, ShapeKind.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER}
    return kinds[kind], [radius, float(size[1]), 0.0]
