"""What a servo's EEPROM is to hold: checked as a whole before anything is written; its id and speed come last."""

from collections.abc import Mapping

from hardware.bus_spec import BAUDS, MAX_RETURN_DELAY, RETURN_DELAY_STEP, BusSpec
from hardware.dynamixel.baud_codes import baud_of, code_of
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.servo_image import ServoImage
from hardware.dynamixel.settings import Setting, differing
from hardware.errors import BusError, describe

HIGHEST_ID = 252
OWN_OPTION = {"id": "--new-id", "baud_rate": "--baud", "return_delay_time": "--return-delay"}
DELAYS = f"0 to {1e6 * MAX_RETURN_DELAY:g} us, even"
SILENCING = "protocol_type"
"""Whoever changes it is no longer understood."""


def setup_command(
    bus: BusSpec, device: int, registers: Mapping[str, int] | None = None, *, baud: int | None = None
) -> str:
    """What a person types to write these into a servo; baud: bits/s."""
    words = [f"--register {name}={value}" for name, value in (registers or {}).items()]
    if baud is not None:
        words.append(f"--baud {baud}")
    return " ".join([f"`retarget servo setup --port {bus.port} --id {device}", *words]) + "`"


def plan(
    image: ServoImage,
    *,
    new_id: int | None = None,
    baud: int | None = None,
    return_delay: float | None = None,
    registers: Mapping[str, int] | None = None,
) -> list[Setting]:
    """What has to be written, in order; what the servo has already is left out. baud: bits/s, return_delay: s.

    Raises BusError (HardwareError for an unknown register) for what this servo cannot hold, and while torque is on.
    """
    table = image.table
    wanted = [setting_of(table, name, value) for name, value in (registers or {}).items()]
    if return_delay is not None:
        if not possible_delay(return_delay):
            raise _no(table, "return delay", f"{1e6 * return_delay:g} us", DELAYS)
        wanted.append(Setting(table["return_delay_time"], round(return_delay / RETURN_DELAY_STEP)))
    if new_id is not None:
        if not 0 <= new_id <= HIGHEST_ID:
            raise _no(table, "id", str(new_id), f"0 to {HIGHEST_ID}: 254 is everybody")
        wanted.append(Setting(table["id"], new_id))
    if baud is not None:
        code = code_of(table, baud)
        if code is None:
            raise _no(table, "baud rate", str(baud), rates_of(table))
        wanted.append(Setting(table["baud_rate"], code))
    due = differing(wanted, image)
    if due and image.value("torque_enable"):
        raise BusError(
            describe(
                what="torque is on, and locks the EEPROM",
                where=table.model,
                then="Secure the robot, then `retarget servo rest`",
            )
        )
    return due


def possible_delay(delay: float) -> bool:
    """Whether a servo can be told to wait for `delay` s before it answers."""
    steps = delay / RETURN_DELAY_STEP
    return 0.0 <= delay <= MAX_RETURN_DELAY and abs(steps - round(steps)) < 1e-6


def rates_of(table: ControlTable) -> str:
    """The speeds that a model can be set to, bits/s, in words."""
    lowest, highest = table["baud_rate"].lowest or 0, table["baud_rate"].highest or 0
    rates = [rate for one in range(lowest, highest + 1) if (rate := baud_of(table, one))]
    usual = [rate for rate in rates if rate in BAUDS[table.protocol]]
    return ", ".join(map(str, sorted(usual)))


def setting_of(table: ControlTable, name: str, value: int) -> Setting:
    """What a register of its EEPROM is to hold. Raises BusError (HardwareError for an unknown register)."""
    register = table[name]
    if name in OWN_OPTION:
        raise _no(table, "register", name, f"the option {OWN_OPTION[name]}")
    if not register.writable or register.address >= table.eeprom_end or name == SILENCING:
        eeprom = [one.name for one in table.registers if one.writable and one.address < table.eeprom_end]
        raise _no(table, "register", name, ", ".join(one for one in eeprom if one != SILENCING))
    if not register.allows(value) or not register.narrowest <= value <= register.widest:
        low = register.narrowest if register.lowest is None else register.lowest
        high = register.widest if register.highest is None else register.highest
        raise _no(table, name, str(value), f"{low} to {high}")
    return Setting(register, value)


def _no(table: ControlTable, what: str, found: str, allowed: str) -> BusError:
    return BusError(describe(what=f"no such {what} for this servo", where=table.model, found=found, allowed=allowed))
