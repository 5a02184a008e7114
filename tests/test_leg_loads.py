"""What legs carry in `stand`, in `rest` and on one leg, against the static balance of the body."""

import numpy as np
import pytest

from retarget.leg_loads import ENOUGH, heaviest_loads, one_leg_load
from retarget.robot_body import load_robot
from retarget.standing_strength import leg_joints

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
GRAVITY = 9.81


@pytest.mark.parametrize("name", ROBOTS)
def test_loads_are_told_beside_the_strength(name: str) -> None:
    robot = load_robot(name)
    stand, rest, alone = heaviest_loads(robot)
    assert [load.posture for load in (stand, rest, alone)] == ["in stand", "in rest", "on one leg"]
    assert 0.0 < stand.torque < 0.3 * stand.stall and stand.joint in leg_joints(robot)
    assert 0.0 < rest.torque < 0.6 * rest.stall
    assert alone.share > stand.share
    assert str(rest).endswith(f"N m, {100.0 * rest.torque / rest.stall:.0f}% of its stall torque")


@pytest.mark.parametrize("name", ["op3", "toddlerbot", "wolfgang"])
def test_the_hip_carries_all_but_its_leg_beside_itself(name: str) -> None:
    """Its roll joint: the weight of all that it holds up, as far beside it as the middle of the body nearly is."""
    robot = load_robot(name)
    load = one_leg_load(robot)
    assert "hip_roll" in load.joint.lower() or "HipRoll" in load.joint
    body = robot.body
    place = body.solver_body().points(
        body.qpos0[None], [body.joint_body[body.joint_index(load.joint)]], np.zeros((1, 3))
    )
    aside = abs(float(place[0, 0, 1]))
    weight = GRAVITY * body.total_mass
    assert 0.6 * weight * aside < load.torque < 1.5 * weight * aside


def test_toddlerbot_alone_is_too_weak_for_one_leg() -> None:
    assert {name: one_leg_load(load_robot(name)).share > ENOUGH for name in ROBOTS} == {
        "op3": False,
        "poppy": False,
        "toddlerbot": True,
        "wolfgang": False,
    }
