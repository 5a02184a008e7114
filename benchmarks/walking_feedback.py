"""Feedback of a walking robot, and the limits of its goals, as functions of data (SI units, world axes, joints in rad).

A servo with a P gain is a spring, so a torque is an angle: goal = q + torque / stiffness. What is measured asks for
little more than what is planned: torque at the ankle that carries, and turns of its hip and ankle against the tilt.
"""

from dataclasses import dataclass
from math import copysign

import numpy as np

from benchmarks.walking_pattern import Gait, Moment, rotated
from retarget._solver import Braking, braking_displacement
from retarget.arithmetic import dot
from retarget.types import FloatArray

SMOOTH_S = 0.02
"""Time constant of the measured velocity of the mass, and of what the IMU shows: noise would accelerate goals."""
HIP, ANKLE = slice(1, 3), slice(4, 6)
"""Roll and pitch of the hip, pitch and roll of the ankle, among the six joints of a leg from the hip down."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What encoders and IMU say, along the axes of the world, with the trunk at its planned yaw and its root at the
    origin. mass (3,): centre of mass, m; soles (2, 3): their centres, m; yaws (2,): of the soles, rad; axes (2, 6, 3):
    of the legs' joints; tilt (3,): of the trunk, rad; rate (3,): its angular velocity, rad/s."""

    mass: FloatArray
    axes: FloatArray
    tilt: FloatArray
    rate: FloatArray
    soles: FloatArray
    yaws: FloatArray


@dataclass(frozen=True)
class Gains:
    """zmp: shift of the zero-moment point per error of the divergent component; most_shift: its bounds forward and
    sideways, m. tilt: turn of the hip per tilt; hip_rate, ankle_rate: per angular velocity, s."""

    zmp: float = 1.0
    most_shift: tuple[float, float] = (0.045, 0.025)
    tilt: float = 0.5
    hip_rate: float = 0.05
    ankle_rate: float = 0.05


def zmp_shift(gains: Gains, error: FloatArray) -> FloatArray:
    """Shift (2,) m of the zero-moment point for an error (2,) m of the divergent component, along the axes of the
    sole."""
    shift = gains.zmp * error
    most = np.array(gains.most_shift)
    return np.asarray(np.minimum(np.maximum(shift, -most), most))


def ankle_torques(axes: FloatArray, shift: FloatArray, force: float) -> FloatArray:
    """Torques (k,) N m of ankle joints with world axes (k, 3) that move the point where `force` N presses by `shift`
    (2,) m, world axes: the moment on the sole is shift x force."""
    moment = np.array([shift[1] * force, -shift[0] * force, 0.0])
    return np.array([-dot(axis, moment) for axis in axes])


def turns_against(axes: FloatArray, turn: FloatArray) -> FloatArray:
    """Turns (k,) rad of the joints between a trunk and the leg that carries it, with world axes (k, 3), that turn the
    trunk by -`turn` (3,): a joint turns what is beyond it, and that stands."""
    return np.array([dot(axis, turn) for axis in axes])


class Feedback:
    """Corrections of both legs, tick by tick. error (2,): of the divergent component, m, in the last tick."""

    def __init__(self, gait: Gait, gains: Gains, *, weight: float) -> None:
        """weight: of the robot, N."""
        self._gait, self._gains, self._weight = gait, gains, weight
        self._share = gait.dt / (SMOOTH_S + gait.dt)
        self._before: FloatArray | None = None
        self._velocity = np.zeros((2, 2))
        self._rate, self._tilt = np.zeros(3), np.zeros(3)
        self.error = np.zeros(2)

    def step(self, measured: Measured, then: Moment, now: Moment) -> tuple[FloatArray, FloatArray]:
        """Turns (2, 6) rad and torques (2, 6) N m of the legs' joints. then: the pattern when what is measured was to
        be; now: that of this tick, whose shares of the weight decide which leg corrects."""
        gains = self._gains
        self.error = self._divergent(measured, then) - then.pendulum.divergent
        self._rate += self._share * (measured.rate - self._rate)
        self._tilt += self._share * (measured.tilt - self._tilt)
        turns, torques = np.zeros((2, 6)), np.zeros((2, 6))
        for side, share in enumerate(now.shares):
            axes, yaw = measured.axes[side], now.soles[side].yaw
            shift = rotated(zmp_shift(gains, rotated(self.error, -yaw)), yaw)
            torques[side, ANKLE] = ankle_torques(axes[ANKLE], shift, share * self._weight)
            back = gains.tilt * self._tilt + gains.hip_rate * self._rate
            turns[side, HIP] = share * turns_against(axes[HIP], back)
            turns[side, ANKLE] = share * turns_against(axes[ANKLE], gains.ankle_rate * self._rate)
        return turns, torques

    def _divergent(self, measured: Measured, then: Moment) -> FloatArray:
        """Divergent component (2,) m of the mass, from both soles as they carry."""
        relative = (measured.mass - measured.soles)[:, :2]
        if self._before is not None:
            self._velocity += self._share * ((relative - self._before) / self._gait.dt - self._velocity)
        self._before = relative
        found = np.zeros(2)
        for side, share in enumerate(then.shares):
            sole, way = then.soles[side], relative[side] + self._velocity[side] / self._gait.omega
            found += share * (sole.place[:2] + rotated(way, sole.yaw - float(measured.yaws[side])))
        return found


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
        pairs = zip(gap.tolist(), self._change.tolist(), strict=True)
        closing = [copysign(braking_displacement(abs(one), 0.5 * change), one) for one, change in pairs]
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
