"""What a servo's registers say against driving it."""

from dataclasses import replace

import pytest

from bus_rig import bus_of, spec
from hardware.bus import ServoAlert
from hardware.dynamixel.checks import alert_text, complaints
from hardware.dynamixel.servo_image import ServoImage
from hardware.servo import ServoMode
from sim.emulator.servo import EmulatedServo
from sim.emulator.workshop import devices_of

PLAIN = spec(1)


def said(mode: ServoMode = ServoMode.POSITION, **values: int) -> list[str]:
    (one,) = devices_of([PLAIN], protocols={"main": 2})
    assert isinstance(one, EmulatedServo)
    memory = one.memory
    for name, value in {"present_input_voltage": 120, **values}.items():
        memory.put(name, value)
    image = ServoImage(one.table, bytes(memory.image[: one.table["present_temperature"].end]))
    return complaints(replace(PLAIN, mode=mode, current_limit=1.0), bus_of([PLAIN]), image)


def test_a_servo_as_delivered_may_be_driven() -> None:
    assert said() == []


@pytest.mark.parametrize(("volts", "fine"), [(94, False), (95, True), (160, True), (161, False)])
def test_the_supply_is_held_against_the_servo_s_own_limits(volts: int, fine: bool) -> None:
    assert (said(present_input_voltage=volts) == []) == fine


def test_time_based_profiles_are_no_harm() -> None:
    assert said(drive_mode=4) == []
    assert len(said(drive_mode=0x0B)) == 3


def test_limits_of_the_position_count_in_position_mode_alone() -> None:
    assert len(said(max_position_limit=2500)) == 1
    assert said(ServoMode.EXTENDED_POSITION, max_position_limit=2500) == []


def test_every_alert_bit_has_a_name() -> None:
    for alert in ServoAlert:
        assert (alert.name or "?") in alert_text(alert)
    assert alert_text(0x42) == "0x42"
    assert alert_text(0x05).startswith("INPUT_VOLTAGE (supply")
