"""A stop from outside, whatever the robot does at that moment: on its soles, in balance, within its limits, to rest."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.errors import GuardError, TorqueError
from messages import refuses, shows
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.model.robot import RobotBody
from retarget.report import motion_metrics
from retarget.report.motion_metrics import LimitViolations, limit_violations
from retarget.run.loop import INTERRUPTED, Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.sources.open import open_source
from sim.performer import synthetic_performer

WARM_UP_S = 4.0
"""A robot follows at full speed after 3 s."""

RECORDED = [("02_06", 8.69), ("02_05", 11.38), ("02_10", 6.02)]
"""Trial, and when (s) the stop comes: where braking joint by joint moves a sole most, and while crouching."""


@contextmanager
def prepared(read: Callable[[], SensorFrames], at: float, faults: Sequence[MockFault] = ()) -> Iterator[Prepared]:
    """The OP3, to follow from a few seconds before the time `at` s until 0.2 s after it."""

    def make_bus(robot: RobotBody, clock: Clock) -> ServoBus:
        stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
        return FaultyBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(stand), faults=faults)

    options = RunOptions(robot="op3", playback=Playback(start=at - WARM_UP_S, end=at + 0.2))
    with prepare(read, options, clock=VirtualClock(), make_bus=make_bus) as ready:
        yield ready


def stop_at(ready: Prepared, time: float = WARM_UP_S) -> RunResult:
    """Interrupt at this time of the run, s."""
    done = [0]
    ticks = round(time / ready.samples.dt)
    return ready.run(Watch(on_tick=done.append, stop_asked=lambda: done[-1] >= ticks, every=1))


def soles(run: RunResult) -> tuple[float, float]:
    """Most that a sole is off its first place and off the ground, m, and tilted, rad."""
    assert run.robot is not None and run.record.robot is not None
    off = tilt = 0.0
    for sole in motion_metrics.soles_of(run.robot, run.record.robot.q):
        corners = motion_metrics.sole_corners(sole)
        off = max(off, float(np.linalg.norm(corners - corners[run.record.following.start], axis=-1).max()))
        tilt = max(tilt, float(motion_metrics.sole_tilt(sole).max()))
    return off, tilt


def assert_stands_well(run: RunResult, *, braked: int = 6) -> None:
    """It was moving when it had to stop, and everything was kept until it stood."""
    robot, sent = run.robot, run.record.robot
    assert robot is not None and sent is not None
    assert np.count_nonzero(run.record.phase == Phase.BRAKE) >= braked
    assert not sent.gated.any()
    positions = np.vstack([sent.start, sent.q[:, robot.servo_columns]])
    at_rest = np.vstack([positions, positions[-1:]])
    assert limit_violations(at_rest, robot.limits, run.clip.dt) == LimitViolations(0, 0, 0)
    off, tilt = soles(run)
    assert off < 0.003 and tilt < np.deg2rad(0.1)
    corners = np.concatenate(
        [motion_metrics.sole_corners(sole) for sole in motion_metrics.soles_of(robot, sent.q)], axis=1
    )
    com = robot.body.solver_body().centre_of_mass(np.ascontiguousarray(sent.q))
    assert (motion_metrics.support_margin(com, corners) > 0.0).all()


@pytest.mark.parametrize(("trial", "at"), RECORDED)
def test_an_interrupt_of_a_recorded_motion(trial: str, at: float, shared: Path) -> None:
    source = shared / "mocap" / "cmu_asfamc" / f"{trial}.amc"
    with prepared(lambda: open_source(source), at) as ready:
        run = stop_at(ready)
    assert (run.state, run.reason) == ("off", INTERRUPTED)
    assert_stands_well(run)


def test_the_end_of_a_clip_in_the_middle_of_a_motion() -> None:
    with prepared(synthetic_performer, 15.4) as ready:
        run = ready.run()
    assert (run.state, run.reason) == ("off", None)
    assert_stands_well(run)


def test_a_stop_by_the_guard() -> None:
    fault = MockFault(FaultKind.HOT, first=1041, cycles=1, servo=4, value=70.0)
    with prepared(synthetic_performer, 11.23, [fault]) as ready:
        run = ready.run()
    assert run.state == "fault"
    assert run.reason is not None
    shows(run.reason, 65, "r_el", 5, 70)
    assert_stands_well(run)


def test_a_refusal_is_not_lost_in_closing_the_bus() -> None:
    silent = MockFault(FaultKind.MISSING, first=0, cycles=10**6, servo=2)
    with (
        refuses(TorqueError) as refusal,
        prepared(synthetic_performer, 15.6, [silent]) as it,
    ):
        it.run()
    assert isinstance(refusal.value.__cause__, GuardError)  # it is silent: whether it has torque is not known


def test_without_the_way_the_same_stop_tears_the_soles(monkeypatch: pytest.MonkeyPatch) -> None:
    """What these tests can see: each joint braking by itself, as fast as it can."""
    with prepared(synthetic_performer, 5.69) as ready:
        assert ready.machine is not None
        monkeypatch.setattr(ready.machine.follower, "halt", lambda dt: None)
        run = stop_at(ready)
    off, tilt = soles(run)
    assert off > 0.003 and tilt > np.deg2rad(0.5)
