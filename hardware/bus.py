"""The interface to all servos, `ServoBus`, and the description of a bus."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cached_property
from typing import Protocol

from hardware.arrays import BoolArray, ByteArray, FloatArray, TickArray
from hardware.errors import BusError, describe
from hardware.imu import ImuSample


class ServoAlert(IntFlag):
    """Hardware Error Status (register 70, X and MX(2.0) series). Each bit switches the servo's torque off."""

    INPUT_VOLTAGE = 0x01
    OVERHEATING = 0x04
    ENCODER = 0x08
    ELECTRICAL_SHOCK = 0x10
    OVERLOAD = 0x20


def alert_names(bits: int, meanings: Mapping[ServoAlert, str] | None = None) -> list[str]:
    """The names of the alert bits, with meanings if given."""
    names = [
        f"{alert.name}" + (f" ({meanings[alert]})" if meanings is not None else "")
        for alert in ServoAlert
        if bits & alert
    ]
    rest = bits & ~sum(ServoAlert)
    return [*names, *([f"0x{rest:02x}"] if rest else [])]


UNREAD_AFTER_S = 3.0
"""[s] Age at which a voltage or temperature is discarded. A motor warms by a degree in that time."""


@dataclass(frozen=True)
class ServoStates:
    """States of all servos, arrays (n,) in servo order, of the shaft in the servo's own direction. A silent servo keeps
    its values."""

    time: float
    """Start of the cycle, s on the bus's clock."""
    position: TickArray
    """Ticks."""
    velocity: FloatArray
    """rad/s."""
    current: FloatArray
    """A; NaN if the model reports none."""
    voltage: FloatArray
    """V; NaN if not read within UNREAD_AFTER_S."""
    temperature: FloatArray
    """Degrees Celsius; NaN as for `voltage`."""
    error: ByteArray
    """Error byte of the last status packet."""
    alert: ByteArray
    """`ServoAlert` bits; 0: healthy."""
    age: FloatArray
    """Time since the last answer, s; inf before the first."""
    valid: BoolArray
    """True if the servo answered in this cycle."""
    driven: BoolArray
    """True if, by its last report, the servo follows goals."""
    retries: int = 0
    """Requests repeated since the bus was opened, for all servos."""
    error_rate: float = 0.0
    """Share of the cycles of the last 0.05 s with damaged answers and several retries."""
    soles: BoolArray | None = None
    """True for each sole with floor contact, (k,) in the profile's order; None if not measured."""
    imu: ImuSample | None = None
    """Latest sample."""

    @cached_property
    def complete(self) -> bool:
        """True if all servos answered in this cycle."""
        return bool(self.valid.all())


@dataclass(frozen=True)
class ServoGoals:
    """Goal positions, ticks (n,), in servo order."""

    ticks: TickArray


class ServoBus(Protocol):
    """All servos of one robot, on any number of ports. Every method may raise BusError. Only `hardware.guard.Guard` may
    call `write` and `torque(True)`."""

    def open(self) -> None:
        """Open the ports and check that the expected servos are there."""

    def read(self) -> ServoStates:
        """Read one cycle. A missing servo is only marked; a dead bus raises BusError."""

    def write(self, goals: ServoGoals) -> None:
        """Send goal positions, without acknowledgement."""

    def limit_drive(self, share: float) -> None:
        """Limit servos with torque to a share (0, 1] of their drive, without acknowledgement."""

    def torque(self, on: bool) -> None:
        """Switch the torque of all servos. Raises BusError naming those that did not confirm."""

    def close(self) -> None:
        """Switch off torque that this bus switched on, then close the ports. Closing twice is allowed."""


def check_open(is_open: bool, *, where: str) -> None:
    """Raise BusError for a closed bus."""
    if not is_open:
        raise BusError(describe(what="the bus is closed", where=where, then="Call open first"))


BAUDS: dict[int, tuple[int, ...]] = {
    1: (9600, 19200, 57600, 115200, 200000, 250000, 400000, 500000, 1000000, 2000000, 2250000, 2500000, 3000000),
    2: (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000),
}
"""Baud rates, bits/s, by protocol (e-Manual, Baud Rate)."""

WATCHDOG_STEP = 0.02  # [s] of register 98
MAX_WATCHDOG = 2.54  # [s]
RETURN_DELAY_STEP = 2e-6  # [s] of register 9 (Protocol 1.0: 5)
MAX_RETURN_DELAY = 508e-6  # [s]


@dataclass(frozen=True)
class PowerSwitch:
    """Switch of the servos' power: byte `register` of device `id` := `value`. wait: s."""

    id: int
    register: int
    value: int
    wait: float


@dataclass(frozen=True)
class BusSpec:
    """One bus of a robot. watchdog: time without an instruction, s, after which a servo stops; 0: off (the older layout
    has none). return_delay: pause before an answer, s."""

    name: str
    port: str
    baud: int
    protocol: int
    ids: tuple[int, ...]
    watchdog: float = 0.1
    return_delay: float = 0.0
    power: PowerSwitch | None = None

    @property
    def watchdog_value(self) -> int:
        """Value of register Bus Watchdog."""
        return round(self.watchdog / WATCHDOG_STEP)

    @property
    def return_delay_value(self) -> int:
        """Value of register Return Delay Time."""
        return round(self.return_delay / RETURN_DELAY_STEP)
