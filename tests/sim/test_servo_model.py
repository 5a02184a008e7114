"""Currents, voltages and temperatures stay plausible."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.servo import ServoGains, loop_lag
from servos import four_servos
from sim.servo_model import AMBIENT, HEAT_PER_AMPERE2, ServoLoad, saturated_lag

ON = np.ones(3, dtype=np.bool_)
STILL = np.zeros(3)


def make() -> ServoLoad:
    return ServoLoad(np.full(3, 12.0), np.full(3, 4.8))


def test_a_moving_servo_draws_more_than_one_at_rest_and_the_supply_sags() -> None:
    load = make()
    load.advance(before=STILL, after=STILL, torque=ON, elapsed=0.01)
    assert np.all(load.current < 0.05) and np.all(load.voltage > 11.9)
    load.advance(before=STILL, after=np.array([4.0, 0.0, 0.0]), torque=ON, elapsed=0.1)
    assert load.current[0] > 0.3 and load.current[1] == load.current[2] < 0.05
    assert np.all(load.voltage == load.voltage[0]) and load.voltage[0] < 12.0
    load.advance(before=STILL, after=np.full(3, 4.0), torque=~ON, elapsed=0.1)
    assert np.all(load.current < 0.05)  # without torque there is no drive


def test_heat_rises_to_its_final_value() -> None:
    load = make()
    fast = np.full(3, 4.0)
    for _ in range(10):
        load.advance(before=fast, after=fast, torque=ON, elapsed=1000.0)
    assert load.temperature == pytest.approx(AMBIENT + HEAT_PER_AMPERE2 * load.current**2)


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
        return loop_lag(replace(servo, gains=ServoGains(**gains)), protocol=protocol)

    # 885 PWM at 885 * 128 / 800 = 141.6 ticks of error, 0.2172 rad; at 4.817 rad/s that is 45 ms.
    assert loop_lag(servo) == pytest.approx(0.0451, abs=1e-4)
    assert lag(position_p=1600) == pytest.approx(loop_lag(servo) / 2)
    assert lag(1, position_p=32) == lag(1) == pytest.approx(loop_lag(servo))  # another number for the same loop
    assert lag(1, position_p=16) == pytest.approx(2.0 * loop_lag(servo))
