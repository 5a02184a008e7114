"""Supply, current and heat of emulated servos."""

import pytest

from emulated import read_register, servo2, wrote
from sim.emulator.power import OVERLOAD_TIME, Electrics, Supply
from sim.servo_model import AMBIENT, HEAT_PER_AMPERE2, IDLE_CURRENT, LARGEST_CURRENT, SUPPLY_RESISTANCE


def electrics(supply: Supply | None = None) -> Electrics:
    return Electrics(supply or Supply(), 12.0, turn=0.0015, top=3000.0)


def test_servos_share_a_supply() -> None:
    supply = Supply()
    one, other = electrics(supply), electrics(supply)
    one.advance(1.0, 0.0, effort=-1.0, torque=True)
    assert one.current == pytest.approx(IDLE_CURRENT + LARGEST_CURRENT) and one.direction < 0.0
    sag = SUPPLY_RESISTANCE * (2 * IDLE_CURRENT + LARGEST_CURRENT)
    assert other.voltage == pytest.approx(12.0 - sag) and other.supplied == 1.0
    one.draw(0.0)
    assert other.voltage == pytest.approx(12.0 - SUPPLY_RESISTANCE * IDLE_CURRENT)


def test_current_heats_as_in_the_mock_bus() -> None:
    one = electrics()
    for step in range(1, 4000):
        one.advance(float(step), 0.0, effort=0.5, torque=True)
    current = IDLE_CURRENT + 0.5 * LARGEST_CURRENT
    assert one.warmth == pytest.approx(AMBIENT + HEAT_PER_AMPERE2 * current**2, abs=0.1)


def test_overload_needs_time_on_end() -> None:
    one = electrics()
    for share, effort in ((0.6, 0.9), (0.7, 0.1), (1.3, 0.9)):
        one.advance(share * OVERLOAD_TIME, 0.0, effort=effort, torque=True)
    assert not one.overloaded
    one.advance(1.8 * OVERLOAD_TIME, 0.0, effort=0.9, torque=True)
    assert one.overloaded


def test_registers_show_voltage_and_temperature() -> None:
    servo = servo2()
    assert read_register(servo, "present_input_voltage") == 120
    servo.supply(11.1, 0.0)
    servo.heat(55.4, 0.0)
    assert read_register(servo, "present_input_voltage") == 111 and read_register(servo, "present_temperature") == 55
    servo.supply(None, 0.0)
    servo.heat(None, 0.0)
    wrote(servo, shutdown=0, torque_enable=1)  # an overload takes no torque
    servo.jam(True, 0.0)
    wrote(servo, goal_position=4000)
    assert read_register(servo, "present_temperature", 1.0) == 25
    for minute in range(1, 11):
        read_register(servo, "present_temperature", 60.0 * minute)
    assert read_register(servo, "present_temperature", 601.0) > 40
