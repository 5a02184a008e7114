"""Trajectories in joint space: minimum-jerk approach, speed override, retiming within velocity limits."""

from collections.abc import Iterator, Sequence

import numpy as np

from hardware.errors import RetargetError, describe
from hardware.joint_map import JointMap
from retarget.model.robot import RobotBody
from retarget.types import FloatArray, RobotPosture

PEAK_SPEED = 1.875
"""Peak speed of a minimum-jerk path over distance / duration: 30 (s^2 - 2 s^3 + s^4) at s = 1/2."""
PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)
"""Peak acceleration of it over distance / duration^2."""
NEAR_RAD = 1e-9


def approach(
    start: FloatArray,
    goal: FloatArray,
    joint_map: JointMap,
    *,
    speed: float,
    dt: float,
    within: float = float("inf"),
) -> Iterator[FloatArray]:
    """Postures (n,) rad every `dt` s from `start`, at rest, to `goal`, at rest (Flash and Hogan 1985).

    speed: share of each servo's greatest speed and acceleration, exceeded only to be there `within` s; the greatest
    themselves are never exceeded. Yields nothing when already there.
    """
    displacement = goal - start
    distance = np.abs(displacement)
    if distance.max() < NEAR_RAD:
        return
    duration = _duration(distance, joint_map, speed)
    if duration > within:
        duration = max(within - 2.0 * dt, _duration(distance, joint_map, 1.0))
    # One tick more than needed, so that differences between ticks stay below the limits of the curve itself.
    ticks = int(np.ceil(duration / dt)) + 1
    for tick in range(1, ticks + 1):
        s = tick / ticks
        yield start + displacement * (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
    yield goal


def _duration(distance: FloatArray, joint_map: JointMap, speed: float) -> float:
    """Duration, s, of a move by distances (n,) rad at a share of the greatest speeds and accelerations."""
    return max(
        float((PEAK_SPEED * distance / (speed * joint_map.max_velocity)).max()),
        float(np.sqrt(PEAK_ACCELERATION * distance / (speed * joint_map.max_acceleration)).max()),
    )


def slower_in_line(displacement: FloatArray, change: FloatArray) -> FloatArray:
    """The displacement (n,) rad of the next tick, in the same direction, when the joints brake together.

    change (n,): greatest change of each joint's displacement, rad.
    """
    ticks = float((np.abs(displacement) / change).max())
    return displacement * max(1.0 - 1.0 / ticks, 0.0) if ticks > 0.0 else displacement


# A planned trajectory that can be followed more slowly, or left and rejoined.

REJOINING_S = 0.75
"""s in which a robot that has left the trajectory is back on it, at full speed."""


class SpeedOverrideTrajectory:
    """A trajectory of postures (m, n) rad, one row per tick of `dt` s, from where the robot is, with speed override."""

    def __init__(self, rows: FloatArray, *, dt: float, straight: int = 0) -> None:
        """straight: number of rows in one line with the first."""
        self._rows, self._straight = rows, straight
        self._rejoining = round(REJOINING_S / dt)  # ticks
        self._at = 0.0  # rows done
        self._left = False
        self._offset = np.zeros(rows.shape[1])  # [rad] from where it was left to where it was taken up
        self._since = self._rejoining  # ticks since then

    @property
    def ticks(self) -> int:
        """Duration in ticks at full speed, if it is never left."""
        return len(self._rows) - 1

    @property
    def done(self) -> bool:
        """Whether the last posture was returned."""
        return self._at >= len(self._rows) - 1 and self._since >= self._rejoining and not self._left

    @property
    def straight(self) -> bool:
        """Whether the robot is still on the straight first part."""
        return self._at <= self._straight

    @property
    def left(self) -> bool:
        """Whether the robot has left the trajectory."""
        return self._left

    def leave(self) -> None:
        """Leave the trajectory; the robot must stand when it rejoins."""
        self._left = True

    def next(self, override: float = 1.0, *, here: FloatArray | None = None) -> FloatArray:
        """The posture (n,) after one tick at a share (0, 1] of full speed; at the end the last one.

        here: where the robot stands, (n,), if it had left the trajectory: it rejoins from there, slowly at first.
        """
        if self._left and here is not None:
            self._left, self._since = False, 0
            self._offset = here - self._posture()
        if self._since >= self._rejoining:
            return self._advance(override)
        self._since += 1
        share = self._since / self._rejoining
        back = share * share * (3.0 - 2.0 * share)
        return self._advance(override * back) + (1.0 - back) * self._offset

    def _advance(self, rows: float) -> FloatArray:
        self._at = min(self._at + rows, len(self._rows) - 1.0)
        return self._posture()

    def _posture(self) -> FloatArray:
        """The present posture of the trajectory, (n,)."""
        row = int(self._at)
        share = self._at - row
        if share == 0.0:
            return np.array(self._rows[row])
        between: FloatArray = self._rows[row] + share * (self._rows[row + 1] - self._rows[row])
        return between


# Retiming: a trajectory is slowed down where a joint would be too fast, and only there.

SMOOTHING = 20
"""Rows to each side over which the override changes, at first; more where servos could not follow that."""
ROUND_OFF = 1e-9
"""Share of a limit: less beyond it is rounding."""


def retimed(rows: FloatArray, *, most: FloatArray, change: FloatArray) -> FloatArray:
    """The path of rows (m, n) rad, one per tick, in more rows (k, n), from its first row to its last.

    most (n,): longest step of a joint, rad; change (n,): greatest difference between consecutive steps, rad, unless the
    rows themselves have a greater one.
    """
    if len(rows) < 2:
        return rows
    steps = np.abs(np.diff(rows, axis=0))
    share = (steps / most).max(axis=1)  # (m - 1,)
    if share.max() <= 1.0 + ROUND_OFF:
        return rows
    override = np.minimum(1.0, 1.0 / np.maximum(share, ROUND_OFF))
    sharpest = np.maximum(change, np.abs(np.diff(rows, n=2, axis=0)).max(axis=0, initial=0.0)) * (1.0 + ROUND_OFF)
    width = SMOOTHING
    while width < len(rows):
        slower = _resampled(rows, _smooth(override, width))
        if (np.abs(np.diff(slower, n=2, axis=0)) <= sharpest).all():
            return slower
        width *= 2
    return _resampled(rows, np.full(len(override), override.min()))


def _smooth(override: FloatArray, width: int) -> FloatArray:
    """A speed override (m,) that changes gradually and is nowhere greater than the one given."""
    least = np.lib.stride_tricks.sliding_window_view(np.pad(override, 2 * width, mode="edge"), 2 * width + 1).min(
        axis=1
    )
    return np.convolve(least, np.full(2 * width + 1, 1.0 / (2 * width + 1)), mode="valid")


def _resampled(rows: FloatArray, override: FloatArray) -> FloatArray:
    """The path at a speed override (m - 1,) of each step, in rows per tick."""
    at = np.concatenate([[0.0], np.cumsum(1.0 / override)])  # [ticks] when each row is reached
    ticks = np.minimum(np.arange(int(np.ceil(at[-1] - ROUND_OFF)) + 1), at[-1])
    positions = np.interp(ticks, at, np.arange(len(rows)))
    return np.stack([np.interp(positions, np.arange(len(rows)), joint) for joint in rows.T], axis=1)


# The approach: from where the robot was found to where following begins, no joint faster than the profile allows.


def require_finite(*postures: RobotPosture) -> None:
    """Refuse postures that are not finite, before the robot has torque. Raises RetargetError."""
    unknown = sum(not np.isfinite(one.q).all() for one in postures)
    if unknown:
        raise RetargetError(
            describe(
                what="the approach has postures that are not finite",
                where="solver",
                found=f"{unknown} of {len(postures)}",
                then="Begin again; if it comes again, report it: no input may cause it",
            )
        )


def approach_trajectory(
    robot: RobotBody, present: FloatArray, path: Sequence[FloatArray], *, dt: float
) -> SpeedOverrideTrajectory:
    """From `present` (n,) rad straight to the first posture (n,) of a path, and on along it, tick by tick of `dt` s.

    The path is retimed where a joint would exceed its share of speed, `speed_caps.approach`.
    """
    speed, joints = robot.profile.safety.speed_caps.approach, robot.joint_map
    straight = [*approach(present, path[0], joints, speed=speed, dt=dt)]
    rows = retimed(np.array(path), most=speed * joints.max_velocity * dt, change=joints.max_acceleration * dt**2)
    return SpeedOverrideTrajectory(np.array([present, *straight, *rows[1:]]), dt=dt, straight=len(straight))


# Speed limits while following: a step is shortened to a share of what the servos can.

NO_STEP = 1e-12
"""A joint that moves less stands still, rad."""
SLOW_OVERRIDE = 0.5
"""Speed override of a robot that is to be slow: at a quarter of its acceleration, steps can still be shortened."""


def step_share(step: FloatArray, before: FloatArray, *, most: FloatArray, change: FloatArray) -> float:
    """The share (0, 1] of a step to take, so that no joint goes farther than `most`, all (n,) rad.

    before: the last step; change: greatest difference between consecutive steps, which `step` itself keeps. A joint
    that was faster than `most` slows down within `change`.
    """
    size = np.abs(step)
    moving = size > NO_STEP
    if not (size > most).any():
        return 1.0
    within = float((most[moving] / size[moving]).min())
    ahead = np.copysign(1.0, step[moving]) * before[moving]  # as far as it goes in the same direction
    return min(1.0, max(within, float(((ahead - change[moving]) / size[moving]).max())))


class SpeedShare:
    """Limits the steps of one robot, in ticks of `dt` s, to a share of each joint's greatest speed."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        self._slow = robot.profile.safety.speed_caps.approach
        self._most = robot.joint_map.max_velocity * dt  # (n,) [rad]
        self._change = robot.joint_map.max_acceleration * dt**2  # (n,) [rad]
        self._columns = robot.servo_columns
        self._kinematics = robot.body.solver_body()

    def speed_override(self, settled: float) -> float:
        """Speed override (0, 1] of the follower."""
        return SLOW_OVERRIDE + (1.0 - SLOW_OVERRIDE) * settled

    def limited(self, here: FloatArray, there: FloatArray, last: FloatArray, *, settled: float) -> FloatArray | None:
        """The displacement (nv,) from posture `here` towards `there` (nq,), limited to the speed of the approach at
        `settled` 0, rising to full speed at 1; None: no limit applies, go all the way.

        last (n,): displacement of the tick before, rad.
        """
        if settled >= 1.0:
            return None
        most = (self._slow + (1.0 - self._slow) * settled) * self._most
        step = there[self._columns] - here[self._columns]
        share = step_share(step, last, most=most, change=self._change)
        if share >= 1.0:
            return None
        return np.asarray(share * self._kinematics.difference(here, there))
