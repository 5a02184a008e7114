"""Torque of servos whose registers could not be read, or whose model has no table here: all have it at one place."""

from collections.abc import Iterable, Sequence

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.register import Register
from hardware.dynamixel.servo_error import NoAnswer, ServoError

TORQUE_ENABLE = {
    1: Register("torque_enable", 24, 1, False, True, None, None, 0, 1, 0),
    2: Register("torque_enable", 64, 1, False, True, None, None, 0, 1, 0),
}
"""By protocol (AX, MX; X)."""
CONTROLLERS = frozenset((0x7400,))
"""Model numbers of devices that are no servos: OpenCR."""


def is_controller(found: Found) -> bool:
    """Whether it has no torque to switch."""
    return found.model in CONTROLLERS


def tell_off(line: BusLine, ids: Iterable[int]) -> None:
    """Tell servos to switch their torque off; nobody answers. Raises BusError when the port is gone."""
    line.write_all(TORQUE_ENABLE[line.spec.protocol], [(device, 0) for device in ids])


def not_limp(line: BusLine, ids: Sequence[int]) -> list[int]:
    """Those with torque, and those that do not say. Raises BusError when the port is gone."""
    return [device for device in ids if _torque(line, device) != 0]


def _torque(line: BusLine, device: int) -> int | None:
    try:
        return line.client.read(device, TORQUE_ENABLE[line.spec.protocol])
    except (NoAnswer, ServoError):
        return None
