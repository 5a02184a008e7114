"""Whether what is about to be sent keeps the robot clear of itself and of what is around it, until it stands."""

import numpy as np

from retarget import _solver
from retarget.following_error import FollowingError
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.surroundings import Surroundings

__all__ = ["KEPT_SHARE", "SERVOS_SHARE", "PathClearance"]

KEPT_SHARE = 0.25
"""Of each pair's margin, what the gate insists on. The observers keep the whole margin and do the work; if the gate
asked for as much, every rounding of theirs would be a refusal. It is the proof, not the control."""
SERVOS_SHARE = 0.25
"""The same for where servos are measured. The straight line from there to the goal cuts the corners of the way that
they go, and the room that the gate keeps is there for just that."""


class PathClearance:
    """A `retarget.gate.PathCheck` for one robot: the observers and the obstacles of its stage, and where it stands.

    Whoever sends tells it where the servos are (`measure`), before, and what was sent (`sent`), after.

    Two ways are looked at. First the one of the goals: from the posture sent last to the goal and on to rest. The
    servos are behind it, but where a goal went the robot passes later, so that lag alone asks for nothing more. What
    lag does not explain (see `FollowingError`: droop under load, play, a servo that slips) is known in size and in
    direction; it is not spread as a margin in all directions, which would stop a robot whose knees give a little. So
    the second way is the one of the servos: from where they are straight to the goal, and if they are off their way,
    on to rest, off by as much as they are now.
    """

    def __init__(
        self, robot: RobotBody, observers: _solver.Observers, surroundings: Surroundings, *, dt: float
    ) -> None:
        """observers: of the robot's stage, with the obstacles of `surroundings`. dt: s per tick."""
        feet = [robot.frame(foot.frame) for foot in robot.profile.feet.values()] if robot.stands else []
        self._checker = _solver.PathChecker(
            robot.body.solver_body(),
            observers,
            columns=robot.servo_columns,
            sole_links=[foot.body for foot in feet],
            sole_points=np.array([foot.position for foot in feet]).reshape(-1, 3),
        )
        self._around = surroundings
        self._dt = dt
        self._columns = robot.servo_columns
        self._following = FollowingError(robot.joint_map.tick_rad, dt=dt)
        self._standing = robot.body.qpos0.copy()
        self._measured: FloatArray | None = None

    def begin(self, standing: FloatArray, position: FloatArray) -> None:
        """The robot stands as in `standing` (nq,), with its servos at `position` (n,) rad."""
        self._checker.restart()
        self._standing[:] = standing
        self._following.seed(position)
        self._measured = None

    def measure(self, position: FloatArray) -> None:
        """Where the servos (n,) rad are in the tick that begins."""
        self._measured = position

    def sent(self, position: FloatArray, standing: FloatArray) -> None:
        """What was sent, (n,) rad; it stands as in `standing` (nq,)."""
        self._following.sent(position)
        self._standing[:] = standing

    def __call__(self, path: FloatArray, instead: FloatArray) -> bool:
        """Whether a path (k, n) rad is clear; instead (k, n): what is followed if not."""
        self._around.look()
        poses = self._around.now
        if poses is not None:
            self._checker.set_obstacles(poses.position, poses.quat, poses.linear_velocity, poses.angular_velocity)
        if not self._checker.is_clear(self._standing, path, dt=self._dt, share=KEPT_SHARE, instead=instead):
            return False
        return self._measured is None or self._servos_are_clear(path, instead, self._measured)

    def _servos_are_clear(self, path: FloatArray, instead: FloatArray, measured: FloatArray) -> bool:
        off = self._following.unexplained(measured)
        rows = len(path) if off.any() else 2  # without, the rest of the way is the one that is clear already
        way, other = path[:rows] + off, instead[:rows] + off
        way[0] = other[0] = measured
        return self._checker.is_clear(
            self._standing, way, dt=self._dt, share=SERVOS_SHARE, instead=other, remember=False
        )
