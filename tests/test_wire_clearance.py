"""Collisions are found from goals alone; and where a forced fault would bring the robot, if there were no gate."""

import numpy as np
import pytest

from retarget.robot_body import RobotBody, load_robot
from sim.faults.always import violations
from sim.faults.bench import Bench
from sim.faults.rows import ROWS
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import Track
from sim.faults.wire_clearance import clearance_of, collisions, postures_of
from support.messages import shows


@pytest.fixture(scope="module")
def op3() -> RobotBody:
    return load_robot("op3")


def swung(robot: RobotBody, joint: str, last: float) -> list[Track]:
    """One joint goes from standing to an angle, rad; the others stand."""
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    times, found = np.linspace(0.0, 1.0, 50), []
    for servo, angle in zip(robot.joint_map.servos, stand.tolist(), strict=True):
        goal = last if servo.joint == joint else angle
        found.append(Track(servo, times, np.linspace(angle, goal, 50), servo.model.tick_rad))
    return found


def test_goals_become_postures(op3: RobotBody) -> None:
    ways = swung(op3, "l_hip_yaw", 0.1)
    late = Track(ways[0].servo, ways[0].times[10:], ways[0].angle[10:], ways[0].step)
    postures = postures_of(op3, [ways[1], late, *ways[2:]])
    np.testing.assert_allclose(postures[-1, op3.servo_columns], [track.angle[-1] for track in ways])
    assert postures.shape == (50, op3.body.nq)
    assert postures_of(op3, []).shape == (0, op3.body.nq)


@pytest.mark.parametrize(("angle", "told"), [(-0.15, ""), (-0.6, "mm in each other")])
def test_a_leg_in_the_other_is_found(op3: RobotBody, angle: float, told: str) -> None:
    found = collisions(op3, swung(op3, "l_hip_yaw", angle))
    assert told in " ".join(found) and bool(told) == bool(found)


def test_no_goals_collide_with_nothing(op3: RobotBody) -> None:
    assert collisions(op3, []) == []
    assert clearance_of(op3, np.zeros((0, op3.body.nq))).smallest is None


def test_without_a_gate_the_forced_stage_is_a_collision() -> None:
    row = next(one for one in ROWS if one.name == "clearance below margin")
    bench = Bench(FakeSender(), duration=2.2, gate=False)
    row.hurt(bench, 0.2)
    found = violations(bench, bench.run())
    shows(found)
