"""From where a robot was found to where following begins: no joint beyond its share of speed."""

from dataclasses import replace

import numpy as np

from followers import DT, follower, op3, performer, postures
from hardware.errors import RetargetError
from retarget.way_there import require_finite, way_there
from support.messages import refuses


def test_no_joint_exceeds_its_share_and_it_ends_where_following_begins() -> None:
    robot, s = op3(), np.linspace(0.0, 1.0, 60)[:, None]
    there = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    present = there - 0.2
    arrival = there + (s**3 * (10.0 - 15.0 * s + 6.0 * s**2)) * np.linspace(-0.6, 0.6, 20)
    way = way_there(robot, present, [there, *arrival], dt=DT)
    got = [present, *(way.next() for _ in range(way.ticks))]
    steps = np.diff(got, axis=0)
    most = robot.profile.safety.speed_caps.approach * robot.joint_map.max_velocity * DT
    assert way.done and np.array_equal(got[-1], arrival[-1])
    assert (np.abs(steps) <= most * (1.0 + 1e-6)).all() and np.abs(steps / most).max() > 0.9
    assert (np.abs(np.diff(steps, axis=0)) <= robot.joint_map.max_acceleration * DT**2).all()


def test_who_is_there_already_has_no_way() -> None:
    robot = op3()
    there = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    assert way_there(robot, there, [there], dt=DT).done


def test_a_way_that_nobody_knows_is_refused() -> None:
    posture = follower().start(postures(performer())[0])
    require_finite(posture, posture)
    unknown = replace(posture, q=np.full_like(posture.q, np.nan))
    with refuses(RetargetError, 1, 2):
        require_finite(posture, unknown)
