"""Whether a robot on its soles tips over an edge of them, and whether it falls: by its IMU and its encoders.

The IMU says which way is up for its link, and the encoders how the soles are turned to that link. The lowest sole
carries. When the robot stands on the floor for the first time, that sole shows how the floor slopes; from then on its
tilt is measured from there. A robot whose lowest sole leaves the floor turns about an edge of its soles. There it is an
inverted pendulum, which does not come back by itself once its capture point is beyond that edge:

    x + v / sqrt(g / h) > edge      x, h: place and height of the centre of mass, v: its velocity about the edge

v is made of the turn of the sole, which is that of the IMU's link less what the joints turn between the two, and of
what the joints move the mass over the sole: a robot that bows over flat soles does not tip.
Source: Pratt et al., Capture Point: A Step toward Humanoid Push Recovery (Humanoids 2006).
"""

from collections import deque
from enum import Enum
from math import degrees, inf, isfinite, radians, sqrt
from typing import NamedTuple

import numpy as np

from hardware.imu import GRAVITY, ImuSample
from retarget._solver import Probe
from retarget.arithmetic import Dwell, arccos, matmul
from retarget.model.robot import RobotBody
from retarget.rotations import Quat, Vector, as_quat, as_vector, inverse, minus, plus, product, rotated, rotation_vector
from retarget.types import FloatArray

TIPS = radians(5.0)
"""Tilt of the lowest sole, rad, from which on a robot tips: noise of an IMU and the play of gears stay below."""
STANDS_S = 0.5
"""Time, s, for which a robot that tipped, or whose tilt was not known, must be seen to stand before it goes on."""
FALLS_S = 0.015
"""Time, s, over which all measurements must show the capture point beyond the edge: no single one makes a fall."""
UNKNOWN_S = 0.1
"""Time, s, without a valid measurement after which nothing is known of the tilt: spikes are shorter."""
LOW_M = 0.015
"""Corners that are higher than the lowest one by more than this, m, are in the air: on a floor that slopes by 8 degrees
two soles side by side differ by less."""
RATE_S = 0.02
"""Time, s, over which is taken what the joints turn and move: an encoder's step in a tick is 0.2 rad/s."""


class TipState(Enum):
    """How a robot on its soles is, as far as it is known."""

    STANDS = "stands"
    TIPS = "tips"
    FALLS = "falls"
    UNKNOWN = "unknown"


HOLDS = {
    TipState.TIPS: "the robot tips: its lower sole is {:.0f} degrees off the floor",
    TipState.UNKNOWN: "the IMU measures nothing valid: a fall would not be seen",
}
"""Reasons to hold."""
FALL = "the robot falls: its soles tip by {:.0f} degrees, and it cannot catch itself"


class _Seen(NamedTuple):
    """A body by its encoders in a tick, along the axes of a root that does not turn. points (c + k, 3): corners of all
    soles, then their links, m; turns (1 + k, 4): of the IMU's link and of the soles' links; mass (3,): m."""

    points: FloatArray
    turns: FloatArray
    mass: FloatArray

    def over(self, sole: int) -> tuple[Quat, Vector]:
        """The turn of the IMU's link, and the mass, m, along the axes of a sole's link and from its origin."""
        back = inverse(as_quat(self.turns[1 + sole]))
        origin = self.points[len(self.points) - len(self.turns) + 1 + sole]
        return product(back, as_quat(self.turns[0])), rotated(back, as_vector(self.mass - origin))


class TipWatch:
    """Judges one robot, tick by tick. tilt: of its lowest sole to the floor, rad, at the last valid measurement."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        """robot: stands on its soles, and has an IMU. dt: s of a tick."""
        imu = robot.profile.imu
        assert imu is not None and robot.stands, "the robot stands, and has an IMU"
        links, corners = robot.sole_corners
        carriers = [robot.body.body_index(imu.link), *(sole.body for sole in robot.soles)]
        origins = np.zeros((len(robot.soles), 3))
        self._corners = [row for row, foot in enumerate(robot.profile.feet.values()) for _ in foot.polygon]
        self._probe = Probe(robot.kinematics, [*links, *carriers[1:]], np.concatenate([corners, origins]), carriers)
        self._past = deque[_Seen](maxlen=1 + max(round(RATE_S / dt), 1))
        self._floors: list[Vector] = []
        """The vertical along the axes of each sole's link, when the robot began to stand."""
        self._q, self._columns, self._dt = robot.posture(robot.profile.postures.stand), robot.servo_columns, dt
        self._silent, self._stood = Dwell(), Dwell(STANDS_S)
        self._beyond_since = inf  # [s] on the bus's clock
        self._state, self.tilt = TipState.STANDS, 0.0

    def look(self, imu: ImuSample, joints: FloatArray) -> TipState:
        """The state now. imu: of this tick; joints (n,): measured, rad, servo order. A fall stays a fall."""
        if self._state is not TipState.FALLS:
            found = self._look(imu, joints)
            stood = self._stood.step(self._dt, holds=found is TipState.STANDS)
            if found is not TipState.STANDS or stood > STANDS_S:
                self._state = found
        return self._state

    def _look(self, imu: ImuSample, joints: FloatArray) -> TipState:
        """What this tick alone says, or, for a moment, what the last valid measurement said."""
        self._q[self._columns] = joints
        seen = _Seen(*self._probe.read(self._q))
        self._past.append(seen)
        known = imu.valid and imu.orientation is not None and isfinite(imu.orientation.sum())
        silent = self._silent.step(self._dt, holds=not known)
        if not known or imu.orientation is None:
            return TipState.UNKNOWN if silent > UNKNOWN_S else self._state
        # From here on along the axes of that root.
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
        """The turn of a sole, rad/s, and the speed of the mass over it, m/s. of_link: the turn of the IMU's link."""
        seen, before = self._past[-1], self._past[0]
        (link, mass), (link_then, mass_then) = seen.over(sole), before.over(sole)
        per_s = 1.0 / (self._dt * max(len(self._past) - 1, 1))
        x, y, z = rotated(as_quat(seen.turns[0]), rotation_vector(product(inverse(link_then), link)))
        u, v, w = rotated(as_quat(seen.turns[1 + sole]), minus(mass, mass_then))
        return minus(of_link, (per_s * x, per_s * y, per_s * z)), (per_s * u, per_s * v, per_s * w)

    @property
    def hold_reason(self) -> str:
        """Why the robot is to hold, "" where it need not."""
        return HOLDS.get(self._state, "").format(degrees(self.tilt))

    @property
    def fall(self) -> str:
        """How it falls, "" where it does not."""
        return FALL.format(degrees(self.tilt)) if self._state is TipState.FALLS else ""


def _is_beyond(arms: FloatArray, up: Vector, ahead: Vector, turn: Vector, speed: Vector) -> bool:
    """Whether the capture point is beyond the edge, of all corners, that is farthest ahead. arms (c, 3): from each to
    the mass, m; turn: of the sole, rad/s; speed: of the mass over it, m/s."""
    size = sqrt(_dot(ahead, ahead))
    x, y, z = ahead[0] / size, ahead[1] / size, ahead[2] / size
    arm = as_vector(arms[int(matmul(arms, np.array((x, y, z))).argmin())])
    wx, wy, wz = turn
    ax, ay, az = arm
    about = (wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax)  # omega x arm
    height = max(_dot(arm, up), 0.0)
    return _dot(arm, (x, y, z)) + _dot(plus(about, speed), (x, y, z)) * sqrt(height / GRAVITY) > 0.0


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def tip_watch_of(robot: RobotBody, *, dt: float) -> TipWatch | None:
    """The watch of a robot that stands and has an IMU, in ticks of `dt` s; None for any other."""
    return None if robot.profile.imu is None or not robot.stands else TipWatch(robot, dt=dt)
