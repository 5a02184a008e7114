"""Fall detection of a robot on its soles, by IMU and encoders.

The lowest sole carries; its first orientation gives the slope of the floor. A robot that turns about an edge of its
soles is an inverted pendulum, and falls once its capture point is beyond that edge:

    x + v / sqrt(g / h) > edge      x, h: place and height of the centre of mass, v: its velocity about the edge

v adds the rotation of the sole and the motion of the mass over it, so a robot that bows over flat soles does not tip.
Source: Pratt et al., Capture Point: A Step toward Humanoid Push Recovery (Humanoids 2006).
"""

from collections import deque
from enum import Enum
from math import degrees, inf, isfinite, radians, sqrt
from typing import NamedTuple

import numpy as np

from hardware.imu import STANDARD_GRAVITY, ImuSample
from retarget._solver import Probe
from retarget.arithmetic import Dwell, arccos, matmul
from retarget.model.robot import RobotBody
from retarget.rotations import Quat, Vector, as_quat, as_vector, inverse, minus, plus, product, rotated, rotation_vector
from retarget.types import FloatArray

TIPS = radians(5.0)  # [rad] least tilt of a tipping robot, above IMU noise and gear play
STANDS_S = 0.5  # [s] of standing before a robot that tipped, or was not observed, goes on
FALLS_S = 0.015  # [s] of a capture point beyond the edge, so that no single measurement makes a fall
UNKNOWN_S = 0.1  # [s] of silence after which the tilt is unknown; spikes are shorter
LOW_M = 0.015  # [m] higher corners are in the air: two soles on a slope of 8 degrees differ by less
RATE_S = 0.02  # [s] window of joint rates: one encoder step in a tick is 0.2 rad/s


class TipState(Enum):
    """The known state of a robot on its soles."""

    STANDS = "stands"
    TIPS = "tips"
    FALLS = "falls"
    UNKNOWN = "unknown"


HOLDS = {
    TipState.TIPS: "the robot tips: its lower sole is {:.0f} degrees off the floor",
    TipState.UNKNOWN: "the IMU measures nothing valid: a fall would not be seen",
}  # hold reasons
FALL = "the robot falls: its soles tip by {:.0f} degrees, and it cannot catch itself"


class _Seen(NamedTuple):
    """The body by its encoders, in axes of a root that does not turn. points (c + k, 3): corners of all soles, then
    their links, m. turns (1 + k, 4): the IMU's link, the soles' links."""

    points: FloatArray
    turns: FloatArray
    mass: FloatArray

    def over(self, sole: int) -> tuple[Quat, Vector]:
        """Orientation of the IMU's link and place of the mass, m, in a sole's link."""
        back = inverse(as_quat(self.turns[1 + sole]))
        origin = self.points[len(self.points) - len(self.turns) + 1 + sole]
        return product(back, as_quat(self.turns[0])), rotated(back, as_vector(self.mass - origin))


class TipWatch:
    """Detects the fall of one robot. tilt: of its lowest sole, rad."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        imu = robot.profile.imu
        assert imu is not None and robot.stands, "the robot stands, and has an IMU"
        links, corners = robot.sole_corners
        carriers = [robot.body.body_index(imu.link), *(sole.body for sole in robot.soles)]
        origins = np.zeros((len(robot.soles), 3))
        self._corners = [row for row, foot in enumerate(robot.profile.feet.values()) for _ in foot.polygon]
        self._probe = Probe(robot.kinematics, [*links, *carriers[1:]], np.concatenate([corners, origins]), carriers)
        self._past = deque[_Seen](maxlen=1 + max(round(RATE_S / dt), 1))
        self._floors: list[Vector] = []
        """The vertical in each sole's link when the robot began to stand."""
        self._q, self._columns, self._dt = robot.posture(robot.profile.postures.stand), robot.servo_columns, dt
        self._silent, self._stood = Dwell(), Dwell(STANDS_S)
        self._beyond_since = inf  # [s] on the bus's clock
        self._state, self.tilt = TipState.STANDS, 0.0

    def look(self, imu: ImuSample, joints: FloatArray) -> TipState:
        """The state now; a fall is final. joints (n,): measured, rad, servo order."""
        if self._state is not TipState.FALLS:
            found = self._look(imu, joints)
            stood = self._stood.step(self._dt, holds=found is TipState.STANDS)
            if found is not TipState.STANDS or stood > STANDS_S:
                self._state = found
        return self._state

    def _look(self, imu: ImuSample, joints: FloatArray) -> TipState:
        self._q[self._columns] = joints
        seen = _Seen(*self._probe.read(self._q))
        self._past.append(seen)
        known = imu.valid and imu.orientation is not None and isfinite(imu.orientation.sum())
        silent = self._silent.step(self._dt, holds=not known)
        if not known or imu.orientation is None:
            return TipState.UNKNOWN if silent > UNKNOWN_S else self._state
        # All vectors from here on are along the axes of that root.
        link = as_quat(seen.turns[0])
        up = rotated(product(link, inverse(as_quat(imu.orientation))), (0.0, 0.0, 1.0))
        heights = matmul(seen.points[: len(self._corners)], np.array(up))
        sole = self._corners[int(heights.argmin())]
        if not self._floors:  # the robot begins to stand, on all its soles
            self._floors = [rotated(inverse(as_quat(turn)), up) for turn in seen.turns[1:]]
        floor = rotated(as_quat(seen.turns[1 + sole]), self._floors[sole])
        cosine = _dot(floor, up)
        self.tilt = arccos(min(cosine, 1.0))
        if self.tilt <= TIPS:
            self._beyond_since = inf
            return TipState.STANDS
        ahead = minus(floor, (cosine * up[0], cosine * up[1], cosine * up[2]))  # where the robot tips, level
        turn, speed = self._motion(sole, rotated(link, as_vector(imu.angular_velocity)))
        arms = seen.mass - seen.points[: len(self._corners)][heights <= heights.min() + LOW_M]
        beyond = _is_beyond(arms, up, ahead, turn, speed)
        self._beyond_since = min(self._beyond_since, imu.time) if beyond else inf
        return TipState.FALLS if imu.time - self._beyond_since >= FALLS_S else TipState.TIPS

    def _motion(self, sole: int, of_link: Vector) -> tuple[Vector, Vector]:
        """Angular velocity of a sole, rad/s, and velocity of the mass over it, m/s."""
        seen, before = self._past[-1], self._past[0]
        (link, mass), (link_then, mass_then) = seen.over(sole), before.over(sole)
        per_s = 1.0 / (self._dt * max(len(self._past) - 1, 1))
        x, y, z = rotated(as_quat(seen.turns[0]), rotation_vector(product(inverse(link_then), link)))
        u, v, w = rotated(as_quat(seen.turns[1 + sole]), minus(mass, mass_then))
        return minus(of_link, (per_s * x, per_s * y, per_s * z)), (per_s * u, per_s * v, per_s * w)

    @property
    def hold_reason(self) -> str:
        """Hold reason, or ""."""
        return HOLDS.get(self._state, "").format(degrees(self.tilt))

    @property
    def fall(self) -> str:
        """Description of the fall, or ""."""
        return FALL.format(degrees(self.tilt)) if self._state is TipState.FALLS else ""


def _is_beyond(arms: FloatArray, up: Vector, ahead: Vector, turn: Vector, speed: Vector) -> bool:
    """True if the capture point is beyond the foremost edge. arms (c, 3): from corners to the mass, m."""
    size = sqrt(_dot(ahead, ahead))
    x, y, z = ahead[0] / size, ahead[1] / size, ahead[2] / size
    arm = as_vector(arms[int(matmul(arms, np.array((x, y, z))).argmin())])
    wx, wy, wz = turn
    ax, ay, az = arm
    about = (wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax)  # omega x arm
    height = max(_dot(arm, up), 0.0)
    return _dot(arm, (x, y, z)) + _dot(plus(about, speed), (x, y, z)) * sqrt(height / STANDARD_GRAVITY) > 0.0


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
