"""Registers side by side that a group read fetches in one go, as named values."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hardware.dynamixel.answers import Answers
from hardware.dynamixel.control_table import ControlTable, Register


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """`size` bytes from `address`. dtype: the registers in them by name, little-endian, at their offsets."""

    address: int
    size: int
    dtype: "np.dtype[np.void]"

    def unpack(self, answers: Answers) -> NDArray[np.void]:
        """A row (k,) of named values for each answer."""
        return np.frombuffer(answers.data, dtype=self.dtype)

    @property
    def layout(self) -> tuple[int, int, tuple[tuple[str, str], ...]]:
        """What makes two blocks the same: address, size, registers."""
        names = self.dtype.names or ()
        return self.address, self.size, tuple((name, str(self.dtype[name])) for name in names)


def block_of(table: ControlTable, first: str, last: str) -> Block:
    """The registers of a table from `first` to `last`. Raises HardwareError where the table lacks them."""
    begin, end = table[first], table[last]
    inside = [register for register in table.registers if begin.address <= register.address <= end.address]
    size = end.address + end.size - begin.address
    layout = {
        "names": [register.name for register in inside],
        "formats": [_format(register) for register in inside],
        "offsets": [register.address - begin.address for register in inside],
        "itemsize": size,
    }
    return Block(begin.address, size, np.dtype(layout))  # type: ignore[call-overload]


def _format(register: Register) -> str:
    """With a direction bit the count is no two's complement, and left as it is."""
    return f"<{'i' if register.signed and register.direction_bit is None else 'u'}{register.size}"
