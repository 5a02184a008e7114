"""Turns what is asked into goals of a tick: an even motion is followed without lag, and a gap is closed evenly.

A solver that corrects all of an error at once, within the acceleration of its joints, gets there too fast to stop, and
oscillates about the goal. Here the step of a tick is the asked motion's own, low-passed, plus a share of the gap that
is left: a gap closes as exp(-RATE t), and its braking asks for no more than RATE^2 times the gap. A gap counts up to
FAR_OFF alone, so a jump is approached at an even speed. And in the weighted compromise of a level, a limb that is far
off because it cannot get there pulls no harder than one that is FAR_OFF, so that a hand in reach gets there (Huber,
"Robust estimation of a location parameter", 1964).
"""

import numpy as np

from retarget.arithmetic import exp, norms
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.tasks import SlotKind
from retarget.model.robot import HEAD, TRUNK, RobotBody
from retarget.robot.landmarks import AskedLandmarks, Reached, robot_limbs
from retarget.rotations import Quat, arc, as_vector, inverse, product, rotated, rotation_vector, turn
from retarget.types import FloatArray

SMOOTH_S = 0.018
"""Time constant (s) of each of three low passes. What they are behind an even motion is added by their velocity, so
that a swing of 2 Hz goes 21 % too far. Two of 0.025 s as far behind let through twice the noise above 20 Hz."""
RATE = 14.0
"""Share of the gap that is closed per s. The larger, the more noise and the harder braking; the smaller, the more lag
of what is not even."""
FAR_OFF = 0.15
"""Gap, rad, or of a limb and a point in lengths of the limb, beyond which it counts no more. Closing it takes RATE *
FAR_OFF = 2.1 rad/s, and braking RATE^2 FAR_OFF = 29 rad/s^2, which most servos of an arm have."""
SUDDEN = 40.0
"""Acceleration, rad/s^2, or in lengths of a limb, with which catching up begins, and up to which what is asked counts
as motion: that of an arm that punches. A jump has more, and is caught up with."""
FAR = 1e3
"""Distance (m) of the point that the eyes are turned to: so far away it is a direction."""


class MotionFilter:
    """Steps of k points or rotations that follow what is asked: (k, 3), m or rad."""

    def __init__(self, lengths: FloatArray, *, lead_time: float = 0.0) -> None:
        """lengths (k,): m of limbs, 1 of rotations. lead_time: s; the goal is where the motion will be then, at its
        velocity."""
        self._lengths, self._lead_time = lengths, lead_time
        self.restart()

    def restart(self) -> None:
        """Start at rest, after something that stands still."""
        self._first = self._second = self._velocity = self._caught = np.zeros((len(self._lengths), 3))

    def step(self, moved: FloatArray, error: FloatArray, dt: float) -> FloatArray:
        """Displacement (k, 3) to ask for in this tick of `dt` s. moved (k, 3): how far what is asked went since the
        last tick. error (k, 3): from where the robot is to what is asked now."""
        kept, sudden = exp(-dt / SMOOTH_S), SUDDEN * dt * self._lengths
        first = kept * (self._first + moved)  # m or rad that the first low pass is behind
        moved = moved + self._first - first
        second = kept * (self._second + moved)
        moved = moved + self._second - second
        self._first, self._second = first, second
        self._velocity = self._velocity + _limited((1.0 - kept) * (moved / dt - self._velocity), sudden)

        # What is left after following that motion for this tick is the gap that is to be caught up with.
        own, lag = dt * self._velocity, 2.0 * dt * kept / (1.0 - kept)
        gap = error - first - second + (lag + self._lead_time) * self._velocity - own
        caught = min(RATE * dt, 1.0) * _limited(gap, FAR_OFF * self._lengths)
        self._caught = self._caught + _limited(caught - self._caught, sudden * dt)
        return own + self._caught


def _limited(vectors: FloatArray, most: FloatArray) -> FloatArray:
    """Vectors (k, 3), those longer than `most` (k,) drawn in to that."""
    return vectors * (most / np.maximum(norms(vectors), most))[:, None]


class AskedMotion:
    """Goals of the pelvis and other landmarks, of limbs, of the trunk and of the eyes."""

    def __init__(
        self,
        robot: RobotBody,
        hierarchy: Hierarchy,
        *,
        still: frozenset[str],
        trunk_at_stance: Quat,
        lead_time: float = 0.0,
    ) -> None:
        """still: landmarks that are planted. trunk_at_stance: orientation wxyz of the trunk's frame in the stance.
        lead_time: s, see `MotionFilter`."""
        marks, limbs = robot.profile.landmarks, robot_limbs(robot)
        moving = [name if name not in still else "" for name in marks]
        points, lines = hierarchy.position_slots(moving), hierarchy.position_slots(list(limbs), SlotKind.LIMB)
        self._source = np.concatenate([points[0], len(marks) + lines[0]])
        self._slots = np.concatenate([points[1], lines[1]])
        lengths = [mark.robot_length for mark in marks.values()] + [limb.length for limb in limbs.values()]
        self._filter = MotionFilter(np.array([*lengths, 1.0, 1.0]), lead_time=lead_time)  # trunk and eyes: rad
        self._hierarchy = hierarchy
        self._trunk_at_stance = trunk_at_stance
        self.restart()

    def restart(self) -> None:
        """Start at rest, without a motion that was asked before."""
        self._before: tuple[FloatArray, AskedLandmarks] | None = None
        self._filter.restart()

    def aim(self, targets: FloatArray, asked: AskedLandmarks, reached: Reached, dt: float) -> None:
        """Write the goals of a tick of `dt` s into the target vector."""
        there, here = np.array([*asked.landmarks, *asked.limbs]), np.array([*reached.landmarks, *reached.limbs])
        last, before = (there, asked) if self._before is None else self._before
        self._before = there, asked
        turned = _turned(before.trunk, asked.trunk), rotation_vector(arc(before.gaze, asked.gaze))
        error = _turned(reached.trunk, asked.trunk), rotation_vector(arc(reached.gaze, asked.gaze))
        step = self._filter.step(np.concatenate([there - last, turned]), np.concatenate([there - here, error]), dt)

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


def _turned(before: Quat, now: Quat) -> tuple[float, float, float]:
    """Rotation vector, rad, from one orientation wxyz to another."""
    return rotation_vector(product(now, inverse(before)))
