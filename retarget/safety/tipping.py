"""Whether a robot on its soles tips over an edge of them, and whether it falls: by its IMU and its encoders.

The IMU says how its link is tilted, and the encoders how the soles are tilted to that link. A robot that stands has a
sole flat on the floor; one whose least tilted sole is off it turns about an edge of its soles. There it is an inverted
pendulum, which does not come back by itself once its capture point is beyond that edge:

    x + v / sqrt(g / h) > edge      x, h: place and height of the centre of mass, v: its velocity about the edge

Source: Pratt et al., Capture Point: A Step toward Humanoid Push Recovery (Humanoids 2006).
"""

from enum import Enum
from math import degrees, radians, sqrt

import numpy as np

from hardware.imu import GRAVITY, ImuSample
from retarget._solver import Probe
from retarget.arithmetic import Dwell, arccos
from retarget.model.robot import RobotBody
from retarget.rotations import Quat, Vector, as_quat, as_vector, inverse, minus, product, rotated
from retarget.types import FloatArray

TIPS = radians(5.0)
"""Tilt of the least tilted sole, rad, from which on a robot tips: biases of IMU and mounting, the play of gears and a
floor that is not level stay below."""
STANDS_S = 0.5
"""Time, s, for which a robot that tipped, or whose tilt was not known, must be seen to stand before it goes on."""
FALLS_S = 0.02
"""Time, s, for which the capture point must be beyond the edge: no single sample makes a fall."""
UNKNOWN_S = 0.1
"""Time, s, without a valid measurement after which nothing is known of the tilt: spikes are shorter."""
LEAST_HEIGHT = 0.02
"""Lowest centre of mass over the edge, m, of a robot that lies."""


class TipState(Enum):
    """How a robot on its soles is, as far as it is known."""

    STANDS = "stands"
    TIPS = "tips"
    FALLS = "falls"
    UNKNOWN = "unknown"


HOLDS = {
    TipState.TIPS: "the robot tips: its flattest sole is {:.0f} degrees off the floor",
    TipState.UNKNOWN: "the IMU measures nothing valid: a fall would not be seen",
}
"""Reasons to hold."""
FALL = "the robot falls: its soles tip by {:.0f} degrees, and it cannot catch itself"


class TipWatch:
    """Judges one robot, tick by tick. tilt: of its least tilted sole, rad, at the last valid measurement."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        """robot: stands on its soles, and has an IMU. dt: s of a tick."""
        imu = robot.profile.imu
        assert imu is not None and robot.stands, "the robot stands, and has an IMU"
        links, corners = robot.sole_corners
        carriers = [robot.body.body_index(imu.link), *(sole.body for sole in robot.soles)]
        self._probe = Probe(robot.kinematics, links, corners, carriers)
        self._flat = [as_vector(np.asarray(rotated(as_quat(sole.quat), (0.0, 0.0, 1.0)))) for sole in robot.soles]
        self._q, self._columns, self._dt = robot.posture(robot.profile.postures.stand), robot.servo_columns, dt
        self._beyond, self._silent, self._stood = Dwell(), Dwell(), Dwell(STANDS_S)
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
        silent = self._silent.step(self._dt, holds=not imu.valid)
        if not imu.valid or imu.orientation is None:
            return TipState.UNKNOWN if silent > UNKNOWN_S else self._state
        self._q[self._columns] = joints
        corners, turns, mass = self._probe.read(self._q)
        link, *soles = turns
        to_world = product(as_quat(imu.orientation), inverse(as_quat(link)))
        up = max(
            (rotated(product(to_world, as_quat(sole)), flat) for sole, flat in zip(soles, self._flat, strict=True)),
            key=lambda normal: normal[2],
        )
        self.tilt = arccos(min(up[2], 1.0))
        tips = self.tilt > TIPS
        turn = rotated(as_quat(imu.orientation), as_vector(imu.angular_velocity))
        beyond = tips and self._is_beyond(up, to_world, corners, as_vector(mass), turn)
        if self._beyond.step(self._dt, holds=beyond) > FALLS_S:
            return TipState.FALLS
        return TipState.TIPS if tips else TipState.STANDS

    @property
    def hold_reason(self) -> str:
        """Why the robot is to hold, "" where it need not."""
        return HOLDS.get(self._state, "").format(degrees(self.tilt))

    @property
    def fall(self) -> str:
        """How it falls, "" where it does not."""
        return FALL.format(degrees(self.tilt)) if self._state is TipState.FALLS else ""

    def _is_beyond(self, up: Vector, to_world: Quat, corners: FloatArray, mass: Vector, turn: Vector) -> bool:
        """Whether the capture point is beyond the edge about which the robot turns. up: normal of the sole, which leans
        to where the robot tips; turn: angular velocity, rad/s; world."""
        level = sqrt(up[0] * up[0] + up[1] * up[1])
        x, y = up[0] / level, up[1] / level
        arms = [rotated(to_world, minus(mass, as_vector(corner))) for corner in corners]  # to the mass
        ax, ay, az = min(arms, key=lambda arm: arm[0] * x + arm[1] * y)  # from the edge, which is farthest that way
        wx, wy, wz = turn
        speed = (wy * az - wz * ay) * x + (wz * ax - wx * az) * y  # of the mass about the edge
        return ax * x + ay * y + speed * sqrt(max(az, LEAST_HEIGHT) / GRAVITY) > 0.0


def tip_watch_of(robot: RobotBody, *, dt: float) -> TipWatch | None:
    """The watch of a robot that stands and has an IMU, in ticks of `dt` s; None for any other."""
    return None if robot.profile.imu is None or not robot.stands else TipWatch(robot, dt=dt)
