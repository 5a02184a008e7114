"""The body beside a drafted profile: a copy, or MJCF that stands by itself and moves the same."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from messages import refuses, shows
from retarget.errors import InputError
from retarget.model.body import load_body
from retarget.setup.body_draft import BodyDraft, draft_body, facing_x, replace_meshes
from retarget.setup.robot_file import Relaxed, read_source
from retarget.setup.shape_fit import link_geometries
from unknown_robots import SHIPPED, humanoid, shipped_body

TWO = """<mujoco><asset>{asset}</asset><worldbody><geom type="plane" size="1 1 1"/><light pos="0 0 1"/>
  <body name="base link"><geom size="0.05"/>
  <body pos="0 0 0.1"><joint axis="0 1 0" range="-90 90"/>{geom}
  <body name="last" pos="0 0 0.1"><joint name="j/2" axis="0 1 0" {kind}/><geom type="capsule" size="0.02 0.05"/>
  </body></body></body></worldbody>{more}</mujoco>"""
BALL = '<geom size="0.02"/>'


def two(*, asset: str = "", geom: str = BALL, kind: str = "", more: str = "") -> str:
    return TWO.format(asset=asset, geom=geom, kind=kind, more=more)


def drafted(text: str, folder: Path, *, freeze: bool = False, no_meshes: bool = False) -> BodyDraft:
    path = folder / "body.xml"
    path.write_text(text, encoding="utf-8")
    return draft_body(read_source(path), Relaxed(freeze=freeze, no_meshes=no_meshes))


def alike(first: mujoco.MjModel, second: mujoco.MjModel) -> None:
    """The same masses, and the same places in a posture."""
    assert second.body_mass == pytest.approx(first.body_mass) and second.nq == first.nq
    data = [mujoco.MjData(first), mujoco.MjData(second)]
    for model, state in zip((first, second), data, strict=True):
        state.qpos[:] = model.qpos0 + 0.3 * np.sin(np.arange(model.nq))
        mujoco.mj_forward(model, state)
    assert data[1].xpos == pytest.approx(data[0].xpos, abs=1e-5)
    assert data[1].subtree_com == pytest.approx(data[0].subtree_com, abs=1e-5)


@pytest.mark.parametrize("robot", SHIPPED)
def test_what_stands_by_itself_is_copied(robot: str) -> None:
    body = draft_body(read_source(shipped_body(robot)), Relaxed())
    assert body.content == shipped_body(robot).read_bytes() and body.file == "body.xml" and not body.notes


def test_names_that_no_profile_can_hold(tmp_path: Path) -> None:
    body = drafted(two(), tmp_path)
    written = mujoco.MjModel.from_xml_string(body.content.decode())
    assert [written.body(i).name for i in range(1, 4)] == ["base_link", "link_2", "last"]
    assert [written.joint(i).name for i in range(2)] == ["joint_1", "j_2"]
    shows(body.notes[0], "'base link'", "base_link")
    assert written.nlight == 0 and b"plane" not in body.content
    alike(body.model, written)


def test_a_mesh_becomes_a_shape(tmp_path: Path) -> None:
    points = "0 0 0  0.1 0 0  0 0.1 0  0 0 0.1  0.1 0.1 0.1"
    body = drafted(two(asset=f'<mesh name="m" vertex="{points}"/>', geom='<geom type="mesh" mesh="m"/>'), tmp_path)
    written = mujoco.MjModel.from_xml_string(body.content.decode())
    assert body.model.nmesh == 1 and written.nmesh == 0 and written.ngeom == 3
    alike(body.model, written)


def test_a_mesh_without_volume_is_a_shell(tmp_path: Path) -> None:
    mesh = '<mesh name="m" vertex="0 0 0  0.1 0 0  0.1 0.1 0  0 0.1 0  0.05 0.05 1e-3" face="0 1 2  0 2 3"/>'
    text = two(asset=mesh, geom='<geom type="mesh" mesh="m"/>' + BALL)
    with refuses(ValueError):
        mujoco.MjModel.from_xml_string(text)
    assert drafted(text, tmp_path).model.nmesh == 1


def test_a_mesh_that_is_missing(tmp_path: Path) -> None:
    text = two(asset='<mesh name="m" file="gone.stl"/>', geom='<geom type="mesh" mesh="m"/>' + BALL)
    with refuses(InputError, "gone.stl", "--no-meshes"):
        drafted(text, tmp_path)
    body = drafted(text, tmp_path, no_meshes=True)
    assert body.model.nmesh == 0 and "gone.stl" in body.notes[0]


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ('type="slide"', ""),
        ('type="ball"', ""),
        ("", '<actuator><position joint="first"/></actuator>'),
        ("", '<equality><joint joint1="j/2" joint2="first"/></equality>'),
    ],
)
def test_joints_that_no_servo_of_their_own_turns(kind: str, more: str, tmp_path: Path) -> None:
    text = two(kind=kind, more=more).replace("<joint axis", '<joint name="first" axis')
    with refuses(InputError, "j/2", "--freeze"):
        drafted(text, tmp_path)
    body = drafted(text, tmp_path, freeze=True)
    assert body.model.njnt == 1 and body.model.joint(0).name == "first"
    shows(body.notes[0])


def test_a_refusal_of_mujoco_is_an_input_error(tmp_path: Path) -> None:
    with refuses(InputError, where="body.xml"):
        drafted(two(geom="<nonsense/>"), tmp_path)


def test_a_body_that_faces_y_is_turned(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    path.write_text(humanoid())
    body = draft_body(read_source(path), Relaxed())
    turned = facing_x(body, np.array([0.0, 1.0, 0.0]))
    written = mujoco.MjModel.from_xml_string(turned.content.decode())
    data = mujoco.MjData(written)
    mujoco.mj_kinematics(written, data)
    assert data.body("p1").xpos[1] == pytest.approx(0.05)  # its left is y now
    alike(turned.model, written)


def test_default_classes_may_name_materials_and_their_pictures(tmp_path: Path) -> None:
    """What is written has neither pictures nor their files."""
    (tmp_path / "paint.xml").write_text(
        '<mujoco><asset><texture name="t" type="2d" builtin="flat" width="4" height="4"/>'
        '<texture name="f" type="2d" file="gone.png"/><material name="m" texture="t" rgba="1 0 0 1"/></asset>'
        '<default><geom material="m"/></default></mujoco>'
    )
    text = two().replace("<mujoco>", '<mujoco><include file="paint.xml"/>')
    body = drafted(text.replace('<geom size="0.02"/>', '<geom size="0.02" material="m"/>'), tmp_path)
    written = mujoco.MjModel.from_xml_string(body.content.decode())
    assert written.ntex == 0 and b"gone.png" not in body.content
    alike(body.model, written)


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


SIZELESS = {
    "body.xml": (two(geom='<geom type="capsule" size="0.02 0"/>'), "body.xml:3"),
    "body.urdf": (humanoid().replace('<box size="0.08 0.08 0.08"/>', '<sphere radius="0"/>'), "body.urdf:6"),
}


@pytest.mark.parametrize("name", SIZELESS)
def test_a_shape_of_no_size_is_found_by_its_link_and_line(name: str, tmp_path: Path) -> None:
    text, where = SIZELESS[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    link = "link_2" if name == "body.xml" else "face"
    with refuses(InputError, where=where, found=link):
        draft_body(read_source(path), Relaxed())
    with refuses(InputError, where=where):
        load_body(path)
