"""A robot for which time goes by slower: half of the speeds, no leap, no limit missed, soles that stay."""

from functools import cache

import numpy as np
import pytest

from followers import DT, follower, op3, performer, postures
from hardware.servo_warnings import RAMP_S
from retarget.follow import Follower
from retarget.gate import Gate
from retarget.human_posture import HumanPosture
from retarget.joint_limits import JointLimits
from retarget.rotations import FloatArray
from retarget.slow_time import SlowTime

TICKS = 900
WARM = range(250, 550)


@cache
def human() -> list[HumanPosture]:
    return postures(performer(), speed=2.0)[:TICKS]


def asked(tick: int) -> float:
    """The share of the speed that the guard would ask for."""
    step = 0.5 * DT / RAMP_S
    return max(0.5, 1.0 - step * (tick - WARM.start)) if tick < WARM.stop else min(1.0, 0.5 + step * (tick - WARM.stop))


def begun() -> Follower:
    robot = follower()
    robot.start(human()[0])
    last = robot.arrive(human()[0], DT)[-1]
    robot.reseed(last.q, np.zeros(op3().body.nv))
    return robot


def followed(*, warm: bool) -> tuple[FloatArray, FloatArray]:
    """Servo angles (T, n) that a gate lets pass, and how far the robot is behind (T,) m."""
    robot, gate = begun(), Gate.for_servos(op3().joint_map, dt=DT)
    rows: list[FloatArray] = []
    behind: list[float] = []
    for tick, posture in enumerate(human()):
        if warm and tick >= WARM.start:
            robot.keep_pace(asked(tick))
        reached = robot.step(posture, DT)
        if not rows:
            gate.seed(reached.joint_positions)
        rows.append(reached.joint_positions)
        assert gate.passes(rows[-1]), tick
        gate.admit(rows[-1])
        behind.append(float(np.linalg.norm(reached.landmarks_asked - reached.landmarks_reached, axis=1).max()))
    return np.array(rows), np.array(behind)


@pytest.fixture(scope="module")
def both() -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    return followed(warm=True), followed(warm=False)


def test_half_of_the_speed_in_time_and_every_limit_kept(both: tuple[tuple[FloatArray, ...], ...]) -> None:
    speeds = np.abs(np.diff(both[0][0], axis=0)) / DT
    most = op3().joint_map.max_velocity
    slow = slice(WARM.start + round(0.7 / DT), WARM.stop - 1)
    assert (speeds[slow] <= 0.5 * most + 1e-9).all()
    assert np.abs(np.diff(both[1][0], axis=0)[slow]).max() / DT > 0.6 * most.max()  # it would have been faster
    changes = np.abs(np.diff(both[0][0], n=2, axis=0)) / DT**2
    assert (changes <= op3().joint_map.max_acceleration + 1e-6).all()


def test_the_robot_lags_and_catches_up(both: tuple[tuple[FloatArray, ...], ...]) -> None:
    (warm, behind), (cold, usual) = both
    assert np.array_equal(warm[: WARM.start], cold[: WARM.start])
    assert behind[WARM.start : WARM.stop].mean() > 1.2 * usual[WARM.start : WARM.stop].mean()
    late = slice(WARM.stop + 150, TICKS)
    assert behind[late].mean() < 1.1 * usual[late].mean()


def test_a_stop_at_half_speed_goes_on_smoothly_on_the_soles() -> None:
    """The way to a stop is one from the speed that the robot has, not from twice or half of it."""
    robot = begun()
    for tick, posture in enumerate(human()[: WARM.start + 120]):
        if tick >= WARM.start:
            robot.keep_pace(asked(tick))
        reached = robot.step(posture, DT)
        if tick == WARM.start + 118:
            rows = [reached.joint_positions]
    rows.append(reached.joint_positions)
    for _ in range(60):
        q = robot.halt(DT)
        assert q is not None
        rows.append(q[op3().servo_columns])
    steps = np.diff(np.array(rows), axis=0)
    assert np.abs(steps[0]).max() / DT > 0.2
    assert (np.abs(np.diff(steps, axis=0)) <= op3().joint_map.max_acceleration * DT**2 + 1e-9).all()
    assert not steps[-1].any()
    still = int(np.argmax(~(np.abs(steps) > 0.0).any(axis=1)))
    assert still * DT <= 0.35


def test_a_leap_of_the_pace_is_none_of_the_robot() -> None:
    """What moves goes on at its speed, and brakes from there: in following, and on the way to a stop."""
    for halts in (False, True):
        robot = begun()
        rows = [robot.step(posture, DT).joint_positions for posture in human()[:200]]
        robot.keep_pace(0.7)
        q = robot.halt(DT) if halts else robot.step(human()[200], DT).q
        assert q is not None
        steps = np.diff([*rows[-2:], q[op3().servo_columns]], axis=0)
        assert np.abs(steps[0]).max() / DT > 1.0
        gentler = 0.7**2 if not halts else 1.0  # a way to a stop that was known is gone on as it was
        assert (np.abs(steps[1] - steps[0]) <= gentler * op3().joint_map.max_acceleration * DT**2 + 1e-9).all()


def test_whoever_tells_where_it_is_speaks_of_our_time() -> None:
    robot = begun()
    for posture in human()[:100]:
        before, q = robot.step(posture, DT), robot.step(posture, DT).q
    robot.keep_pace(0.5)
    body = op3().body.solver_body()
    moved = body.difference(before.q, q)
    robot.reseed(q, moved / DT)
    after = robot.step(human()[100], DT).q
    change = np.abs(body.difference(q, after) - moved)[-len(op3().joint_map) :]
    assert np.abs(moved[-len(op3().joint_map) :]).max() / DT > 0.5
    assert change.max() <= 0.25 * op3().joint_map.max_acceleration.max() * DT**2 + 1e-9


def test_obstacles_are_told_of_the_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, told = begun(), list[tuple[float, float]]()
    robot.keep_pace(0.5)
    monkeypatch.setattr(robot.surroundings, "tick", lambda who, dt, pace=1.0: told.append((dt, pace)))
    robot.step(human()[0], DT)
    robot.halt(DT)
    assert told == [(DT, 0.5), (DT, 1.0)]


def hinge() -> tuple[SlowTime, FloatArray, FloatArray]:
    body = op3().body
    limits = JointLimits(*(np.full(body.nv, value) for value in (-1.0, 1.0, 4.0, 10.0)))
    return SlowTime(body, limits), body.qpos0.copy(), np.zeros(body.nv)


def test_a_joint_that_brakes_before_its_limit_is_not_asked_to_brake_less() -> None:
    time, q, velocity = hinge()
    velocity[-1] = 2.0  # needs 0.2 rad to stand
    q[-1] = 0.75
    assert time.turn(0.95, q, velocity) == 0.95 and time.pace == 0.95
    q[-1] = 0.79
    assert time.turn(0.9, q, velocity) == 1.0 and time.pace == 0.95
    velocity[-1] = -2.0  # away from the limit
    assert time.turn(0.9, q, velocity) == pytest.approx(0.9 / 0.95)


def test_faster_again_is_always_possible_and_a_joint_at_its_limit_hinders_nothing() -> None:
    time, q, velocity = hinge()
    q[-1] = 1.0
    assert time.turn(0.5, q, velocity) == 0.5
    velocity[-1] = 2.0
    assert time.turn(1.0, q, velocity) == 2.0 and time.pace == 1.0
