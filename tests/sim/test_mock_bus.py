"""The mock bus: a bus with servos that lag, round and fail on request."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bus_rig import four_servos
from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.bus import ServoAlert, ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.servo import ServoGains, loop_lag
from messages import refuses
from sim.mock_bus import MockBus
from sim.servo_model import saturated_lag

SERVOS = four_servos()
START = np.array([2048, 2100, 2048, 512])
GOAL = np.array([2548, 1900, 2048, 600])


def opened(*faults: MockFault, lag: float | None = None) -> tuple[FaultyBus, VirtualClock]:
    clock = VirtualClock()
    bus = FaultyBus(SERVOS, clock, lag=lag, faults=faults)
    bus.open()
    return bus, clock


def test_what_servos_say_can_be_set_for_a_while() -> None:
    hot, low = (MockFault(kind, 1, 1, servo=2, value=9.0) for kind in (FaultKind.HOT, FaultKind.SUPPLY))
    bus, _ = opened(hot, low)
    cycles = [bus.read() for _ in range(3)]
    assert [states.temperature[2] == 9.0 for states in cycles] == [False, True, False]
    assert [states.voltage[2] == 9.0 for states in cycles] == [False, True, False]
    assert cycles[1].temperature[1] > 20.0 and cycles[1].voltage[1] > 10.0


def test_its_servos_measure_no_current_voltage_and_temperature() -> None:
    bus = MockBus(SERVOS, clock := VirtualClock(), start=START)
    bus.open()
    bus.write(ServoGoals(GOAL))
    bus.torque(True)
    clock.advance(0.1)
    states = bus.read()
    assert states.velocity.any()
    assert np.isnan([states.current, states.voltage, states.temperature]).all()


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


# The lag with which a servo follows its goal.

LAG = np.array([0.045, 0.02, 0.1, 0.0])  # [s]
TOP = np.array([3140.0, 1000.0, 50.0, 800.0])  # [tick/s]


def test_two_halves_are_the_whole() -> None:
    error = np.array([600.0, -300.0, 40.0, -200.0])
    whole, speed = saturated_lag(error, lag=LAG, top=TOP, elapsed=0.3)
    half, _ = saturated_lag(error, lag=LAG, top=TOP, elapsed=0.15)
    rest, speed_after = saturated_lag(error - half, lag=LAG, top=TOP, elapsed=0.15)
    np.testing.assert_allclose(half + rest, whole, atol=1e-9)
    np.testing.assert_allclose(speed_after, speed, atol=1e-9)
    assert np.all(np.abs(speed) <= TOP)


def test_the_lag_of_a_loop() -> None:
    servo = four_servos()[0]

    def lag(protocol: int = 2, **gains: int) -> float:
        return loop_lag(replace(servo, gains=ServoGains(**gains), protocol=protocol))

    # 885 PWM at 885 * 128 / 800 = 141.6 ticks of error, 0.2172 rad; at 4.817 rad/s that is 45 ms.
    assert loop_lag(servo) == pytest.approx(0.0451, abs=1e-4)
    assert lag(position_p=1600) == pytest.approx(loop_lag(servo) / 2)
    assert lag(1, position_p=32) == lag(1) == pytest.approx(loop_lag(servo))  # another number for the same loop
    assert lag(1, position_p=16) == pytest.approx(2.0 * loop_lag(servo))
