"""A device on a line: its memory, its instructions, and faults from outside.

Source: e-Manual, protocols 1.0 and 2.0. With protocol 1.0 addresses and lengths are bytes, with 2.0 words.
"""

from typing import NamedTuple

from hardware.dynamixel.codec import Error2, Instruction
from hardware.dynamixel.control_table import ControlTable, baud_of
from sim.emulator.memory import Memory, RegisterWrite
from sim.imu import Ailment

_LEVEL: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}  # status return level from which it answers, else 2
_OBEYED = frozenset((Instruction.WRITE, Instruction.REG_WRITE, Instruction.ACTION))  # through a secondary id
_REGISTERED = {1: "registered", 2: "registered_instruction"}  # by protocol: the flag of a waiting Reg Write
_PING = ("model_number", "firmware_version")  # the registers that a ping of protocol 2.0 returns


class Answer(NamedTuple):
    """The error byte and the data of a status frame (no stuffing, no CRC)."""

    error: int
    data: bytes


class Device:
    """A device with the memory of its control table, as the maker delivers it. `now` is s of the line's clock.

    secondary_id: obeyed without an answer, RAM area only. baud: bits/s. return_delay: s before every status.
    answers_reads: status return level 1 or 2. registered: address and data of a Reg Write that waits for its Action.
    malformed: error for a wrong number of parameters; unknown: for an unknown instruction.
    """

    malformed: int = Error2.DATA_LENGTH
    unknown: int = Error2.INSTRUCTION

    def __init__(self, table: ControlTable, now: float) -> None:
        self.table = table
        self.model, self.number, self.protocol = table.model, table.number, table.protocol
        self.fast_read = table.fast_read
        self.memory = Memory(table)
        self.id, self.baud, self.return_delay = 0, 0, 0.0
        self.secondary_id: int | None = None
        self.answers_reads = True
        self.registered: tuple[int, bytes] | None = None
        self._awake_at = now
        self.defaults(0, table.eeprom_end)

    def defaults(self, first: int, end: int) -> None:
        """Set the registers from `first` to before `end` to the maker's values."""
        for register in self.table.registers:
            if first <= register.address < end:
                self.memory.store(register, register.initial or 0)
        self.memory.put("model_number", self.table.number)
        self.memory.put("firmware_version", self.table.usual_firmware)

    def booting(self, now: float) -> bool:
        """Return whether the device starts or has no power, and so neither receives nor answers."""
        return now < self._awake_at

    def receive(self, now: float) -> None:
        """Note a valid instruction frame on the line: it feeds the bus watchdog."""

    def execute(
        self, instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool = False
    ) -> Answer | None:
        """Carry out any instruction but group reads and writes; None: no status frame follows."""
        if now < self._awake_at:
            return None
        self.catch_up(now)
        if (secondary and instruction not in _OBEYED) or (broadcast and self.ignores_broadcast(instruction, params)):
            return None
        answer = self._carry_out(instruction, params, now, ram_only=secondary)
        if secondary or (broadcast and instruction != Instruction.PING):
            return None
        return answer if self.memory.value("status_return_level") >= _LEVEL.get(instruction, 2) else None

    def read(self, address: int, length: int, now: float) -> Answer:
        """The bytes of a range, or its error: also the device's part of a group read."""
        self.catch_up(now)
        if not self.memory.readable(address, length):
            return self.answer(self.error_of(Error2.ACCESS if length else Error2.DATA_LENGTH))
        self.show(address, length, now)
        return self.answer(0, self.memory.slice(address, length))

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        """Carry out the device's part of a group write; a refused one is dropped without an answer."""
        if now >= self._awake_at:
            self.change(address, data, now, ram_only=secondary)

    def change(self, address: int, data: bytes, now: float, *, ram_only: bool = False) -> int:
        """Write registers, all or none; return the error."""
        self.catch_up(now)
        parts = self.accepts(address, data, ram_only=ram_only)
        if isinstance(parts, int):
            return parts
        for register, value in parts:
            self.memory.store(register, value)
        self.react({part.register.name for part in parts}, now)
        return 0

    def accepts(self, address: int, data: bytes, *, ram_only: bool = False) -> list[RegisterWrite] | int:
        """The registers that a write would set, or the error by which it is refused as a whole."""
        if ram_only and address < self.table.eeprom_end:
            return self.error_of(Error2.ACCESS)
        parts = self.memory.parts(address, data)
        if isinstance(parts, Error2):
            return self.error_of(parts)
        return next((error for error in map(self.refusal, parts) if error), None) or parts

    def answer(self, error: int = 0, data: bytes = b"") -> Answer:
        """An answer, with the errors that every one has."""
        return Answer(error, data)

    def catch_up(self, now: float) -> None:
        """Let time pass up to `now` (s)."""

    def tune(self) -> None:
        """Apply every setting in the registers."""
        memory = self.memory
        self.id = memory.value("id")
        self.baud = baud_of(self.table, memory.value("baud_rate")) or 0
        self.return_delay = memory.value("return_delay_time") * 2e-6
        self.answers_reads = memory.value("status_return_level") >= 1

    def error_of(self, error: Error2) -> int:
        """An error of the memory as this device reports it."""
        return error

    def refusal(self, part: RegisterWrite) -> int:
        """The error by which a writable register refuses a value, 0 if it is accepted."""
        return 0 if part.register.allows(part.value) else Error2.DATA_RANGE

    def react(self, names: set[str], now: float) -> None:
        """Apply the written registers `names`."""
        self.tune()

    def show(self, address: int, length: int, now: float) -> None:
        """Refresh the registers of a range that show its state."""

    def ignores_broadcast(self, instruction: int, params: bytes) -> bool:
        """Return whether the device ignores this instruction to all devices."""
        return instruction == Instruction.READ

    def special(self, instruction: int, params: bytes, now: float) -> Answer:
        """Carry out an instruction beyond ping, read, write, registered write and action."""
        return self.answer(self.unknown)

    def supply(self, volts: float | None, now: float) -> None:
        """Set the supply voltage in V; None: nominal, which sags with the current."""

    def heat(self, celsius: float | None, now: float) -> None:
        """Set the temperature in degrees Celsius; None: that of the model."""

    def sense(self, ailment: Ailment | None, now: float) -> None:
        """Set the fault of its IMU; None: it works."""

    def hold_current(self, stuck: bool, now: float) -> None:
        """Keep the shown current, or show the true one again."""

    def jam(self, stuck: bool, now: float) -> None:
        """Block the shaft, or free it: a blocked servo overloads after a while."""

    def power_cut(self, now: float) -> None:
        """Switch the power off: the device is silent and loses its RAM."""

    def power_back(self, now: float) -> None:
        """Switch the power on: the device boots."""

    def _carry_out(self, instruction: int, params: bytes, now: float, *, ram_only: bool) -> Answer:
        wide = self.protocol  # bytes of an address
        address, data = int.from_bytes(params[:wide], "little"), params[wide:]
        if instruction == Instruction.PING:
            shown = [self.table[name].encode(self.memory.value(name)) for name in _PING]
            return self.answer(0, b"".join(shown) if self.protocol == 2 else b"")
        if instruction == Instruction.READ and len(data) == wide:
            return self.read(address, int.from_bytes(data, "little"), now)
        if instruction == Instruction.WRITE and data:
            return self.answer(self.change(address, data, now, ram_only=ram_only))
        if not self.table.has(_REGISTERED[self.protocol]) and instruction in (
            Instruction.REG_WRITE,
            Instruction.ACTION,
        ):
            return self.answer(self.unknown)
        if instruction == Instruction.REG_WRITE and data:
            checked = self.accepts(address, data, ram_only=ram_only)
            if isinstance(checked, int):
                return self.answer(checked)
            self._register((address, data))
            return self.answer()
        if instruction == Instruction.ACTION and self.registered is not None:
            address, data = self.registered
            self._register(None)
            return self.answer(self.change(address, data, now, ram_only=ram_only))
        if instruction in (Instruction.READ, Instruction.WRITE, Instruction.REG_WRITE):
            return self.answer(self.malformed)
        return self.special(instruction, params, now)

    def _register(self, write: tuple[int, bytes] | None) -> None:
        self.registered = write
        self.memory.put(_REGISTERED[self.protocol], int(write is not None))
