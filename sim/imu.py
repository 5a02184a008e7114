"""An IMU that is not there: what it would measure of a body's true motion, with bias, noise, delay and dropouts.

The same seed gives the same numbers. Every reading has noise, as that of a real sensor: one that never changes hangs.
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
from hardware.imu import GRAVITY, STRONGEST, ImuReading, ImuSample, ImuSpec, ImuTracker, Quat, Vector, product, rotated
from retarget import rotations
from retarget.arithmetic import arcsin, arctan2
from retarget.ik.base_pose import plant_root
from retarget.ik.support_polygon import plant
from retarget.model.robot import RobotBody

LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)
"""Not turned at all."""


@dataclass(frozen=True)
class ImuTruth:
    """The motion of a sensor, along the axes of the link that carries it. orientation: wxyz of the link in the world;
    angular_velocity: rad/s; acceleration: m/s^2 where the sensor is, specific force."""

    orientation: Quat = LEVEL
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    acceleration: Vector = (0.0, 0.0, GRAVITY)


STILL = ImuTruth()
"""Upright, and standing still."""


def standing_still() -> ImuTruth:
    """The motion of what does not move."""
    return STILL


class PlantedMotion:
    """Says how the link of the IMU moves on a robot without mass: its lower sole never leaves the floor."""

    def __init__(self, robot: RobotBody, joints: Callable[[], FloatArray], clock: Clock) -> None:
        """joints: says where they are now, (n,) rad in servo order."""
        assert robot.profile.imu is not None, "the robot has an IMU"
        self._robot, self._joints, self._clock = robot, joints, clock
        self._link = robot.body.body_index(robot.profile.imu.link)
        self._q = robot.posture(robot.profile.postures.stand)
        if robot.stands:
            self._q = plant(robot, robot.profile.postures.stand).q
        self._time, self._before = clock.now(), LEVEL

    def __call__(self) -> ImuTruth:
        """The motion now. The angular velocity is the mean one since it was asked last."""
        q, now = self._q.copy(), self._clock.now()
        q[self._robot.servo_columns] = self._joints()
        plant_root(self._robot, self._q, q)
        turn = rotations.as_quat(self._robot.kinematics.orientations(q[None], [self._link])[0, 0])
        elapsed = now - self._time
        x, y, z = rotations.rotation_vector(product(rotations.inverse(self._before), turn))
        speed = (x / elapsed, y / elapsed, z / elapsed) if elapsed > 0.0 else (0.0, 0.0, 0.0)
        self._q, self._time, self._before = q, now, turn
        return ImuTruth(turn, speed, rotated(rotations.inverse(turn), (0.0, 0.0, GRAVITY)))


@dataclass(frozen=True)
class ImuErrors:
    """How wrong a sensor is: standard deviations of what stands still (bias) and of what changes with every reading
    (noise), of angles, rad, angular velocity, rad/s, and acceleration, m/s^2. delay: age of what it shows, s; dropouts:
    share of readings that are missing."""

    angle_bias: float = 0.005
    angle_noise: float = 0.001
    turn_bias: float = 0.005
    turn_noise: float = 0.002
    force_bias: float = 0.1
    force_noise: float = 0.08
    delay: float = 0.004
    dropouts: float = 0.0


TYPICAL = ImuErrors()
"""About those of an MPU-9250 whose gyroscope was calibrated at start: noise 0.1 degree/s and 8 mg (its datasheet)."""


class Ailment(Enum):
    """A fault of a sensor that answers."""

    FROZEN = "shows the same for ever"
    SWAPPED = "shows x and y with the wrong sign"
    SPIKES = "now and then shows numbers beyond its range"


SPIKES = 0.2
"""Share of readings that are spikes."""
SPIKE = 1e3 * GRAVITY  # [m/s^2, rad/s]
KEPT = 100
"""Motions that wait for the delay."""


class ImuStandIn:
    """A sensor in the place of `spec` on a body; None: with the axes of its link. motion: says how its link moves now.
    errors: of it; ailment: of now."""

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
        """What it shows at `now`, s, along its own axes; None: nothing new."""
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
        return ImuReading((w, x, y, z), turn, _within(force, STRONGEST))

    def _drawn(self, deviation: float) -> Vector:
        """Three even random numbers of this standard deviation."""
        width, drawn = math.sqrt(12.0) * deviation, self._chance.random
        return width * (drawn() - 0.5), width * (drawn() - 0.5), width * (drawn() - 0.5)


def sample_of(truth: ImuTruth, now: float) -> ImuSample:
    """What a sensor without an error shows at `now`, s."""
    turn, force = np.array(truth.angular_velocity), np.array(truth.acceleration)
    return ImuSample(now, np.array(truth.orientation), turn, force, True, 0.0)


class SensedMotion:
    """Samples of a sensor that no wire is before."""

    def __init__(self, spec: ImuSpec, sensor: ImuStandIn) -> None:
        self._tracker, self._sensor = ImuTracker(spec), sensor

    def sample(self, now: float) -> ImuSample:
        """What is known at `now`, s."""
        reading = self._sensor.measure(now)
        if reading is not None:
            self._tracker.take(reading, now)
        return self._tracker.sample(now)


def roll_pitch_yaw(q: Quat) -> Vector:
    """Roll, pitch and yaw, rad, that `hardware.imu.from_roll_pitch_yaw` turns back into this orientation."""
    w, x, y, z = q
    sine = min(max(2.0 * (w * y - x * z), -1.0), 1.0)
    roll = arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, arcsin(sine), arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _within(vector: Vector, most: float) -> Vector:
    """What a sensor with this range shows of an impact."""
    x, y, z = (min(max(one, -most), most) for one in vector)
    return x, y, z


def _added(*vectors: Vector) -> Vector:
    x = y = z = 0.0
    for a, b, c in vectors:
        x, y, z = x + a, y + b, z + c
    return x, y, z
