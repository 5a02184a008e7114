"""The one interface to servos, `ServoBus`, and the description of a bus: its port, speed, ids and power switch."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cached_property
from typing import Protocol

from hardware.arrays import BoolArray, ByteArray, FloatArray, TickArray
from hardware.errors import BusError, describe
from hardware.imu import ImuSample


class ServoAlert(IntFlag):
    """Hardware Error Status, register 70 of the X and MX(2.0) series; any of these bits has switched the servo's torque
    off."""

    INPUT_VOLTAGE = 0x01
    OVERHEATING = 0x04
    ENCODER = 0x08
    ELECTRICAL_SHOCK = 0x10
    OVERLOAD = 0x20


def alert_names(bits: int, meanings: Mapping[ServoAlert, str] | None = None) -> list[str]:
    """Names of the alert bits, with their meanings; bits that the maker leaves undefined as a number."""
    names = [
        f"{alert.name}" + (f" ({meanings[alert]})" if meanings is not None else "")
        for alert in ServoAlert
        if bits & alert
    ]
    rest = bits & ~sum(ServoAlert)
    return [*names, *([f"0x{rest:02x}"] if rest else [])]


UNREAD_AFTER_S = 3.0
"""Age, s, at which a voltage or temperature that was read is forgotten. A motor heats up by a degree in that time."""


@dataclass(frozen=True)
class ServoStates:
    """What the servos reported, one entry per servo in the profile's servo order, all arrays (n,).

    A servo that did not answer in this cycle has `valid` False and keeps its last values; `age` says how old they are.
    Values are the shaft's, in the servo's own sense of rotation: `hardware.joint_map` turns them into joint values.
    """

    time: float
    """When the cycle was read, s on the bus's clock."""
    position: TickArray
    """Present position, ticks."""
    velocity: FloatArray
    """Present velocity, rad/s."""
    current: FloatArray
    """Present current, A; NaN where the model reports no current."""
    voltage: FloatArray
    """Input voltage, V; NaN before it was read, and once it has not been read for UNREAD_AFTER_S."""
    temperature: FloatArray
    """Internal temperature, degrees Celsius; NaN as for `voltage`."""
    error: ByteArray
    """Error byte of the last status packet (bit 7: alert)."""
    alert: ByteArray
    """Hardware Error Status as `ServoAlert` bits, 0 when healthy."""
    age: FloatArray
    """Time since the last answer, s; 0 when valid, inf before the first answer."""
    valid: BoolArray
    """Whether the servo answered in this cycle."""
    driven: BoolArray
    """Whether the servo follows its goals, by its last report: torque on, not stopped by its bus watchdog."""
    retries: int = 0
    """Requests that had to be repeated since the bus was opened, of all servos."""
    error_rate: float = 0.0
    """Share of the last cycles (0.05 s) in which answers came damaged and requests were repeated more than once."""
    soles: BoolArray | None = None
    """Which soles press on the floor, (k,) in the order of the profile's feet; None where nothing measures it."""
    imu: ImuSample | None = None
    """What the robot's IMU measured last; None on a bus without one."""

    @cached_property
    def complete(self) -> bool:
        """Whether all servos answered in this cycle."""
        return bool(self.valid.all())


@dataclass(frozen=True)
class ServoGoals:
    """What the servos are asked to do: goal positions in ticks, (n,), in the profile's servo order."""

    ticks: TickArray


class ServoBus(Protocol):
    """All servos of one robot, on however many ports. Every method may raise BusError.

    Only `hardware.guard.Guard` may call `write` and `torque(True)`; anyone may call `torque(False)`.
    """

    def open(self) -> None:
        """Open the ports and check that the expected servos are there; torque stays as it is."""

    def read(self) -> ServoStates:
        """Read one cycle. A missing servo is marked in the answer and never an exception; a dead bus raises
        BusError."""

    def write(self, goals: ServoGoals) -> None:
        """Send goal positions to all servos; no servo acknowledges."""

    def limit_drive(self, share: float) -> None:
        """Allow the servos, while they have torque, a share (0, 1] of their full drive; none acknowledges."""

    def torque(self, on: bool) -> None:
        """Switch the torque of all servos; each acknowledges. The command goes to all servos even if one fails. Then
        raises BusError that names those that did not confirm."""

    def close(self) -> None:
        """Close the ports and leave the bus safe: torque that this bus switched on is off. Closing twice is allowed."""


def check_open(is_open: bool, *, where: str) -> None:
    """Raise BusError for a bus that is closed."""
    if not is_open:
        raise BusError(describe(what="the bus is closed", where=where, then="Call open first"))


# A bus as data: its port, its speed, the devices on it, and what is set up in its servos once.

BAUDS: dict[int, tuple[int, ...]] = {
    1: (9600, 19200, 57600, 115200, 200000, 250000, 400000, 500000, 1000000, 2000000, 2250000, 2500000, 3000000),
    2: (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000),
}
"""Bits per second that servos can be set to, by protocol (e-Manual, Baud Rate)."""

WATCHDOG_STEP = 0.02  # [s] of register 98
MAX_WATCHDOG = 2.54  # [s]
RETURN_DELAY_STEP = 2e-6  # [s] of register 9 (Protocol 1.0: 5)
MAX_RETURN_DELAY = 508e-6  # [s]


@dataclass(frozen=True)
class PowerSwitch:
    """A register that switches the servos' power: of device `id`, a byte at address `register` := `value`.

    wait: how long the servos take to start, s.
    """

    id: int
    register: int
    value: int
    wait: float


@dataclass(frozen=True)
class BusSpec:
    """One bus of a robot. ids: every device expected on it, servos and others.

    watchdog: longest time without an instruction, s, after which a servo stops by itself; 0: off (servos of the
    older layout have none). return_delay: pause of a servo before it answers, s.
    """

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
        """Value of the register Bus Watchdog."""
        return round(self.watchdog / WATCHDOG_STEP)

    @property
    def return_delay_value(self) -> int:
        """Value of the register Return Delay Time."""
        return round(self.return_delay / RETURN_DELAY_STEP)
