"""Supply, current and heat of emulated servos."""

import pytest

from emulated import read_register, servo2, wrote
from sim.emulator.power import Electrics, Supply
from sim.servo_model import IDLE_CURRENT, LARGEST_CURRENT, SUPPLY_RESISTANCE


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
