"""Goals of one tick: near to where the robot is, towards what is desired, and none for what was not desired."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import DT, follower, op3, performer, postures, stance
from hardware.servo import loop_lag
from retarget.ik.tasks import SlotKind
from retarget.robot.desired_motion import RATE, DesiredMotion, MotionFilter
from retarget.robot.following_limits import following_limits
from retarget.robot.landmarks import DesiredLandmarks, RobotReader, limb_names
from retarget.rotations import plus
from retarget.types import FloatArray

LIMBS = limb_names(op3().profile)
PELVIS = list(op3().profile.landmarks).index("pelvis")


class Aiming:
    """Goals of a robot that stands; lag_compensation as of `DesiredMotion`."""

    def __init__(self, lag_compensation: float = 0.0) -> None:
        robot, limits, reader = follower(), following_limits(op3(), stance()), RobotReader(op3(), stance())
        robot.start(postures(performer())[0])
        self.hierarchy, self.actual = robot.hierarchy, reader.read(stance().q)
        self.motion = DesiredMotion(
            op3(),
            self.hierarchy,
            limits,
            still=frozenset({"l_sole", "r_sole"}),
            trunk_at_stance=reader.trunk_at_stance,
            lag_compensation=lag_compensation,
        )
        self.targets = self.hierarchy.blank()

    def moved(self, x: float, *, landmarks: bool = False) -> DesiredLandmarks:
        """All limbs x m ahead of where they are, and all landmarks."""
        own = self.actual
        limbs = [plus(place, (x, 0.0, 0.0)) for place in own.limbs]
        places = [plus(place, (x, 0.0, 0.0)) for place in own.landmarks] if landmarks else own.landmarks
        return DesiredLandmarks(places, limbs, own.trunk, own.gaze)

    def goal(self, name: str) -> FloatArray:
        """Weight and goal (4,) of a landmark, or of a limb."""
        kind = SlotKind.POSITION if self.hierarchy.position_slots([name])[0].size else SlotKind.LIMB
        return np.asarray(self.targets[self.hierarchy.position_slots([name], kind)[1][0]])


def test_a_goal_is_a_step_from_where_the_robot_is_and_planted_landmarks_get_none() -> None:
    aiming = Aiming()
    actual, desired = aiming.actual, aiming.moved(0.1)
    for _ in range(5):
        aiming.motion.aim(aiming.targets, desired, actual, DT, speed_override=1.0)
        weight, *place = aiming.goal("l_hand")
        x, y, z = np.array(place) - np.array(actual.limbs[LIMBS.index("l_hand")])
        assert weight == 1.0 and 0.0 < x <= 0.1 * RATE * DT + 1e-12 and abs(y) < 1e-12 and abs(z) < 1e-12
    assert np.allclose(aiming.goal("pelvis")[1:], actual.landmarks[PELVIS], atol=1e-12)
    assert aiming.hierarchy.position_slots(["l_sole"])[0].size and aiming.goal("l_sole")[0] == 0.0


OWN, CATCH_UP, SPEED = 40.0, 20.0, 2.0
"""Acceleration of a motion, and of catching up, m/s^2; speed of catching up, m/s."""


def followed(
    desired: FloatArray,
    dt: float = DT,
    *,
    start: float | None = None,
    lead_time: float = 0.0,
    own: float = OWN,
    speed_override: Sequence[float] | None = None,
) -> FloatArray:
    """Where a point gets (T,) m that follows desired (T,) m along x and reaches every goal. speed_override (T,)."""
    passing = MotionFilter(np.array([[own, CATCH_UP, SPEED]]), np.array([lead_time]))
    here, last, path = desired[0] if start is None else start, desired[0], []
    for there, share in zip(desired.tolist(), speed_override or [1.0] * len(desired), strict=True):
        moved, error = (np.array([[off, 0.0, 0.0]]) for off in (there - last, there - here))
        step = passing.step(moved, error, dt, speed_override=share)
        here, last = here + float(step[0, 0]), there
        path.append(here)
    return np.array(path)


@given(gap=st.floats(1e-4, 2.0), dt=st.sampled_from([0.008, 0.02]))
def test_a_gap_closes_without_overshoot_within_the_limits(gap: float, dt: float) -> None:
    """Braking is that of v = sqrt(2 a gap), and up to twice as hard where exp(-RATE t) takes over."""
    left = gap - followed(np.full(600, gap), dt, start=0.0)
    assert (left >= -1e-12).all() and left[-1] < 1e-6
    speed = -np.diff(left, prepend=gap) / dt
    assert speed.max() <= min(RATE * gap, SPEED) + 1e-9
    change = np.diff(speed, prepend=0.0) / dt
    assert change.max() <= CATCH_UP + 1e-6 and change.min() >= -2.0 * CATCH_UP * (1.0 + RATE * dt)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_slower_robot_catches_up_more_slowly_and_gently(share: float) -> None:
    path = followed(np.full(1500, 1.0), start=0.0, speed_override=[share] * 1500)
    speed = np.diff(path, prepend=0.0) / DT
    assert speed.max() <= share * SPEED + 1e-9 and path.max() <= 1.0 + 1e-9 and path[-1] == pytest.approx(1.0, abs=1e-3)
    assert (np.diff(speed, prepend=0.0) / DT).max() <= share**2 * CATCH_UP + 1e-6


@pytest.mark.parametrize(("before", "after"), [(1.0, 0.5), (1.0, 0.2), (0.5, 0.5)])
def test_a_slower_robot_brakes_as_hard_as_any(before: float, after: float) -> None:
    """The motion stops, and the robot is made slower in the same tick: it goes on no farther than it would."""
    desired = np.minimum(1.5 * DT * np.arange(600.0), 1.5 * DT * 200)
    shares = [before] * 200 + [after] * 400
    fast = followed(desired).max() - desired[-1]
    assert followed(desired, speed_override=shares).max() - desired[-1] <= fast + 0.03


@pytest.mark.parametrize("own", [1.0, OWN])
def test_a_jump_is_caught_up_with_and_hardly_overshot(own: float) -> None:
    desired = np.where(np.arange(400) < 50, 0.0, 0.5)
    path = followed(desired, own=own)
    assert path.max() < 1.05 * 0.5 and path[-1] == pytest.approx(0.5, abs=1e-6)
    assert (np.diff(path, n=2) / DT**2).max() < own + CATCH_UP + 1e-6


@pytest.mark.parametrize("dt", [0.008, 0.02])
def test_an_even_motion_is_on_time_and_a_lead_time_ahead(dt: float) -> None:
    even = 0.3 * dt * np.arange(1000.0)
    assert followed(even, dt)[-1] == pytest.approx(even[-1], abs=1e-6)
    assert followed(even, dt, lead_time=0.05)[-1] - even[-1] == pytest.approx(0.3 * 0.05, rel=0.01)


@pytest.mark.parametrize(("dt", "most"), [(0.008, 0.08), (0.02, 0.25)])
def test_noise_is_smoothed(dt: float, most: float) -> None:
    noise = np.random.default_rng(3).normal(0.0, 1e-3, 4000)

    def jerk(path: FloatArray) -> float:
        return float(np.sqrt((np.diff(path, n=3) ** 2).mean()))

    assert jerk(followed(noise, dt)) < most * jerk(noise)


def test_a_swing_of_2_hz_goes_21_percent_too_far() -> None:
    path = followed(np.sin(2.0 * np.pi * 2.0 * DT * np.arange(2000.0)) * 0.02)
    assert path[1000:].max() / 0.02 == pytest.approx(1.21, abs=0.015)


@pytest.mark.parametrize("far", [2.0, 20.0])
def test_what_is_far_off_pulls_no_harder_than_what_is_off(far: float) -> None:
    """A limb that cannot get there, and so does not move, beside one that is half as far off as counts."""
    most = SPEED / RATE
    passing = MotionFilter(np.array([[OWN, CATCH_UP, SPEED]] * 2), np.zeros(2))
    error = np.array([[0.5 * most, 0.0, 0.0], [far * most, 0.0, 0.0]])
    for _ in range(50):
        near, off = passing.step(np.zeros((2, 3)), error, DT)
    assert off[0] == pytest.approx(2.0 * near[0])


def test_only_what_carries_nothing_is_ahead_by_the_lag_of_its_servos() -> None:
    """Both hands and the pelvis go on evenly: the goal of the hands is ahead by the lead time."""
    goals = list[tuple[float, float]]()
    for lag_compensation in (2.0, 0.0):
        aiming = Aiming(lag_compensation)
        for tick in range(100):
            desired = aiming.moved(0.05 * DT * tick, landmarks=True)
            there = replace(aiming.actual, landmarks=desired.landmarks, limbs=desired.limbs)
            aiming.motion.aim(aiming.targets, desired, there, DT, speed_override=1.0)
        hand, pelvis = desired.limbs[LIMBS.index("l_hand")], desired.landmarks[PELVIS]
        goals.append((aiming.goal("l_hand")[1] - hand[0], aiming.goal("pelvis")[1] - pelvis[0]))
    late = loop_lag(op3().joint_map.servos[0]) + 1.0 / op3().profile.safety.rate_hz  # all of its servos are alike
    (hand_ahead, pelvis_ahead), (hand_usual, pelvis_usual) = goals
    assert hand_ahead - hand_usual == pytest.approx(0.05 * 2.0 * late * RATE * DT, rel=0.1)
    assert pelvis_ahead == pelvis_usual


def test_what_was_asked_before_a_hold_is_no_motion_to_what_is_asked_after_it() -> None:
    passing, still = MotionFilter(np.array([[OWN, CATCH_UP, SPEED]]), np.zeros(1)), np.zeros((1, 3))
    for _ in range(100):
        passing.step(np.array([[0.5 * DT, 0.0, 0.0]]), still, DT)
    assert passing.step(still, still, DT)[0, 0] > 0.2 * DT
    passing.restart()
    assert not passing.step(still, still, DT).any()
