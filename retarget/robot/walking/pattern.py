"""Step pattern of a walking robot: soles, zero-moment point and centre of mass, tick by tick, through steps to a stand.

The mass is a linear inverted pendulum, w = sqrt(g/h), with zero-moment point z (Takenaka et al., IROS 2009; Englsberger
et al., IEEE T-RO 31(2), 2015):

    xi  = c + c'/w,   xi'  =  w (xi - z)      divergent component
    eta = c - c'/w,   eta' = -w (eta - z)     convergent component

Steps prescribe z. xi is integrated backward from the final stand, eta forward. Two bumps of z meet the initial xi and
the final eta. Units are m, s, rad, on the floor, x forward and y left.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt

import numpy as np

from retarget.arithmetic import cos, exp, sin
from retarget.ik.gravity_torque import GRAVITY
from retarget.types import BoolArray, FloatArray

LEFT, RIGHT = 0, 1
OUTWARD = (1.0, -1.0)
"""Sign of y outside each foot."""
# Times in 1/w, which keep the zero-moment point 3 cm inside OP3's soles.
RAMP = 1.3
"""Time of the zero-moment point between a sole and the middle of both."""
CATCH = 2.0
"""Time to take up a new plan at the start of a path."""
EASE = 3.9
"""Time to come to rest after the last step."""
ROLL = 0.35
"""Movement of the zero-moment point on a single sole, relative to the step."""


@dataclass(frozen=True)
class Gait:
    """Times and sizes of steps. ticks: of `dt` s; least_ticks, most_ticks: in time with a performer; double_ticks:
    double support. height: of the mass; width: between soles; lift: of the swing foot; longest: step, m."""

    ticks: int
    least_ticks: int
    most_ticks: int
    double_ticks: int
    dt: float
    height: float
    width: float
    lift: float
    longest: float

    @property
    def period(self) -> float:
        """Duration of a step, s."""
        return self.ticks * self.dt

    @cached_property
    def omega(self) -> float:
        """Natural frequency w of the pendulum, 1/s."""
        return sqrt(GRAVITY / self.height)

    def natural(self, time: float) -> int:
        """Ticks in a time in 1/w."""
        return round(time / (self.omega * self.dt))


@dataclass(frozen=True)
class Request:
    """Requested velocity in the robot's frame: m/s, m/s, rad/s."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True)
class Swing:
    """A performer's swing. foot: LEFT or RIGHT; since: its middle, s ago; period: to that of the other foot, s."""

    foot: int
    since: float
    period: float


@dataclass(frozen=True, eq=False)
class Foothold:
    """Centre of a sole on the floor (2,) m, and its yaw, rad."""

    place: FloatArray
    yaw: float

    def moved(self, offset: FloatArray, turn: float = 0.0) -> "Foothold":
        """Foothold at `offset` (2,) m in this one's frame, turned by `turn` rad."""
        return Foothold(self.place + rotated(offset, self.yaw), self.yaw + turn)


@dataclass(frozen=True, eq=False)
class Step:
    """One step. carrying: LEFT or RIGHT; target: of the other sole; double, single: ticks of support."""

    carrying: int
    target: Foothold
    double: int
    single: int


@dataclass(frozen=True, eq=False)
class Pattern:
    """A walk, tick by tick. divergent, convergent, zmp: (k, 2) m; height: (k,) m, of the mass; soles: (k, 2, 4), x, y,
    z and yaw; carries: (k, 2), True in contact."""

    divergent: FloatArray
    convergent: FloatArray
    zmp: FloatArray
    height: FloatArray
    soles: FloatArray
    carries: BoolArray

    @property
    def mass(self) -> FloatArray:
        """Centre of mass (k, 3) m."""
        return np.column_stack([0.5 * (self.divergent + self.convergent), self.height])

    @property
    def yaws(self) -> FloatArray:
        """Yaw (k,) rad of the trunk."""
        return 0.5 * (self.soles[:, 0, 3] + self.soles[:, 1, 3])

    def feet(self, row: int) -> tuple[Foothold, Foothold]:
        """Both footholds in a row of double support."""
        left, right = (Foothold(sole[:2], float(sole[3])) for sole in self.soles[row])
        return left, right


def rotated(vector: FloatArray, yaw: float) -> FloatArray:
    """Vector (2,) turned by `yaw` rad."""
    c, s = cos(yaw), sin(yaw)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def smooth(u: FloatArray) -> FloatArray:
    """3u^2 - 2u^3 within 0 to 1."""
    u = np.minimum(np.maximum(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


def bump(u: FloatArray) -> FloatArray:
    """64 u^3 (1-u)^3 within 0 to 1."""
    u = np.minimum(np.maximum(u, 0.0), 1.0)
    square = u * (1.0 - u)
    return 64.0 * square * square * square


PEAK = 5.53  # largest acceleration of `modified_sine`


def modified_sine(u: float) -> float:
    """Modified sine cam. Its greatest velocity, 1.76, is less than 1.88 of minimum jerk."""
    u = min(max(u, 0.0), 1.0)
    if u > 0.5:
        return 1.0 - modified_sine(1.0 - u)
    if u < 0.125:
        return (pi * u - 0.25 * sin(4.0 * pi * u)) / (4.0 + pi)
    return (2.0 + pi * u - 2.25 * sin((pi + 4.0 * pi * u) / 3.0)) / (4.0 + pi)


def next_foothold(gait: Gait, support: Foothold, request: Request, swinging: int, time: float) -> Foothold:
    """Foothold of the swing foot in a step of `time` s. Sideways only the outer foot moves."""
    side, turn = OUTWARD[swinging], request.turn * time
    sideways = 2.0 * request.left * time if side * request.left > 0.0 else 0.0
    half = np.array([0.0, 0.5 * side * gait.width])
    return support.moved(half + np.array([request.forward * time, sideways]) + rotated(half, turn), turn)


def standing(feet: tuple[Foothold, Foothold], mass: FloatArray, ticks: int) -> Pattern:
    """Rest on both feet for some ticks, with the mass at (3,) m."""
    place, height = np.tile(mass[:2], (ticks, 1)), np.full(ticks, mass[2])
    soles = np.array([[*foot.place, 0.0, foot.yaw] for foot in feet])
    return Pattern(place, place, place, height, np.tile(soles, (ticks, 1, 1)), np.ones((ticks, 2), dtype=np.bool_))


def walk(gait: Gait, begun: Pattern, row: int, steps: Sequence[Step], heights: tuple[float, float]) -> Pattern:
    """Pattern from a row of `begun` in double support to a stand. heights: of the mass, m, then and in mid-step."""
    soles, carries, zmp = [begun.soles[row : row + 1]], [np.ones((1, 2), dtype=np.bool_)], [begun.zmp[row : row + 1]]
    risen = [np.zeros(1)]
    for step in steps:
        now = soles[-1][-1]
        support, u = now[step.carrying, :2], np.arange(1, step.single + 1) / step.single
        roll = ROLL * 0.5 * (step.target.place - now[1 - step.carrying, :2])
        zmp += [
            _transfer(gait, zmp[-1][-1], 0.5 * (now[0, :2] + now[1, :2]), support - roll, step.double),
            support + (2.0 * smooth(u) - 1.0)[:, None] * roll,
        ]
        both, swung = np.tile(now, (step.double, 1, 1)), np.tile(now, (step.single, 1, 1))
        swung[:, 1 - step.carrying] = _swing(gait, now[1 - step.carrying], step.target, u)
        soles += [both, swung]
        risen += [np.zeros(step.double), bump(u)]
        carries += [np.ones((step.double, 2), dtype=np.bool_), np.ones((step.single, 2), dtype=np.bool_)]
        carries[-1][:-1, 1 - step.carrying] = False  # the last tick is the touchdown
    last, ticks = soles[-1][-1], gait.natural(EASE)
    middle = 0.5 * (last[0, :2] + last[1, :2])
    soles.append(np.tile(last, (ticks, 1, 1)))
    carries.append(np.ones((ticks, 2), dtype=np.bool_))
    zmp.append(_transfer(gait, zmp[-1][-1], middle, middle, ticks))
    risen.append(np.zeros(ticks))
    pressed, (low, high) = np.concatenate(zmp), heights
    divergent, convergent = _through(gait, pressed, begun.divergent[row], begun.convergent[row], middle)
    height = low + (high - low) * np.concatenate(risen)
    return Pattern(divergent, convergent, pressed, height, np.concatenate(soles), np.concatenate(carries))


def _swing(gait: Gait, sole: FloatArray, target: Foothold, u: FloatArray) -> FloatArray:
    """Path (k, 4) of the swing sole at shares u (k,) of its time."""
    share = np.array([modified_sine(one) for one in u.tolist()])
    to = np.array([*target.place, 0.0, target.yaw])
    path = sole + share[:, None] * (to - sole)
    path[:, 2] = gait.lift * bump(u)
    path[-1] = to
    return path


def _transfer(gait: Gait, at: FloatArray, middle: FloatArray, to: FloatArray, ticks: int) -> FloatArray:
    ramp, t = min(gait.natural(RAMP), ticks), np.arange(1, ticks + 1)[:, None]
    return at + smooth(t / ramp) * (middle - at) + smooth((t - (ticks - ramp)) / ramp) * (to - middle)


def _through(
    gait: Gait, zmp: FloatArray, divergent: FloatArray, convergent: FloatArray, middle: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Components (k, 2) m of the mass to rest in the middle. Adds two bumps to `zmp` in place."""
    count, kept = len(zmp), exp(-gait.omega * gait.dt)
    ticks = np.arange(count)[:, None]
    early = bump(ticks / min(gait.natural(CATCH), count - 1))
    late = bump((ticks - (count - 1 - gait.natural(EASE))) / gait.natural(EASE))
    off = divergent - _divergent(zmp, middle, kept)[0], middle - _convergent(zmp, convergent, kept)[-1]
    # Bumps of heights h change xi at the start by a, b and eta at the end by c, d: [[a, b], [c, d]] h = off.
    rest = np.zeros(1)
    a, b = (float(_divergent(one, rest, kept)[0, 0]) for one in (early, late))
    c, d = (float(_convergent(one, rest, kept)[-1, 0]) for one in (early, late))
    zmp += (early * (d * off[0] - b * off[1]) + late * (a * off[1] - c * off[0])) / (a * d - b * c)
    return _divergent(zmp, middle, kept), _convergent(zmp, convergent, kept)


def _divergent(zmp: FloatArray, end: FloatArray, kept: float) -> FloatArray:
    """Divergent component (k, n) m that ends at (n,) m. kept: exp(-w dt)."""
    columns = []
    for row, last in zip(zmp.T.tolist(), end.tolist(), strict=True):
        path = [last]
        for now, after in zip(row[-2::-1], row[:0:-1], strict=True):
            between = 0.5 * (now + after)
            path.append(between + kept * (path[-1] - between))
        columns.append(path[::-1])
    return np.ascontiguousarray(np.array(columns).T)


def _convergent(zmp: FloatArray, start: FloatArray, kept: float) -> FloatArray:
    return _divergent(zmp[::-1], start, kept)[::-1]
