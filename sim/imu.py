"""A stand-in for an IMU: measurements of a body's true motion, with bias, noise, delay and dropouts.

The same seed gives the same numbers.
"""

import math
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from hardware.arrays import FloatArray
from hardware.clock import Clock
from hardware.imu import (
    STANDARD_GRAVITY,
    STRONGEST,
    ImuReading,
    ImuSample,
    ImuSpec,
    ImuTracker,
    Quat,
    Vector,
    product,
    rotated,
)
from retarget import rotations
from retarget.arithmetic import arcsin, arctan2
from retarget.ik.support_polygon import plant
from retarget.model.robot import RobotBody, plant_root

LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)
"""No rotation."""


@dataclass(frozen=True)
class ImuTruth:
    """The motion of a sensor, along the axes of the link that carries it. orientation: wxyz of the link in the world;
    angular_velocity: rad/s; acceleration: specific force at the sensor, m/s^2."""

    orientation: Quat = LEVEL
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    acceleration: Vector = (0.0, 0.0, STANDARD_GRAVITY)


STILL = ImuTruth()
"""Upright, and standing still."""


def standing_still() -> ImuTruth:
    """Return STILL."""
    return STILL


class PlantedMotion:
    """The motion of the link of the IMU on a robot without mass: its lower sole never leaves the floor."""

    def __init__(self, robot: RobotBody, joints: Callable[[], FloatArray], clock: Clock) -> None:
        """joints: returns their present positions, (n,) rad in servo order."""
        assert robot.profile.imu is not None, "the robot has an IMU"
        self._robot, self._joints, self._clock = robot, joints, clock
        self._link = robot.body.body_index(robot.profile.imu.link)
        self._q = robot.posture(robot.profile.postures.stand)
        if robot.stands:
            self._q = plant(robot, robot.profile.postures.stand).q
        self._time, self._before = clock.now(), LEVEL

    def __call__(self) -> ImuTruth:
        """The present motion. The angular velocity is the mean since the last call."""
        q, now = self._q.copy(), self._clock.now()
        q[self._robot.servo_columns] = self._joints()
        plant_root(self._robot, self._q, q)
        turn = rotations.as_quat(self._robot.kinematics.orientations(q[None], [self._link])[0, 0])
        elapsed = now - self._time
        x, y, z = rotations.rotation_vector(product(rotations.inverse(self._before), turn))
        speed = (x / elapsed, y / elapsed, z / elapsed) if elapsed > 0.0 else (0.0, 0.0, 0.0)
        self._q, self._time, self._before = q, now, turn
        return ImuTruth(turn, speed, rotated(rotations.inverse(turn), (0.0, 0.0, STANDARD_GRAVITY)))


@dataclass(frozen=True)
class ImuErrors:
    """Errors of a sensor: standard deviations of constant bias and of noise, of angles, rad, angular velocity, rad/s,
    and acceleration, m/s^2. delay: age of a reading, s; dropouts: share of missing readings."""

    angle_bias: float = 0.005
    angle_noise: float = 0.001
    turn_bias: float = 0.005
    turn_noise: float = 0.002
    force_bias: float = 0.1
    force_noise: float = 0.08
    delay: float = 0.004
    dropouts: float = 0.0


TYPICAL = ImuErrors()
"""Errors of an MPU-9250 whose gyroscope was calibrated at start: noise 0.1 degree/s and 8 mg (its datasheet)."""


class Ailment(Enum):
    """A fault of a sensor that answers."""

    FROZEN = "shows the same for ever"
    SWAPPED = "shows x and y with the wrong sign"
    SPIKES = "now and then shows numbers beyond its range"


SPIKES = 0.2
"""Share of readings that are spikes."""
SPIKE = 1e3 * STANDARD_GRAVITY  # [m/s^2, rad/s]
KEPT = 100
"""Motions that wait for the delay."""


class ImuStandIn:
    """A sensor on a body, mounted as `spec`; None: along the axes of its link. motion: returns the present motion of
    the link; ailment: the present fault."""

    def __init__(
        self,
        spec: ImuSpec | None = None,
        *,
        seed: int = 0,
        motion: Callable[[], ImuTruth] = standing_still,
        errors: ImuErrors = TYPICAL,
    ) -> None:
        self.ailment: Ailment | None = None
        self.motion, self._errors, self._chance = motion, errors, random.Random(f"IMU {seed}")
        self._mounting: Quat = LEVEL if spec is None else spec.mounting
        w, x, y, z = self._mounting
        self._to_sensor: Quat = (w, -x, -y, -z)
        self._turn_bias, self._force_bias = self._drawn(errors.turn_bias), self._drawn(errors.force_bias)
        self._angle_bias = self._drawn(errors.angle_bias)
        self._moved: deque[tuple[float, ImuTruth]] = deque(maxlen=KEPT)
        self._last: ImuReading | None = None

    def measure(self, now: float) -> ImuReading | None:
        """The reading at `now`, s, along its own axes; None: nothing new."""
        self._moved.append((now, self.motion()))
        while len(self._moved) > 1 and self._moved[1][0] <= now - self._errors.delay:
            self._moved.popleft()
        if self.ailment is Ailment.FROZEN and self._last is not None:
            return self._last
        if self._chance.random() < self._errors.dropouts:
            return None
        self._last = self._reading(self._moved[0][1])
        return self._last

    def _reading(self, truth: ImuTruth) -> ImuReading:
        errors = self._errors
        angles = _added(self._angle_bias, self._drawn(errors.angle_noise))
        w, x, y, z = product(product(truth.orientation, rotations.turn(angles)), self._mounting)
        turn = _added(rotated(self._to_sensor, truth.angular_velocity), self._turn_bias, self._drawn(errors.turn_noise))
        force = _added(rotated(self._to_sensor, truth.acceleration), self._force_bias, self._drawn(errors.force_noise))
        if self.ailment is Ailment.SWAPPED:
            return ImuReading((w, -x, -y, z), (-turn[0], -turn[1], turn[2]), (-force[0], -force[1], force[2]))
        if self.ailment is Ailment.SPIKES and self._chance.random() < SPIKES:
            return ImuReading((w, x, y, z), (SPIKE, -SPIKE, SPIKE), (-SPIKE, SPIKE, -SPIKE))
        fx, fy, fz = (min(max(one, -STRONGEST), STRONGEST) for one in force)  # the range of a sensor
        return ImuReading((w, x, y, z), turn, (fx, fy, fz))

    def _drawn(self, deviation: float) -> Vector:
        """Draw three uniform random numbers of this standard deviation."""
        width, drawn = math.sqrt(12.0) * deviation, self._chance.random
        return width * (drawn() - 0.5), width * (drawn() - 0.5), width * (drawn() - 0.5)


def sample_of(truth: ImuTruth, now: float) -> ImuSample:
    """The sample of a sensor without errors at `now`, s."""
    turn, force = np.array(truth.angular_velocity), np.array(truth.acceleration)
    return ImuSample(now, np.array(truth.orientation), turn, force, True, 0.0)


class SensedMotion:
    """Samples of a sensor without a wire."""

    def __init__(self, spec: ImuSpec, sensor: ImuStandIn) -> None:
        self._tracker, self._sensor = ImuTracker(spec), sensor

    def sample(self, now: float) -> ImuSample:
        """The sample at `now`, s."""
        reading = self._sensor.measure(now)
        if reading is not None:
            self._tracker.take(reading, now)
        return self._tracker.sample(now)


def roll_pitch_yaw(q: Quat) -> Vector:
    """Return roll, pitch and yaw, rad: the inverse of `hardware.imu.from_roll_pitch_yaw`."""
    w, x, y, z = q
    sine = min(max(2.0 * (w * y - x * z), -1.0), 1.0)
    roll = arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, arcsin(sine), arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _added(*vectors: Vector) -> Vector:
    x = y = z = 0.0
    for a, b, c in vectors:
        x, y, z = x + a, y + b, z + c
    return x, y, z
