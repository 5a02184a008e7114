"""Tipping: tilt of the soles from IMU and encoders, and which motions about an edge are falls."""

from collections.abc import Iterable
from dataclasses import replace
from math import cos, degrees, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from followers import op3
from hardware.imu import STANDARD_GRAVITY, ImuSample
from retarget import rotations
from retarget.ik.support_polygon import plant
from retarget.model.robot import RobotBody, plant_root
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


STILL, UPRIGHT = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


class Watched:
    """A watch that is handed measurements, a tick apart. It begins on a level floor."""

    def __init__(self, robot: RobotBody, joints: FloatArray | None = None, floor: FloatArray = UPRIGHT) -> None:
        self.watch, self.time = TipWatch(robot, dt=DT), 0.0
        q = planted(robot, joints)
        self.joints = q[robot.servo_columns]
        self.flat = sample_of(robot, q, floor, STILL)
        self.look([self.flat])

    def look(self, samples: Iterable[ImuSample], joints: FloatArray | None = None) -> TipState:
        for sample in samples:
            self.time += DT
            state = self.watch.look(replace(sample, time=self.time), self.joints if joints is None else joints)
        return state


@settings(max_examples=30)
@given(st.integers(0, 2**31), st.floats(0.0, 2.0 * pi))
def test_what_bends_over_flat_soles_does_not_tip(seed: int, heading: float) -> None:
    """Any posture, whatever its trunk's tilt, and whichever way the robot faces."""
    robot = op3()
    servos, draw = robot.joint_map, np.random.default_rng(seed)
    joints = draw.uniform(servos.lower, servos.upper)
    yaw = rotations.from_axis_angle([0.0, 0.0, 1.0], heading)
    watched, q = Watched(robot), planted(robot, joints)
    links, corners = robot.sole_corners
    assume(robot.kinematics.points(q[None], links, corners)[0, :, 2].min() > -1e-6)  # else it stands on the other foot
    sample = sample_of(robot, q, yaw, STILL)
    assert watched.look([sample] * 20, joints) is TipState.STANDS and watched.watch.tilt < 1e-6


@settings(max_examples=30)
@given(st.floats(0.0, 2.0 * pi), st.floats(0.0, 0.5))
def test_the_tilt_is_that_of_the_soles(way: float, tilt: float) -> None:
    robot = op3()
    watched = Watched(robot)
    turn = rotations.from_axis_angle([cos(way), sin(way), 0.0], tilt)
    watched.look([sample_of(robot, planted(robot), turn, STILL)])
    assert watched.watch.tilt == pytest.approx(tilt, abs=1e-6)


def bow(robot: RobotBody, watched: Watched, lean: FloatArray, *, speed: float, ticks: int) -> set[TipState]:
    """The states while the hips bow the trunk at a speed, rad/s, over soles that lie turned by `lean`, wxyz."""
    names, begin, states = robot.joint_map.joints, watched.joints, set[TipState]()
    bowed = sample_of(robot, planted(robot), lean, STILL)
    for k in range(1, ticks):
        joints = begin.copy()
        joints[names.index("l_hip_pitch")] -= speed * DT * k
        joints[names.index("r_hip_pitch")] += speed * DT * k
        now = sample_of(robot, planted(robot, joints), lean, STILL)
        assert now.orientation is not None and bowed.orientation is not None
        turned = rotations.log(rotations.multiply(rotations.conjugate(bowed.orientation), now.orientation)) / DT
        states.add(watched.look([replace(now, angular_velocity=turned)], joints))
        bowed = now
    return states


@pytest.mark.parametrize("slope", [0.0, 5.5, 8.0])
@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_robot_that_bows_on_a_slope_does_not_tip(robot: RobotBody, slope: float, speed: float) -> None:
    """Its trunk turns and its mass moves, over soles that lie on the floor."""
    floor = rotations.from_axis_angle([0.0, 1.0, 0.0], radians(slope))
    watched = Watched(robot, floor=floor)
    assert bow(robot, watched, floor, speed=speed, ticks=40) == {TipState.STANDS}


def test_bowing_makes_no_fall_of_a_robot_that_leans_with_its_soles(robot: RobotBody) -> None:
    """Soles 5.5 degrees off the floor, which do not turn: it tips, and only where the mass goes counts."""
    watched = Watched(robot)
    lean = rotations.from_axis_angle([0.0, 1.0, 0.0], radians(5.5))
    watched.look([sample_of(robot, planted(robot), lean, STILL)] * 5)
    assert bow(robot, watched, lean, speed=1.2, ticks=12) == {TipState.TIPS}


def test_the_lower_sole_carries(robot: RobotBody) -> None:
    """A foot that is lifted may turn as it likes; the one below it may not."""
    watched, names = Watched(robot), robot.joint_map.joints
    lifted = watched.joints.copy()
    for joint, angle in (("l_hip_pitch", -0.5), ("l_knee", 1.0), ("l_ank_pitch", 0.5), ("l_ank_roll", 0.3)):
        lifted[names.index(joint)] += angle
    assert watched.look([watched.flat] * 20, lifted) is TipState.STANDS and watched.watch.tilt < 1e-6
    tilted = sample_of(robot, planted(robot), rotations.from_axis_angle([1.0, 0.0, 0.0], -0.2), STILL)
    assert watched.look([tilted] * 5, lifted) is not TipState.STANDS
    assert watched.watch.tilt == pytest.approx(0.2, abs=1e-6)


def test_a_robot_that_tips_is_followed_again_once_it_has_stood(robot: RobotBody) -> None:
    watched = Watched(robot)
    flat, watch = watched.flat, watched.watch
    tilted = sample_of(robot, planted(robot), rotations.from_axis_angle([0.0, 1.0, 0.0], 1.2 * TIPS), STILL)
    assert watched.look([flat]) is TipState.STANDS and not watch.hold_reason
    assert watched.look([tilted] * 40) is TipState.TIPS and "tips" in watch.hold_reason and not watch.fall
    ticks = round(STANDS_S / DT)
    assert watched.look([flat] * (ticks - 2)) is TipState.TIPS
    assert watched.look([flat] * 4) is TipState.STANDS


@pytest.mark.parametrize("what", [{"valid": False}, {"orientation": None}, {"orientation": np.full(4, np.nan)}])
def test_nothing_is_known_without_the_imu(robot: RobotBody, what: dict[str, Any]) -> None:
    watched, ticks = Watched(robot), round(UNKNOWN_S / DT)
    flat, lost = watched.flat, replace(watched.flat, **what)
    assert watched.look([flat, *[lost] * (ticks - 1), flat, *[lost] * (ticks - 1)]) is TipState.STANDS
    assert watched.look([lost] * 3) is TipState.UNKNOWN and "IMU" in watched.watch.hold_reason


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
    needed = 2.0 * STANDARD_GRAVITY / radius * (1.0 - cos(left))  # (rad/s)^2
    if left <= 0.0:
        needed = -needed  # beyond the top it comes back only if it is fast enough backwards
    over = rate * abs(rate) - needed
    if abs(over) < 0.5 + 0.3 * abs(needed):
        return
    sample = sample_of(robot, q, rotations.from_axis_angle(axis, tilt), rate * axis)
    found = Watched(robot).look([sample] * (round(FALLS_S / DT) + 3))
    assert (found is TipState.FALLS) == (over > 0.0), (degrees(tilt), rate, over)


def test_a_fall_stays_one_and_no_single_sample_makes_it(robot: RobotBody) -> None:
    watched = Watched(robot)
    flat = watched.flat
    over = rotations.from_axis_angle([0.0, 1.0, 0.0], radians(30.0))
    falling = sample_of(robot, planted(robot), over, np.array([0.0, 2.0, 0.0]))
    assert watched.look([flat, falling, flat, falling, flat]) is not TipState.FALLS
    at = watched.time
    for _ in range(10):  # the same measurement, again and again
        assert watched.watch.look(replace(falling, time=at), watched.joints) is not TipState.FALLS
    assert watched.look([falling] * 4) is TipState.FALLS and "30 degrees" in watched.watch.fall
    assert watched.look([flat] * 200) is TipState.FALLS
