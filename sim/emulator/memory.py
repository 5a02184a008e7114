"""The memory of a device: bytes in the layout of its control table, with indirect addressing."""

from typing import NamedTuple

from hardware.dynamixel.codec import Error2
from hardware.dynamixel.control_table import ControlTable, Register


class RegisterWrite(NamedTuple):
    """A register that a write covers to its end, and its new counts."""

    register: Register
    value: int


class Memory:
    """The bytes of a control table, all zero at first. Holes read as 0 when a read also covers a defined register.

    An indirect data byte stands for the byte at the address in its indirect address register, unless that is indirect
    data again.
    """

    def __init__(self, table: ControlTable) -> None:
        self.table = table
        self.image = bytearray(table.size)
        self._starts: list[Register | None] = [None] * table.size  # the register that begins at an address
        self._defined = bytearray(table.size)  # 1 where a register is
        self._pointers: dict[int, int] = {}  # address of indirect data -> that of its indirect address register
        for register in table.registers:
            self._starts[register.address] = register
            self._defined[register.address : register.end] = b"\1" * register.size
            if register.name.startswith("indirect_data_"):
                pointer = table["indirect_address_" + register.name.removeprefix("indirect_data_")]
                self._pointers[register.address] = pointer.address
        self.plain_end = min(self._pointers, default=table.size)
        """Below this address nothing is indirect."""

    def value(self, name: str) -> int:
        """The counts of a register. Raises HardwareError for a name that the table does not have."""
        register = self.table[name]
        return register.decode(bytes(self.image[register.address : register.end]))

    def value_or(self, name: str, default: int) -> int:
        """The counts of a register, `default` where the model does not have it."""
        return self.value(name) if self.table.has(name) else default

    def scaled(self, name: str) -> float:
        """The value of a register in the unit of its scale."""
        return self.value(name) * (self.table[name].scale or 0.0)

    def flag(self, name: str, mask: int) -> bool:
        """Return whether a bit of a register is set; False where the model does not have it."""
        return bool(self.value_or(name, 0) & mask)

    def put(self, name: str, value: int) -> None:
        """Set a register, clipped to its width; nothing if the model does not have it."""
        if self.table.has(name):
            self.store(self.table[name], value)

    def store(self, register: Register, value: int) -> None:
        """Set a register of this table, clipped to its width."""
        counts = min(max(value, register.narrowest), register.widest)
        self.image[register.address : register.end] = register.encode(counts)

    def readable(self, address: int, length: int) -> bool:
        """Return whether a read stays inside the table and covers any defined register."""
        end = address + length
        return length > 0 and address >= 0 and end <= len(self.image) and 1 in self._defined[address:end]

    def slice(self, address: int, length: int) -> bytes:
        """The bytes of a readable range, with indirect data resolved."""
        end = address + length
        if end <= self.plain_end:
            return bytes(self.image[address:end])
        image = self.image
        return bytes([image[self.target(place)] for place in range(address, end)])

    def target(self, address: int) -> int:
        """The address that the byte at `address` stands for: itself unless it is indirect data."""
        pointer = self._pointers.get(address)
        if pointer is None:
            return address
        pointed = self.image[pointer] | self.image[pointer + 1] << 8
        return address if pointed in self._pointers or pointed >= len(self.image) else pointed

    def touches(self, address: int, length: int, first: int, last: int) -> bool:
        """Return whether a read of a range shows any byte from `first` to before `last`."""
        end = address + length
        if end <= self.plain_end:
            return address < last and end > first
        return any(first <= self.target(place) < last for place in range(address, end))

    def parts(self, address: int, data: bytes) -> list[RegisterWrite] | Error2:
        """The registers that a write covers, in order, or its error: DATA_LENGTH for a part of a register,
        ACCESS for a hole, a read-only register and the end of the table."""
        if not data:
            return Error2.DATA_LENGTH
        if address + len(data) > len(self.image):
            return Error2.ACCESS
        found: list[RegisterWrite] = []
        done = 0
        while done < len(data):
            first = self.target(address + done)
            register = self._starts[first]
            if register is None or not register.writable:
                return Error2.ACCESS
            chunk = data[done : done + register.size]
            places = [self.target(address + done + index) for index in range(len(chunk))]
            if places != list(range(first, register.end)):
                return Error2.DATA_LENGTH
            found.append(RegisterWrite(register, register.decode(chunk)))
            done += register.size
        return found
