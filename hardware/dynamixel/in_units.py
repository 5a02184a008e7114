"""Counts of a servo's registers as people say them."""

import math

from hardware.bus_spec import RETURN_DELAY_STEP
from hardware.dynamixel.baud_codes import baud_of
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.settings import MODES

TICKS = frozenset(("homing_offset", "min_position_limit", "max_position_limit", "cw_angle_limit", "ccw_angle_limit"))
"""Registers whose counts are ticks of the shaft."""


def in_units(table: ControlTable, name: str, value: int) -> str:
    """What `value` counts mean: in SI units or words, angles in degrees; "" where the count says it all."""
    if name == "baud_rate":
        return str(baud_of(table, value) or "")
    if name == "return_delay_time":
        return f"{1e6 * RETURN_DELAY_STEP * value:.0f} us"
    if name == "operating_mode":
        return next((mode.value for mode, code in MODES.items() if code == value), "")
    if name in ("drive_mode", "startup_configuration", "shutdown", "alarm_led"):
        return f"0x{value:02x}"
    register = table[name]
    if register.scale is None or register.unit is None:
        return ""
    if name in TICKS and register.unit == "rad":
        return f"{math.degrees(value * register.scale):.1f} deg"
    return f"{value * register.scale:.4g} {register.unit}"
