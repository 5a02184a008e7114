"""Devices for tests of the emulated line: bytes in a table, no motion, no rules."""

from dataclasses import dataclass, field

from hardware.dynamixel.codec import Error2, Instruction
from sim.emulator.device import Answer, Device


@dataclass(eq=False)
class StubDevice(Device):
    """A device of plain memory."""

    id: int = 1
    protocol: int = 2
    baud: int = 57600
    return_delay: float = 0.0
    secondary_id: int | None = None
    answers_reads: bool = True
    fast_read: bool = True
    model: str = "stub"
    number: int = 1030
    firmware: int = 38
    boots: bool = False
    store: bytearray = field(default_factory=lambda: bytearray(1024))
    heard: list[float] = field(default_factory=list)
    done: list[tuple[int, bytes, bool, bool]] = field(default_factory=list)
    handles: list[tuple[str, float | bool | None]] = field(default_factory=list)

    def booting(self, now: float) -> bool:
        return self.boots

    def receive(self, now: float) -> None:
        self.heard.append(now)

    def execute(
        self, instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool = False
    ) -> Answer | None:
        self.done.append((instruction, params, broadcast, secondary))
        wide = 2 if self.protocol == 2 else 1
        address = int.from_bytes(params[:wide], "little")
        if instruction == Instruction.PING:
            ping = self.number.to_bytes(2, "little") + bytes((self.firmware,)) if self.protocol == 2 else b""
            return Answer(0, ping)
        if instruction == Instruction.READ and not broadcast and not secondary:
            return self.read(address, int.from_bytes(params[wide : 2 * wide], "little"), now)
        if instruction == Instruction.WRITE:
            self.write(address, params[wide:], now, secondary=secondary)
        return None if broadcast or secondary else Answer(0, b"")

    def read(self, address: int, length: int, now: float) -> Answer:
        if address + length > len(self.store):
            return Answer(Error2.ACCESS, b"")
        return Answer(0, bytes(self.store[address : address + length]))

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        self.store[address : address + len(data)] = data

    def supply(self, volts: float | None, now: float) -> None:
        self.handles.append(("supply", volts))

    def heat(self, celsius: float | None, now: float) -> None:
        self.handles.append(("heat", celsius))

    def load(self, torque: float, now: float) -> None:
        self.handles.append(("load", torque))

    def jam(self, stuck: bool, now: float) -> None:
        self.handles.append(("jam", stuck))

    def shock(self, now: float) -> None:
        self.handles.append(("shock", None))

    def power_cut(self, now: float) -> None:
        self.boots = True
        self.handles.append(("power", False))

    def power_back(self, now: float) -> None:
        self.boots = False
        self.handles.append(("power", True))
