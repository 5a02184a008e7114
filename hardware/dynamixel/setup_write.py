"""One EEPROM value written and seen to be kept, also where the servo then answers elsewhere."""

from contextlib import suppress

from hardware.dynamixel.baud_codes import baud_of
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.line_scan import Speed
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.servo_error import NoAnswer
from hardware.dynamixel.settings import Setting
from hardware.errors import BusError, describe

TRIES = 3
SETTLE = 0.05
"""[s] That a servo is given to change its speed."""


def write_setting(
    port: BytePort, table: ControlTable, device: int, speed: Speed, setting: Setting
) -> tuple[int, Speed]:
    """Write one value; id and speed of the servo afterwards, the port's too. Raises BusError."""
    register, value = setting
    if register.name not in ("id", "baud_rate"):
        OneOff(port, speed.protocol).write(device, register, value, verify=True)
        return device, speed
    new_id = value if register.name == "id" else device
    rate = baud_of(table, value) if register.name == "baud_rate" else speed.baud
    assert rate is not None
    for _ in range(TRIES):
        port.set_baud(speed.baud)
        # The answer comes at the new speed, or is lost: the servo is looked for below.
        with suppress(NoAnswer):
            OneOff(port, speed.protocol, retries=0).write(device, register, value)
        port.sleep_until(port.now() + SETTLE)
        port.set_baud(rate)
        there = OneOff(port, speed.protocol)
        try:
            if there.read(new_id, register) == value:
                return new_id, Speed(speed.protocol, rate)
        except NoAnswer:
            continue
    raise BusError(
        describe(
            what=f"the servo does not answer after {register.name} := {value}",
            where=port.name,
            found=f"silence of id {new_id} at {rate} baud",
            then="Find it with `retarget servo scan`",
        )
    )
