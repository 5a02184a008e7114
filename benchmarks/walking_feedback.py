"""Feedback of a walking robot, and the limits of its goals, as functions of data (SI units, world axes, joints in rad).

A servo with a P gain is a spring, so a torque is an angle: goal = q + torque / stiffness. What is measured asks for
little more than what is planned: torque at the ankle that carries, and turns of its hip and ankle against the tilt.
"""

from dataclasses import dataclass

import numpy as np

from retarget._solver import Braking, braking_displacement
from retarget.arithmetic import dot
from retarget.types import FloatArray


@dataclass(frozen=True)
class Gains:
    """zmp: shift of the zero-moment point per error of the divergent component; most_shift: its bounds forward and
    sideways, m. tilt: turn of the hip per tilt; hip_rate, ankle_rate: per angular velocity, s."""

    zmp: float = 1.0
    most_shift: tuple[float, float] = (0.045, 0.025)
    tilt: float = 0.5
    hip_rate: float = 0.05
    ankle_rate: float = 0.05


def zmp_shift(gains: Gains, measured: FloatArray, planned: FloatArray) -> FloatArray:
    """Shift (2,) m of the zero-moment point for divergent components (2,) m, along the axes of the sole."""
    shift = gains.zmp * (measured - planned)
    most = np.array(gains.most_shift)
    return np.minimum(np.maximum(shift, -most), most)


def ankle_torques(axes: FloatArray, shift: FloatArray, force: float) -> FloatArray:
    """Torques (k,) N m of ankle joints with world axes (k, 3) that move the point where `force` N presses by `shift`
    (2,) m, world axes: the moment on the sole is shift x force."""
    moment = np.array([shift[1] * force, -shift[0] * force, 0.0])
    return np.array([-dot(axis, moment) for axis in axes])


def turns_against(axes: FloatArray, turn: FloatArray) -> FloatArray:
    """Turns (k,) rad of the joints between a trunk and the leg that carries it, with world axes (k, 3), that turn the
    trunk by -`turn` (3,): a joint turns what is beyond it, and that stands."""
    return np.array([dot(axis, turn) for axis in axes])


class GoalLimits:
    """Goals within limits of speed and acceleration, joint by joint, as near to what is asked as these allow.

    limited (n,): which joints were held back in the last tick."""

    def __init__(self, braking: Braking, change: FloatArray, start: FloatArray) -> None:
        """braking: the gate's limits. change: of a displacement from tick to tick, (n,) rad."""
        self._braking, self._change = braking, change
        self.goal = start.copy()
        self._displacement = np.zeros_like(start)
        self._asked = start.copy()
        self.limited = np.zeros(len(start), dtype=np.bool_)

    def limit(self, asked: FloatArray) -> FloatArray:
        """The goal (n,) of this tick for the one that is asked (n,)."""
        # Where a goal has fallen behind, it closes the gap no faster than it can brake relative to what it follows.
        gap, way = self._asked - self.goal, asked - self._asked
        closing = [np.sign(one) * braking_displacement(abs(one), 0.5 * change) for one, change in zip(gap, self._change)]
        wanted = np.where(np.abs(gap) < 1e-9, asked - self.goal, way + closing)
        straight = asked - self.goal
        low, high = self._braking.bounds(self.goal, self._displacement)
        fits = (straight >= low - 1e-9) & (straight <= high + 1e-9) & (np.abs(straight - way) <= self._change)
        wanted = np.where(fits, straight, wanted)
        self._displacement = np.minimum(np.maximum(wanted, low), high)
        self.goal = self.goal + self._displacement
        self._asked = asked.copy()
        self.limited = np.abs(self.goal - asked) > 1e-6
        return self.goal
