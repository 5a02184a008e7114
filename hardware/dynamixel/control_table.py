"""Control tables: what every register of a servo model means, in the protocol and firmware that it runs."""

from dataclasses import dataclass
from functools import cache, cached_property

from hardware.dynamixel import control_table_files as files
from hardware.dynamixel.control_table_files import ModelRow
from hardware.dynamixel.register import Register
from hardware.errors import HardwareError, describe
from hardware.servo import find_model

__all__ = ["ControlTable", "Register", "find_table", "table_of_number", "tables"]

_EEPROM_END = {1: 24, 2: 64}


@dataclass(frozen=True)
class ControlTable:
    """The registers of one model, ascending by address, as firmware `firmware[0]` to `firmware[1]` has them.

    `number` is what the servo answers in its model number register, `eeprom_end` the first address of the RAM area,
    `fast_read` whether it answers Fast Sync Read and Fast Bulk Read, `modes` its operating modes (none in protocol
    1.0), `usual_firmware` a version of this range for an emulated servo, `baud_family` names the codes of its baud rate
    register.
    """

    model: str
    number: int
    protocol: int
    firmware: tuple[int, int]
    usual_firmware: int
    fast_read: bool
    modes: tuple[int, ...]
    baud_family: str
    registers: tuple[Register, ...]

    @property
    def eeprom_end(self) -> int:
        """First address of the RAM area."""
        return _EEPROM_END[self.protocol]

    @cached_property
    def size(self) -> int:
        """Bytes from address 0 to the end of the last register."""
        return self.registers[-1].end

    @cached_property
    def _by_name(self) -> dict[str, Register]:
        return {register.name: register for register in self.registers}

    @cached_property
    def _by_address(self) -> dict[int, Register]:
        return {address: one for one in self.registers for address in range(one.address, one.end)}

    def __getitem__(self, name: str) -> Register:
        register = self._by_name.get(name)
        if register is None:
            raise HardwareError(
                describe(
                    what="no such register",
                    where=f"{self.model}, protocol {self.protocol}.0, firmware {self.firmware[0]} to "
                    f"{self.firmware[1]}",
                    found=repr(name),
                    allowed=", ".join(one for one in self._by_name if not one.startswith("indirect_")),
                )
            )
        return register

    def has(self, name: str) -> bool:
        """Whether there is a register of that name."""
        return name in self._by_name

    def at(self, address: int) -> Register | None:
        """Return the register that covers `address`, None where the table has a hole or ends."""
        return self._by_address.get(address)


def tables() -> tuple[ControlTable, ...]:
    """Every table there is: each model, protocol and range of firmware."""
    return tuple(_table(row, first) for row in files.model_rows() for first in files.firmware_starts(row))


def find_table(model: str, protocol: int, firmware: int | None = None) -> ControlTable:
    """Return the table of a model, by its name in `hardware.servo`, as `firmware` (0 to 255, None: a usual one) has it.

    Raises HardwareError for an unknown model, and for a protocol that the model does not speak.
    """
    name = find_model(model).name
    rows = {row.protocol: row for row in files.model_rows() if row.model == name}
    row = rows.get(protocol)
    if row is None:
        raise HardwareError(
            describe(
                what="the model does not speak this protocol",
                where=name,
                found=f"protocol {protocol}.0",
                allowed=", ".join(f"{one}.0" for one in sorted(rows)),
            )
        )
    return _table_at(row, firmware)


def table_of_number(number: int, firmware: int | None = None) -> ControlTable | None:
    """Return the table of the model that reports `number`, None for a model without a table."""
    return next((_table_at(row, firmware) for row in files.model_rows() if row.number == number), None)


def _table_at(row: ModelRow, firmware: int | None) -> ControlTable:
    """The table of a model whose range holds `firmware`."""
    wanted = row.usual_firmware if firmware is None else firmware
    return _table(row, max(start for start in files.firmware_starts(row) if start <= max(wanted, 0)))


@cache
def _table(row: ModelRow, first: int) -> ControlTable:
    """The table of the range of firmware that begins at `first`."""
    later = [start for start in files.firmware_starts(row) if start > first]
    last = min(later) - 1 if later else files.LAST_FIRMWARE
    return ControlTable(
        model=row.model,
        number=row.number,
        protocol=row.protocol,
        firmware=(first, last),
        usual_firmware=min(max(row.usual_firmware, first), last),
        fast_read=row.fast_since is not None and first >= row.fast_since,
        modes=row.modes,
        baud_family=row.baud_family,
        registers=files.registers_of(row, first),
    )
