"""A mesh becomes a capsule or a box around it: no smaller, little larger, and where it was."""

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from retarget.fitting.geometry import link_geometries
from retarget.importing.simple_shapes import replace_meshes

HALF = np.array([0.06, 0.05, 0.008])
AT = np.array([0.1, -0.2, 0.05])


def corners() -> NDArray[np.float64]:
    signs = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    return np.asarray(np.array(signs) * HALF)


def long_thing() -> NDArray[np.float64]:
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = 0.01 * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.column_stack([ring, np.full(12, end)]) for end in (-0.1, 0.1)])


def spec_with(points: NDArray[np.float64]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.add_mesh(name="thing", uservert=points.ravel().tolist())
    body = spec.worldbody.add_body(name="limb")
    body.add_freejoint()
    body.add_geom(name="hull", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="thing", pos=AT)
    return spec


@pytest.mark.parametrize(
    ("points", "kind"),
    [(corners(), mujoco.mjtGeom.mjGEOM_BOX), (long_thing(), mujoco.mjtGeom.mjGEOM_CAPSULE)],
    ids=["a plate", "a rod"],
)
def test_one_shape_is_around_the_mesh(points: NDArray[np.float64], kind: int) -> None:
    spec = spec_with(points)
    model = spec.compile()
    assert replace_meshes(spec, model, link_geometries(model)[0]) == 1
    simple = spec.compile()
    assert simple.ngeom == 1 and simple.geom_type[0] == kind
    data, fromto = mujoco.MjData(simple), np.zeros(6)
    mujoco.mj_forward(simple, data)
    size = np.ptp(points, axis=0).prod()
    assert simple.geom_aabb[0, 3:].prod() * 8.0 < 3.0 * size, "it is not much larger"
    probe = mujoco.MjSpec.from_string(spec.to_xml())
    for number, point in enumerate(points):
        ball = probe.worldbody.add_body(name=f"p{number}", pos=point + AT)
        ball.add_geom(name=f"g{number}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1e-6, 0, 0])
    both = probe.compile()
    data = mujoco.MjData(both)
    mujoco.mj_forward(both, data)
    shell = both.geom("limb_shell").id
    for number in range(len(points)):
        gap = mujoco.mj_geomDistance(both, data, shell, both.geom(f"g{number}").id, 1.0, fromto)
        assert gap < 0.002, f"point {number} is {1e3 * gap:.1f} mm outside"
