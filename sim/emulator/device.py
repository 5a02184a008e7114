"""What the line knows of a device: instructions and parameters in, an answer out, all at a given time."""

from typing import NamedTuple, Protocol


class Answer(NamedTuple):
    """What one device has to say: the error byte of its status frame, and the data behind it (no stuffing, no CRC)."""

    error: int
    data: bytes


class Device(Protocol):
    """One device on a line. `now` is s of the line's clock and never decreases; a device reads no clock itself."""

    model: str
    """Name as in `hardware.servo.SERVO_MODELS`, or what stands in its place for a device that is no servo."""
    number: int
    """Model number, as a ping of protocol 2.0 says it."""
    protocol: int
    """1 or 2: the only one that the device hears."""

    @property
    def id(self) -> int:
        """Id that it answers to, from its register."""
        ...

    @property
    def secondary_id(self) -> int | None:
        """Id that it obeys without ever answering, RAM area only; None: none is set."""
        ...

    @property
    def baud(self) -> int:
        """Rate of its port in bit/s, from its register."""
        ...

    @property
    def return_delay(self) -> float:
        """Time in s that it waits before every status frame, from its register."""
        ...

    @property
    def answers_reads(self) -> bool:
        """Whether the status return level lets it answer reads (level 1 and 2)."""
        ...

    @property
    def fast_read(self) -> bool:
        """Whether its model and firmware know Fast Sync Read and Fast Bulk Read."""
        ...

    def booting(self, now: float) -> bool:
        """Whether it starts, or has no power: then it neither hears nor answers."""
        ...

    def receive(self, now: float) -> None:
        """Note a sound instruction frame on the line, for whomever it was: the life sign of the bus watchdog."""
        ...

    def execute(
        self, instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool = False
    ) -> Answer | None:
        """Carry out any instruction but group reads and writes; None: no status frame follows."""
        ...

    def read(self, address: int, length: int, now: float) -> Answer:
        """Answer the device's part of a group read."""
        ...

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        """Take the device's part of a group write; what it refuses is lost without a word."""
        ...


class Faulty(Protocol):
    """The handles by which a fault plan hurts a device while the line runs."""

    def supply(self, volts: float | None, now: float) -> None:
        """Set the supply voltage in V; None: the nominal one, which sags with the current. Below what the electronics
        need, power is gone: a brown-out."""
        ...

    def heat(self, celsius: float | None, now: float) -> None:
        """Set the temperature in degrees Celsius; None: it follows the current again."""
        ...

    def load(self, torque: float, now: float) -> None:
        """Put a torque in N m on the shaft, positive towards higher ticks."""
        ...

    def jam(self, stuck: bool, now: float) -> None:
        """Block the shaft, or free it: a blocked servo stalls on the way to its goal, and overloads after a while."""
        ...

    def shock(self, now: float) -> None:
        """Make the electronics note an electrical shock, or a lack of power for the motor."""
        ...

    def power_cut(self, now: float) -> None:
        """Take the power away: silence, and everything in RAM is lost."""
        ...

    def power_back(self, now: float) -> None:
        """Give the power back: the device boots."""
        ...
