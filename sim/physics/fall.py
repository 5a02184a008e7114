"""Whether a simulated robot has fallen.

It has when every sole tips more than MOST_TILT (a torso that bends low over flat soles has not), when its pelvis (the
root link, where the profile has no such frame) is lower than LOW_SHARE of its height in `stand` - or, where the robot
parks lower still, than REST_SHARE of its height there -, or when anything but soles and hands touches the floor
(a hand there is no fall by itself). A robot that parks on more than its soles may do that in its rest posture only. A
robot without torque that was not parked and goes down has fallen too; one that was parked has sat down.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from hardware.arrays import FloatArray
from retarget.robot_body import RobotBody
from retarget.stance import plant
from retarget.ways_home import NEAR_REST
from sim.physics.state import PhysicsState

__all__ = ["Fall", "FallWatch", "parked"]

MOST_TILT = radians(30.0)
LOW_SHARE, REST_SHARE = 0.5, 0.8


@dataclass(frozen=True)
class Fall:
    """time: s since the bus was opened. how: in words. powered: whether servos had torque."""

    time: float
    how: str
    powered: bool


class FallWatch:
    """Looks at each state of a robot that stands on the floor. `fall`: the first, None while it stands."""

    def __init__(self, robot: RobotBody) -> None:
        self._robot = robot
        stand, rest = (plant(robot, posture) for posture in (robot.profile.postures.stand, robot.profile.postures.rest))
        # Height of the pelvis over the root link, seen by the root: with it each state costs one rotation.
        frame = robot.profile.frames.get("pelvis")
        on_root = frame is not None and robot.frame("pelvis").body == int(np.flatnonzero(robot.body.parent == 0)[1])
        self._pelvis = robot.frame("pelvis").position.tolist() if on_root else [0.0, 0.0, 0.0]
        heights = [stance.q[2] + _raised(stance.q.tolist(), self._pelvis) for stance in (stand, rest)]
        self.lowest = min(LOW_SHARE * heights[0], REST_SHARE * heights[1])
        """Of the pelvis, m."""
        self._rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
        self.fall: Fall | None = None

    def look(self, state: PhysicsState, *, powered: bool) -> None:
        """Judge a state."""
        if self.fall is not None:
            return
        how = self._judged(state)
        if how is not None:
            self.fall = Fall(state.time, how, powered)

    def _judged(self, state: PhysicsState) -> str | None:
        root = state.root.tolist()
        if state.tilt.min(initial=np.inf) > MOST_TILT:
            return f"the soles tip by {degrees(state.tilt.min()):.0f} degrees"
        height = root[2] + _raised(root, self._pelvis)
        if height < self.lowest:
            return f"the pelvis is {1e3 * height:.0f} mm high, allowed {1e3 * self.lowest:.0f}"
        if state.touching and not self.parks(state.q):
            return "more than soles and hands touches the floor"
        return None

    def parks(self, q: FloatArray) -> bool:
        """Whether a posture (nq,) is the one in which the robot is parked."""
        return parked(q[self._robot.servo_columns], self._rest)


def parked(joints: FloatArray, rest: FloatArray) -> bool:
    """Whether joints (n,) rad are as in posture `rest` (n,)."""
    return bool(np.abs(joints - rest).max() <= NEAR_REST)


def _raised(root: Sequence[float], point: Sequence[float]) -> float:
    """How high a point (3,) of a root link is over its origin; root: xyz, wxyz. In plain floats, for every tick."""
    w, i, j, k = root[3:7]
    x, y, z = point
    return 2.0 * (i * k - w * j) * x + 2.0 * (j * k + w * i) * y + (1.0 - 2.0 * (i * i + j * j)) * z
