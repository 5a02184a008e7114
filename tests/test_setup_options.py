"""What no servo can hold is refused before a port is opened, by the name of its option."""

import pytest

from hardware.dynamixel.control_table import tables
from hardware.dynamixel.setup_plan import setting_of
from hardware.errors import HardwareError
from retarget.cli.servo.setup_options import Asked, check_asked, check_device, registers_of
from retarget.errors import UsageError
from support.messages import refuses

X, AX = "XM430-W350", "AX-12A"


@pytest.mark.parametrize(
    ("asked", "protocol", "model", "text"),
    [
        (Asked(new_id=254), None, None, "--new-id: no servo has this id; found 254; allowed: 0 to 252"),
        (Asked(new_id=-1), None, X, "--new-id"),
        (Asked(return_delay=3), None, None, "--return-delay: no servo has this pause; found 3 us"),
        (Asked(return_delay=510), 2, X, "allowed: 0 to 508 us, even"),
        (Asked(return_delay=float("nan")), 2, X, "found nan us"),
        (Asked(baud=77), None, None, "--baud: no such speed"),
        (Asked(baud=4_500_000), 1, None, "--baud: no such speed"),
        (Asked(baud=4_500_000), 2, "XL330-M288", "--baud: no such baud rate for XL330-M288"),
        (Asked(drive_mode=300), None, None, "--drive-mode: no such drive_mode; found 300"),
        (Asked(drive_mode=-1), 2, X, "--drive-mode"),
        (Asked(drive_mode=0), 1, AX, "--drive-mode: no such register"),
        (Asked(registers={"goal_position": 1}), None, None, "--register: no such register; found 'goal_position'"),
        (Asked(registers={"protocol_type": 1}), 2, X, "--register: no such register"),
        (Asked(registers={"max_position_limit": 4096}), 2, X, "allowed: 0 to 4095"),
        (Asked(registers={"baud_rate": 1}), 2, X, "found baud_rate; allowed: --baud"),
        (Asked(registers={"status_return_level": 1}), 2, X, "--register: no such register"),
    ],
)
def test_refused(asked: Asked, protocol: int | None, model: str | None, text: str) -> None:
    assert asked.anything
    with pytest.raises(UsageError) as caught:
        check_asked(asked, protocol, model)
    assert text in str(caught.value)


def test_whatever_some_servo_takes_passes() -> None:
    for table in tables():
        for register in table.registers:
            for value in {register.initial, register.lowest, register.highest} - {None}:
                try:
                    setting_of(table, register.name, value or 0)
                except HardwareError:
                    continue
                for protocol, model in ((None, None), (table.protocol, table.model)):
                    check_asked(Asked(registers={register.name: value or 0}), protocol, model)


def test_sound_options_pass() -> None:
    everything = Asked(252, 57_600, 508, 5, {"shutdown": 52, "status_return_level": 2})
    check_asked(everything, 2, X)
    check_asked(everything, None, None)
    assert everything.all_registers == {"shutdown": 52, "status_return_level": 2, "drive_mode": 5}
    assert not Asked().anything and registers_of(["a=0x10", " b =-2"]) == {"a": 16, "b": -2}


@pytest.mark.parametrize(
    ("device", "protocol", "fine"), [(252, 2, True), (253, 2, False), (253, 1, True), (254, 1, False)]
)
def test_ids(device: int, protocol: int, fine: bool) -> None:
    if fine:
        check_device(device, protocol)
        return
    with refuses(UsageError, "--id", 254):
        check_device(device, protocol)
