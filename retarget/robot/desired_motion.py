"""Turns what is asked into goals of a tick: an even motion is followed without lag, and a gap is closed evenly.

A solver that corrects all of an error at once, within the acceleration of its joints, gets there too fast to stop, and
oscillates about the goal. Here the step of a tick is the asked motion's own, low-passed, plus no more of the gap that
is left than can be braked before it closes. A gap closes as exp(-RATE t) in the end, and at an even speed while it is
far: in the weighted compromise of a level, a limb that cannot get to its goal pulls no harder than one that is a little
off, so that a hand in reach gets there (Huber, "Robust estimation of a location parameter", 1964).
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
"""Time constant (s) of each of three low passes. Their lag at constant velocity is compensated by feed-forward; a sine
of 2 Hz overshoots by 21 %. Two low passes of 0.025 s, with the same lag, let through twice the noise above 20 Hz."""
RATE = 14.0
"""Share of the gap that is closed per s. The larger, the more noise and the harder braking; the smaller, the more lag
of what is not even."""
FREE, CARRYING = (1.0, 0.4, 1.0), (0.5, 0.2, 0.5)
"""Limits of what carries nothing, and of what carries the robot: of the asked motion's own acceleration, and of the
acceleration and the speed of catching up, as shares of those of the weakest joint at the length of the limb.

How a limb's acceleration maps to a joint's depends on the posture, and a robot on its soles can tip. A jump of what is
asked has more acceleration than its own motion may have, and is caught up with."""
STILL = 1e-12
"""Least length, m or rad, by which is divided."""
FAR = 1e3
"""Distance (m) of the point that the eyes are turned to: so far away it is a direction."""


class MotionFilter:
    """Steps of k points or rotations that follow what is asked: (k, 3), m or rad."""

    def __init__(self, limits: FloatArray, lead_times: FloatArray) -> None:
        """limits (k, 3): of each, m or rad: greatest acceleration of the asked motion that counts as motion, per s^2;
        acceleration and braking of catching up, per s^2; its speed, per s. lead_times (k,): s; the goal is where the
        motion will be then, at its velocity."""
        self._own, self._catch_up, self._speed = limits.T
        self._leads = lead_times[:, None]
        self.restart()

    def restart(self) -> None:
        """Start at rest, after something that stands still."""
        self._first = self._second = self._velocity = self._caught = np.zeros((len(self._own), 3))

    def step(self, moved: FloatArray, error: FloatArray, dt: float, *, speed_override: float = 1.0) -> FloatArray:
        """Displacement (k, 3) to ask for in this tick of `dt` s. moved (k, 3): how far what is asked went since the
        last tick. error (k, 3): from where the robot is to what is asked now. speed_override: (0, 1], share of the
        limit of speed; its square is the share of accelerations, but for what slows down."""
        gain = speed_override * speed_override
        braking, speed = gain * self._catch_up, speed_override * self._speed
        kept = exp(-dt / SMOOTH_S)
        first = kept * (self._first + moved)  # m or rad that the first low pass is behind
        moved = moved + self._first - first
        second = kept * (self._second + moved)
        moved = moved + self._second - second
        self._first, self._second = first, second
        self._velocity = _changed(self._velocity, (1.0 - kept) * (moved / dt - self._velocity), self._own * dt, gain)

        # What is left after following that motion for this tick is the gap that is to be caught up with.
        own, lag = dt * self._velocity, 2.0 * dt * kept / (1.0 - kept)
        gap = error - first - second + (lag + self._leads) * self._velocity - own
        far = norms(gap)
        fastest = np.minimum(np.minimum(RATE * far, np.sqrt(2.0 * braking * far)), speed)
        caught = _limited(gap, np.minimum(fastest * dt, far))
        self._caught = _changed(self._caught, caught - self._caught, self._catch_up * dt * dt, gain)
        return own + self._caught


def _limited(vectors: FloatArray, most: FloatArray) -> FloatArray:
    """Vectors (k, 3), those longer than `most` (k,) drawn in to that."""
    return vectors * (most / np.maximum(np.maximum(norms(vectors), most), STILL))[:, None]


def _changed(velocities: FloatArray, changes: FloatArray, most: FloatArray, gain: float) -> FloatArray:
    """Velocities (k, 3) after changes, of at most `most` (k,) each where it slows down, else a share `gain` of it."""
    slows = norms(velocities + changes) < norms(velocities)
    return velocities + _limited(changes, np.where(slows, most, gain * most))


class DesiredMotion:
    """Goals of the pelvis and other landmarks, of limbs, of the trunk and of the eyes."""

    def __init__(
        self,
        robot: RobotBody,
        hierarchy: Hierarchy,
        limits: JointLimits,
        *,
        still: frozenset[str],
        trunk_at_stance: Quat,
        servo_lead: float = 0.0,
    ) -> None:
        """limits (nv,): those of following. still: landmarks that are planted. trunk_at_stance: orientation wxyz of the
        trunk's frame in the stance. servo_lead: share of the lag of its servos by which what carries nothing is ahead.
        """
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
        moved += [(TRUNK, soles, 1.0), (HEAD, [TRUNK], 1.0)]  # turns, in rad
        channels, lags = zip(*(_channel(robot, limits, *channel) for channel in moved), strict=True)
        self._filter = MotionFilter(np.array(channels), servo_lead * np.array(lags))
        self._hierarchy = hierarchy
        self._trunk_at_stance = trunk_at_stance
        self.restart()

    def restart(self) -> None:
        """Start at rest, without a motion that was asked before."""
        self._before: tuple[FloatArray, DesiredLandmarks] | None = None
        self._filter.restart()

    def aim(
        self, targets: FloatArray, asked: DesiredLandmarks, reached: Reached, dt: float, *, speed_override: float
    ) -> None:
        """Write the goals of a tick of `dt` s into the target vector, for a share (0, 1] of all speeds."""
        there, here = np.array([*asked.landmarks, *asked.limbs]), np.array([*reached.landmarks, *reached.limbs])
        last, before = (there, asked) if self._before is None else self._before
        self._before = there, asked
        turned = _turned(before.trunk, asked.trunk), rotation_vector(arc(before.gaze, asked.gaze))
        error = _turned(reached.trunk, asked.trunk), rotation_vector(arc(reached.gaze, asked.gaze))
        moved, gap = np.concatenate([there - last, turned]), np.concatenate([there - here, error])
        step = self._filter.step(moved, gap, dt, speed_override=speed_override)

        goals = np.column_stack([np.ones(len(here)), here + step[:-2]])
        targets[self._slots] = goals[self._source]
        trunk = product(turn(as_vector(step[-2])), reached.trunk)
        self._hierarchy.set_orientation(targets, TRUNK, np.array(product(trunk, self._trunk_at_stance)))
        self._hierarchy.set_look_at(targets, HEAD, FAR * np.array(rotated(turn(as_vector(step[-1])), reached.gaze)))

    def ask_nothing(self, targets: FloatArray) -> None:
        """Take all goals out of the target vector: the robot goes by its posture alone."""
        targets[self._slots] = 0.0
        self._hierarchy.set_orientation(targets, TRUNK, np.zeros(4), 0.0)
        self._hierarchy.set_look_at(targets, HEAD, np.zeros(3), 0.0)


def _channel(
    robot: RobotBody, limits: JointLimits, frame: str, anchor: Sequence[str], length: float
) -> tuple[FloatArray, float]:
    """Limits (3,), see `MotionFilter`, of a frame `length` m away from the joints between it and its anchor; and s by
    which the quickest of their servos is late, 0 where one of them carries the robot."""
    servos = robot.joint_map.servos
    movers = [servo for servo, moves in zip(servos, joints_between(robot, frame, anchor), strict=True) if moves]
    dofs = [robot.body.dof_index(servo.joint) for servo in movers]
    carries = robot.stands and bool(standing_dofs(robot, TRUNK)[dofs].any())
    acceleration, speed = limits.max_acceleration[dofs].min(), limits.max_velocity[dofs].min()
    channel = length * np.array([acceleration, acceleration, speed]) * (CARRYING if carries else FREE)
    late = 0.0 if carries else min(map(loop_lag, movers)) + 1.0 / robot.profile.safety.rate_hz
    return channel, late


def _turned(before: Quat, now: Quat) -> tuple[float, float, float]:
    """Rotation vector, rad, from one orientation wxyz to another."""
    return rotation_vector(product(now, inverse(before)))
