"""Goal playback: the same goals are sent, the robot approaches slowly and ends at rest, and the gate may refuse."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.arrays import TickArray
from hardware.clock import VirtualClock
from hardware.guard_state import StopCause
from messages import refuses, shows
from operators import Asks
from recordings import Recorded, mock_bus, record, with_cycles
from retarget.errors import InputError
from retarget.model.robot import RobotBody, load_robot, robot_of
from retarget.recording.goal_playback import goal_playback
from retarget.recording.reading import Recording
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.record import Phase
from retarget.run.run_result import RunResult


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("goal_playback") / "run.mcap", seconds=1.6)


def send(
    found: Recording,
    *,
    speed: float = 1.0,
    operator: Operator | None = None,
    held: range = range(0),
    robot: RobotBody | None = None,
) -> RunResult:
    """held: ticks in which the robot is to hold. robot: instead of that of the recording."""
    options = replace(found.session.options, bus="mock")
    with goal_playback(
        found, options, speed=speed, clock=VirtualClock(), make_bus=mock_bus, notify=lambda text: None, robot=robot
    ) as prepared:
        sample = prepared.samples.sample
        vars(prepared.samples)["sample"] = lambda tick: None if tick in held else sample(tick)
        return prepared.run(operator)


def check_motion(result: RunResult) -> None:
    robot, sent = result.robot, result.record
    assert robot is not None
    joints = np.vstack([sent.start, sent.q[:, robot.servo_columns]])
    assert limit_violations(joints, robot.limits, result.clip.dt) == LimitViolations(0, 0, 0)


def followed(result: RunResult) -> TickArray:
    return result.record.goal_ticks[result.record.following]


def test_the_same_goals_are_sent(plain: Recorded) -> None:
    result = send(plain.read())
    assert result.reason is None
    now, was = followed(result), followed(plain.result)
    assert len(was) <= len(now) <= len(was) + 40
    now = now[: len(was)]
    assert np.abs(now - was).max() <= 1  # a tick, where a rounding lies between two
    assert np.count_nonzero(now != was) < 0.001 * now.size
    assert np.abs(was - was[0]).max() > 20 and not result.record.gated.any()
    check_motion(result)


def test_it_approaches_slowly_and_ends_at_rest(plain: Recorded) -> None:
    result = send(plain.read())
    robot, sent = result.robot, result.record
    assert robot is not None
    approach = np.vstack([sent.start, sent.q[sent.phase == Phase.APPROACH][:, robot.servo_columns]])
    speed = np.abs(np.diff(approach, axis=0)) * robot.profile.safety.rate_hz
    share = robot.profile.safety.speed_caps.approach
    assert len(approach) > 2 and (speed <= share * robot.limits.max_velocity * (1.0 + 1e-9)).all()
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    np.testing.assert_allclose(sent.q[-1, robot.servo_columns], rest, atol=1e-6)


@pytest.mark.long
def test_slower_is_the_same_trajectory_in_more_ticks(plain: Recorded) -> None:
    result = send(plain.read(), speed=0.5)
    now, was = followed(result), followed(plain.result)
    assert len(now) >= 2 * len(was) - 1 and np.abs(now[: 2 * len(was) : 2] - was).max() <= 1
    check_motion(result)


@pytest.mark.long
def test_after_a_hold_it_rejoins_the_trajectory_slowly(plain: Recorded) -> None:
    result = send(plain.read(), held=range(120, 140))
    assert result.reason is None
    check_motion(result)
    straight, following = send(plain.read()), followed(result)
    assert result.ticks_followed > straight.ticks_followed + 20
    assert np.abs(following[-1] - followed(straight)[-1]).max() <= 1
    assert (following[130:140] == following[140]).all()
    # The recording was cut in full motion. After a hold, its last goal is less than a tick away: too hard to brake.
    gated = np.flatnonzero(result.record.gated)
    assert len(gated) <= 1 and (np.abs(result.record.goal_ticks[gated - 1] - following[-1]) < 20).all()


def test_a_stop_is_a_stop(plain: Recorded) -> None:
    asked = iter([False] * 150 + [True] * 9999)
    result = send(plain.read(), operator=Asks(stop=lambda: next(asked)))
    assert result.stop is not None and result.stop.cause is StopCause.REQUESTED
    check_motion(result)


def test_who_has_no_goals_is_refused(tmp_path: Path, plain: Recorded) -> None:
    alone = record(tmp_path / "human.mcap", options=RunOptions(robot="human", bus="none"), seconds=0.1).read()
    with refuses(InputError):
        send(alone)
    found = plain.read()
    before = found.cycles[np.arange(20)]
    with refuses(InputError):
        send(with_cycles(found, before))


def test_the_gate_refuses_what_no_robot_can(plain: Recorded) -> None:
    """A recording that was tampered with: a goal that jumps is not sent."""
    found = plain.read()
    cycles = found.cycles[np.arange(len(found.cycles))]
    cycles.q_servos[200:, 3] += 1.0
    result = send(with_cycles(found, cycles))
    assert result.record.gated.any()
    shows(result.reason, "4.8")
    check_motion(result)


@pytest.mark.long
def test_a_robot_that_is_too_slow_for_the_goals_gives_up(plain: Recorded) -> None:
    """The gate refuses them again and again: the robot holds, stops with a reason, and rests."""
    robot = load_robot("op3")
    servos = {
        name: servo.model_copy(update={"max_velocity": 0.08 * servo.max_velocity})
        for name, servo in robot.profile.servos.items()
    }
    slow = robot_of(robot.profile.model_copy(update={"servos": servos}), None)
    result = send(plain.read(), robot=slow)
    assert len(result.record) < 20 * len(plain.result.record) and result.record.gated.any()
    shows(result.reason)
