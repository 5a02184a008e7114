"""Faults that the servos' states show: each stops the robot along a braking way, with a reason that names the servo."""

import re
from dataclasses import replace

import numpy as np
import pytest

from guard_rig import MAP, Rig
from hardware.arrays import FloatArray
from hardware.bus import ServoStates
from hardware.clock import VirtualClock
from hardware.errors import GuardError
from hardware.guard_state import GuardLimits, GuardState, StopCause
from hardware.joint_map import JointMap
from hardware.servo_health import ServoHealth
from retarget.profile import load_profile
from servos import waist_servos
from sim.mock_bus import MockBus
from sim.mock_faults import FaultKind, MockFault
from support.messages import refuses, shows

LIMITS = GuardLimits(max_age=0.1, max_temperature=65.0, voltage=(10.0, 14.8), following_error=0.35)

FAULTS = {
    "hot": (FaultKind.HOT, 66.0, StopCause.TEMPERATURE, "hotter than 65 degrees Celsius: shoulder (id 1) 66"),
    "low": (FaultKind.SUPPLY, 9.9, StopCause.VOLTAGE, "supply outside 10 to 14.8 V: shoulder (id 1) 9.9 V"),
    "high": (FaultKind.SUPPLY, 15.0, StopCause.VOLTAGE, "supply outside 10 to 14.8 V: shoulder (id 1) 15.0 V"),
    "stuck": (FaultKind.STUCK, 0.0, StopCause.FOLLOWING_ERROR, "more than 0.35 rad from its goal: shoulder (id 1) 0.3"),
}


@pytest.mark.parametrize("case", list(FAULTS))
def test_a_servo_out_of_bounds_stops_the_robot(case: str) -> None:
    kind, value, cause, text = FAULTS[case]
    rig = Rig(MockFault(kind, first=20, cycles=1000, servo=0, value=value), limits=LIMITS)
    rig.guard.arm()
    rig.run(19)
    assert rig.state() is GuardState.MOVING
    rig.run(100)
    assert rig.state() is GuardState.STOPPED
    stop = rig.guard.stop_reason
    assert stop is not None and stop.cause is cause
    assert text in stop.reason
    assert rig.gate.at_rest and rig.bus.torque_on
    rig.check_goals()


@pytest.mark.parametrize("case", list(FAULTS))
def test_within_bounds_or_unwatched_nothing_stops(case: str) -> None:
    kind, value, _, _ = FAULTS[case]
    inside = {"hot": 65.0, "low": 10.0, "high": 14.8, "stuck": 0.0}[case]
    short = MockFault(kind, first=20, cycles=3 if case == "stuck" else 1000, servo=0, value=inside)
    for rig in (Rig(short, limits=LIMITS), Rig(MockFault(kind, 20, 1000, servo=0, value=value))):
        rig.guard.arm()
        rig.run(60)
        assert rig.state() is GuardState.MOVING


@pytest.mark.parametrize("case", ["hot", "low", "high"])
def test_a_servo_out_of_bounds_is_not_armed(case: str) -> None:
    kind, value, _, text = FAULTS[case]
    rig = Rig(MockFault(kind, first=0, cycles=9, servo=0, value=value), limits=LIMITS)
    with refuses(GuardError) as refusal:
        rig.guard.arm()
    assert text in str(refusal.value)
    assert rig.bus.calls == ["torque off"]


def test_a_silent_servo_is_lost_and_not_far_from_its_goal() -> None:
    """What it said last is old: it says nothing about where it is."""
    fault = MockFault(FaultKind.MISSING, first=20, cycles=1000, servo=0)
    rig = Rig(fault, limits=GuardLimits(max_age=0.1, following_error=0.1))
    rig.guard.arm()
    rig.run(100)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.SERVO_LOST


LASTING = GuardLimits(max_age=0.1, following_error=0.5, lasting_error=0.2, lasting_time=0.2)


def displaced(rig: Rig, by: float, ticks: int) -> None:
    """Ticks in which the first servo is `by` rad off its goal, which stands."""
    read = rig.bus.read

    def off() -> ServoStates:
        states = read()
        position = states.position.copy()
        position[0] += round(by / float(MAP.tick_rad[0]))
        return replace(states, position=position)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rig.bus, "read", off)
        rig.run(ticks, lambda _: rig.gate.position)


@pytest.mark.parametrize(("by", "ticks", "stopped"), [(0.21, 21, True), (0.21, 19, False), (0.19, 200, False)])
def test_a_following_error_that_lasts_stops_the_robot_in_time(by: float, ticks: int, stopped: bool) -> None:
    rig = Rig(limits=LASTING)
    rig.guard.arm()
    rig.run(10, lambda _: rig.gate.position)
    displaced(rig, by, ticks)
    stop = rig.guard.stop_reason
    assert (stop is not None) == stopped
    if stop is not None:
        assert stop.cause is StopCause.FOLLOWING_ERROR
        assert stop.reason == "servo is more than 0.2 rad from its goal for 0.2 s: shoulder (id 1) 0.21 rad"


def test_following_errors_that_do_not_last_stop_nothing() -> None:
    rig = Rig(limits=LASTING)
    rig.guard.arm()
    for _ in range(5):
        displaced(rig, 0.3, 15)
        displaced(rig, 0.0, 1)
    assert rig.state() is GuardState.MOVING
    displaced(rig, 0.51, 1)  # the larger bound is one at once
    assert rig.guard.stop_reason is not None
    shows(rig.guard.stop_reason.reason, "0.5")


def test_a_current_that_lasts_stops_the_robot() -> None:
    rig = Rig(limits=GuardLimits(max_current=1e-6, current_time=0.1))
    rig.guard.arm()
    rig.run(60)
    stop = rig.guard.stop_reason
    assert stop is not None and stop.cause is StopCause.CURRENT
    assert re.search(r"servo draws more than 1e-06 A for 0.1 s: shoulder \(id 1\) \d\.\d\d A", stop.reason)
    assert rig.bus.read().current[3] != rig.bus.read().current[3]  # the AX tells none, and is not complained of


def test_a_servo_that_was_reset_is_never_driven_again_by_itself() -> None:
    rig = Rig(limits=LIMITS)
    rig.guard.arm()
    rig.run(20)
    read, whole = rig.bus.read, rig.bus.calls.count("torque on")

    def reset() -> ServoStates:
        states = read()
        return replace(states, driven=np.array([True, False, True, True]))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rig.bus, "read", reset)
        rig.run(1)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.SERVO_LIMP
    rig.run(200)  # it says that it is driven again: nobody asks
    assert rig.state() is GuardState.STOPPED
    with pytest.raises(GuardError):
        rig.guard.arm()
    assert rig.bus.calls.count("torque on") == whole == 1


@pytest.mark.parametrize(("seconds", "stopped"), [(0.09, False), (0.11, True)])
def test_a_goal_that_comes_too_late_is_not_sent(seconds: float, stopped: bool) -> None:
    rig = Rig(limits=LIMITS)
    rig.guard.arm()
    rig.run(20)
    speed = float(np.abs(rig.gate.velocity).max())

    def slow(states: ServoStates) -> FloatArray:
        rig.clock.advance(seconds)
        return rig.faster(states)

    rig.run(1, slow)
    assert (rig.state() is GuardState.STOPPING) == stopped
    assert (float(np.abs(rig.gate.velocity).max()) < speed) == stopped
    if stopped:
        assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.STALE_GOAL
        shows(rig.guard.stop_reason.reason, "0.11", "0.1")
        rig.run(100)
        rig.check_goals()


def test_a_reading_that_takes_too_long_makes_the_goal_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(limits=LIMITS)
    rig.guard.arm()
    rig.run(20)
    read, written = rig.bus.read, len(rig.bus.goals)
    speed = float(np.abs(rig.gate.velocity).max())

    def slow() -> ServoStates:
        rig.clock.advance(0.11)
        return read()

    monkeypatch.setattr(rig.bus, "read", slow)
    rig.run(1)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.STALE_GOAL
    assert len(rig.bus.goals) == written + 1 and float(np.abs(rig.gate.velocity).max()) < speed


@pytest.mark.parametrize(("seconds", "stopped"), [(0.08, False), (0.11, True)])
def test_a_pause_between_ticks_stops(seconds: float, stopped: bool) -> None:
    rig = Rig(limits=LIMITS)
    rig.guard.arm()
    rig.clock.advance(5.0)  # a robot that was only just armed may be held as long as one likes
    rig.run(20)
    rig.clock.advance(seconds)
    rig.run(1)
    assert (rig.state() is GuardState.STOPPING) == stopped
    if stopped:
        assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.STALE_GOAL
        shows(rig.guard.stop_reason.reason, "0.12", "0.1")
        rig.run(100)
        assert rig.state() is GuardState.STOPPED
        rig.check_goals()


def test_the_limits_are_those_of_the_profile() -> None:
    profile = load_profile("op3")
    safety, limits = profile.safety, profile.guard_limits()
    assert (limits.max_age, limits.max_temperature) == (safety.freshness, safety.temperature_c)
    assert (limits.voltage, limits.following_error) == (safety.voltage, safety.following_error)


@pytest.mark.parametrize(
    ("kind", "told"), [(FaultKind.HOT, "is hotter than .*not known"), (FaultKind.SUPPLY, "has a supply .*not known")]
)
def test_a_value_that_nobody_knows_stops_the_robot(kind: FaultKind, told: str) -> None:
    rig = Rig(MockFault(kind, 20, 99, servo=1, value=float("nan")), limits=LIMITS)
    rig.guard.arm()
    rig.run(50)
    assert rig.guard.stop_reason is not None
    assert re.search(told, rig.guard.stop_reason.reason)


def test_a_bus_that_never_tells_is_no_complaint() -> None:
    nothing = float("nan")
    faults = (MockFault(kind, 0, 999, servo=1, value=nothing) for kind in (FaultKind.HOT, FaultKind.SUPPLY))
    rig = Rig(*faults, limits=LIMITS)
    rig.guard.arm()
    rig.run(50)
    assert rig.state() is GuardState.MOVING


def test_of_a_coupled_pair_the_joints_count_not_the_servos() -> None:
    joint_map = JointMap(waist_servos())
    bus = MockBus(joint_map.servos, VirtualClock(), start=joint_map.to_ticks(np.zeros(4)))
    bus.open()
    health = ServoHealth(joint_map, LIMITS)
    states = replace(bus.read(), driven=np.ones(4, dtype=np.bool_))
    # Both servos 0.9 rad off: the yaw by 0.38 rad (0.2083 of their sum), the roll not at all.
    off = np.array([0, 587, -587, 0])
    complaint = health.complaint(states, states.position - off)
    assert complaint is not None
    assert complaint[1] == "servo is more than 0.35 rad from its goal: yaw (id 3) 0.38 rad"
    assert health.complaint(states, states.position - np.array([0, 587, 587, 0]) // 2) is None  # roll, 0.26 rad
    # Where one of the two is silent, nothing is known of either joint.
    silent = replace(states, valid=np.array([True, False, True, True]))
    assert health.complaint(silent, states.position - off) is None


def test_what_a_load_explains_is_no_fault() -> None:
    """A servo that is held beside its goal is where it is to be; one that is not held there, is off."""
    joint_map = JointMap(waist_servos())
    bus = MockBus(joint_map.servos, VirtualClock(), start=joint_map.to_ticks(np.zeros(4)))
    bus.open()
    states = replace(bus.read(), driven=np.ones(4, dtype=np.bool_))
    at = joint_map.to_radians(states.position)
    goal = at + np.array([0.5, 0.0, 0.0, 0.0])
    sent = joint_map.to_ticks(goal)
    assert ServoHealth(joint_map, LIMITS).complaint(states, sent, at) is None
    for held in (None, goal, np.full(4, 1e3)):  # the last is beyond any travel, and explains nothing
        complaint = ServoHealth(joint_map, LIMITS).complaint(states, sent, held)
        assert complaint is not None
        shows(complaint[1], "0.50")


def test_a_bus_that_tells_nothing_of_some_costs_nobody_else_a_warning() -> None:
    """Unknown values go along with known ones that are watched as ever."""
    rig = Rig(
        MockFault(FaultKind.SUPPLY, 0, 999, servo=1, value=float("nan")),
        MockFault(FaultKind.HOT, first=20, cycles=999, servo=0, value=66.0),
        limits=LIMITS,
    )
    rig.guard.arm()
    rig.run(50)
    assert rig.guard.stop_reason is not None and rig.guard.stop_reason.cause is StopCause.TEMPERATURE


def test_a_value_without_a_limit_is_not_missed() -> None:
    rig = Rig(MockFault(FaultKind.HOT, 20, 99, servo=1, value=float("nan")), limits=GuardLimits(voltage=(10.0, 14.8)))
    rig.guard.arm()
    rig.run(50)
    assert rig.state() is GuardState.MOVING
