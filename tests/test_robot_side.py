"""The robot's half of a tick: goals that keep their distance in time, and an end that leaves no torque on."""

import numpy as np
import pytest

from hardware.bus import ServoGoals
from hardware.errors import BusError, TorqueError
from hardware.guard_state import GuardState
from retarget.pipeline import Watch
from retarget.record import Phase
from retarget.rotations import FloatArray
from rig import Rig, play, short_clip
from sim.mock_faults import FaultKind, MockFault
from support.messages import refuses, shows

FOR_EVER = 10**6


def swing() -> FloatArray:
    """All joints set off smoothly, and go on."""
    return np.asarray(0.05 * (1.0 - np.cos(2.0 * np.pi * np.arange(100)[:, None] / 80)) * np.ones(20))


def times_of_writing(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """When anything goes onto the bus, s, filled while the rig plays."""
    times: list[float] = []
    write = rig.bus.write

    def noted(goals: ServoGoals) -> None:
        times.append(rig.clock.now())
        write(goals)

    monkeypatch.setattr(rig.bus, "write", noted)
    return times


@pytest.mark.parametrize(("stall", "reason"), [(0.05, None), (2.0, "no tick for 2 s, allowed 0.1 s")])
def test_what_was_missed_in_a_stall_is_not_caught_up_with(
    stall: float, reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(swing())
    times = times_of_writing(rig, monkeypatch)
    ending = play(rig, Watch(lambda done: rig.clock.advance(stall) if done == 20 else None, every=1))
    assert np.diff(times)[1:].min() > 0.999 * rig.dt
    assert (ending.state, ending.reason) == ("idle" if reason is None else "stopped", reason)


def test_a_servo_that_is_silent_in_the_end_is_told_to_a_person() -> None:
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
    with refuses(TorqueError) as told:
        play(rig)
    assert told.value.__cause__ is error and rig.bus.torque_on


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
    admit, way, refused, asked = rig.gate.admit, [], 0, 0

    def noted(goal: FloatArray) -> FloatArray:
        nonlocal refused
        way.append(admit(goal))
        refused += bool(np.abs(way[-1] - goal).max() > 0.0)
        return way[-1]

    def broken() -> bool:
        nonlocal asked
        asked += 1
        if asked == 60:
            raise OSError("no terminal")
        return False

    monkeypatch.setattr(rig.gate, "admit", noted)
    with refuses(OSError):
        play(rig, Watch(stop_asked=broken))
    assert refused == 0 and len(way) > 60 and rig.gate.at_rest and not rig.bus.torque_on
    line = way[-1] - way[0]
    off = (np.array(way) - way[0]) @ (np.eye(20) - np.outer(line, line) / (line @ line))
    assert np.abs(off).max() < 1e-12


def test_what_the_gate_would_refuse_is_not_asked_where_the_robot_can_yield(monkeypatch: pytest.MonkeyPatch) -> None:
    """It goes along the follower's way to a stop instead, from where it is; what has no such way is refused."""
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
    """The robot brakes and stands, the guard knows that nobody is followed, and nothing but numbers is sent."""
    script = 0.2 * swing()
    script[40:] = np.nan
    rig = Rig(script)
    states: list[GuardState] = []
    monkeypatch.setattr(rig.follower, "halt", lambda dt: None)
    ending = play(rig, Watch(on_tick=lambda done: states.append(rig.guard.state), every=1))
    assert GuardState.HOLDING in states and ending.record.robot is not None
    assert np.isfinite(ending.record.robot.q).all() and (ending.record.robot.goal_ticks >= 0).all()


def test_no_joint_is_faster_than_its_share_on_the_way_to_where_following_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(np.zeros((60, 20)))
    s = np.linspace(0.0, 1.0, 60)[:, None]
    rig.follower.script = (s**3 * (10.0 - 15.0 * s + 6.0 * s**2)) * np.linspace(-0.5, 0.5, 20)
    postures = [rig.follower._posture(tick) for tick in range(60)]
    rig.follower.script = rig.follower.script[-1:]
    monkeypatch.setattr(rig.follower, "start", lambda human: postures[0])
    monkeypatch.setattr(rig.follower, "arrive", lambda human, dt: postures)
    ending = play(rig)
    assert ending.record.robot is not None
    way = ending.record.robot.q[ending.record.phase == Phase.APPROACH][:, rig.robot.servo_columns]
    share = np.abs(np.diff(way, axis=0)).max(axis=0) / (rig.robot.joint_map.max_velocity * rig.dt)
    cap = rig.robot.profile.safety.speed_caps.approach
    assert 0.9 * cap < share.max() <= cap * (1.0 + 1e-6)
    np.testing.assert_allclose(way[-1], postures[-1].joint_positions, atol=1e-12)
    assert ending.record.time[ending.record.following][0] == 0.0


def test_a_pause_on_the_way_uses_up_nothing_of_what_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
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
