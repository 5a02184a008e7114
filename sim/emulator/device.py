"""The interface between a line and its devices: instructions and parameters in, an answer out, at a given time."""

from typing import NamedTuple, Protocol


class Answer(NamedTuple):
    """The answer of one device: the error byte of its status frame, and the data behind it (no stuffing, no CRC)."""

    error: int
    data: bytes


class Device(Protocol):
    """One device on a line. `now` is s of the line's clock and never decreases; a device reads no clock itself."""

    model: str
    """Name as in `hardware.servo.SERVO_MODELS`, or another name for a device that is no servo."""
    number: int
    """Model number, as in the answer to a ping of protocol 2.0."""
    protocol: int
    """1 or 2: the only one that the device understands."""

    @property
    def id(self) -> int:
        """Id that it answers to, from its register."""
        ...

    @property
    def secondary_id(self) -> int | None:
        """Id that it obeys without an answer, RAM area only; None: none is set."""
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
        """Whether its model and firmware support Fast Sync Read and Fast Bulk Read."""
        ...

    def booting(self, now: float) -> bool:
        """Whether it starts, or has no power: then it neither receives nor answers."""
        ...

    def receive(self, now: float) -> None:
        """Note a valid instruction frame on the line, whatever its id: it feeds the bus watchdog."""
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
        """Carry out the device's part of a group write; a refused one is dropped without an answer."""
        ...


class Faulty(Protocol):
    """The methods by which a fault plan disturbs a device while the line runs."""

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
        """Block the shaft, or free it: a blocked servo stalls before its goal, and overloads after a while."""
        ...

    def shock(self, now: float) -> None:
        """Make the electronics note an electrical shock, or too little power for the motor."""
        ...

    def power_cut(self, now: float) -> None:
        """Switch the power off: the device is silent, and everything in RAM is lost."""
        ...

    def power_back(self, now: float) -> None:
        """Switch the power on: the device boots."""
        ...
