"""Targets of a tick for desired landmarks: an even motion is followed without lag, and a gap is closed smoothly.

A solver that corrects a whole error at once arrives too fast to stop. So the step of a tick is the desired motion's
own, low-passed, plus a part of the gap from which the robot can brake. Far gaps close at constant speed, so that a limb
out of reach pulls no harder (Huber, "Robust estimation of a location parameter", 1964); near ones as exp(-RATE t).
"""

from collections.abc import Sequence

import numpy as np

from hardware.servo import loop_lag
from retarget.arithmetic import exp, norms
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.tasks import SlotKind
from retarget.model.body import JointLimits
from retarget.model.robot import HEAD, TRUNK, RobotBody, joints_between
from retarget.robot.landmarks import DesiredLandmarks, Reached, robot_limbs, standing_dofs
from retarget.rotations import Quat, arc, as_vector, inverse, product, rotated, rotation_vector, turn
from retarget.types import FloatArray

SMOOTH_S = 0.018
"""Time constant of three low passes, s. Two with the same lag let through twice the noise."""
RATE = 14.0
"""Rate at which a gap closes, 1/s: a compromise of noise and lag."""
FREE, CARRYING = (1.0, 0.4, 1.0), (0.5, 0.2, 0.5)
"""Limits of landmarks that legs do not move, and of others: acceleration, acceleration and speed of closing gaps,
relative to the weakest joint's."""
SHORTEST = 1e-12
"""Least divisor, m or rad."""
FAR = 1e3
"""Distance of a point in the gaze, m."""


class MotionFilter:
    """Steps (k, 3), m or rad, to desired values."""

    def __init__(self, limits: FloatArray, lead_times: FloatArray) -> None:
        """limits (k, 3): accelerations of motion and of closing gaps, per s^2, and speed of that. lead_times (k,):
        s."""
        self._own, self._catch_up, self._speed = limits.T
        self._ahead = lead_times[:, None]
        self.restart()

    def restart(self) -> None:
        """Start at rest."""
        self._first = self._second = self._velocity = self._caught = np.zeros((len(self._own), 3))

    def step(self, moved: FloatArray, error: FloatArray, dt: float, *, speed_override: float = 1.0) -> FloatArray:
        """Displacement (k, 3) for a tick of `dt` s.

        moved (k, 3): of desired values since the last tick; error (k, 3): to desired values. speed_override: (0, 1],
        share of speed; its square is that of accelerations, not of decelerations.
        """
        gain = speed_override * speed_override
        braking, speed = gain * self._catch_up, speed_override * self._speed
        kept = exp(-dt / SMOOTH_S)
        first = kept * (self._first + moved)
        moved = moved + self._first - first
        second = kept * (self._second + moved)
        moved = moved + self._second - second
        self._first, self._second = first, second
        self._velocity = _changed(self._velocity, (1.0 - kept) * (moved / dt - self._velocity), self._own * dt, gain)

        own, lag = dt * self._velocity, 2.0 * dt * kept / (1.0 - kept)
        gap = error - first - second + (lag + self._ahead) * self._velocity - own
        far = norms(gap)
        fastest = np.minimum(np.minimum(RATE * far, np.sqrt(2.0 * braking * far)), speed)
        caught = _limited(gap, np.minimum(fastest * dt, far))
        self._caught = _changed(self._caught, caught - self._caught, self._catch_up * dt * dt, gain)
        return own + self._caught


def _limited(vectors: FloatArray, most: FloatArray) -> FloatArray:
    return vectors * (most / np.maximum(np.maximum(norms(vectors), most), SHORTEST))[:, None]


def _changed(velocities: FloatArray, changes: FloatArray, most: FloatArray, gain: float) -> FloatArray:
    """Velocities (k, 3) after changes of at most `most` (k,), or `gain` of it where they speed up."""
    slows = norms(velocities + changes) < norms(velocities)
    return velocities + _limited(changes, np.where(slows, most, gain * most))


class DesiredMotion:
    """Writes the targets of landmarks, limbs, trunk and gaze."""

    def __init__(
        self,
        robot: RobotBody,
        hierarchy: Hierarchy,
        limits: JointLimits,
        *,
        still: frozenset[str],
        trunk_at_stance: Quat,
        lag_compensation: float = 0.0,
    ) -> None:
        """limits (nv,): of following. still: planted landmarks. lag_compensation: share of the servos' lag."""
        marks, limbs = robot.profile.landmarks, robot_limbs(robot)
        points = hierarchy.position_slots(["" if name in still else name for name in marks])
        lines = hierarchy.position_slots(list(limbs), SlotKind.LIMB)
        self._source = np.concatenate([points[0], len(marks) + lines[0]])
        self._slots = np.concatenate([points[1], lines[1]])

        soles = [foot.frame for foot in robot.profile.feet.values()]
        moved: list[tuple[str, Sequence[str], float]] = []
        for name, mark in marks.items():
            moved.append((mark.frame, [TRUNK] if name in limbs else mark.anchor, mark.robot_length))
        for name, limb in limbs.items():
            moved.append((marks[name].frame, [TRUNK], limb.length) if name in marks else (TRUNK, soles, limb.length))
        moved += [(TRUNK, soles, 1.0), (HEAD, [TRUNK], 1.0)]  # rotations, rad
        channels, lags = zip(*(_channel(robot, limits, *channel) for channel in moved), strict=True)
        self._filter = MotionFilter(np.array(channels), lag_compensation * np.array(lags))
        self._hierarchy = hierarchy
        self._trunk_at_stance = trunk_at_stance
        self.restart()

    def restart(self) -> None:
        """Start at rest."""
        self._before: tuple[FloatArray, DesiredLandmarks] | None = None
        self._filter.restart()

    def aim(
        self, targets: FloatArray, desired: DesiredLandmarks, reached: Reached, dt: float, *, speed_override: float
    ) -> None:
        """Write the targets of a tick of `dt` s. speed_override: (0, 1], share of all speeds."""
        there, here = np.array([*desired.landmarks, *desired.limbs]), np.array([*reached.landmarks, *reached.limbs])
        last, before = (there, desired) if self._before is None else self._before
        self._before = there, desired
        turned = _turned(before.trunk, desired.trunk), rotation_vector(arc(before.gaze, desired.gaze))
        error = _turned(reached.trunk, desired.trunk), rotation_vector(arc(reached.gaze, desired.gaze))
        moved, gap = np.concatenate([there - last, turned]), np.concatenate([there - here, error])
        step = self._filter.step(moved, gap, dt, speed_override=speed_override)

        goals = np.column_stack([np.ones(len(here)), here + step[:-2]])
        targets[self._slots] = goals[self._source]
        trunk = product(turn(as_vector(step[-2])), reached.trunk)
        self._hierarchy.set_orientation(targets, TRUNK, np.array(product(trunk, self._trunk_at_stance)))
        self._hierarchy.set_look_at(targets, HEAD, FAR * np.array(rotated(turn(as_vector(step[-1])), reached.gaze)))

    def clear(self, targets: FloatArray) -> None:
        """Remove all these targets."""
        targets[self._slots] = 0.0
        self._hierarchy.set_orientation(targets, TRUNK, np.zeros(4), 0.0)
        self._hierarchy.set_look_at(targets, HEAD, np.zeros(3), 0.0)


def _channel(
    robot: RobotBody, limits: JointLimits, frame: str, anchor: Sequence[str], length: float
) -> tuple[FloatArray, float]:
    """Limits (3,) of a frame `length` m from the joints to its anchor, and their least lag, s."""
    servos = robot.joint_map.servos
    movers = [servo for servo, moves in zip(servos, joints_between(robot, frame, anchor), strict=True) if moves]
    dofs = [robot.body.dof_index(servo.joint) for servo in movers]
    carries = robot.stands and bool(standing_dofs(robot, TRUNK)[dofs].any())
    acceleration, speed = limits.max_acceleration[dofs].min(), limits.max_velocity[dofs].min()
    channel = length * np.array([acceleration, acceleration, speed]) * (CARRYING if carries else FREE)
    late = 0.0 if carries else min(map(loop_lag, movers)) + 1.0 / robot.profile.safety.rate_hz
    return channel, late


def _turned(before: Quat, now: Quat) -> tuple[float, float, float]:
    return rotation_vector(product(now, inverse(before)))
