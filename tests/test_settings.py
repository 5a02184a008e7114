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
    servo, bus = replace(PLAIN, mode=mode, current_limit=1.0), replace(bus_of([PLAIN]), return_delay=20e-6)
    assert named(eeprom_settings(servo, bus, TABLE)) == {"return_delay_time": 10, "operating_mode": value}


def test_protocol_1_keeps_its_answers_in_eeprom() -> None:
    table = find_table("AX-12A", 1)
    assert named(eeprom_settings(PLAIN, bus_of([PLAIN], protocol=1), table)) == {
        "return_delay_time": 0,
        "status_return_level": 2,
    }
    assert named(ram_settings(PLAIN, table)) == {"moving_speed": 0}


def test_only_gains_of_the_profile_are_set() -> None:
    servo = replace(PLAIN, gains=ServoGains(position_p=0, feedforward_2=7))
    assert named(ram_settings(servo, TABLE)) == {
        "status_return_level": 2,
        "profile_acceleration": 0,
        "profile_velocity": 0,
        "position_p_gain": 0,
        "feedforward_2nd_gain": 7,
    }


def test_what_is_there_is_not_due() -> None:
    settings = ram_settings(replace(PLAIN, gains=ServoGains(position_p=640)), TABLE)
    held = image(status_return_level=2, position_p_gain=640, profile_velocity=5)
    assert named(differing(settings, held)) == {"profile_velocity": 0}


@pytest.mark.parametrize(("amperes", "limit", "expected"), [(1.0, 1193, 372), (100.0, 1193, 1193), (1.0, 200, 200)])
def test_a_limited_current_is_the_drive_and_never_above_the_servo_s(amperes: float, limit: int, expected: int) -> None:
    servo = replace(PLAIN, mode=ServoMode.CURRENT_BASED_POSITION, current_limit=amperes)
    assert named([full_drive(servo, image(current_limit=limit, pwm_limit=885))]) == {"goal_current": expected}


def test_the_drive_of_a_position_mode_is_its_pwm_limit() -> None:
    assert named([full_drive(PLAIN, image(pwm_limit=700, current_limit=5))]) == {"goal_pwm": 700}
