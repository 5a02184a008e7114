"""Inertial measurement units: where one is mounted, what it measures, and whether that can be true.

A sensor measures along its own axes; a sample is along those of the link that carries it. A reading that no robot can
have, or that never changes although a sensor has noise, marks the sample as not valid.
"""

import math
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Protocol

import numpy as np

from hardware.arrays import FloatArray

Vector = tuple[float, float, float]
Quat = tuple[float, float, float, float]
GRAVITY = 9.80665
"""[m/s^2] One g, in which makers give accelerations."""
FRESH = 0.05
"""[s] Age up to which a sample is valid: five frames of a sensor at 100 Hz, six cycles of a robot at 125 Hz."""
FROZEN = 0.2
"""[s] After which a reading that has not changed in one bit is that of a sensor that hangs."""
FASTEST = math.radians(2000.0)
"""[rad/s] Fastest turn about one axis: the range of the gyroscopes of both kinds."""
STRONGEST = 16.0 * GRAVITY
"""[m/s^2] Largest acceleration along one axis: the widest range of such sensors."""
BNO08X_BAUD = 115200
"""[bit/s] Of a BNO08x in UART-RVC mode (datasheet)."""
STEP = 0.1
"""[rad] Two orientations one after the other may differ by it, and by what the fastest turn adds: filters correct
themselves."""


class ImuKind(StrEnum):
    """How a sensor is connected, and what it sends."""

    OPENCR = "opencr"
    """The board of an OP3: registers of a Dynamixel device."""
    BNO08X = "bno08x"
    """BNO080, BNO085 and BNO086 in UART-RVC mode: frames on a serial line of its own."""


@dataclass(frozen=True)
class ImuSpec:
    """A sensor of a robot. link: what carries it; position, m, and mounting, wxyz: where it is on that link and how its
    axes are turned there.

    bus, id: of a device on a bus of the robot. port, baud: of a serial line of its own.
    """

    kind: ImuKind
    link: str
    position: Vector
    mounting: Quat
    bus: str = ""
    id: int = 0
    port: str = ""
    baud: int = BNO08X_BAUD


@dataclass(frozen=True, eq=False)
class ImuSample:
    """The newest measurement, along the axes of the sensor's link.

    time: s on the bus's clock, when it was measured; -inf before the first. orientation (4,): wxyz of the link in a
    world whose z is up and whose yaw is free; None where the sensor has none. angular_velocity (3,): rad/s.
    acceleration (3,): m/s^2 at the sensor, specific force: upwards and one g at rest. valid: it is fresh, and the
    sensor works. age: s since it was measured; inf before the first.
    """

    time: float
    orientation: FloatArray | None
    angular_velocity: FloatArray
    acceleration: FloatArray
    valid: bool
    age: float

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll (to the right) and pitch (forward) of the link, rad: by its orientation, else by its acceleration; NaN
        before the first measurement."""
        if self.orientation is None:
            x, y, z = self.acceleration.tolist()
        else:
            w, a, b, c = self.orientation.tolist()
            x, y, z = rotated((w, -a, -b, -c), (0.0, 0.0, 1.0))
        return math.atan2(y, z), math.atan2(-x, math.hypot(y, z))


@dataclass(frozen=True, slots=True)
class ImuReading:
    """A measurement along the axes of the sensor. orientation: wxyz of the sensor, z up; None where it has none;
    angular_velocity: rad/s; acceleration: m/s^2, specific force."""

    orientation: Quat | None
    angular_velocity: Vector
    acceleration: Vector


class ImuFault(Enum):
    """Why a sample is not valid."""

    SILENT = "does not answer"
    FROZEN = "shows the same numbers again and again"
    IMPOSSIBLE = "shows numbers that no robot has"


class ImuDevice(Protocol):
    """A sensor that is read within the cycle of a bus. Its methods raise BusError when its port is gone."""

    def post(self) -> None:
        """Ask for a measurement, where the sensor wants to be asked, and do not wait."""

    def collect(self) -> bool:
        """Take the answer, or what has come by itself. Return whether it had to wait, which is bounded."""

    def sample(self, now: float) -> ImuSample:
        """The newest measurement, as of `now`, s."""

    @property
    def fault(self) -> ImuFault | None:
        """Why the sample that was given last is not valid."""


class ImuTracker:
    """The newest sample of a sensor, from its readings. fault: why the sample that was given last is not valid."""

    def __init__(self, spec: ImuSpec) -> None:
        self._mounting = spec.mounting
        w, x, y, z = spec.mounting
        self._back = (w, -x, -y, -z)
        self._last: ImuReading | None = None
        self._time, self._changed = -math.inf, -math.inf  # [s]
        self._impossible = False
        self._orientation: FloatArray | None = None
        self._turn: FloatArray = np.full(3, np.nan)
        self._force: FloatArray = np.full(3, np.nan)
        self.fault: ImuFault | None = ImuFault.SILENT

    def take(self, reading: ImuReading | None, time: float) -> None:
        """Take a reading of the time `time`, s; None: one that the sensor cannot mean. What is impossible is not
        kept."""
        self._impossible = reading is None or not _is_possible(reading) or self._jumps(reading, time)
        if reading is None or self._impossible:
            return
        if self._last is None or reading != self._last:
            self._changed = time
            self._force = np.array(rotated(self._mounting, reading.acceleration))
            self._turn = np.array(rotated(self._mounting, reading.angular_velocity))
            if reading.orientation is not None:
                self._orientation = np.array(product(reading.orientation, self._back))
        self._last, self._time = reading, time

    def sample(self, now: float) -> ImuSample:
        """The newest sample, as of `now`, s."""
        age = max(now - self._time, 0.0)
        self.fault = None
        if age > FRESH:
            self.fault = ImuFault.IMPOSSIBLE if self._impossible else ImuFault.SILENT
        elif self._impossible:
            self.fault = ImuFault.IMPOSSIBLE
        elif self._time - self._changed >= FROZEN:
            self.fault = ImuFault.FROZEN
        return ImuSample(self._time, self._orientation, self._turn, self._force, self.fault is None, age)

    def _jumps(self, reading: ImuReading, time: float) -> bool:
        """Whether the sensor would have turned faster than it can since the last reading that was kept."""
        before = None if self._last is None else self._last.orientation
        if before is None or reading.orientation is None:
            return False
        w = sum_of_products(before, reading.orientation)
        chord = 2.0 * math.sqrt(max(0.0, 1.0 - w * w))  # at most the angle between the two
        return chord > STEP + FASTEST * max(time - self._time, 0.0)


def _is_possible(reading: ImuReading) -> bool:
    """Whether all numbers are within the range of such sensors; NaN is not."""
    turned = reading.orientation is None or abs(sum_of_products(reading.orientation, reading.orientation) - 1.0) < STEP
    turn, force = reading.angular_velocity, reading.acceleration
    return turned and all(abs(one) <= FASTEST for one in turn) and all(abs(one) <= STRONGEST for one in force)


# Turns of single vectors in plain floats: a sample has three of them, and the tick waits.


def product(a: Quat, b: Quat) -> Quat:
    """The turn `b` followed by the turn `a`, wxyz."""
    (p, q, r, s), (w, x, y, z) = a, b
    return (
        p * w - q * x - r * y - s * z,
        p * x + q * w + r * z - s * y,
        p * y - q * z + r * w + s * x,
        p * z + q * y - r * x + s * w,
    )


def rotated(q: Quat, v: Vector) -> Vector:
    """The vector turned by a unit quaternion, wxyz."""
    w, x, y, z = q
    _, a, b, c = product(product(q, (0.0, *v)), (w, -x, -y, -z))
    return a, b, c


def sum_of_products(a: Quat, b: Quat) -> float:
    """The cosine of half the angle between two unit quaternions."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


def from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Quat:
    """The turn, wxyz, by yaw about z, then by pitch about the new y, then by roll about the new x, rad."""
    (a, x), (b, y), (c, z) = ((math.cos(0.5 * one), math.sin(0.5 * one)) for one in (roll, pitch, yaw))
    return product(product((c, 0.0, 0.0, z), (b, 0.0, y, 0.0)), (a, x, 0.0, 0.0))
