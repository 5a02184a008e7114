"""Step pattern of a walking robot: where its feet, its zero-moment point and its mass are, tick by tick, through some
steps to a stand.

The mass is a linear inverted pendulum of constant height h over a floor, w = sqrt(g/h), whose zero-moment point is z
(T. Takenaka et al., IROS 2009; J. Englsberger et al., IEEE T-RO 31(2), 2015):

    xi  = c + c'/w     xi'  =  w (xi - z)      divergent component of motion
    eta = c - c'/w     eta' = -w (eta - z)     convergent one;  c = (xi + eta)/2,  c' = w (xi - eta)/2

Steps say where soles are and when, and that says where z goes: while both soles carry, from one over the middle to the
other, and then forward on the one that carries. The end is a stand, so xi is known there, and is integrated backward
from it, which is stable; eta is integrated forward, which is stable too. So a step may last for any time. Both are
linear in z: two bumps of z, at the start and at the end, make xi begin, and eta end, where they must.

Everything here is a function of data in a plane of the floor: m, s, rad, x forward and y left.
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
"""Sign of y on the outer side of the left and of the right foot."""
# Times in 1/w. The shorter they are, the more the zero-moment point has to move; each was made shorter until it came to
# within 3 cm of the edge of OP3's soles, which the balance against errors and pushes needs.
RAMP = 1.3
"""Time in which the zero-moment point goes from a sole to the middle, or from there to a sole; it does both at once
where both soles carry for less than twice that."""
CATCH = 2.0
"""Time in which the mass takes up a new plan, at the start of a path; one that rests is pushed to a sole meanwhile."""
EASE = 3.9
"""Time in which the mass comes to rest after the last step."""
ROLL = 0.35
"""While one sole carries, the zero-moment point goes forward on it, from behind its middle to before it by this share
of a step. So the mass goes on while a foot swings, and legs need not reach so far."""


@dataclass(frozen=True)
class Gait:
    """Times and sizes of steps. ticks: of a step, of `dt` s each; least_ticks, most_ticks: of one in time with a
    performer; double_ticks: of double support in each. height: of the centre of mass over the floor, m. width: between
    the centres of the soles, m. lift: greatest height of the foot that swings, m. longest: step forward, m."""

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
        """w, 1/s."""
        return sqrt(GRAVITY / self.height)

    def natural(self, time: float) -> int:
        """The ticks of a time in 1/w."""
        return round(time / (self.omega * self.dt))


@dataclass(frozen=True)
class Request:
    """Velocity asked of a robot, in its own frame: forward and left m/s, turn rad/s."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True)
class Swing:
    """The last swing of a foot of a performer with whom a robot is to keep step. foot: LEFT or RIGHT; since: s since
    its middle; period: s from there to the middle of the other foot's."""

    foot: int
    since: float
    period: float


@dataclass(frozen=True, eq=False)
class Foothold:
    """Centre of a sole on the floor (2,) m, and its yaw, rad."""

    place: FloatArray
    yaw: float

    def moved(self, way: FloatArray, turn: float = 0.0) -> "Foothold":
        """The foothold that is at `way` (2,) m in the frame of this one, turned by `turn` rad."""
        return Foothold(self.place + rotated(way, self.yaw), self.yaw + turn)


@dataclass(frozen=True, eq=False)
class Step:
    """One step. carrying: LEFT or RIGHT. target: where the other sole lands. double, single: ticks in which both soles
    carry, and then one."""

    carrying: int
    target: Foothold
    double: int
    single: int


@dataclass(frozen=True, eq=False)
class Pattern:
    """A walk, tick by tick. divergent, convergent: components of the mass, zmp: zero-moment point, (k, 2) m each;
    height (k,) m of the mass. soles (k, 2, 4): x, y, z m and yaw rad of the left and the right one. carries (k, 2):
    which of them do."""

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
        """Yaw (k,) rad of the trunk: mid-way between those of the soles."""
        return 0.5 * (self.soles[:, 0, 3] + self.soles[:, 1, 3])

    def feet(self, row: int) -> tuple[Foothold, Foothold]:
        """Both footholds in a row in which no sole is in the air."""
        left, right = (Foothold(sole[:2], float(sole[3])) for sole in self.soles[row])
        return left, right


def rotated(way: FloatArray, yaw: float) -> FloatArray:
    """A vector (2,) turned by `yaw` rad."""
    c, s = cos(yaw), sin(yaw)
    return np.array([c * way[0] - s * way[1], s * way[0] + c * way[1]])


def smooth(u: FloatArray) -> FloatArray:
    """3u^2 - 2u^3 within 0 to 1."""
    u = np.minimum(np.maximum(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


def bump(u: FloatArray) -> FloatArray:
    """64 u^3 (1-u)^3 within 0 to 1: 1 in the middle; velocity and acceleration vanish at both ends."""
    u = np.minimum(np.maximum(u, 0.0), 1.0)
    square = u * (1.0 - u)
    return 64.0 * square * square * square


PEAK = 5.53
"""Largest acceleration of `modified_sine`."""


def modified_sine(u: float) -> float:
    """From 0 to 1 within 0 to 1: quarters of sines of acceleration, fast ones at both ends and a slow one between (the
    cam of that name). Velocity and acceleration vanish at both ends; their peaks, 1.76 and PEAK, are less than those of
    minimum jerk, 1.88 and 5.77, and speed is what a servo lacks first."""
    u = min(max(u, 0.0), 1.0)
    if u > 0.5:
        return 1.0 - modified_sine(1.0 - u)
    if u < 0.125:
        return (pi * u - 0.25 * sin(4.0 * pi * u)) / (4.0 + pi)
    return (2.0 + pi * u - 2.25 * sin((pi + 4.0 * pi * u) / 3.0)) / (4.0 + pi)


def landing(gait: Gait, support: Foothold, request: Request, swinging: int, time: float) -> Foothold:
    """The foothold of the foot that swings beside or before the one that carries, in a step of `time` s. Sideways the
    foot on that side makes the whole way, so that soles never come nearer than the width."""
    side, turn = OUTWARD[swinging], request.turn * time
    sideways = 2.0 * request.left * time if side * request.left > 0.0 else 0.0
    half = np.array([0.0, 0.5 * side * gait.width])
    return support.moved(half + np.array([request.forward * time, sideways]) + rotated(half, turn), turn)


def standing(feet: tuple[Foothold, Foothold], mass: FloatArray, ticks: int) -> Pattern:
    """A robot that rests on both feet, its mass at (3,) m, for so many ticks."""
    place, height = np.tile(mass[:2], (ticks, 1)), np.full(ticks, mass[2])
    soles = np.array([[*foot.place, 0.0, foot.yaw] for foot in feet])
    return Pattern(place, place, place, height, np.tile(soles, (ticks, 1, 1)), np.ones((ticks, 2), dtype=np.bool_))


def walk(gait: Gait, begun: Pattern, row: int, steps: Sequence[Step], heights: tuple[float, float]) -> Pattern:
    """The pattern that goes on from a row of another, in which both soles are on the floor, through steps to a stand
    half-way between both feet. Its first row is that one. heights: of the mass, m, while both feet are on the floor,
    and in the middle of a step, where the leg that carries is upright."""
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
        both, swung = _planted(now, step.double), _planted(now, step.single)
        swung[:, 1 - step.carrying] = _swing(gait, now[1 - step.carrying], step.target, u)
        soles += [both, swung]
        risen += [np.zeros(step.double), bump(u)]
        carries += [np.ones((step.double, 2), dtype=np.bool_), np.ones((step.single, 2), dtype=np.bool_)]
        carries[-1][:-1, 1 - step.carrying] = False  # in the last tick it has landed
    last, ticks = soles[-1][-1], gait.natural(EASE)
    middle = 0.5 * (last[0, :2] + last[1, :2])
    soles.append(_planted(last, ticks))
    carries.append(np.ones((ticks, 2), dtype=np.bool_))
    zmp.append(_transfer(gait, zmp[-1][-1], middle, middle, ticks))
    risen.append(np.zeros(ticks))
    pressed, (low, high) = np.concatenate(zmp), heights
    divergent, convergent = _through(gait, pressed, begun.divergent[row], begun.convergent[row], middle)
    height = low + (high - low) * np.concatenate(risen)
    return Pattern(divergent, convergent, pressed, height, np.concatenate(soles), np.concatenate(carries))


def _planted(soles: FloatArray, ticks: int) -> FloatArray:
    """Soles (2, 4) that stay for some ticks."""
    return np.tile(soles, (ticks, 1, 1))


def _swing(gait: Gait, sole: FloatArray, target: Foothold, u: FloatArray) -> FloatArray:
    """Way (k, 4) of the sole that swings, at shares u (k,) of the time from 0 to 1."""
    share = np.array([modified_sine(one) for one in u.tolist()])
    to = np.array([*target.place, 0.0, target.yaw])
    way = sole + share[:, None] * (to - sole)
    way[:, 2] = gait.lift * bump(u)
    way[-1] = to
    return way


def _transfer(gait: Gait, at: FloatArray, middle: FloatArray, to: FloatArray, ticks: int) -> FloatArray:
    """Way (k, 2) m of the zero-moment point over the middle of both soles, tick by tick."""
    ramp, t = min(gait.natural(RAMP), ticks), np.arange(1, ticks + 1)[:, None]
    return at + smooth(t / ramp) * (middle - at) + smooth((t - (ticks - ramp)) / ramp) * (to - middle)


def _through(
    gait: Gait, zmp: FloatArray, divergent: FloatArray, convergent: FloatArray, middle: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Both components (k, 2) m of the mass, from where they are, (2,) m each, to rest in the middle (2,) m. Two bumps
    are added to `zmp` (k, 2) m for that."""
    count, kept = len(zmp), exp(-gait.omega * gait.dt)
    ticks = np.arange(count)[:, None]
    early = bump(ticks / min(gait.natural(CATCH), count - 1))
    late = bump((ticks - (count - 1 - gait.natural(EASE))) / gait.natural(EASE))
    off = divergent - _divergent(zmp, middle, kept)[0], middle - _convergent(zmp, convergent, kept)[-1]
    # Both bumps change xi at the start by a, b and eta at the end by c, d, so their heights h solve
    # [[a, b], [c, d]] h = off.
    rest = np.zeros(1)
    a, b = (float(_divergent(one, rest, kept)[0, 0]) for one in (early, late))
    c, d = (float(_convergent(one, rest, kept)[-1, 0]) for one in (early, late))
    zmp += (early * (d * off[0] - b * off[1]) + late * (a * off[1] - c * off[0])) / (a * d - b * c)
    return _divergent(zmp, middle, kept), _convergent(zmp, convergent, kept)


def _divergent(zmp: FloatArray, end: FloatArray, kept: float) -> FloatArray:
    """The divergent component (k, n) m that ends at (n,) m, by the zero-moment point (k, n) m, which between two ticks
    is at the mean of both. kept: exp(-w dt)."""
    columns = []
    for row, last in zip(zmp.T.tolist(), end.tolist(), strict=True):
        way = [last]
        for now, after in zip(row[-2::-1], row[:0:-1], strict=True):
            between = 0.5 * (now + after)
            way.append(between + kept * (way[-1] - between))
        columns.append(way[::-1])
    return np.ascontiguousarray(np.array(columns).T)


def _convergent(zmp: FloatArray, start: FloatArray, kept: float) -> FloatArray:
    """The convergent component (k, n) m that starts at (n,) m, as `_divergent` says."""
    return _divergent(zmp[::-1], start, kept)[::-1]
