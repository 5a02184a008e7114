"""Tipping: tilt of the soles from IMU and encoders, and which motions about an edge are falls."""

from collections.abc import Iterable
from dataclasses import replace
from math import cos, degrees, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import op3
from hardware.imu import GRAVITY, ImuSample
from retarget import rotations
from retarget.ik.base_pose import plant_root
from retarget.ik.support_polygon import plant
from retarget.model.robot import RobotBody
from retarget.safety.tipping import FALLS_S, STANDS_S, TIPS, UNKNOWN_S, TipState, TipWatch
from retarget.types import FloatArray

DT = 0.008


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return op3()


def planted(robot: RobotBody, joints: FloatArray | None = None) -> FloatArray:
    """A posture (nq,) on flat soles."""
    q = plant(robot, robot.profile.postures.stand).q
    if joints is not None:
        moved = q.copy()
        moved[robot.servo_columns] = joints
        plant_root(robot, q, moved)
        return moved
    return q


def sample_of(robot: RobotBody, q: FloatArray, turn: FloatArray, speed: FloatArray) -> ImuSample:
    """What the IMU measures when the whole robot is turned by `turn`, wxyz, and turns on by `speed`, rad/s; world."""
    assert robot.profile.imu is not None
    link = robot.kinematics.orientations(q[None], [robot.body.body_index(robot.profile.imu.link)])[0, 0]
    orientation = rotations.multiply(turn, link)
    return ImuSample(
        0.0, orientation, rotations.rotate(rotations.conjugate(orientation), speed), np.zeros(3), True, 0.0
    )


def looked(watch: TipWatch, samples: Iterable[ImuSample], joints: FloatArray) -> TipState:
    for sample in samples:
        balance = watch.look(sample, joints)
    return balance


@settings(max_examples=30)
@given(st.integers(0, 2**31), st.floats(0.0, 2.0 * pi))
def test_what_bends_over_flat_soles_does_not_tip(seed: int, heading: float) -> None:
    """Any posture, whatever its trunk's tilt, and whichever way the robot faces."""
    robot = op3()
    servos, draw = robot.joint_map, np.random.default_rng(seed)
    joints = draw.uniform(servos.lower, servos.upper)
    yaw = rotations.from_axis_angle([0.0, 0.0, 1.0], heading)
    watch = TipWatch(robot, dt=DT)
    sample = sample_of(robot, planted(robot, joints), yaw, np.zeros(3))
    assert looked(watch, [sample] * 20, joints) is TipState.STANDS and watch.tilt < 1e-6


@settings(max_examples=30)
@given(st.floats(0.0, 2.0 * pi), st.floats(0.0, 0.5))
def test_the_tilt_is_that_of_the_soles(way: float, tilt: float) -> None:
    robot = op3()
    watch, q = TipWatch(robot, dt=DT), planted(robot)
    turn = rotations.from_axis_angle([cos(way), sin(way), 0.0], tilt)
    watch.look(sample_of(robot, q, turn, np.zeros(3)), q[robot.servo_columns])
    assert watch.tilt == pytest.approx(tilt, abs=1e-6)


def test_one_flat_sole_carries(robot: RobotBody) -> None:
    q = planted(robot)
    joints = q[robot.servo_columns].copy()
    joints[robot.joint_map.joints.index("l_ank_roll")] += 0.3
    watch = TipWatch(robot, dt=DT)
    assert watch.look(sample_of(robot, q, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)), joints) is TipState.STANDS
    assert watch.tilt < 1e-6


def test_a_robot_that_tips_is_followed_again_once_it_has_stood(robot: RobotBody) -> None:
    q = planted(robot)
    joints, still = q[robot.servo_columns], np.zeros(3)
    flat = sample_of(robot, q, np.array([1.0, 0.0, 0.0, 0.0]), still)
    tilted = sample_of(robot, q, rotations.from_axis_angle([0.0, 1.0, 0.0], 1.2 * TIPS), still)
    watch = TipWatch(robot, dt=DT)
    assert looked(watch, [flat], joints) is TipState.STANDS and not watch.hold_reason
    assert looked(watch, [tilted] * 40, joints) is TipState.TIPS and "tips" in watch.hold_reason and not watch.fall
    ticks = round(STANDS_S / DT)
    assert looked(watch, [flat] * (ticks - 2), joints) is TipState.TIPS
    assert looked(watch, [flat] * 4, joints) is TipState.STANDS


def test_nothing_is_known_without_the_imu(robot: RobotBody) -> None:
    q = planted(robot)
    joints = q[robot.servo_columns]
    flat = sample_of(robot, q, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    lost = replace(flat, valid=False)
    watch, ticks = TipWatch(robot, dt=DT), round(UNKNOWN_S / DT)
    assert looked(watch, [flat, *[lost] * (ticks - 1), flat, *[lost] * (ticks - 1)], joints) is TipState.STANDS
    assert looked(watch, [lost] * 3, joints) is TipState.UNKNOWN and "IMU" in watch.hold_reason


def pendulum(robot: RobotBody, q: FloatArray, way: float) -> tuple[FloatArray, float, float]:
    """The robot as a rigid body about the edge of its soles that is farthest in direction `way`: the axis (3,) of the
    turn, and its mass about the edge: metres beyond it (negative: inside), and above."""
    ahead = np.array([cos(way), sin(way), 0.0])
    links, local = robot.sole_corners
    corners = robot.kinematics.points(q[None], links, local)[0]
    mass = robot.kinematics.centre_of_mass(q[None])[0]
    edge = corners[int((corners @ ahead).argmax())]
    return np.cross([0.0, 0.0, 1.0], ahead), float((mass - edge) @ ahead), float(mass[2] - edge[2])


@settings(max_examples=60)
@given(st.floats(0.0, 2.0 * pi), st.floats(0.1, 0.6), st.floats(-1.5, 3.0))
def test_falls_are_those_of_a_pendulum(way: float, tilt: float, rate: float) -> None:
    """A rigid robot at an angle and a rate goes over the edge, or comes back, by its energy (a point mass); what is
    close to neither is not judged."""
    robot = op3()
    q = planted(robot)
    axis, behind, height = pendulum(robot, q, way)
    radius = sqrt(behind * behind + height * height)
    left = np.arctan2(-behind, height) - tilt  # rad to the top
    needed = 2.0 * GRAVITY / radius * (1.0 - cos(left))  # (rad/s)^2
    if left <= 0.0:
        needed = -needed  # beyond the top it comes back only if it is fast enough backwards
    over = rate * abs(rate) - needed
    if abs(over) < 0.5 + 0.3 * abs(needed):
        return
    turn = rotations.from_axis_angle(axis, tilt)
    sample = sample_of(robot, q, turn, rate * axis)
    watch = TipWatch(robot, dt=DT)
    found = looked(watch, [sample] * (round(FALLS_S / DT) + 3), q[robot.servo_columns])
    assert (found is TipState.FALLS) == (over > 0.0), (degrees(tilt), rate, over)


def test_a_fall_stays_one_and_no_single_sample_makes_it(robot: RobotBody) -> None:
    q = planted(robot)
    joints = q[robot.servo_columns]
    falling = sample_of(robot, q, rotations.from_axis_angle([0.0, 1.0, 0.0], radians(30.0)), np.array([0.0, 2.0, 0.0]))
    flat = sample_of(robot, q, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    watch = TipWatch(robot, dt=DT)
    assert looked(watch, [flat, falling, flat, falling, flat], joints) is not TipState.FALLS
    assert looked(watch, [falling] * 4, joints) is TipState.FALLS and "30 degrees" in watch.fall
    assert looked(watch, [flat] * 200, joints) is TipState.FALLS
