"""Interrupts, failures and stops of a run: no step is doubled, the soles stay planted, and no torque is left on."""

from dataclasses import replace
from typing import Any, cast
from unittest.mock import Mock

import numpy as np
import pytest

from faulty_bus import FaultKind, MockFault
from gates import displacement, sent
from hardware.bus import ServoAlert
from hardware.errors import BusError, GuardError, HardwareError, TorqueError
from hardware.guard import CUT_POWER, CheckedGoal, Torque
from hardware.guard_state import StopCause
from messages import refuses, shows
from operators import ENOUGH, Asks
from planted import failing
from retarget.human.samples import Clip
from retarget.run.controllers import RETRY_S, rest_joints
from retarget.run.loop import STOOD_S, Operator, Progress, RowObserver, RunObserver
from retarget.run.record import Phase, TickRecorder
from retarget.run.rest_trajectory import EndPlan
from retarget.run.supervisor import FORCED_STOP, LONGEST_TO_REST_S, End, OperatorInput
from retarget.safety.standing import StandingCheck
from retarget.types import FloatArray, HumanPosture, RobotPosture, RunState
from rig import Rig, gentle_stop, play, short_clip

FOR_EVER = 10**6
COUNT = 4096 / (2.0 * np.pi)


SWING = 0.05 * (1.0 - np.cos(2.0 * np.pi * np.arange(100)[:, None] / 80)) * np.ones(20)
"""All joints set off smoothly, and go on."""


STILL = np.zeros((60, 20))


def fail_to_switch_off(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, times: int, error: BaseException | None = None
) -> None:
    """The first calls that switch torque off are interrupted, or fail, before they reach a servo."""
    error = KeyboardInterrupt() if error is None else error
    monkeypatch.setattr(rig.bus, "torque", failing(rig.bus.torque, error, range(2, 2 + times)))  # on, then off


MOVING = 140
"""A write in which the joints of `swing` are fastest."""


def assert_no_doubled_step(rig: Rig) -> None:
    """A step that is doubled would be an acceleration beyond the limit, by more than the rounding to ticks."""
    changes = np.abs(np.diff(rig.robot.joint_map.to_radians(np.array(rig.bus.written)), n=2, axis=0))
    assert (changes <= rig.robot.joint_map.max_acceleration * rig.dt**2 + 2.5 / COUNT).all()


# Interrupts between the check of a goal and its writing.


@pytest.mark.parametrize("where", ["before the guard has it", "when the bus has it", "when the guard has it"])
def test_an_interrupt_beside_a_write_doubles_no_step(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(SWING)
    part = rig.bus if "the bus" in where else rig.guard
    write, count = part.write, 0

    def torn(goal: Any) -> None:
        nonlocal count
        count += 1
        if count != MOVING or "before" not in where:
            write(goal)
        if count == MOVING:
            raise KeyboardInterrupt

    monkeypatch.setattr(part, "write", torn)
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    assert not displacement(rig.guard).any() and not rig.bus.torque_on
    assert rig.guard.stop is not None and rig.guard.stop.reason == "KeyboardInterrupt", "nothing else has failed"
    fastest, moved = np.abs(np.diff(SWING, axis=0)).max(), np.abs(np.diff(rig.bus.written, axis=0)).max() / COUNT
    assert fastest / 2.0 < moved < fastest + 1.5 / COUNT


@pytest.mark.parametrize("ticks", [(MOVING,), (MOVING, MOVING + 1), (MOVING, MOVING + 2)])
def test_an_interrupted_write_doubles_no_step_and_leaves_no_torque(
    ticks: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first interrupt brakes the robot; a second one switches torque off."""
    rig = Rig(SWING)
    monkeypatch.setattr(rig.bus, "write", failing(rig.bus.write, KeyboardInterrupt(), ticks))
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    assert rig.guard.stop is not None and rig.guard.stop.cause is StopCause.REQUESTED
    assert not rig.bus.torque_on and displacement(rig.guard).any() != (len(ticks) == 1)
    assert_no_doubled_step(rig)


@pytest.mark.parametrize("failures", [1, 2])
def test_a_goal_that_no_servo_takes_doubles_no_step(failures: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot brakes from the goal before; one that is not understood again costs the torque."""
    rig = Rig(SWING)
    joint_map = rig.robot.joint_map
    beyond = failing(joint_map.to_ticks, HardwareError("beyond the servo's travel"), range(MOVING, MOVING + failures))
    monkeypatch.setattr(joint_map, "to_ticks", beyond)
    ending = play(rig)
    assert rig.guard.stop is not None and rig.guard.stop.cause is StopCause.FILTER
    assert ending.state is (RunState.OFF if failures == 1 else RunState.FAULT) and not rig.bus.torque_on
    assert displacement(rig.guard).any() != (failures == 1)
    assert_no_doubled_step(rig)


# The beginning and the end of torque.


@pytest.mark.parametrize("error", [BusError("port gone"), KeyboardInterrupt("port gone")])
def test_a_start_that_leaves_torque_on_says_so(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(SWING)
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


def test_a_servo_that_is_silent_at_the_end_is_reported() -> None:
    rig = Rig(SWING)
    play(rig)
    last = len(rig.bus.read_at) - 2
    rig = Rig(SWING, faults=(MockFault(FaultKind.MISSING, first=last, cycles=FOR_EVER, servo=2),))
    ending = play(rig)
    assert rig.bus.torque_on and ending.state is RunState.FAULT
    shows(ending.reason, "r_sho_roll")


@pytest.mark.parametrize("calls", [1, 2])
def test_an_interrupt_of_the_last_torque_off_leaves_no_torque(calls: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(STILL)
    fail_to_switch_off(rig, monkeypatch, calls)
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    assert not rig.bus.torque_on and rig.guard.torque is Torque.OFF


def lose_port(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig.bus, "write", failing(rig.bus.write, BusError("the port is gone"), [41]))


def test_an_interrupt_while_torque_goes_off_after_a_failure_leaves_none_and_keeps_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(SWING)
    fail_to_switch_off(rig, monkeypatch, 1)
    lose_port(rig, monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    stop = rig.guard.stop
    assert not rig.bus.torque_on and rig.guard.torque is Torque.OFF
    assert stop is not None and stop.cause is StopCause.BUS and not stop.powered
    shows(stop.reason, "the port is gone")


def test_torque_off_that_is_interrupted_for_ever_says_that_the_power_is_to_be_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(SWING)
    fail_to_switch_off(rig, monkeypatch, FOR_EVER)
    lose_port(rig, monkeypatch)
    with refuses(TorqueError, "the port is gone"):
        play(rig)
    assert rig.guard.stop is not None and rig.guard.stop.powered


def test_torque_that_is_off_at_the_second_try_is_reported_as_off(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(SWING)
    lose_port(rig, monkeypatch)
    unconfirmed = BusError("l_el did not confirm that torque is off", then="Cut the power by hand")
    fail_to_switch_off(rig, monkeypatch, 1, unconfirmed)
    ending = play(rig)
    assert not rig.bus.torque_on and rig.guard.stop is not None and not rig.guard.stop.powered
    assert CUT_POWER not in (ending.reason or "")
    shows(ending.reason)


@pytest.mark.parametrize("at_reading", [True, False])
def test_an_interrupt_of_arming_leaves_no_torque_of_an_earlier_process(
    at_reading: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(SWING)
    rig.bus.torque(True)
    part, method = (rig.bus, "read") if at_reading else (rig.gate, "begin")
    monkeypatch.setattr(part, method, Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        play(rig)
    assert not rig.bus.torque_on and rig.guard.torque is Torque.OFF


class Troubled:
    """A clip that fails in every tick from one on, in what the loop calls or looks at, or that the operator pauses."""

    def __init__(self, *, fails: str = "", first: int = 0, paused: range = range(0), seconds: float = 0.4) -> None:
        self._clip, self._fails, self._left = short_clip(seconds=seconds), fails, first
        self._paused, self._tick, self.held = paused, -1, 0

    def __getattr__(self, name: str) -> Any:
        if name == self._fails:
            self._left -= 1
            if self._left < 0:
                raise OSError("no such drive")
        return getattr(self._clip, name)

    @property
    def paused(self) -> bool:
        return self._tick in self._paused

    def poll(self) -> None:
        self._tick += 1
        self.__getattr__("poll")()

    def may_approach(self) -> bool:
        return not self.paused

    def hold(self) -> None:
        """Is told of each hold that is not its own."""
        self.held += 1


@pytest.mark.parametrize("what", ["stop", "torque_off", "poll", "over"])
def test_a_look_that_fails_again_and_again_leads_to_rest_all_the_same(what: str) -> None:
    """Something that only looks at the run, or asks for its stop."""
    rig, looks = Rig(SWING, goes_to_rest=True), iter([False] * 20)
    broken, clip = failing(lambda *_: False, OSError("no such drive"), range(31, FOR_EVER)), None
    operator = Asks(lambda: next(looks, True), broken) if what == "torque_off" else Asks(broken)
    if what in ("poll", "over"):
        operator, clip = Asks(), cast("Clip", Troubled(fails=what, first=30, seconds=0.6))
    ending = rig.loop(clip, operator).run()
    expected = ENOUGH if what == "torque_off" else "no such drive"
    assert (ending.state, ending.reason) == (RunState.OFF, expected) and not rig.bus.torque_on
    np.testing.assert_allclose(sent(rig.guard), rest_joints(rig.robot), atol=1e-9)


@pytest.mark.parametrize(
    ("script", "method", "state", "reason"),
    [
        (STILL, "return_to_stance", RunState.RETURN_TO_STANCE, None),
        (SWING, "pass_time", RunState.STOPPING, "it broke"),
    ],
)
def test_a_failure_on_the_way_to_rest_or_one_that_comes_back_while_the_robot_stops_does_not_keep_it_under_torque(
    script: FloatArray, method: str, state: RunState, reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, failed = Rig(script, goes_to_rest=True), 0
    usual = getattr(rig.follower, method)

    def fails(dt: float) -> Any:
        nonlocal failed
        if rig.supervisor.state is not state:
            return usual(dt)
        failed += 1
        raise ArithmeticError("it broke")

    monkeypatch.setattr(rig.follower, method, fails)
    ending = play(rig)
    assert (ending.state, ending.reason) == (RunState.OFF, reason)
    if reason is None:
        shows(rig.notes, "it broke")
    assert len(rig.follower.returns) == 1 and (failed > 1) is (reason is not None)
    np.testing.assert_allclose(sent(rig.guard), rest_joints(rig.robot), atol=1e-9)


# Failures and stops while the robot moves.


def test_a_posture_that_is_not_finite_is_a_hold() -> None:
    """The robot brakes and stands, and only finite goals are sent."""
    script = 0.2 * SWING
    script[40:] = np.nan
    rig, states, clip = Rig(script), list[RunState](), Troubled()
    seen = Progress(lambda done: states.append(rig.supervisor.state), every=1)
    record = rig.loop(cast("Clip", clip), observers=[seen]).run().record
    assert clip.held >= 3 and RunState.HOLD in states
    assert np.isfinite(record.q).all() and (record.goal_ticks >= 0).all()


def test_a_pause_during_the_approach_uses_up_no_tick_of_the_clip() -> None:
    rig = Rig(STILL + 0.3)
    ending = rig.loop(cast("Clip", Troubled(paused=range(20, 900)))).run()
    phases = ending.record.phase
    assert ending.state is RunState.OFF
    assert np.count_nonzero(phases == Phase.FOLLOW) == len(short_clip(seconds=0.4))
    assert np.count_nonzero(phases == Phase.APPROACH) > 900, "a hold is part of what it holds up"
    share = np.abs(np.diff(ending.record.goals, axis=0)) / (rig.robot.joint_map.max_velocity * rig.dt)
    assert share.max() <= 0.3 and share[ending.record.following].max() < 1e-6


def test_a_forced_stop_after_an_interrupt_does_not_wait_either() -> None:
    rig = Rig(SWING)
    interrupted = failing(lambda done: None, KeyboardInterrupt(), [20])
    with pytest.raises(KeyboardInterrupt):
        play(rig, Asks(torque_off=lambda: True), Progress(interrupted, every=1))
    assert displacement(rig.guard).any() and not rig.bus.torque_on


def test_a_control_that_fails_for_ever_does_not_hide_that_torque_is_to_go_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C was pressed twice."""
    rig, operator = Rig(SWING, goes_to_rest=True), Operator()
    monkeypatch.setattr(operator, "poll", Mock(side_effect=OSError("no such pedal")))
    monkeypatch.setattr(operator, "requested", lambda: OperatorInput(torque_off=True))
    ending = play(rig, operator)
    assert ending.state is RunState.FAULT and not rig.bus.torque_on and ending.reason is not None
    assert ending.reason.startswith("no such pedal") and FORCED_STOP in ending.reason


def test_torque_goes_off_where_it_is_asked_for_though_every_tick_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, asked = Rig(STILL, goes_to_rest=True), iter([False] * 3000 + [True] * 100)
    rig.machine = replace(rig.machine, waits=True)
    monkeypatch.setattr(rig.bus, "read", failing(rig.bus.read, ValueError("no number"), range(120, FOR_EVER)))

    def is_asked() -> bool:
        if (asks := next(asked, None)) is None:
            raise GeneratorExit("the request was not heard")
        return asks

    ending = play(rig, Asks(torque_off=is_asked))
    assert not rig.bus.torque_on and ending.reason is not None and ending.reason.startswith("no number")


@pytest.mark.parametrize("kind", [Progress, RowObserver])
def test_an_observer_that_fails_is_dropped_and_the_robot_goes_on(kind: type[RunObserver]) -> None:
    broken = Mock(side_effect=OSError("no terminal"))
    observer = kind(broken)  # type: ignore[call-arg]
    ending = play(Rig(SWING), None, observer)
    assert (ending.state, ending.reason, broken.call_count) == (RunState.OFF, None, 1)
    assert observer.failure == "no terminal"


def test_a_tick_that_fails_twice_after_its_goal_was_written_brakes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, broken = Rig(SWING), list[float]()
    follow, keep = rig.follower.step, TickRecorder.keep_human

    def fails(human: HumanPosture, dt: float) -> RobotPosture:
        if rig.follower.tick == 12:
            broken.append(rig.clock.now())
            raise ArithmeticError("the stage broke")
        return follow(human, dt)

    def torn(*given: Any, **named: Any) -> None:
        keep(*given, **named)
        if broken == [rig.clock.now()]:
            raise IndexError("and what comes after it")

    monkeypatch.setattr(rig.follower, "step", fails)
    monkeypatch.setattr(TickRecorder, "keep_human", torn)
    ending = play(rig)
    assert broken and ending.state is RunState.OFF and not displacement(rig.guard).any() and not rig.bus.torque_on


def test_a_run_begins_once() -> None:
    rig = Rig(STILL)
    loop = rig.loop()
    loop.run()
    with refuses(GuardError):
        loop.run()
    assert not rig.bus.torque_on


@pytest.mark.parametrize("error", [BrokenPipeError(), ValueError("I/O operation on closed file")])
def test_a_lost_terminal_does_not_hinder_the_stop(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, notify = Rig(SWING), Mock(side_effect=error)
    rig.machine = replace(rig.machine, notify=notify)
    monkeypatch.setattr(rig.guard.health.warnings, "take_news", lambda: ["it is warm"])
    ending = play(rig)
    assert notify.call_count > 40 and (ending.state, ending.reason) == (RunState.OFF, None)
    assert not displacement(rig.guard).any() and not rig.bus.torque_on


# To rest.


@pytest.mark.parametrize("waits", [False, True])
def test_a_robot_that_cannot_go_to_rest_keeps_its_torque_until_the_operator_has_it(
    waits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A simulated one stands for a moment, and the run is over; a real one is waited for."""
    rig = Rig(STILL, goes_to_rest=True)
    rig.machine = replace(rig.machine, waits=waits)
    check, asked, began = rig.gate.check, 0, list[float]()

    def walled(
        last: CheckedGoal, target: FloatArray | None, *, standing: FloatArray | None = None
    ) -> CheckedGoal | None:
        nonlocal asked
        if rig.supervisor.state is not RunState.GO_TO_REST:
            return check(last, target, standing=standing)
        began.append(rig.clock.now())
        asked += target is not None
        return check(last, target, standing=standing) if asked <= 50 else None

    monkeypatch.setattr(rig.gate, "check", walled)
    stands_s = 10.0 * STOOD_S if waits else STOOD_S

    def held() -> bool:
        supervisor = rig.supervisor
        return supervisor.state is RunState.STANDING and rig.clock.now() - supervisor.since >= stands_s - 0.5 * rig.dt

    ending = play(rig, Asks(torque_off=held) if waits else None)
    shows(rig.notes)
    lasted = rig.clock.now() - began[0]
    assert lasted == pytest.approx(LONGEST_TO_REST_S + stands_s, abs=5 * rig.dt)
    assert 50 + 0.5 * LONGEST_TO_REST_S / (RETRY_S + rig.dt) < asked, "it tries again and again"
    assert ending.state is (RunState.OFF if waits else RunState.STANDING) and not displacement(rig.guard).any()
    assert rig.bus.torque_on is not waits
    shows(ending.reason)  # which is no success
    shows(ending.standing)


def test_a_fault_during_the_return_to_stance_brakes_on_the_soles(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the path that was planned with the last goal: joints alone would move its soles."""
    fault = MockFault(FaultKind.ALERT, 220, FOR_EVER, servo=12, alert=ServoAlert.OVERLOAD)
    rig = Rig(STILL, faults=(fault,), goes_to_rest=True)
    way, first = [rig.follower.stance.q] * 2, rig.robot.servo_columns[0]

    def led(dt: float) -> FloatArray:
        way.append(way[-1].copy())
        way[-1][first] += 0.3 * rig.dt
        return way[-1]

    monkeypatch.setattr(rig.follower, "return_to_stance", led)
    monkeypatch.setattr(rig.follower, "stop", lambda dt: gentle_stop(rig.robot, way[-2], way[-1], dt))
    rig.gate.standing = StandingCheck(rig.robot, rig.follower.stance, dt=rig.dt)
    ending = play(rig)
    record, stop = ending.record, gentle_stop(rig.robot, way[-2], way[-1], rig.dt).postures
    assert rig.guard.stop is not None and rig.guard.stop.cause is StopCause.SERVO_ALERT
    assert 2 <= len(stop) < 50 and not record.gated.any() and len(way) > 4
    last = np.flatnonzero((record.q == way[-1]).all(axis=1))[0]
    np.testing.assert_array_equal(record.q[last : last + len(stop)], stop)
    assert ending.state is RunState.FAULT and np.abs(sent(rig.guard) - rest_joints(rig.robot)).max() > 0.2


@pytest.mark.parametrize("kind", [FaultKind.ALERT, FaultKind.MISSING])
@pytest.mark.parametrize("first", [20, 140, 220])
def test_a_faulty_robot_does_not_go_to_rest(kind: FaultKind, first: int) -> None:
    """While it follows, or on the way to rest: the robot brakes and stands."""
    fault = MockFault(kind, first, FOR_EVER, servo=12, alert=ServoAlert.OVERLOAD)
    rig = Rig(STILL, faults=(fault,), goes_to_rest=True)
    ending = play(rig)
    assert np.abs(sent(rig.guard) - rest_joints(rig.robot)).max() > 0.2 and ending.state is RunState.FAULT
    assert rig.guard.stop is not None and not displacement(rig.guard).any()
    assert rig.guard.stop.cause in (StopCause.SERVO_ALERT, StopCause.SERVO_LOST)
    assert rig.machine.not_at_rest() == () and not ending.standing, "it stays, and the reason says so"


WHY = "for this test"


@pytest.mark.parametrize("waits", [False, True])
def test_an_interrupted_run_that_is_to_end_standing_stands_and_is_over(waits: bool) -> None:
    """A simulated robot for a moment, a real one until the next interrupt."""
    rig = Rig(STILL, goes_to_rest=True)
    rig.machine = replace(rig.machine, waits=waits, end_plan=EndPlan(End.STANDING, why=WHY))
    ticks, stood = 0, 0

    def interrupts() -> bool:
        nonlocal ticks, stood
        ticks, stood = ticks + 1, stood + (rig.supervisor.state is RunState.STANDING)
        if ticks == 60 or (waits and stood == 2000):
            raise KeyboardInterrupt
        return False

    with pytest.raises(KeyboardInterrupt):
        play(rig, Asks(interrupts, interrupts))
    assert stood == (2000 if waits else pytest.approx(STOOD_S / rig.dt, abs=2)) and not rig.bus.torque_on
    assert not [note for note in rig.notes if WHY in note], "it is said once, at the end"
