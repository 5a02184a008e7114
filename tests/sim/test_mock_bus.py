"""The mock bus: a bus with servos that lag and round."""

from dataclasses import replace

import numpy as np
import pytest

from bus_rig import four_servos
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.errors import BusError
from hardware.servo import ServoGains, loop_lag
from messages import refuses
from sim.mock_bus import MockBus
from sim.servo_model import saturated_lag

SERVOS = four_servos()
START = np.array([2048, 2100, 2048, 512])
GOAL = np.array([2548, 1900, 2048, 600])


def test_goals_are_approached_no_faster_than_the_servo_turns_and_nothing_else_is_measured() -> None:
    bus = MockBus(SERVOS, clock := VirtualClock(), start=START)
    bus.open()
    bus.write(ServoGoals(START))
    bus.torque(True)
    bus.write(ServoGoals(GOAL))
    before = bus.read().position
    top = np.array([servo.model.no_load_speed for servo in SERVOS])
    for tick in range(100):
        clock.advance(0.008)
        states = bus.read()
        assert states.velocity.any() or tick > 20
        assert np.isnan([states.current, states.voltage, states.temperature]).all()
        moved = np.abs(states.position - before) * [servo.model.tick_rad for servo in SERVOS]
        assert np.all(moved <= top * 0.008 + 0.006)
        assert np.all(np.abs(states.velocity) <= top + 0.03)
        before = states.position
    assert before.tolist() == GOAL.tolist()
    bus.close()
    bus.close()
    assert not bus.torque_on
    with refuses(BusError):
        bus.read()


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
