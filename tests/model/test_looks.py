"""Shapes for looking at: they weigh nothing, touch nothing, stay near what collides, and show the side of a limb."""

import re

import mujoco
import numpy as np
import pytest

from followers import ROBOTS, shipped
from retarget import rotations
from retarget.model.body import Geom, load_body_text
from retarget.model.meshes import LEFT, MIDDLE, RIGHT, rgb, side_colours, solid_body
from retarget.model.robot import RobotBody
from retarget.types import FloatArray

FARTHEST = 0.015
"""What is drawn of a link may stand out by so much, m, of what collides of it or of the link that carries it: a bracket
turns about a servo of the other."""


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotBody:
    return shipped(request.param)


def test_looks_change_no_mass_and_touch_nothing(robot: RobotBody) -> None:
    """The file without them is the same body to the bit; a run of it in physics too."""
    text = robot.profile.body_path.read_text(encoding="utf-8")
    bare = re.sub(r" *<geom class=[^\n]*\n", "", text)
    assert text.count("<geom class=") > 60 > bare.count("<geom class=")
    with_looks, without = (mujoco.MjModel.from_xml_string(xml) for xml in (text, bare))
    assert (with_looks.ngeom > without.ngeom) and np.count_nonzero(with_looks.geom_contype) == without.ngeom
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_M0", "actuator_acc0"):
        np.testing.assert_array_equal(getattr(with_looks, name), getattr(without, name))
    first, second = (mujoco.MjData(model) for model in (with_looks, without))
    for data, model in ((first, with_looks), (second, without)):
        data.qpos[:] = robot.posture(robot.profile.postures.stand)
        data.ctrl[:] = 0.8
        for _ in range(300):  # arms and legs fold until they meet
            mujoco.mj_step(model, data)
    assert first.ncon == second.ncon
    np.testing.assert_array_equal(first.qpos, second.qpos)


def test_every_link_has_looks_of_its_side(robot: RobotBody) -> None:
    """Of each link of a limb something has the colour of its side, and no other link has that colour."""
    sides = side_colours(robot.body, {name: robot.frame(name).body for name in robot.profile.frames})
    links = robot.solid.links[robot.solid.owners]
    colours = {link: robot.solid.colours[links == link].tolist() for link in range(1, len(sides))}
    for link, side in enumerate(sides[1:], 1):
        assert any(geom.body == link and not geom.collides for geom in robot.body.geoms)
        shown = [one for one in (LEFT, RIGHT) if rgb(one) in colours[link]]
        assert shown == ([] if side == MIDDLE else [side]), robot.body.body_names[link]
    assert len({tuple(colour) for link in colours.values() for colour in link}) >= 6


def test_what_is_drawn_stays_near_what_collides(robot: RobotBody) -> None:
    """Pictures show no room where bodies have none, and none that they do not need."""
    body, solid = robot.body, robot.solid
    position, quat = body.solver_body().forward(body.qpos0)
    for owner, mesh in zip(solid.owners, solid.meshes, strict=True):
        link = int(solid.links[owner])
        points = mesh.placed(position[link], quat[link]).vertices
        near = [geom for geom in body.geoms if geom.collides and geom.body in (link, body.parent[link])]
        off = [outside(geom, points, position[geom.body], quat[geom.body]) for geom in near]
        assert np.min(off, axis=0).max() < FARTHEST, body.body_names[link]


def outside(geom: Geom, points: FloatArray, position: FloatArray, quat: FloatArray) -> FloatArray:
    """Distance, m, of points (n, 3) of the world from a box, capsule or sphere of a link there; below 0: inside."""
    turn = rotations.multiply(quat, geom.quat) * np.array([1.0, -1.0, -1.0, -1.0])
    local = np.abs(rotations.rotate(turn, points - position - rotations.rotate(quat, geom.position)))
    half, radius = {
        "box": (geom.size, 0.0),
        "capsule": (np.array([0.0, 0.0, geom.size[1]]), geom.size[0]),
        "sphere": (np.zeros(3), geom.size[0]),
    }[geom.kind]
    return np.asarray(np.linalg.norm(np.maximum(local - half, 0.0), axis=1) - radius)


LIMB = """<mujoco><worldbody><body name="base"><geom size=".1"/>
<body name="l_arm" pos="0 .5 0"><joint/><geom size=".1" rgba="1 0 0 1"/>{}</body></body></worldbody></mujoco>"""
LOOK = '<geom type="box" size=".1 .1 .1" contype="0" conaffinity="0" mass="0" {}/>'
RED = 'rgba="0.8 0.1 0.1 1"'


@pytest.mark.parametrize(
    ("looks", "expected"),
    [
        ("", [rgb(LEFT)]),
        (LOOK.format(""), [rgb(LEFT)]),
        (LOOK.format(RED), [rgb(LEFT)]),
        (LOOK.format(RED) + LOOK.format(""), [[0.8, 0.1, 0.1], rgb(LEFT)]),
    ],
)
def test_a_limb_has_colours_of_its_own_only_beside_that_of_its_side(looks: str, expected: list[list[float]]) -> None:
    solid = solid_body(load_body_text(LIMB.format(looks), source="test"))
    np.testing.assert_allclose(solid.colours[solid.owners == 1], expected)
