"""Joint targets of another program, in place of a performer. They come late or in jumps, so they are smoothed."""

from typing import Protocol

import numpy as np

from retarget._solver import TrajectoryGenerator
from retarget.human.samples import PerformerInput
from retarget.model.robot import RobotBody, plant_root
from retarget.robot.follower import Follower
from retarget.run.controllers import JERK_S, RISE_S, Commanded, Controller, GoalsInstead, Target
from retarget.types import FloatArray

TARGET_RISE_S, TARGET_JERK_S = 0.06, 0.03
"""[s] Rise of the smoothed target's velocity and acceleration: about two periods of targets at 30 Hz."""
JUMP = 1.5
"""A target faster than this multiple of a servo's greatest velocity has jumped; timing noise is less."""


class JointTargets(Protocol):
    """A source of joint targets."""

    def target(self) -> FloatArray:
        """The target of this tick, (n,) rad, servo order, finite."""
        ...


class TargetFollower(Controller):
    """Follows the smoothed target plus an offset, commanded - target, that decays at approach speed. It restarts with
    following, after a refusal, and when the target jumps."""

    def __init__(self, robot: RobotBody, follower: Follower, targets: JointTargets, *, dt: float) -> None:
        """follower: plans the stops of a robot on its soles."""
        self._robot, self._follower, self._targets, self._dt = robot, follower, targets, dt
        servos, share = robot.joint_map, robot.profile.safety.speed_caps.approach
        slow, self._most = share * servos.max_velocity, JUMP * servos.max_velocity * dt
        fade = np.minimum(slow / RISE_S, 0.5 * servos.max_acceleration)
        smooth = np.minimum(servos.max_velocity / TARGET_RISE_S, servos.max_acceleration - fade)
        self._smooth = TrajectoryGenerator(servos.max_velocity, smooth, smooth / TARGET_JERK_S, dt=dt)
        self._offset = TrajectoryGenerator(slow, fade, fade / JERK_S, dt=dt)
        self._none = np.zeros(len(servos))
        self._last: Target | None = None  # None: nothing was asked for yet
        self._target = self._before = self._none

    def begin(self, commanded: Commanded) -> None:
        """Follow from where the robot stands."""
        self._last, self._before = None, commanded.joints

    def target(self, commanded: Commanded, performer: PerformerInput, *, speed_override: float) -> Target:
        """The target of the next tick, with the path of its stop."""
        self._follower.pass_time(self._dt)
        target = np.clip(self._targets.target(), self._robot.joint_map.lower, self._robot.joint_map.upper)
        jumped = (np.abs(target - self._target) > self._most).any()
        if self._last is None or jumped:
            self._smooth.reset(target)
        if self._last is None or jumped or commanded.target is not self._last:
            velocity = (commanded.joints - self._before) / self._dt
            self._offset.reset(commanded.joints - self._smooth.position, velocity - self._smooth.velocity)
        self._target, self._before = target, commanded.joints
        joints = self._smooth.step(target, speed_override) + self._offset.step(self._none, speed_override)
        # Planted where the robot stands, with the stop on its soles.
        robot, dt, q = self._robot, self._dt, commanded.standing.copy()
        q[robot.servo_columns] = joints
        plant_root(robot, commanded.standing, q)
        velocity = robot.kinematics.difference(commanded.standing, q) / dt
        self._last = Target(joints, q, self._follower.stop_from(q, velocity, dt))
        return self._last


def following_targets(
    robot: RobotBody, follower: Follower, targets: JointTargets, *, first: FloatArray, dt: float
) -> GoalsInstead:
    """Follow joint targets. first (n,): rad, destination of the approach."""
    return GoalsInstead(TargetFollower(robot, follower, targets, dt=dt), first, "the targets")
