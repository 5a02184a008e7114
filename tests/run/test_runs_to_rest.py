"""Whole runs that are stopped at any time: the robot goes to rest, slowly, clear of what moves, and stays there."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faulty_bus import FaultKind, MockFault
from hardware.clock import VirtualClock
from hardware.errors import GuardError, TorqueError
from hardware.guard import CheckedGoal
from messages import refuses, shows
from operators import ENOUGH, Asks
from recordings import mock_bus as faulty_bus
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.report import motion_metrics
from retarget.report.measure import limits_broken
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.robot.follower import Follower
from retarget.run.controllers import rest_joints
from retarget.run.loop import Progress
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.run.supervisor import STATES
from retarget.safety.gate import Gate
from retarget.sources.open import open_source
from retarget.types import FloatArray, Notify, RunState
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer


def stopped(name: str, after: int, *, end: float = 1.0, notify: Notify = lambda text: None) -> RunResult:
    """A run on a mock bus that is stopped after so many ticks, and goes to rest."""
    asked = RunOptions(robot=name, bus="mock", priorities="balanced", playback=Playback(end=end))
    ticks, clock = iter(range(10**6)), VirtualClock()
    with prepare(
        synthetic_performer, asked, clock=clock, make_bus=mock_bus, goes_to_rest=True, notify=notify
    ) as prepared:
        return prepared.run(Asks(lambda: next(ticks) >= after))


RETURN_S = 4.0
"""Longest return to stance in place of that of a run, so that what is refused takes less time."""


@pytest.mark.long
@pytest.mark.parametrize("passed", [60, 0])
def test_a_refused_return_to_stance_times_out_and_the_way_to_rest_keeps_the_soles(
    passed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a crouch, and from halfway: the robot holds for as long as it may, says so, and goes to rest from there."""
    check, returned, return_to_stance = Gate.check, list[FloatArray](), Follower.return_to_stance

    def to_stance(self: Follower, dt: float) -> FloatArray | None:
        q = return_to_stance(self, dt)
        returned.extend([] if q is None else [q])
        return q

    def walled(self: Gate, last: CheckedGoal, target: FloatArray | None, **given: Any) -> CheckedGoal | None:
        is_return = len(returned) > passed and given.get("stop") is not None  # whole or in part
        return None if is_return else check(self, last, target, **given)

    monkeypatch.setattr(Follower, "return_to_stance", to_stance)
    monkeypatch.setattr(Gate, "check", walled)
    monkeypatch.setitem(STATES, RunState.RETURN_TO_STANCE, replace(STATES[RunState.RETURN_TO_STANCE], limit_s=RETURN_S))
    notes: list[str] = []
    run = stopped("op3", 900, end=8.0, notify=notes.append)
    assert run.robot is not None
    assert len(returned) * run.clip.dt == pytest.approx(RETURN_S, abs=3 * run.clip.dt), "what is refused is no arrival"
    shows(notes)
    assert np.abs(run.record.goals[-1] - rest_joints(run.robot)).max() < 0.1
    stand = motion_metrics.standing_of(run.robot, run.record.q[900 + len(returned) :])
    assert stand.tilt.max() < np.deg2rad(0.2) and (stand.margin > 0.0).all()
    assert np.ptp(stand.corners[..., 2], axis=0).max() < 5e-3, "neither sole is lifted"


@pytest.mark.long
def test_a_stop_after_it_followed_ends_in_rest_within_four_seconds() -> None:
    run = stopped("op3", 10**6)
    assert run.robot is not None
    goals = run.record.goals
    assert (len(goals) - run.record.following.stop) * run.clip.dt < 4.0
    assert np.abs(goals[-1] - rest_joints(run.robot)).max() < 0.1


# A stop from outside, whatever the robot does at that moment: on its soles, in balance, within its limits, to rest.

WARM_UP_S = 4.0
"""A robot follows at full speed after 3 s."""

RECORDED = [
    ("02_06", 8.69),
    *(pytest.param(*one, marks=pytest.mark.long) for one in (("02_05", 11.38), ("02_10", 11.0))),
]
"""Trial, and when (s) the stop comes: where braking joint by joint moves a sole most, and while crouching."""


@contextmanager
def prepared(read: Callable[[], SensorFrames], at: float, faults: tuple[MockFault, ...] = ()) -> Iterator[Prepared]:
    """The OP3, to follow from a few seconds before the time `at` s until 0.2 s after it."""
    options = RunOptions(robot="op3", playback=Playback(start=at - WARM_UP_S, end=at + 0.2))
    bus = partial(faulty_bus, faults=faults)
    with prepare(read, options, clock=VirtualClock(), make_bus=bus) as ready:
        yield ready


def stop_at(ready: Prepared, time: float = WARM_UP_S) -> RunResult:
    """Interrupt at this time of the run, s."""
    done = [0]
    ticks = round(time / ready.samples.dt)
    return ready.run(Asks(lambda: done[-1] >= ticks), [Progress(done.append, every=1)])


def soles(run: RunResult) -> tuple[float, float]:
    """Most that a sole is off its first place and off the ground, m, and tilted, rad."""
    assert run.robot is not None
    stand = motion_metrics.standing_of(run.robot, run.record.q)
    off = np.linalg.norm(stand.corners - stand.corners[run.record.following.start], axis=-1)
    return float(off.max()), float(stand.tilt.max())


def assert_stands_well(run: RunResult, *, braked: int = 6) -> None:
    """It was moving when it had to stop, and everything was kept until it stood."""
    robot, record = run.robot, run.record
    assert robot is not None
    brakes = record.phase == Phase.BRAKE
    assert np.count_nonzero(brakes) >= braked
    assert not record.gated[int(np.argmax(brakes)) :].any()
    positions = np.vstack([record.start, record.q[:, robot.servo_columns]])
    at_rest = np.vstack([positions, positions[-1:]])
    assert limit_violations(at_rest, robot.limits, run.clip.dt) == LimitViolations(0, 0, 0)
    off, tilt = soles(run)
    assert off < 0.003 and tilt < np.deg2rad(0.1)
    assert (motion_metrics.standing_of(robot, record.q).margin > 0.0).all()


@pytest.mark.parametrize(("trial", "at"), RECORDED)
def test_an_interrupt_of_a_recorded_motion(trial: str, at: float, shared: Path) -> None:
    source = shared / "mocap" / "cmu_asfamc" / f"{trial}.amc"
    with prepared(lambda: open_source(source), at) as ready:
        run = stop_at(ready)
    assert (run.state, run.reason) == ("off", ENOUGH)
    assert_stands_well(run)


@pytest.mark.parametrize(("robot", "end"), [("wolfgang", 2.9), ("wolfgang", 5.2), ("op3", 2.6)])
def test_a_stop_is_over_when_its_goals_stand_not_its_posture_alone(robot: str, end: float) -> None:
    """Goals that make up for a load may go on after the posture that they hold."""
    options, clock = RunOptions(robot=robot, priorities="balanced"), VirtualClock()
    with prepare(lambda: synthetic_performer().cut(0.0, end), options, clock=clock, make_bus=mock_bus) as prepared:
        run = prepared.run()
    assert limits_broken(run) == LimitViolations(position=0, velocity=0, acceleration=0)


@pytest.mark.long
def test_the_end_of_a_clip_in_the_middle_of_a_motion() -> None:
    with prepared(synthetic_performer, 15.4) as ready:
        run = ready.run()
    assert (run.state, run.reason) == ("off", None)
    assert_stands_well(run)


@pytest.mark.long
def test_a_stop_by_the_guard() -> None:
    fault = MockFault(FaultKind.HOT, first=981, cycles=1, servo=4, value=70.0)
    with prepared(synthetic_performer, 11.23, (fault,)) as ready:
        run = ready.run()
    assert run.state == "fault"
    shows(run.reason, 65, "r_el", 5, 70)
    assert_stands_well(run, braked=5)


def test_a_refusal_is_not_lost_in_closing_the_bus() -> None:
    silent = MockFault(FaultKind.MISSING, first=0, cycles=10**6, servo=2)
    with refuses(TorqueError) as refusal, prepared(synthetic_performer, 15.6, (silent,)) as it:
        it.run()
    assert isinstance(refusal.value.__cause__, GuardError)  # it is silent: whether it has torque is not known


@pytest.mark.long
def test_without_the_way_the_same_stop_moves_the_soles_a_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """What these tests can see: joints that brake in proportion, as they do where no stop is planned."""
    with prepared(synthetic_performer, 5.9) as ready:
        by_way = soles(stop_at(ready))
    with prepared(synthetic_performer, 5.9) as ready:
        assert ready.machine is not None
        monkeypatch.setattr(ready.machine.follower, "stop", lambda dt: None)
        by_gate = soles(stop_at(ready))
    assert by_way[0] < 1e-4 < by_gate[0] < 0.001
