"""Inertial measurement units: mounting, samples, and their plausibility."""

import math
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Protocol

import numpy as np

from hardware.arrays import FloatArray

Vector = tuple[float, float, float]
Quat = tuple[float, float, float, float]
STANDARD_GRAVITY = 9.80665
"""[m/s^2] One g, in which makers give accelerations."""
FRESH = 0.05
"""[s] Age of a valid sample: five frames at 100 Hz, six cycles at 125 Hz."""
FROZEN = 0.2
"""[s] A sensor without any changed bit for so long is frozen."""
FASTEST = math.radians(2000.0)
"""[rad/s] Range of the gyroscopes."""
STRONGEST = 16.0 * STANDARD_GRAVITY
"""[m/s^2] Widest range of the accelerometers."""
BNO08X_BAUD = 115200
"""[bit/s] (datasheet)."""
MAX_JUMP = 0.1
"""[rad] Largest correction by a sensor's filter, beyond the fastest turn."""


class ImuKind(StrEnum):
    """Kinds of sensors."""

    OPENCR = "opencr"
    """OP3's board, a Dynamixel device."""
    BNO08X = "bno08x"
    """BNO080, BNO085 and BNO086 in UART-RVC mode."""


@dataclass(frozen=True)
class ImuSpec:
    """A sensor of a robot. position: m, and mounting: wxyz, in the frame of its link. bus, id: of a device. port, baud:
    of its own serial line."""

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

    time: s on the bus's clock; -inf before the first. orientation (4,): wxyz in a world with z up and free yaw.
    angular_velocity (3,): rad/s. acceleration (3,): specific force, m/s^2, one g upwards at rest. valid: fresh and
    plausible. age: s.
    """

    time: float
    orientation: FloatArray | None
    angular_velocity: FloatArray
    acceleration: FloatArray
    valid: bool
    age: float

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll (to the right) and pitch (forward) of the link, rad, by its orientation or else its acceleration."""
        if self.orientation is None:
            x, y, z = self.acceleration.tolist()
        else:
            w, a, b, c = self.orientation.tolist()
            x, y, z = rotated((w, -a, -b, -c), (0.0, 0.0, 1.0))
        return math.atan2(y, z), math.atan2(-x, math.hypot(y, z))


@dataclass(frozen=True, slots=True)
class ImuReading:
    """A measurement along the sensor's axes, in the units of `ImuSample`."""

    orientation: Quat | None
    angular_velocity: Vector
    acceleration: Vector

    @property
    def is_possible(self) -> bool:
        """True if all numbers are in range. NaN is not."""
        q = self.orientation
        turned = q is None or abs(sum_of_products(q, q) - 1.0) < MAX_JUMP
        turn, force = self.angular_velocity, self.acceleration
        return turned and all(abs(one) <= FASTEST for one in turn) and all(abs(one) <= STRONGEST for one in force)


class ImuFault(Enum):
    """Reasons of an invalid sample."""

    SILENT = "does not answer"
    FROZEN = "shows the same numbers again and again"
    IMPOSSIBLE = "shows numbers that no robot has"


class ImuDevice(Protocol):
    """A sensor that is read within the cycle of a bus. Raises BusError when its port is gone."""

    tracker: "ImuTracker"

    def post(self) -> None:
        """Request a measurement if necessary."""

    def collect(self) -> bool:
        """Take the measurements that have come. Return True if this had to wait."""


class ImuTracker:
    """The newest sample of a sensor, and its fault."""

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
        """Take a reading of the time `time`, s; None: undecodable. Impossible readings are dropped."""
        self._impossible = reading is None or not reading.is_possible or self._jumps(reading, time)
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
        before = None if self._last is None else self._last.orientation
        if before is None or reading.orientation is None:
            return False
        w = sum_of_products(before, reading.orientation)
        chord = 2.0 * math.sqrt(max(0.0, 1.0 - w * w))  # at most the angle between the two
        return chord > MAX_JUMP + FASTEST * max(time - self._time, 0.0)


def product(a: Quat, b: Quat) -> Quat:
    """The quaternion product a * b, wxyz: the rotation `b` followed by `a`."""
    (p, q, r, s), (w, x, y, z) = a, b
    return (
        p * w - q * x - r * y - s * z,
        p * x + q * w + r * z - s * y,
        p * y - q * z + r * w + s * x,
        p * z + q * y - r * x + s * w,
    )


def rotated(q: Quat, v: Vector) -> Vector:
    """A vector rotated by a quaternion, wxyz."""
    w, x, y, z = q
    _, a, b, c = product(product(q, (0.0, *v)), (w, -x, -y, -z))
    return a, b, c


def sum_of_products(a: Quat, b: Quat) -> float:
    """The cosine of half the angle between two unit quaternions."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


def from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Quat:
    """The rotation, wxyz, by yaw about z, then pitch about y, then roll about x, rad."""
    (a, x), (b, y), (c, z) = ((math.cos(0.5 * one), math.sin(0.5 * one)) for one in (roll, pitch, yaw))
    return product(product((c, 0.0, 0.0, z), (b, 0.0, y, 0.0)), (a, x, 0.0, 0.0))
