"""What a profile wants in registers, by model and mode."""

from dataclasses import replace

import pytest

from bus_rig import bus_of, spec
from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.settings import (
    SILENCING,
    ServoImage,
    Setting,
    SetupRequest,
    eeprom_settings,
    full_drive,
    in_units,
    plan,
    ram_settings,
    settings_of,
)
from hardware.errors import HardwareError
from hardware.servo import ServoGains, ServoMode
from messages import refuses
from sim.emulator.robot_lines import devices_of


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("return_delay_time", 2, "4 us"),
        ("return_delay_time", 250, "500 us"),
        ("baud_rate", 3, "1000000"),
        ("baud_rate", 99, ""),
        ("operating_mode", 3, "position"),
        ("operating_mode", 16, ""),
        ("drive_mode", 9, "0x09"),
        ("homing_offset", 1024, "90.0 deg"),
        ("max_position_limit", 2048, "180.0 deg"),
        ("max_voltage_limit", 160, "16 V"),
        ("current_limit", 1000, "2.69 A"),
        ("id", 7, ""),
    ],
)
def test_values_of_an_xm430(name: str, value: int, text: str) -> None:
    assert in_units(find_table("XM430-W350", 2), name, value) == text


PLAIN = spec(1)
TABLE = find_table("XM430-W350", 2)


def named(settings: list[Setting]) -> dict[str, int]:
    return {setting.register.name: setting.value for setting in settings}


def image_of(model: str = "XM430-W350", protocol: int = 2, **values: int) -> ServoImage:
    """Of a servo as delivered, but for these registers."""
    (one,) = devices_of([spec(1, model)], protocols={"main": protocol})
    for name, value in values.items():
        one.memory.put(name, value)
    return ServoImage(one.table, bytes(one.memory.image))


def test_a_position_mode_limits_its_current_in_eeprom() -> None:
    servo, bus = replace(PLAIN, current_limit=0.3), bus_of([PLAIN])
    assert named(eeprom_settings(servo, bus, TABLE))["current_limit"] == 112
    assert named(eeprom_settings(replace(servo, current_limit=99.0), bus, TABLE))["current_limit"] == 1193
    by_current = replace(servo, mode=ServoMode.CURRENT_BASED_POSITION)
    assert "current_limit" not in named(eeprom_settings(by_current, bus, TABLE))
    assert named(ram_settings(by_current, image_of(pwm_limit=700)))["goal_pwm"] == 700


def test_only_gains_of_the_profile_are_set() -> None:
    servo = replace(PLAIN, gains=ServoGains(position_p=0, feedforward_2=7))
    assert named(ram_settings(servo, image_of())) == {
        "status_return_level": 2,
        "profile_acceleration": 0,
        "profile_velocity": 0,
        "position_p_gain": 0,
        "feedforward_2nd_gain": 7,
    }


@pytest.mark.parametrize(("amperes", "limit", "expected"), [(1.0, 1193, 372), (100.0, 1193, 1193), (1.0, 200, 200)])
def test_a_limited_current_is_the_drive_and_never_above_the_servo_s(amperes: float, limit: int, expected: int) -> None:
    servo = replace(PLAIN, mode=ServoMode.CURRENT_BASED_POSITION, current_limit=amperes)
    assert named([full_drive(servo, image_of(current_limit=limit, pwm_limit=885))]) == {"goal_current": expected}


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("MX-28", 1), ("AX-12A", 1)])
def test_nothing_but_writable_eeprom_is_ever_due(model: str, protocol: int) -> None:
    image = image_of(model, protocol)
    for register in image.table.registers:
        value = register.highest if register.highest is not None else register.widest
        try:
            due = plan(image, settings_of(image.table, SetupRequest(registers={register.name: value})))
        except HardwareError:
            continue
        assert register.writable and register.address < image.table.eeprom_end and register.name != SILENCING
        assert all(one.register == register and register.allows(one.value) for one in due)


def test_torque_locks_what_would_change_and_nothing_else() -> None:
    image = image_of(torque_enable=1)
    assert plan(image, settings_of(image.table, SetupRequest(new_id=1))) == []
    with refuses(HardwareError):
        plan(image, settings_of(image.table, SetupRequest(new_id=2)))
