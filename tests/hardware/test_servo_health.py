"""Faults in the servo states: each brakes the robot, with a reason that names the servo. Also warnings and buses."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus_rig import four_servos, waist_servos
from faulty_bus import FaultKind, FaultyBus, MockFault
from gates import displacement
from guard_rig import DT, MAP, Rig, moving, silent
from hardware.bus import ServoStates
from hardware.clock import VirtualClock
from hardware.errors import GuardError
from hardware.guard import CheckedGoal, Torque
from hardware.guard_state import GuardLimits, StopCategory, StopCause
from hardware.joint_map import JointMap
from hardware.servo_health import (
    CALM_S,
    HIGHEST_ERROR_RATE,
    MOST_NEWS,
    RAMP_S,
    BusHealth,
    ServoHealth,
    ServoLevels,
    ServoWarnings,
    WatchedRow,
    name_servos,
    watched,
)
from messages import shows


@pytest.fixture
def states() -> ServoStates:
    return Rig().bus.read()


def without(states: ServoStates, age: float, who: slice = slice(None)) -> ServoStates:
    valid, ages = states.valid.copy(), states.age.copy()
    valid[who], ages[who] = False, age
    return replace(states, valid=valid, age=ages)


def later(states: ServoStates) -> ServoStates:
    return replace(states, time=states.time + DT)


def judge(health: BusHealth, states: ServoStates) -> StopCategory | None:
    fault = health.silence(states)
    assert fault is None or (fault.cause is StopCause.BUS_SILENT and "bus" in fault.reason)
    return None if fault is None else fault.category


def test_a_silent_bus_is_held_at_once_and_lost_after_some_time(states: ServoStates) -> None:
    health = BusHealth(MAP, 0.05)
    assert judge(health, without(states, 0.005)) is StopCategory.HOLD
    assert judge(health, later(without(states, 0.05))) is StopCategory.HOLD
    assert judge(health, later(without(states, 0.051))) is StopCategory.TORQUE_OFF
    assert judge(health, states) is None
    for _ in range(2):  # a host that was held up: it answers in between
        assert judge(health, without(states, 9.0)) is StopCategory.HOLD
        assert judge(health, states) is None
    assert judge(health, without(states, 9.0)) is StopCategory.HOLD
    assert judge(health, later(without(states, 9.0))) is StopCategory.TORQUE_OFF


def test_a_bus_of_limbs_alone_is_held_for_and_never_costs_the_torque(states: ServoStates) -> None:
    divided = JointMap([replace(one, bus="legs" if place < 2 else "arms") for place, one in enumerate(MAP.servos)])
    health = ServoHealth(divided, replace(LIMITS, limbs=(False, False, True, True)))
    found = []
    for tick in range(12):
        now = replace(without(states, DT * (tick + 1), slice(2, None)), time=states.time + DT * tick)
        found.append(health.check(now, None))
    categories = [None if fault is None else fault.category for fault in found]
    assert categories == [StopCategory.HOLD] * 10 + [StopCategory.BRAKE_AND_TORQUE_OFF, None]
    assert found[10] is not None and found[10].cause is StopCause.LIMB_LOST
    hot = replace(without(states, 0.02, slice(2, None)), temperature=np.array([70.0, 30.0, 30.0, 30.0]))
    fault = ServoHealth(divided, LIMITS).check(hot, None)
    assert fault is not None and fault.cause is StopCause.TEMPERATURE, "a servo of the other bus"
    assert fault.category is StopCategory.BRAKE_AND_TORQUE_OFF


def test_the_share_of_cycles_with_an_answer_counts_from_the_first_silent_one(states: ServoStates) -> None:
    health = BusHealth(MAP, 0.05)
    for tick in range(100):
        health.silence(replace(states, time=DT * tick))
    assert health.answered == 1.0
    for tick in range(100, 300):
        now = replace(states, time=DT * tick)
        health.silence(without(now, DT) if tick % 4 == 0 else now)
    assert health.answered == pytest.approx(0.75)


@pytest.mark.parametrize("cycles", [1, 3, 4])
def test_a_short_silence_of_the_bus_is_held(cycles: int) -> None:
    rig = moving(*silent(0, 1, 2, 3, cycles=cycles))
    for _ in range(cycles):
        rig.run(1)
        assert rig.guard.is_silent and rig.guard.stop is None and rig.bus.torque_on
    rig.run(20)
    assert rig.guard.stop is None
    rig.check_goals()


def test_a_bus_that_is_silent_for_two_cycles_can_be_armed() -> None:
    rig = moving(*silent(0, 1, 2, 3, first=0, cycles=2), ticks=0)
    assert rig.guard.torque is Torque.ON and rig.bus.torque_on


def test_the_guard_switches_torque_off_when_a_bus_stays_silent() -> None:
    rig = moving(*silent(0, 1, 2, 3))
    assert rig.stopped() is None
    rig.run(round(0.05 / DT) + 2)
    assert rig.guard.torque is not Torque.ON
    assert rig.cause() is StopCause.BUS_SILENT
    assert rig.bus.calls[-1] == "torque off"


def test_the_guard_brakes_at_a_high_error_rate() -> None:
    rig = moving(ticks=30)
    with read_as(rig, lambda states: replace(states, error_rate=HIGHEST_ERROR_RATE - 0.01)):
        rig.run(1)
    assert rig.stopped() is None
    with read_as(rig, lambda states: replace(states, error_rate=0.75)):
        rig.run(1)
    assert rig.cause() is StopCause.BUS
    shows(rig.reason())
    rig.run(100)
    assert not displacement(rig.guard).any() and rig.guard.torque is Torque.ON
    rig.check_goals()


LIMITS = GuardLimits(max_age=0.1, max_temperature=65.0, voltage=(10.0, 14.8), following_error=0.35)


@pytest.mark.parametrize(
    ("kind", "value", "inside", "cause", "text"),
    [
        (FaultKind.HOT, 66, 65, StopCause.TEMPERATURE, "hotter than 65 degrees Celsius: shoulder (id 1) 66"),
        (FaultKind.SUPPLY, 9.9, 10, StopCause.VOLTAGE, "supply outside 10 to 14.8 V: shoulder (id 1) 9.9 V"),
        (FaultKind.SUPPLY, 15, 14.8, StopCause.VOLTAGE, "supply outside 10 to 14.8 V: shoulder (id 1) 15.0 V"),
        (FaultKind.STUCK, 0, 0, StopCause.FOLLOWING_ERROR, "more than 0.35 rad from its goal: shoulder (id 1) 0.3"),
    ],
)
def test_a_servo_out_of_bounds_stops_the_robot(
    kind: FaultKind, value: float, inside: float, cause: StopCause, text: str
) -> None:
    fault = MockFault(kind, first=20, cycles=1000, servo=0, value=value)
    rig = moving(fault, limits=LIMITS)
    assert rig.stopped() is None
    rig.run(100)
    assert rig.cause() is cause and text in rig.reason()
    assert not displacement(rig.guard).any() and rig.bus.torque_on
    rig.check_goals()
    within = replace(fault, value=inside, cycles=3 if kind is FaultKind.STUCK else 1000)
    assert moving(within, limits=LIMITS, ticks=60).stopped() is None
    assert moving(fault, ticks=60).stopped() is None, "unwatched"


SUSTAINED = GuardLimits(max_age=0.1, following_error=0.5, sustained_error=0.2, sustained_time=0.2)


def displaced(rig: Rig, by: float, ticks: int, goal: Callable[[], CheckedGoal] | None = None) -> None:
    """Ticks in which the first servo is `by` rad off its goal, which stands."""
    shift = np.array([round(by / float(MAP.tick_rad[0])), 0, 0, 0])
    with read_as(rig, lambda states: replace(states, position=states.position + shift)):
        rig.run(ticks, goal or rig.stand)


@contextmanager
def read_as(rig: Rig, change: Callable[[ServoStates], ServoStates]) -> Iterator[None]:
    """The bus reads something else meanwhile."""
    read = rig.bus.read
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rig.bus, "read", lambda: change(read()))
        yield


@pytest.mark.parametrize(("by", "ticks", "stopped"), [(0.21, 21, True), (0.21, 19, False), (0.19, 200, False)])
def test_a_following_error_that_lasts_stops_the_robot_in_time(by: float, ticks: int, stopped: bool) -> None:
    rig = moving(limits=SUSTAINED, ticks=0)
    rig.run(10, rig.stand)
    displaced(rig, by, ticks)
    stop = rig.guard.stop
    assert (stop is not None) == stopped
    if stop is not None:
        assert stop.cause is StopCause.FOLLOWING_ERROR
        assert stop.reason == "servo is more than 0.2 rad from its goal for 0.2 s: shoulder (id 1) 0.21 rad"


def test_following_errors_that_do_not_last_stop_nothing() -> None:
    rig = moving(limits=SUSTAINED, ticks=0)
    for _ in range(5):
        displaced(rig, 0.3, 15)
        displaced(rig, 0.0, 1)
    assert rig.stopped() is None
    displaced(rig, 0.51, 1)  # the larger bound is one at once
    shows(rig.reason(), "0.5")


def test_the_guard_measures_errors_from_where_goals_hold_the_joints() -> None:
    rig = moving(limits=SUSTAINED, ticks=0)
    off = np.array([round(0.3 / float(MAP.tick_rad[0])), 0, 0, 0])

    def loaded() -> CheckedGoal:
        last = rig.guard.goal
        assert last is not None
        goal = rig.gate.check(replace(last, posture=last.joints), last.joints)
        assert goal is not None
        made = replace(goal, posture=MAP.to_radians(MAP.to_ticks(goal.joints) + off))
        goal.seal.before, goal.seal.last = last, made
        return made

    displaced(rig, 0.3, 100, loaded)
    assert rig.stopped() is None
    displaced(rig, 0.0, 100, loaded)
    assert rig.cause() is StopCause.FOLLOWING_ERROR


def test_a_current_that_lasts_stops_the_robot() -> None:
    rig = moving(limits=GuardLimits(max_current=1e-6, current_time=0.1), ticks=60)
    assert rig.cause() is StopCause.CURRENT
    assert re.search(r"servo draws more than 1e-06 A for 0.1 s: shoulder \(id 1\) \d\.\d\d A", rig.reason())
    assert rig.bus.read().current[3] != rig.bus.read().current[3]  # the AX reports none, which is no fault


def test_a_servo_that_was_reset_is_never_driven_again_by_itself() -> None:
    rig = moving(limits=LIMITS, ticks=20)
    with read_as(rig, lambda states: replace(states, driven=np.array([True, False, True, True]))):
        rig.run(1)
    assert rig.cause() is StopCause.SERVO_LIMP
    rig.run(200)  # it reports that it is driven again, which changes nothing
    assert rig.cause() is StopCause.SERVO_LIMP and not displacement(rig.guard).any()
    rig.guard.release()
    with pytest.raises(GuardError):
        rig.arm()
    assert rig.bus.calls.count("torque on") == 1


@pytest.mark.parametrize(("kind", "quantity"), [(FaultKind.HOT, "temperature"), (FaultKind.SUPPLY, "voltage")])
def test_a_value_that_is_no_longer_known_stops_the_robot(kind: FaultKind, quantity: str) -> None:
    rig = moving(MockFault(kind, 20, 99, servo=1, value=float("nan")), limits=LIMITS, ticks=50)
    assert rig.cause() is StopCause.NOT_READ
    assert rig.guard.may_go_to_rest, "nothing is known to be wrong with a servo"
    shows(rig.reason())
    assert rig.reason().startswith(quantity) and "hotter" not in rig.reason()


def test_a_hot_servo_counts_more_than_one_that_is_not_read() -> None:
    unread = [MockFault(FaultKind.HOT, 20, 99, servo=servo, value=float("nan")) for servo in (0, 1, 3)]
    rig = moving(*unread, MockFault(FaultKind.HOT, 30, 99, servo=2, value=70.0), limits=LIMITS, ticks=50)
    assert rig.guard.stop is not None and rig.guard.stop.then is StopCause.TEMPERATURE
    assert not rig.guard.may_go_to_rest
    shows(rig.guard.stop.reason)
    never_read = MockFault(FaultKind.SUPPLY, 0, 999, servo=1, value=float("nan"))
    rig = moving(never_read, MockFault(FaultKind.HOT, 20, 999, servo=0, value=66.0), limits=LIMITS, ticks=50)
    assert rig.cause() is StopCause.TEMPERATURE


def test_of_a_coupled_pair_the_joints_count_and_what_a_load_explains_is_no_fault() -> None:
    joint_map = JointMap(waist_servos())
    bus = FaultyBus(joint_map.servos, VirtualClock(), start=joint_map.to_ticks(np.zeros(4)))
    bus.open()
    health = ServoHealth(joint_map, LIMITS)
    states = replace(bus.read(), driven=np.ones(4, dtype=np.bool_))
    # Both servos 0.9 rad off: the yaw by 0.38 rad (0.2083 of their sum), the roll not at all.
    off = np.array([0, 587, -587, 0])
    fault = health.check(states, states.position - off)
    assert fault is not None
    assert fault.reason == "servo is more than 0.35 rad from its goal: yaw (id 3) 0.38 rad"
    assert health.check(states, states.position - np.array([0, 587, 587, 0]) // 2) is None  # roll, 0.26 rad
    # Where one of the two is silent, nothing is known of either joint.
    one_silent = replace(states, valid=np.array([True, False, True, True]))
    assert health.check(one_silent, states.position - off) is None
    # A servo that is held beside its goal is where it is to be; one that is not held there, is off.
    at = joint_map.to_radians(states.position)
    goal = at + np.array([0.5, 0.0, 0.0, 0.0])
    sent = joint_map.to_ticks(goal)
    assert ServoHealth(joint_map, LIMITS).check(states, sent, at) is None
    for held in (None, goal, np.full(4, 1e3)):  # the last is beyond any travel, and explains nothing
        fault = ServoHealth(joint_map, LIMITS).check(states, sent, held)
        assert fault is not None
        shows(fault.reason, "0.50")


def test_patience_counts_what_lasts_of_each_servo() -> None:
    levels = ServoLevels([(0.0, 1.0)], [0.2], 2)
    seen = [np.array([row]) for row in ([2.0, 0.0], [2.0, 2.0], [2.0, 2.0], [2.0, 0.0], [2.0, 2.0])]
    found = [levels.beyond(row, 0.1 * tick).tolist()[0] for tick, row in enumerate(seen)]
    assert found == [[False, False], [False, False], [True, False], [True, False], [True, False]]
    assert levels.count
    levels.beyond(np.zeros((1, 2)), 0.5)
    assert not levels.count


WARNING_LIMITS = replace(
    GuardLimits(max_temperature=65.0, warn_temperature=60.0, voltage=(10.0, 14.8), warn_voltage=(11.0, 14.0)),
    warn_current=1.5,
    current_time=0.5,
    warn_following_error=0.1,
    warn_age=0.025,
)


def warnings() -> tuple[ServoWarnings, np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    rows = watched(WARNING_LIMITS)
    seen = np.zeros((len(rows), len(MAP)))
    seen[WatchedRow.TEMPERATURE], seen[WatchedRow.VOLTAGE] = 40.0, 12.0
    return ServoWarnings(MAP.servos, rows, WARNING_LIMITS.slow_share), seen


def test_a_warm_servo_slows_the_robot_to_half_within_the_limit_and_is_reported_once() -> None:
    rig = moving(MockFault(FaultKind.HOT, 20, 300, servo=1, value=61.0), limits=WARNING_LIMITS, ticks=0)
    slows, news = [], []
    for _ in range(600):
        rig.run(1, rig.stand)
        slows.append(rig.guard.health.warnings.speed_override)
        news += rig.guard.health.warnings.take_news()
    assert rig.guard.stop is None
    assert news == [
        "warning: servo is hotter than 60 degrees Celsius: elbow (id 2) 61; the robot goes at 50% of its speed",
        news[-1],
    ]
    assert news[-1].startswith("over: servo is hotter than 60 degrees Celsius: elbow (id 2)")
    begun, half = slows.index(next(slow for slow in slows if slow < 1.0)), slows.index(0.5)
    assert 18 <= begun <= 21 and (half - begun) * DT <= RAMP_S
    assert np.abs(np.diff(slows)).max() <= 0.5 * DT / RAMP_S + 1e-9
    assert slows[-1] == 1.0
    # Back at full speed no sooner than all was calm for a while.
    assert next(tick for tick in range(half, 600) if slows[tick] > 0.5) >= 320 + round(CALM_S / DT) - 1


def test_a_temperature_at_its_level_does_not_begin_and_end_all_the_time_and_news_are_bounded() -> None:
    warned, seen = warnings()
    for tick in range(2000):
        seen[WatchedRow.TEMPERATURE, 0] = 61.0 if tick // 50 % 2 else 59.0
        warned.look(seen, tick * DT)
    assert len(warned.take_news()) == 1 and warned.speed_override == 0.5
    warned, seen = warnings()
    for tick in range(3 * MOST_NEWS):
        seen[WatchedRow.VOLTAGE] = 12.0 if tick % 2 else 10.5
        warned.look(seen, 2.0 * tick)
    assert len(warned.take_news()) == MOST_NEWS


@pytest.mark.parametrize(
    ("row", "value", "slows"),
    [(WatchedRow.VOLTAGE, 10.5, False), (WatchedRow.AGE, 0.05, False), (WatchedRow.CURRENT, 1.6, True)],
)
def test_only_what_heat_is_about_slows(row: WatchedRow, value: float, slows: bool) -> None:
    warned, seen = warnings()
    seen[row, 2] = value
    for tick in range(150):
        warned.look(seen, tick * DT)
    assert (warned.speed_override == 0.5) == slows
    (text,) = warned.take_news()
    assert "waist (id 3)" in text and ("of its speed" in text) == slows


@given(st.lists(st.tuples(st.floats(20.0, 90.0), st.floats(0.0, 0.1)), min_size=1, max_size=60))
@settings(max_examples=60, deadline=None)
def test_the_speed_never_jumps(readings: list[tuple[float, float]]) -> None:
    warned, seen = warnings()
    now, before = 0.0, 1.0
    for temperature, elapsed in readings:
        now += elapsed
        seen[WatchedRow.TEMPERATURE, 3] = temperature
        warned.look(seen, now)
        assert 0.5 <= warned.speed_override <= 1.0
        assert abs(warned.speed_override - before) <= 0.5 * elapsed / RAMP_S + 1e-12
        before = warned.speed_override


def test_all_servos_are_named_as_such() -> None:
    rows = watched(GuardLimits())

    def named(row: WatchedRow, *values: float) -> str:
        servos = four_servos()[: len(values)]
        return name_servos(servos, rows[row], np.ones(len(servos), dtype=bool), np.array(values))

    assert named(WatchedRow.VOLTAGE, 10.2, 10.2, 10.2, 10.2) == "all 4 servos 10.2 V"
    assert named(WatchedRow.VOLTAGE, 10.2, 10.1, 10.2, 10.1) == "all 4 servos 10.1 V and 10.2 V"
    assert named(WatchedRow.TEMPERATURE, 63.0, 60.0, 61.0, 62.0) == "all 4 servos 60 to 63"
    assert named(WatchedRow.AGE, 1.0, 1.0, 1.0, 1.0) == "all 4 servos"
    assert named(WatchedRow.VOLTAGE, 10.2, 10.2, 10.2).count("(id") == 3
