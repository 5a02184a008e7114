"""The way of a robot that stands to where it is parked."""

from collections.abc import Iterator

from retarget.approach import approach
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["WayHome"]


class WayHome:
    """To the profile's rest posture, once, tick by tick of `dt` s; it ends where something is in the way."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        self._robot, self._dt = robot, dt
        self._way: Iterator[FloatArray] | None = None

    @property
    def begun(self) -> bool:
        """Whether the robot has set off, and perhaps arrived."""
        return self._way is not None

    def next(self, here: FloatArray, *, passed: bool, ticks: int) -> FloatArray | None:
        """The next goal (n,) rad; None: it is there, or cannot go on.

        here (n,): rad, where the robot is; passed: whether the goal before was sent as it was; ticks: at most.
        """
        if self._way is None:
            robot, dt = self._robot, self._dt
            parked = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
            speed, within = robot.profile.safety.speed_caps.approach, (ticks - 1) * dt
            self._way = approach(here, parked, robot.joint_map, speed=speed, dt=dt, within=within)
        elif not passed:  # something is in the way
            self._way = iter(())
        return next(self._way, None)
