"""The OpenCR of an OP3: a device of protocol 2.0 that switches the servos' power.

Id 200; register 24 is the power switch in public OP3 code, and 50 the voltage; not verified on hardware.
"""

from collections.abc import Sequence
from math import inf

from hardware.dynamixel.control_table import ControlTable, Register
from hardware.dynamixel.packets import Error2, Instruction
from sim.emulator.device import Answer, Faulty
from sim.emulator.memory import Memory
from sim.emulator.power import BROWN_OUT, Supply

ID = 200
NUMBER = 0x7400
POWER = 24
VOLTAGE = 12.0  # [V]


def _row(name: str, address: int, size: int, bounds: tuple[int, int] | None, initial: int) -> Register:
    """A register without sign; bounds: what may be written, None: read only."""
    low, high = bounds or (None, None)
    return Register(name, address, size, False, bounds is not None, None, None, low, high, initial)


TABLE = ControlTable(
    model="OpenCR",
    number=NUMBER,
    protocol=2,
    firmware=(0, 255),
    usual_firmware=1,
    fast_read=False,
    modes=(),
    baud_family="x",
    registers=(
        _row("model_number", 0, 2, None, NUMBER),
        _row("firmware_version", 6, 1, None, 1),
        _row("id", 7, 1, (0, 252), ID),
        _row("baud_rate", 8, 1, (0, 7), 4),
        _row("return_delay_time", 9, 1, (0, 254), 0),
        _row("status_return_level", 16, 1, (0, 2), 2),
        _row("dynamixel_power", POWER, 1, (0, 1), 0),
        _row("led", 25, 1, (0, 7), 0),
        _row("present_voltage", 50, 1, None, 120),
    ),
)
_LEVEL: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}


class EmulatedController:
    """A `sim.emulator.device.Device` at `baud` bits/s that switches the power of `powered` devices.

    on: whether they have power at first. It answers ping, read and write only.
    """

    def __init__(
        self,
        powered: Sequence[Faulty] = (),
        *,
        baud: int,
        id: int = ID,
        now: float = 0.0,
        on: bool = False,
        supply: Supply | None = None,
    ) -> None:
        self.model = TABLE.model
        self.number = NUMBER
        self.protocol = 2
        self.id = id
        self.secondary_id: int | None = None
        self.baud = baud
        self.return_delay = 0.0
        self.answers_reads = True
        self.fast_read = False
        self.memory = Memory(TABLE)
        self._powered = tuple(powered)
        self._supply = supply or Supply()
        self._volts: float | None = None
        self._silent_until = -inf
        for register in TABLE.registers:
            self.memory.store(register, register.initial or 0)
        self._switch(on, now)

    def booting(self, now: float) -> bool:
        """Whether it has no power."""
        return now < self._silent_until

    def receive(self, now: float) -> None:
        """Do nothing: it has no watchdog."""

    def execute(
        self, instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool = False
    ) -> Answer | None:
        """Carry out ping, read and write; None: no status follows."""
        if self.booting(now) or secondary or (broadcast and instruction == Instruction.READ):
            return None
        answer = Answer(Error2.INSTRUCTION, b"")
        if instruction == Instruction.PING:
            answer = Answer(0, bytes(self.memory.image[0:2]) + bytes(self.memory.image[6:7]))
        elif instruction == Instruction.READ:
            answer = Answer(Error2.DATA_LENGTH, b"")
            if len(params) == 4:
                answer = self.read(params[0] | params[1] << 8, params[2] | params[3] << 8, now)
        elif instruction == Instruction.WRITE:
            error = Error2.DATA_LENGTH
            if len(params) > 2:
                error = self._change(params[0] | params[1] << 8, params[2:], now)
            answer = Answer(error, b"")
        if broadcast and instruction != Instruction.PING:
            return None
        return answer if self.memory.value("status_return_level") >= _LEVEL.get(instruction, 2) else None

    def read(self, address: int, length: int, now: float) -> Answer:
        """Return the bytes of a range, or the error for it."""
        if not self.memory.readable(address, length):
            return Answer(Error2.ACCESS if length else Error2.DATA_LENGTH, b"")
        volts = VOLTAGE - self._supply.sag if self._volts is None else self._volts
        self.memory.put("present_voltage", round(10.0 * volts))
        return Answer(0, self.memory.slice(address, length))

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        """Carry out a write; a refused one is dropped."""
        if not self.booting(now) and not secondary:
            self._change(address, data, now)

    def supply(self, volts: float | None, now: float) -> None:
        """Set the supply voltage in V; below BROWN_OUT of the nominal it is silent, and so are the servos."""
        self._volts = volts
        if volts is not None and volts < BROWN_OUT * VOLTAGE:
            self.power_cut(now)
        elif self.booting(now):
            self.power_back(now)

    def heat(self, celsius: float | None, now: float) -> None:
        """Do nothing: it reports no temperature."""

    def load(self, torque: float, now: float) -> None:
        """Do nothing: it has no shaft."""

    def jam(self, stuck: bool, now: float) -> None:
        """Do nothing: it has no shaft."""

    def shock(self, now: float) -> None:
        """Do nothing: it has no motor."""

    def power_cut(self, now: float) -> None:
        """Switch the power off; the servos lose theirs with it."""
        self._silent_until = inf
        self._switch(False, now)

    def power_back(self, now: float) -> None:
        """Switch the power on; that of the servos stays off until register 24 is written."""
        self._silent_until = now

    def _change(self, address: int, data: bytes, now: float) -> Error2:
        """Write registers, all or none; return the error."""
        parts = self.memory.parts(address, data)
        if isinstance(parts, Error2):
            return parts
        if not all(part.register.writable for part in parts):
            return Error2.ACCESS
        if not all(part.register.allows(part.value) for part in parts):
            return Error2.DATA_RANGE
        for register, value in parts:
            self.memory.store(register, value)
            if register.name == "dynamixel_power":
                self._switch(bool(value), now)
        self.id = self.memory.value("id")
        self.return_delay = self.memory.value("return_delay_time") * 2e-6
        self.answers_reads = self.memory.value("status_return_level") >= 1
        return Error2.NONE

    def _switch(self, on: bool, now: float) -> None:
        """Switch the servos' power."""
        self.memory.put("dynamixel_power", int(on))
        for device in self._powered:
            if on:
                device.power_back(now)
            else:
                device.power_cut(now)
