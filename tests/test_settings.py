"""What a profile wants in registers, by model and mode."""

from dataclasses import replace

import pytest

from bus_rig import bus_of, spec
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.settings import Setting, differing, eeprom_settings, full_drive, ram_settings
from hardware.servo import ServoGains, ServoMode

PLAIN = spec(1)
TABLE = find_table("XM430-W350", 2)


def named(settings: list[Setting]) -> dict[str, int]:
    return {setting.register.name: setting.value for setting in settings}


def image(**values: int) -> ServoImage:
    data = bytearray(TABLE["present_temperature"].end)
    for name, value in values.items():
        register = TABLE[name]
        data[register.address : register.end] = register.encode(value)
    return ServoImage(TABLE, bytes(data))


@pytest.mark.parametrize(("mode", "value"), list(zip(ServoMode, (3, 4, 5), strict=True)))
def test_eeprom_holds_mode_and_delay(mode: ServoMode, value: int) -> None:
    servo, bus = replace(PLAIN, mode=mode), replace(bus_of([PLAIN]), return_delay=20e-6)
    assert named(eeprom_settings(servo, bus, TABLE)) == {"return_delay_time": 10, "operating_mode": value}


def test_a_position_mode_limits_its_current_in_eeprom() -> None:
    servo, bus = replace(PLAIN, current_limit=0.3), bus_of([PLAIN])
    assert named(eeprom_settings(servo, bus, TABLE))["current_limit"] == 112
    assert named(eeprom_settings(replace(servo, current_limit=99.0), bus, TABLE))["current_limit"] == 1193
    by_current = replace(servo, mode=ServoMode.CURRENT_BASED_POSITION)
    assert "current_limit" not in named(eeprom_settings(by_current, bus, TABLE))
    assert named(ram_settings(by_current, image(pwm_limit=700)))["goal_pwm"] == 700


def test_an_mx_64_follows_positions_not_torques() -> None:
    table = find_table("MX-64", 1)
    assert named(ram_settings(spec(1, "MX-64"), ServoImage(table, bytes(table.size))))["torque_ctrl_mode_enable"] == 0


def test_protocol_1_keeps_its_answers_in_eeprom() -> None:
    table = find_table("AX-12A", 1)
    assert named(eeprom_settings(PLAIN, bus_of([PLAIN], protocol=1), table)) == {
        "return_delay_time": 0,
        "status_return_level": 2,
    }
    assert named(ram_settings(PLAIN, ServoImage(table, bytes(60)))) == {"moving_speed": 0}


def test_only_gains_of_the_profile_are_set() -> None:
    servo = replace(PLAIN, gains=ServoGains(position_p=0, feedforward_2=7))
    assert named(ram_settings(servo, image())) == {
        "status_return_level": 2,
        "profile_acceleration": 0,
        "profile_velocity": 0,
        "position_p_gain": 0,
        "feedforward_2nd_gain": 7,
    }


def test_what_is_there_is_not_due() -> None:
    settings = ram_settings(replace(PLAIN, gains=ServoGains(position_p=640)), image())
    held = image(status_return_level=2, position_p_gain=640, profile_velocity=5)
    assert named(differing(settings, held)) == {"profile_velocity": 0}


@pytest.mark.parametrize(("amperes", "limit", "expected"), [(1.0, 1193, 372), (100.0, 1193, 1193), (1.0, 200, 200)])
def test_a_limited_current_is_the_drive_and_never_above_the_servo_s(amperes: float, limit: int, expected: int) -> None:
    servo = replace(PLAIN, mode=ServoMode.CURRENT_BASED_POSITION, current_limit=amperes)
    assert named([full_drive(servo, image(current_limit=limit, pwm_limit=885))]) == {"goal_current": expected}


def test_the_drive_of_a_position_mode_is_its_pwm_limit() -> None:
    assert named([full_drive(PLAIN, image(pwm_limit=700, current_limit=5))]) == {"goal_pwm": 700}
