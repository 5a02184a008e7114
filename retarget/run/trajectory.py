"""Trajectories in joint space: approach, retiming within velocity limits, speed override."""

from collections.abc import Iterator, Sequence

import numpy as np

from hardware.errors import RetargetError, describe
from hardware.joint_map import JointMap
from retarget.model.robot import RobotBody
from retarget.types import FloatArray, RobotPosture

__all__ = [
    "REJOINING_S",
    "SpeedOverrideTrajectory",
    "SpeedShare",
    "approach",
    "approach_trajectory",
    "require_finite",
    "retimed",
    "slower_in_line",
    "taken_of",
]


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

    speed: share of each servo's greatest speed and acceleration that is not exceeded, but to be there `within` s; those
    themselves never are. Nothing when already there.
    """
    way = goal - start
    distance = np.abs(way)
    if distance.max() < NEAR_RAD:
        return
    duration = _duration(distance, joint_map, speed)
    if duration > within:
        duration = max(within - 2.0 * dt, _duration(distance, joint_map, 1.0))
    # One tick more than needed: what differences of ticks see stays below what the curve itself has.
    ticks = int(np.ceil(duration / dt)) + 1
    for tick in range(1, ticks + 1):
        s = tick / ticks
        yield start + way * (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
    yield goal


def _duration(distance: FloatArray, joint_map: JointMap, speed: float) -> float:
    """How long a share of the greatest speeds and accelerations takes, s, for distances (n,) rad."""
    return max(
        float((PEAK_SPEED * distance / (speed * joint_map.max_velocity)).max()),
        float(np.sqrt(PEAK_ACCELERATION * distance / (speed * joint_map.max_acceleration)).max()),
    )


def slower_in_line(displacement: FloatArray, change: FloatArray) -> FloatArray:
    """What follows a tick's displacement (n,) rad, in the same direction, when the joints brake together.

    change (n,): most that the displacement of each may change.
    """
    ticks = float((np.abs(displacement) / change).max())
    return displacement * max(1.0 - 1.0 / ticks, 0.0) if ticks > 0.0 else displacement


# A way that is laid out tick by tick, and can be gone along slower, or left and taken up again.

REJOINING_S = 0.75
"""s in which somebody who stood beside the way is back on it, and at full pace."""


class SpeedOverrideTrajectory:
    """Postures (m, n) rad, a tick of `dt` s from row to row, the first where the robot is."""

    def __init__(self, rows: FloatArray, *, dt: float, straight: int = 0) -> None:
        """straight: so many rows lie in one line with the first."""
        self._rows, self._straight = rows, straight
        self._rejoining = round(REJOINING_S / dt)  # ticks
        self._at = 0.0  # rows gone so far
        self._left = False
        self._beside = np.zeros(rows.shape[1])  # [rad] from where it was left to where it was taken up
        self._since = self._rejoining  # ticks since then

    @property
    def ticks(self) -> int:
        """That it takes at full pace, if it is never left."""
        return len(self._rows) - 1

    @property
    def done(self) -> bool:
        """Whether the last posture was returned."""
        return self._at >= len(self._rows) - 1 and self._since >= self._rejoining and not self._left

    @property
    def straight(self) -> bool:
        """Whether the robot is still on its first part, in one line with where it began."""
        return self._at <= self._straight

    @property
    def left(self) -> bool:
        """Whether the robot does something else."""
        return self._left

    def leave(self) -> None:
        """The robot does something else, and will stand when it goes on."""
        self._left = True

    def next(self, pace: float = 1.0, *, here: FloatArray | None = None) -> FloatArray:
        """The posture (n,) after one tick at a share (0, 1] of its speed; at the end the last one.

        here: where the robot stands, (n,), if the way was left: from there, slowly at first, it comes back onto it.
        """
        if self._left and here is not None:
            self._left, self._since = False, 0
            self._beside = here - self._there()
        if self._since >= self._rejoining:
            return self._go(pace)
        self._since += 1
        share = self._since / self._rejoining
        back = share * share * (3.0 - 2.0 * share)
        return self._go(pace * back) + (1.0 - back) * self._beside

    def _go(self, rows: float) -> FloatArray:
        self._at = min(self._at + rows, len(self._rows) - 1.0)
        return self._there()

    def _there(self) -> FloatArray:
        """Where on the way it is, (n,)."""
        row = int(self._at)
        share = self._at - row
        if share == 0.0:
            return np.array(self._rows[row])
        between: FloatArray = self._rows[row] + share * (self._rows[row + 1] - self._rows[row])
        return between


# A way laid out tick by tick, laid out again so that no joint is faster than it may be: slower only where it must.

SMOOTHING = 20
"""Rows to each side over which the pace changes, at first; more where servos could not follow that."""
ROUND_OFF = 1e-9
"""Share of a limit: less beyond it is rounding."""


def retimed(rows: FloatArray, *, most: FloatArray, change: FloatArray) -> FloatArray:
    """The same way as rows (m, n) rad, a tick from row to row, in more ticks (k, n), from its first row to its last.

    most (n,): rad, the longest step of a joint; change (n,): rad, what a step may differ from the one before, where
    those of the way itself do not differ more.
    """
    if len(rows) < 2:
        return rows
    steps = np.abs(np.diff(rows, axis=0))
    share = (steps / most).max(axis=1)  # (m - 1,)
    if share.max() <= 1.0 + ROUND_OFF:
        return rows
    pace = np.minimum(1.0, 1.0 / np.maximum(share, ROUND_OFF))
    sharpest = np.maximum(change, np.abs(np.diff(rows, n=2, axis=0)).max(axis=0, initial=0.0)) * (1.0 + ROUND_OFF)
    width = SMOOTHING
    while width < len(rows):
        laid = _resampled(rows, _smooth(pace, width))
        if (np.abs(np.diff(laid, n=2, axis=0)) <= sharpest).all():
            return laid
        width *= 2
    return _resampled(rows, np.full(len(pace), pace.min()))


def _smooth(pace: FloatArray, width: int) -> FloatArray:
    """A pace (m,) that changes gently and is nowhere greater than the one given."""
    least = np.lib.stride_tricks.sliding_window_view(np.pad(pace, 2 * width, mode="edge"), 2 * width + 1).min(axis=1)
    return np.convolve(least, np.full(2 * width + 1, 1.0 / (2 * width + 1)), mode="valid")


def _resampled(rows: FloatArray, pace: FloatArray) -> FloatArray:
    """The way at a pace (m - 1,) in rows per tick, of each step."""
    at = np.concatenate([[0.0], np.cumsum(1.0 / pace)])  # [ticks] when each row is reached
    ticks = np.minimum(np.arange(int(np.ceil(at[-1] - ROUND_OFF)) + 1), at[-1])
    places = np.interp(ticks, at, np.arange(len(rows)))
    return np.stack([np.interp(places, np.arange(len(rows)), joint) for joint in rows.T], axis=1)


# The way from where a robot was found to where following begins: no joint of it is faster than the profile lets it.


def require_finite(*postures: RobotPosture) -> None:
    """Refuse postures of which nobody knows all numbers, before the robot has torque. Raises RetargetError."""
    unknown = sum(not np.isfinite(one.q).all() for one in postures)
    if unknown:
        raise RetargetError(
            describe(
                what="the robot's posture where following begins is not known",
                where="solver",
                found=f"not finite in {unknown} of {len(postures)} postures on the way there",
                then="Begin again; if it stays, report it: nothing that you send may lead to it",
            )
        )


def approach_trajectory(
    robot: RobotBody, present: FloatArray, arrival: Sequence[FloatArray], *, dt: float
) -> SpeedOverrideTrajectory:
    """From `present` (n,) rad to the first posture (n,) of an arrival, and on along it, tick by tick of `dt` s.

    The arrival is laid out in more ticks where a joint would exceed its share of speed, `speed_caps.approach`.
    """
    speed, joints = robot.profile.safety.speed_caps.approach, robot.joint_map
    there = [*approach(present, arrival[0], joints, speed=speed, dt=dt)]
    rows = retimed(np.array(arrival), most=speed * joints.max_velocity * dt, change=joints.max_acceleration * dt**2)
    return SpeedOverrideTrajectory(np.array([present, *there, *rows[1:]]), dt=dt, straight=len(there))


# How much of a step a robot takes that is not to be faster than a share of what its servos can.

NO_STEP = 1e-12
"""rad; what moves less stands."""
CALM = 0.5
"""Pace at which a robot follows that is to be slow: a quarter of its acceleration leaves room to shorten steps."""


def taken_of(step: FloatArray, before: FloatArray, *, most: FloatArray, change: FloatArray) -> float:
    """The share (0, 1] of a step that is taken, so that no joint goes farther than `most`, all (n,) rad.

    before: the step that was taken last; change: most that steps in a row may differ, which `step` itself keeps. Who
    was faster than `most` slows down no faster than that.
    """
    size = np.abs(step)
    moving = size > NO_STEP
    if not (size > most).any():
        return 1.0
    within = float((most[moving] / size[moving]).min())
    ahead = np.copysign(1.0, step[moving]) * before[moving]  # as far as it goes the same way
    return min(1.0, max(within, float(((ahead - change[moving]) / size[moving]).max())))


class SpeedShare:
    """Steps of one robot in ticks of `dt` s, no joint faster than a share of its greatest speed."""

    def __init__(self, robot: RobotBody, *, dt: float) -> None:
        self._slow = robot.profile.safety.speed_caps.approach
        self._most = robot.joint_map.max_velocity * dt  # (n,) [rad]
        self._change = robot.joint_map.max_acceleration * dt**2  # (n,) [rad]
        self._columns = robot.servo_columns
        self._kinematics = robot.body.solver_body()

    def pace(self, settled: float) -> float:
        """Pace (0, 1] at which it follows."""
        return CALM + (1.0 - CALM) * settled

    def moved(self, here: FloatArray, there: FloatArray, last: FloatArray, *, settled: float) -> FloatArray | None:
        """The displacement (nv,) from posture `here` towards `there` (nq,), in which the speed is that of the slow
        approach, from there to all of it as `settled` goes to 1; None: all the way.

        last (n,): rad, what was moved in the tick before.
        """
        if settled >= 1.0:
            return None
        most = (self._slow + (1.0 - self._slow) * settled) * self._most
        step = there[self._columns] - here[self._columns]
        share = taken_of(step, last, most=most, change=self._change)
        if share >= 1.0:
            return None
        return np.asarray(share * self._kinematics.difference(here, there))
