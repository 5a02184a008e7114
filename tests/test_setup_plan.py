"""What a servo's EEPROM is to hold: all of it is checked before anything is written."""

import pytest

from bus_rig import bus_of, spec
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.setup_plan import SILENCING, plan, setup_command
from hardware.errors import HardwareError
from sim.emulator.workshop import devices_of
from support.messages import refuses


def _image(model: str = "XM430-W350", protocol: int = 2, **values: int) -> ServoImage:
    (one,) = devices_of([spec(1, model)], protocols={"main": protocol})
    for name, value in values.items():
        one.memory.put(name, value)
    return ServoImage(one.table, bytes(one.memory.image))


def test_id_and_speed_come_last_and_what_is_so_already_is_left_out() -> None:
    image = _image()
    due = plan(image, new_id=9, baud=1_000_000, return_delay=0.0, registers={"shutdown": 53, "drive_mode": 0})
    assert [(one.register.name, one.value) for one in due] == [
        ("shutdown", 53),
        ("return_delay_time", 0),
        ("id", 9),
        ("baud_rate", 3),
    ]
    assert plan(image, new_id=1, registers={"drive_mode": 0}) == []


@pytest.mark.parametrize(("model", "protocol"), [("XM430-W350", 2), ("MX-28", 1), ("AX-12A", 1)])
def test_nothing_but_writable_eeprom_is_ever_due(model: str, protocol: int) -> None:
    image = _image(model, protocol)
    for register in image.table.registers:
        value = register.highest if register.highest is not None else register.widest
        try:
            due = plan(image, registers={register.name: value})
        except HardwareError:
            continue
        assert register.writable and register.address < image.table.eeprom_end and register.name != SILENCING
        assert all(one.register == register and register.allows(one.value) for one in due)


def test_torque_locks_what_would_change_and_nothing_else() -> None:
    image = _image(torque_enable=1)
    assert plan(image, new_id=1) == []
    with refuses(HardwareError):
        plan(image, new_id=2)


@pytest.mark.parametrize("delay", [-1e-6, 510e-6])
def test_a_delay_that_no_servo_has_is_refused(delay: float) -> None:
    with refuses(HardwareError):
        plan(_image(), return_delay=delay)


def test_a_command_is_what_a_person_types() -> None:
    bus = bus_of([spec(1)])
    assert setup_command(bus, 3, {"drive_mode": 4, "shutdown": 53}) == (
        "`retarget servo setup --port /dev/main --id 3 --register drive_mode=4 --register shutdown=53`"
    )
    assert setup_command(bus, 3, baud=57_600) == "`retarget servo setup --port /dev/main --id 3 --baud 57600`"
