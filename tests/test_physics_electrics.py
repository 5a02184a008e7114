"""Heat, supply and alerts."""

import numpy as np
import pytest

from hardware.bus import ServoAlert
from physics_rig import op3
from sim.physics.electrics import HEAT_PER_WATT, Electrics
from sim.physics.motors import Drive
from sim.physics.world import robot_drives
from sim.servo_load import AMBIENT, HEAT_PER_AMPERE2, HEAT_TIME

DRIVES: tuple[Drive, ...] = robot_drives(op3())
COUNT = len(DRIVES)
ON = np.ones(COUNT, dtype=np.bool_)


def load(value: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    torque = np.zeros(COUNT)
    torque[3] = value
    return torque


def test_a_servo_warms_to_its_final_rise_and_cools_again() -> None:
    electrics = Electrics(DRIVES)
    current = electrics.current(load(1.0), ON)[3]
    final = AMBIENT + HEAT_PER_WATT * DRIVES[3].numbers.resistance * current**2
    electrics.advance(load(1.0), ON, HEAT_TIME)
    assert electrics.temperature[3] - AMBIENT == pytest.approx((final - AMBIENT) * (1.0 - np.exp(-1.0)))
    assert electrics.temperature[4] == AMBIENT
    electrics.advance(load(1.0), ON, 100 * HEAT_TIME)
    assert electrics.temperature[3] == pytest.approx(final)
    electrics.advance(load(0.0), ON, 100 * HEAT_TIME)
    assert electrics.temperature[3] == pytest.approx(AMBIENT)


def test_heat_is_of_the_size_of_the_mock_bus() -> None:
    electrics = Electrics(DRIVES)
    current = electrics.current(load(1.0), ON)[3]
    electrics.advance(load(1.0), ON, 100 * HEAT_TIME)
    assert electrics.temperature[3] - AMBIENT == pytest.approx(HEAT_PER_AMPERE2 * current**2, rel=0.5)


def test_the_supply_sags_and_the_motors_hear_of_it() -> None:
    electrics = Electrics(DRIVES)
    before = electrics.voltage.copy()
    assert not electrics.advance(load(0.0), ON, 0.01)
    assert electrics.advance(np.full(COUNT, 1.5), ON, 0.01)
    assert (electrics.voltage < before).all()


def test_too_much_for_too_long_is_an_overload() -> None:
    electrics = Electrics(DRIVES)
    most = DRIVES[3].most_torque
    for _ in range(99):
        electrics.advance(load(0.9 * most), ON, 0.01)
    assert not electrics.alert.any()
    electrics.advance(load(0.0), ON, 0.01)  # a breath
    for _ in range(99):
        electrics.advance(load(0.9 * most), ON, 0.01)
    assert not electrics.alert.any()
    for _ in range(3):
        electrics.advance(load(0.9 * most), ON, 0.01)
    assert electrics.alert[3] == ServoAlert.OVERLOAD and not electrics.alert[4]


def test_too_hot_is_an_alert_that_stays() -> None:
    electrics = Electrics(DRIVES)
    electrics.temperature[5] = 200.0
    assert electrics.advance(load(0.0), ON, 1e-3)
    assert electrics.alert[5] == ServoAlert.OVERHEATING
    electrics.advance(load(0.0), ON, 1e6)
    assert electrics.alert[5] == ServoAlert.OVERHEATING and electrics.temperature[5] < 30.0
