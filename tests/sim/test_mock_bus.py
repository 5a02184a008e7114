"""The mock bus: a bus with servos that lag, round and fail on request."""

from collections.abc import Callable

import numpy as np
import pytest

from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.bus import ServoAlert, ServoBus, ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from messages import refuses
from servos import four_servos, waist_servos

SERVOS = four_servos()
START = np.array([2048, 2100, 2048, 512])
GOAL = np.array([2548, 1900, 2048, 600])


def opened(*faults: MockFault, lag: float | None = None) -> tuple[FaultyBus, VirtualClock]:
    clock = VirtualClock()
    bus = FaultyBus(SERVOS, clock, lag=lag, faults=faults)
    bus.open()
    return bus, clock


def test_it_is_a_servo_bus() -> None:
    bus: ServoBus = opened()[0]
    states = bus.read()
    assert states.position.tolist() == START.tolist()
    assert states.valid.all()
    assert not states.age.any()
    assert np.isnan(states.current[3])  # an AX reports load, not current


def test_what_servos_say_can_be_set_for_a_while() -> None:
    hot, low = (MockFault(kind, 1, 1, servo=2, value=9.0) for kind in (FaultKind.HOT, FaultKind.SUPPLY))
    bus, _ = opened(hot, low)
    cycles = [bus.read() for _ in range(3)]
    assert [states.temperature[2] == 9.0 for states in cycles] == [False, True, False]
    assert [states.voltage[2] == 9.0 for states in cycles] == [False, True, False]
    assert cycles[1].temperature[1] > 20.0 and cycles[1].voltage[1] > 10.0


def test_a_stuck_shaft_stays_and_the_others_move() -> None:
    bus, clock = opened(MockFault(FaultKind.STUCK, 0, 2, servo=1))
    bus.write(ServoGoals(GOAL))
    bus.torque(True)
    bus.read()
    clock.advance(0.5)
    stuck = bus.read()
    assert stuck.position[1] == START[1] and stuck.velocity[1] == 0.0 and stuck.position[0] > START[0]
    bus.read()
    clock.advance(1.0)
    assert bus.read().position[1] < START[1]


def test_with_torque_off_nothing_moves_and_on_it_goes_to_the_old_goal() -> None:
    # As a real servo: the goal register keeps what it had. This is why the guard writes goals before torque.
    bus, clock = opened()
    clock.advance(1.0)
    assert bus.read().position.tolist() == START.tolist()
    bus.torque(True)
    clock.advance(1.0)
    assert bus.read().position[1] == 2048


def test_goals_are_approached_no_faster_than_the_servo_turns() -> None:
    bus, clock = opened()
    bus.write(ServoGoals(START))
    bus.torque(True)
    bus.write(ServoGoals(GOAL))
    before = bus.read().position
    for _ in range(100):
        clock.advance(0.008)
        states = bus.read()
        moved = np.abs(states.position - before) * [servo.model.tick_rad for servo in SERVOS]
        top = np.array([servo.model.no_load_speed for servo in SERVOS])
        assert np.all(moved <= top * 0.008 + 0.006)
        assert np.all(np.abs(states.velocity) <= top + 0.03)
        before = states.position
    assert before.tolist() == GOAL.tolist()


def test_how_often_it_is_read_does_not_matter() -> None:
    seldom, clock_of_seldom = opened()
    often, clock_of_often = opened()
    for bus in (seldom, often):
        bus.write(ServoGoals(GOAL))
        bus.torque(True)
    clock_of_seldom.advance(0.06)
    for _ in range(60):
        clock_of_often.advance(0.001)
        often.read()
    assert seldom.read().position.tolist() == often.read().position.tolist()


def test_a_missing_servo_keeps_its_last_values_and_ages() -> None:
    never, _ = opened(MockFault(FaultKind.MISSING, first=0, cycles=1, servo=2))
    assert never.read().age[2] == np.inf
    bus, clock = opened(MockFault(FaultKind.MISSING, first=1, cycles=2, servo=1), lag=0.0)
    bus.write(ServoGoals(GOAL))
    bus.torque(True)
    bus.read()
    ages = []
    for _ in range(3):
        clock.advance(0.02)
        states = bus.read()
        ages.append(states.age[1])
        if not states.valid[1]:
            assert states.position[1] == START[1]
        assert states.valid[[0, 2, 3]].all()
    assert ages == pytest.approx([0.02, 0.04, 0.0])
    assert states.position[1] < START[1]


def test_an_alert_stays_and_takes_the_torque() -> None:
    fault = MockFault(FaultKind.ALERT, first=1, cycles=1, servo=0, alert=ServoAlert.OVERLOAD)
    bus, clock = opened(fault, lag=0.0)
    bus.write(ServoGoals(START))
    bus.torque(True)
    bus.read()
    bus.write(ServoGoals(GOAL))
    for _ in range(3):
        clock.advance(0.1)
        states = bus.read()
        assert states.alert[0] == ServoAlert.OVERLOAD
        assert states.error[0] == 0x80
    assert states.position[0] < GOAL[0]
    assert states.position[1] == GOAL[1]
    bus.torque(True)
    clock.advance(1.0)
    assert bus.read().position[0] == states.position[0]


@pytest.mark.parametrize("ticks", [[4096, 0, 0, 0], [0, 0, 0, 1024], [-1, 0, 0, 0], [0, 0, 0]])
def test_ticks_that_no_servo_has_are_refused(ticks: list[int]) -> None:
    with refuses(BusError):
        opened()[0].write(ServoGoals(np.array(ticks)))


def test_a_dead_bus_raises_and_closing_switches_torque_off() -> None:
    bus, _ = opened(MockFault(FaultKind.READ_FAILS, first=0, cycles=1), MockFault(FaultKind.WRITE_FAILS, 1, 1))
    with refuses(BusError):
        bus.read()
    bus.read()
    with refuses(BusError):
        bus.write(ServoGoals(GOAL))
    bus.read()
    bus.write(ServoGoals(GOAL))
    bus.torque(True)
    bus.close()
    bus.close()
    assert not bus.torque_on
    with refuses(BusError):
        bus.read()


def test_a_servo_without_answer_to_torque_is_named_and_the_others_are_off() -> None:
    bus, clock = opened(MockFault(FaultKind.MISSING, first=1, cycles=9, servo=1))
    bus.read()
    bus.torque(True)
    clock.advance(0.01)
    bus.read()
    switches: tuple[Callable[[], None], ...] = (lambda: bus.torque(False), bus.close)
    for switch in switches:
        with refuses(BusError, "elbow", 2):
            switch()
    assert bus._torque.tolist() == [False, True, False, False]
    bus.close()  # is closed, and allowed


def test_servos_of_many_turns_take_goals_beyond_one() -> None:
    clock = VirtualClock()
    bus = FaultyBus(waist_servos(), clock)
    bus.open()
    goals = np.array([2048, -9000, 9000, 1500])
    bus.write(ServoGoals(goals))
    bus.torque(True)
    clock.advance(30.0)
    assert bus.read().position.tolist() == goals.tolist()
    with refuses(BusError):
        bus.write(ServoGoals(np.array([-1, 0, 0, 0])))
