"""What a person asks of a servo's EEPROM: all that no servo can hold is refused before a port is opened."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hardware.dynamixel.baud_codes import code_of
from hardware.dynamixel.control_table import ControlTable, tables
from hardware.dynamixel.muted import LEVEL
from hardware.dynamixel.register import Register
from hardware.dynamixel.settings import ANSWER_ALL
from hardware.dynamixel.setup_plan import (
    DELAYS,
    HIGHEST_ID,
    OWN_OPTION,
    SILENCING,
    possible_delay,
    rates_of,
    setting_of,
)
from hardware.errors import HardwareError
from retarget.cli.servo.places import check_speed
from retarget.errors import UsageError


@dataclass(frozen=True)
class Asked:
    """Options as they were typed; None: not. baud: bits/s; return_delay: us; registers: counts by name."""

    new_id: int | None = None
    baud: int | None = None
    return_delay: float | None = None
    drive_mode: int | None = None
    registers: Mapping[str, int] = field(default_factory=dict)

    @property
    def anything(self) -> bool:
        """Whether anything is asked."""
        return bool(self.registers) or any(
            one is not None for one in (self.new_id, self.baud, self.return_delay, self.drive_mode)
        )

    @property
    def all_registers(self) -> dict[str, int]:
        """With the drive mode."""
        return dict(self.registers) | ({} if self.drive_mode is None else {"drive_mode": self.drive_mode})


def registers_of(words: Sequence[str]) -> dict[str, int]:
    """What NAME=VALUE means. Raises UsageError."""
    found = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            found[name.strip()] = int(value, 0)
        except ValueError:
            raise UsageError(
                "this is no setting", where="--register", found=repr(word[:80]), allowed="NAME=VALUE"
            ) from None
    return found


def check_device(device: int, protocol: int | None) -> None:
    """Raise UsageError for an id that no servo has."""
    highest = HIGHEST_ID + (protocol == 1)
    if not 0 <= device <= highest:
        raise UsageError(
            "no servo has this id", where="--id", found=device, allowed=f"0 to {highest}: 254 is everybody"
        )


def check_asked(asked: Asked, protocol: int | None, model: str | None) -> None:
    """Raise UsageError for what no servo (of this protocol, of this model; None: any) can hold."""
    if asked.new_id is not None and not 0 <= asked.new_id <= HIGHEST_ID:
        allowed = f"0 to {HIGHEST_ID}: 254 is everybody"
        raise UsageError("no servo has this id", where="--new-id", found=asked.new_id, allowed=allowed)
    if asked.return_delay is not None and not possible_delay(1e-6 * asked.return_delay):
        found = f"{asked.return_delay:g} us"
        raise UsageError("no servo has this pause", where="--return-delay", found=found, allowed=DELAYS)
    check_speed(protocol, asked.baud)
    possible = [one for one in tables() if protocol in (None, one.protocol) and model in (None, one.model)]
    if not possible:
        return
    if asked.baud is not None and not any(code_of(one, asked.baud) is not None for one in possible):
        rates = rates_of(possible[0])
        raise UsageError(f"no such baud rate for {model}", where="--baud", found=asked.baud, allowed=rates)
    for name, value in asked.all_registers.items():
        own = name == "drive_mode" and name not in asked.registers
        _check_register(possible, name, value, "--drive-mode" if own else "--register")


def _check_register(possible: Sequence[ControlTable], name: str, value: int, option: str) -> None:
    if (name, value) == (LEVEL[2].name, ANSWER_ALL) or any(_holds(one, name, value) for one in possible):
        return
    if name in OWN_OPTION:
        raise UsageError("this register has its own option", where=option, found=name, allowed=OWN_OPTION[name])
    having = [table[name] for table in possible if name in _eeprom(table)]
    if having:
        low, high = min(map(_lowest, having)), max(map(_highest, having))
        raise UsageError(f"no such {name}", where=option, found=value, allowed=f"{low} to {high}")
    names = dict.fromkeys(name for table in possible for name in _eeprom(table))
    raise UsageError("no such register", where=option, found=repr(name[:80]), allowed=", ".join(names))


def _holds(table: ControlTable, name: str, value: int) -> bool:
    try:
        setting_of(table, name, value)
    except HardwareError:
        return False
    return True


def _eeprom(table: ControlTable) -> list[str]:
    """Registers that may be written by name."""
    found = [one.name for one in table.registers if one.writable and one.address < table.eeprom_end]
    return [name for name in found if name not in OWN_OPTION and name != SILENCING]


def _lowest(register: Register) -> int:
    return register.narrowest if register.lowest is None else register.lowest


def _highest(register: Register) -> int:
    return register.widest if register.highest is None else register.highest
