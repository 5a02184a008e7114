"""Currents, voltages and temperatures stay plausible."""

import numpy as np
import pytest

from sim.servo_load import AMBIENT, HEAT_PER_AMPERE2, ServoLoad

ON = np.ones(3, dtype=np.bool_)
STILL = np.zeros(3)


def make() -> ServoLoad:
    return ServoLoad(np.full(3, 12.0), np.full(3, 4.8))


def test_a_servo_at_rest_draws_little() -> None:
    load = make()
    load.advance(before=STILL, after=STILL, torque=ON, elapsed=0.01)
    assert np.all(load.current < 0.05)
    assert np.all(load.voltage > 11.9)


def test_a_moving_servo_draws_more_and_the_supply_sags() -> None:
    load = make()
    load.advance(before=STILL, after=np.array([4.0, 0.0, 0.0]), torque=ON, elapsed=0.1)
    assert load.current[0] > 0.3
    assert load.current[1] == load.current[2] < 0.05
    assert np.all(load.voltage == load.voltage[0])
    assert load.voltage[0] < 12.0


def test_without_torque_there_is_no_drive() -> None:
    load = make()
    load.advance(before=STILL, after=np.full(3, 4.0), torque=~ON, elapsed=0.1)
    assert np.all(load.current < 0.05)


def test_heat_rises_to_its_final_value() -> None:
    load = make()
    fast = np.full(3, 4.0)
    for _ in range(10):
        load.advance(before=fast, after=fast, torque=ON, elapsed=1000.0)
    assert load.temperature == pytest.approx(AMBIENT + HEAT_PER_AMPERE2 * load.current**2)


def test_looks_within_a_moment_show_no_larger_current() -> None:
    """Ticks of a busy machine come at uneven times; the supply must not sag for that."""
    usual, late = make(), make()
    after = np.full(3, 0.3)
    usual.advance(before=STILL, after=after, torque=ON, elapsed=0.008)
    late.advance(before=STILL, after=after, torque=ON, elapsed=0.0005)
    assert np.all(late.current == usual.current)
    assert np.all(usual.current < 1.0)
