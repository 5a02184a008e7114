"""The robot's half of a tick: goals that keep their distance in time, and an end that leaves no torque on."""

import numpy as np
import pytest

from hardware.bus import ServoGoals
from hardware.errors import BusError, TorqueError
from hardware.guard_state import GuardState, StopCause
from messages import refuses, shows
from retarget.run.loop import INTERRUPTED, Watch
from retarget.run.record import Phase
from retarget.run.robot_side import FORCED_STOP
from retarget.types import FloatArray
from rig import Rig, play, short_clip
from robot_side_helpers import swing, times_of_writing
from sim.mock_bus import FaultKind, MockFault

FOR_EVER = 10**6


@pytest.mark.parametrize(("stall", "reason"), [(0.05, None), (2.0, "no tick for 2 s, allowed 0.1 s")])
def test_what_was_missed_in_a_stall_is_not_caught_up_with(
    stall: float, reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(swing())
    times = times_of_writing(rig, monkeypatch)
    ending = play(rig, Watch(lambda done: rig.clock.advance(stall) if done == 20 else None, every=1))
    assert np.diff(times)[1:].min() > 0.999 * rig.dt
    assert (ending.state, ending.reason) == ("idle" if reason is None else "stopped", reason)


def test_a_servo_that_is_silent_at_the_end_is_reported() -> None:
    rig = Rig(swing())
    play(rig)
    last = rig.bus._cycle
    rig = Rig(swing(), faults=(MockFault(FaultKind.MISSING, first=last - 1, cycles=FOR_EVER, servo=2),))
    ending = play(rig)
    assert rig.bus.torque_on and ending.state == "stopped"
    assert ending.reason is not None
    shows(ending.reason, "r_sho_roll")


@pytest.mark.parametrize("error", [BusError("port gone"), KeyboardInterrupt("port gone")])
def test_a_start_that_leaves_torque_on_says_so(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing())
    torque = rig.bus.torque

    def stuck(on: bool) -> None:
        if not on:
            raise OSError("no such device")
        torque(on)
        raise error

    monkeypatch.setattr(rig.bus, "torque", stuck)
    with refuses(TorqueError) as refused:
        play(rig)
    assert refused.value.__cause__ is error and rig.bus.torque_on


def test_an_interrupted_start_switches_torque_off(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing())
    torque = rig.bus.torque

    def interrupted(on: bool) -> None:
        torque(on)
        if on:
            raise KeyboardInterrupt

    monkeypatch.setattr(rig.bus, "torque", interrupted)
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    assert not rig.bus.torque_on


def test_a_failure_with_a_servo_that_keeps_its_torque_says_so() -> None:
    rig = Rig(swing(), faults=(MockFault(FaultKind.MISSING, first=25, cycles=FOR_EVER, servo=2),))

    def broken(done: int) -> None:
        if done == 30:
            raise OSError("no terminal")

    with refuses(TorqueError, "r_sho_roll"):
        play(rig, Watch(broken, every=1))
    assert rig.bus.torque_on


def test_an_interrupt_while_it_comes_to_a_stand_switches_torque_off(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing())
    write, count = rig.bus.write, 0

    def torn(goals: ServoGoals) -> None:
        nonlocal count
        count += 1
        if count in (40, 42):
            raise KeyboardInterrupt
        write(goals)

    monkeypatch.setattr(rig.bus, "write", torn)
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    assert count == 42 and not rig.bus.torque_on and rig.guard.stop_reason is not None


def test_whatever_fails_in_switching_torque_off_the_record_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(swing())
    torque = rig.bus.torque

    def gone(on: bool) -> None:
        if not on:
            raise OSError("no such device")
        torque(on)

    monkeypatch.setattr(rig.bus, "torque", gone)
    ending = play(rig)
    assert ending.state == "stopped" and len(ending.record) > 50
    assert ending.reason == "no such device (torque could not be switched off: cut the power)"


def test_a_failure_during_the_approach_brakes_on_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(np.zeros((60, 20)) + np.linspace(-0.4, 0.4, 20))
    admit, path, refused, asked = rig.gate.admit, [], 0, 0

    def noted(goal: FloatArray) -> FloatArray:
        nonlocal refused
        path.append(admit(goal))
        refused += bool(np.abs(path[-1] - goal).max() > 0.0)
        return path[-1]

    def broken() -> bool:
        nonlocal asked
        asked += 1
        if asked == 60:
            raise OSError("no terminal")
        return False

    monkeypatch.setattr(rig.gate, "admit", noted)
    with refuses(OSError):
        play(rig, Watch(stop_asked=broken))
    assert refused == 0 and len(path) > 60 and rig.gate.at_rest and not rig.bus.torque_on
    line = path[-1] - path[0]
    off = (np.array(path) - path[0]) @ (np.eye(20) - np.outer(line, line) / (line @ line))
    assert np.abs(off).max() < 1e-12


def test_what_the_gate_would_refuse_is_not_asked_where_the_robot_can_yield(monkeypatch: pytest.MonkeyPatch) -> None:
    """It follows the follower's stopping trajectory instead, from where it is; without one the goal is refused."""
    for knows_way, gated in ((True, False), (False, True)):
        rig = Rig(np.vstack([np.zeros((10, 20)), np.full((90, 20), 0.5)]))  # a leap that no gate sends
        rig.side._passes = rig.gate.passes
        halts: list[FloatArray] = []

        def halt(
            dt: float, rig: Rig = rig, halts: list[FloatArray] = halts, known: bool = knows_way
        ) -> FloatArray | None:
            halts.append(rig.follower.reseeded[-1])
            q = rig.side._before.copy()
            return q if known else None

        monkeypatch.setattr(rig.follower, "halt", halt)
        ending = play(rig)
        assert ending.record.robot is not None
        following = ending.record.following
        assert len(halts) >= 30 and ending.record.robot.gated[following].any() == gated
        stand = rig.robot.posture(rig.robot.profile.postures.stand)[rig.robot.servo_columns]
        np.testing.assert_allclose(halts[0], stand, atol=1e-9)


def test_a_posture_that_is_not_finite_is_a_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot brakes and stands, the guard holds, and only finite goals are sent."""
    script = 0.2 * swing()
    script[40:] = np.nan
    rig = Rig(script)
    states: list[GuardState] = []
    monkeypatch.setattr(rig.follower, "halt", lambda dt: None)
    ending = play(rig, Watch(on_tick=lambda done: states.append(rig.guard.state), every=1))
    assert GuardState.HOLDING in states and ending.record.robot is not None
    assert np.isfinite(ending.record.robot.q).all() and (ending.record.robot.goal_ticks >= 0).all()


def test_no_joint_is_faster_than_its_share_during_the_approach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(np.zeros((60, 20)))
    s = np.linspace(0.0, 1.0, 60)[:, None]
    rig.follower.script = (s**3 * (10.0 - 15.0 * s + 6.0 * s**2)) * np.linspace(-0.5, 0.5, 20)
    postures = [rig.follower._posture(tick) for tick in range(60)]
    rig.follower.script = rig.follower.script[-1:]
    monkeypatch.setattr(rig.follower, "start", lambda human: postures[0])
    monkeypatch.setattr(rig.follower, "settle", lambda human, dt: postures)
    ending = play(rig)
    assert ending.record.robot is not None
    path = ending.record.robot.q[ending.record.phase == Phase.APPROACH][:, rig.robot.servo_columns]
    share = np.abs(np.diff(path, axis=0)).max(axis=0) / (rig.robot.joint_map.max_velocity * rig.dt)
    cap = rig.robot.profile.safety.speed_caps.approach
    assert 0.9 * cap < share.max() <= cap * (1.0 + 1e-6)
    np.testing.assert_allclose(path[-1], postures[-1].joint_positions, atol=1e-12)
    assert ending.record.time[ending.record.following][0] == 0.0


def test_a_pause_during_the_approach_uses_up_no_tick_of_the_clip(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(np.zeros((60, 20)) + 0.3)
    looks = 0

    def look() -> bool:
        nonlocal looks
        looks += 1
        rig.guard.paused = 20 <= looks < 400
        return False

    ending = play(rig, Watch(stop_asked=look))
    phases, robot = ending.record.phase, ending.record.robot
    assert ending.state == "idle" and robot is not None
    assert np.count_nonzero(phases == Phase.FOLLOW) == len(short_clip(seconds=0.4))
    share = np.abs(np.diff(robot.q[:, rig.robot.servo_columns], axis=0)) / (rig.robot.joint_map.max_velocity * rig.dt)
    assert share.max() <= 0.3 and share[ending.record.following].max() < 1e-6


def test_a_forced_stop_does_not_wait_for_the_robot_to_stand() -> None:
    rig, asked = Rig(swing()), 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked == 30

    ending = play(rig, Watch(stop_asked=stop, torque_off_asked=lambda: asked == 30 and not rig.gate.at_rest))
    assert not rig.gate.at_rest and not rig.bus.torque_on
    assert ending.reason == f"{INTERRUPTED}, then: {FORCED_STOP} (torque is off)"
    assert len(ending.record) == 29


def test_a_forced_stop_after_a_failure_does_not_wait_either() -> None:
    rig = Rig(swing())

    def broken(done: int) -> None:
        if done == 20:
            raise OSError("no terminal")

    with refuses(OSError):
        play(rig, Watch(broken, torque_off_asked=lambda: True, every=1))
    assert not rig.gate.at_rest and not rig.bus.torque_on


@pytest.mark.parametrize("in_clip", [True, False])
def test_a_look_that_fails_while_it_brakes_is_raised_when_it_stands(in_clip: bool) -> None:
    """In a stop that was asked for, and in that of the failure."""
    rig, asked = Rig(swing()), 0

    def look() -> bool:
        nonlocal asked
        asked += 1
        if asked >= 30 and in_clip:
            raise OSError("no such drive")
        return asked >= 30

    def torque_off() -> bool:
        raise OSError("no such drive")

    with refuses(OSError):
        play(rig, Watch(stop_asked=look, torque_off_asked=torque_off))
    assert rig.gate.at_rest and not rig.bus.torque_on and rig.guard.stop_reason is not None


def test_a_lost_terminal_does_not_hinder_the_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, calls = Rig(swing()), 0

    def notify(text: str) -> None:
        nonlocal calls
        calls += 1
        raise BrokenPipeError

    monkeypatch.setattr(rig.side, "_notify", notify)
    monkeypatch.setattr(rig.guard.health.warnings, "take_news", lambda: ["it is warm"])
    ending = play(rig)
    assert calls > 40 and (ending.state, ending.reason) == ("idle", None)
    assert rig.gate.at_rest and not rig.bus.torque_on


def test_a_stop_that_comes_during_the_wait_for_a_tick_brakes_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop asked just after a poll is seen by the next one, a tick later, and nothing is followed any more."""
    rig, looked, stopped = Rig(swing()), list[float](), list[float]()
    stop = rig.guard.stop

    def noted(reason: str, cause: StopCause = StopCause.REQUESTED) -> None:
        stopped.append(rig.clock.now())
        stop(reason, cause)

    def asked() -> bool:
        looked.append(rig.clock.now())
        return len(looked) > 30

    times = times_of_writing(rig, monkeypatch)
    monkeypatch.setattr(rig.guard, "stop", noted)
    play(rig, Watch(stop_asked=asked))
    assert stopped[0] - looked[29] == pytest.approx(rig.dt) and stopped[0] == looked[30]
    assert min(time for time in times if time >= stopped[0]) - looked[29] < 1.5 * rig.dt
