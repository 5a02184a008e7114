"""Step pattern of a walking robot: divergent component of motion, footholds, and the path of the foot that swings.

The mass is a linear inverted pendulum of constant height h over a floor, w = sqrt(g/h), whose zero-moment point is z
(T. Takenaka et al., IROS 2009; J. Englsberger et al., IEEE T-RO 31(2), 2015):

    xi  = c + c'/w     xi'  =  w (xi - z)      divergent component of motion
    eta = c - c'/w     eta' = -w (eta - z)     convergent one;  c = (xi + eta)/2,  c' = w (xi - eta)/2

A step of T seconds begins with a double support of Td, in which z goes from the old sole to the new one as 3u^2 - 2u^3;
then z stays, and the other foot swings. With A = exp(w T), e = xi - z at the start, d the way of z in the step:
e(T) = A (e + f d). So e + f d is what grows, and the next foothold is where it is as the request asks (dead beat).

Everything here is a function of data in a plane of the floor: m, s, rad, x forward and y left.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import pi, sqrt

import numpy as np

from retarget.arithmetic import cos, exp, sin
from retarget.ik.gravity_torque import GRAVITY
from retarget.types import FloatArray

LEFT, RIGHT = 0, 1
OUTWARD = (1.0, -1.0)
"""Sign of y on the outer side of the left and of the right foot."""


@dataclass(frozen=True)
class Gait:
    """Times and sizes of steps. ticks: of a step, of `dt` s each; double_ticks: of its double support. height: of the
    centre of mass over the floor, m. width: between the centres of the soles, m. lift: greatest height of the foot
    that swings, m. narrowest, longest: bounds of a step, sideways and forward, m."""

    ticks: int
    double_ticks: int
    dt: float
    height: float
    width: float
    lift: float
    narrowest: float
    longest: float

    @property
    def period(self) -> float:
        """Duration T of a step, s."""
        return self.ticks * self.dt

    @property
    def double(self) -> float:
        """Duration Td of its double support, s."""
        return self.double_ticks * self.dt

    @cached_property
    def omega(self) -> float:
        """w, 1/s."""
        return sqrt(GRAVITY / self.height)

    @cached_property
    def growth(self) -> float:
        """A = exp(w T)."""
        return exp(self.omega * self.period)

    @cached_property
    def shift(self) -> float:
        """f: the share of a step's way d by which its double support pushes the divergent component."""
        a = self.omega * self.double
        return 1.0 - _response(0.0, a) + exp(-a) * (_response(1.0, a) - 1.0)


@dataclass(frozen=True)
class Request:
    """Velocity asked of a robot, in its own frame: forward and left m/s, turn rad/s."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, eq=False)
class Foothold:
    """Centre of a sole on the floor (2,) m, and its yaw, rad."""

    place: FloatArray
    yaw: float

    def moved(self, way: FloatArray, turn: float = 0.0) -> "Foothold":
        """The foothold that is at `way` (2,) m in the frame of this one, turned by `turn` rad."""
        return Foothold(self.place + rotated(way, self.yaw), self.yaw + turn)


@dataclass(frozen=True, eq=False)
class Pendulum:
    """State of the mass: divergent and convergent component (2,) m each."""

    divergent: FloatArray
    convergent: FloatArray

    @property
    def mass(self) -> FloatArray:
        """Centre of mass (2,) m."""
        return 0.5 * (self.divergent + self.convergent)


@dataclass(frozen=True, eq=False)
class Step:
    """One step. carrying: LEFT or RIGHT. feet: where both soles are at its start; target: where the other lands. start:
    state of the mass. zmp: (2,) m, from where the zero-moment point comes."""

    carrying: int
    feet: tuple[Foothold, Foothold]
    target: Foothold
    start: Pendulum
    zmp: FloatArray

    @property
    def support(self) -> Foothold:
        """Where the sole is that carries."""
        return self.feet[self.carrying]


@dataclass(frozen=True, eq=False)
class SolePose:
    """Pose of a sole: place (3,) m, yaw rad."""

    place: FloatArray
    yaw: float


@dataclass(frozen=True, eq=False)
class PatternState:
    """The pattern at one time: state of the mass, zero-moment point (2,) m, poses of both soles, yaw of the trunk,
    rad. carries: which soles press on the floor, left and right."""

    pendulum: Pendulum
    zmp: FloatArray
    soles: tuple[SolePose, SolePose]
    yaw: float
    carries: tuple[bool, bool]


def rotated(way: FloatArray, yaw: float) -> FloatArray:
    """A vector (2,) turned by `yaw` rad."""
    c, s = cos(yaw), sin(yaw)
    return np.array([c * way[0] - s * way[1], s * way[0] + c * way[1]])


def smooth(u: float) -> float:
    """3u^2 - 2u^3 within 0 to 1."""
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


def minimum_jerk(u: float) -> float:
    """10u^3 - 15u^4 + 6u^5 within 0 to 1 (T. Flash and N. Hogan, J. Neuroscience 5(7), 1985)."""
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def modified_sine(u: float) -> float:
    """From 0 to 1 within 0 to 1: quarters of sines of acceleration, fast ones at both ends and a slow one between (the
    cam of that name). Velocity and acceleration vanish at both ends; their peaks, 1.76 and 5.53, are less than those of
    minimum jerk, 1.88 and 5.77, and speed is what a servo lacks first."""
    u = min(max(u, 0.0), 1.0)
    if u > 0.5:
        return 1.0 - modified_sine(1.0 - u)
    if u < 0.125:
        return (pi * u - 0.25 * sin(4.0 * pi * u)) / (4.0 + pi)
    return (2.0 + pi * u - 2.25 * sin((pi + 4.0 * pi * u) / 3.0)) / (4.0 + pi)


def bump(u: float) -> float:
    """64 u^3 (1-u)^3 within 0 to 1: 1 in the middle; velocity and acceleration vanish at both ends."""
    u = min(max(u, 0.0), 1.0)
    square = u * (1.0 - u)
    return 64.0 * square * square * square


def _response(u: float, a: float) -> float:
    """Particular solution of x' = a (x - s) for s = 3u^2 - 2u^3, by u: s + s'/a + s''/a^2 + s'''/a^3."""
    return u * u * (3.0 - 2.0 * u) + (6.0 * u * (1.0 - u) + ((6.0 - 12.0 * u) - 12.0 / a) / a) / a


def _component(start: FloatArray, zmp: FloatArray, to: FloatArray, rate: float, ramp: float, t: float) -> FloatArray:
    """x (2,) after t s of x' = rate (x - z), z from `zmp` to `to` within `ramp` s."""
    a = rate * ramp
    u = min(t / ramp, 1.0)
    way = to - zmp
    x = zmp + way * _response(u, a) + exp(rate * u * ramp) * (start - zmp - way * _response(0.0, a))
    return x if t <= ramp else to + exp(rate * (t - ramp)) * (x - to)


def pendulum_after(
    start: Pendulum, zmp: FloatArray, to: FloatArray, *, omega: float, ramp: float, t: float
) -> Pendulum:
    """State of the mass after t s in which the zero-moment point (2,) m goes from `zmp` to `to` within `ramp` s, and
    stays."""
    return Pendulum(
        _component(start.divergent, zmp, to, omega, ramp, t), _component(start.convergent, zmp, to, -omega, ramp, t)
    )


def in_step(gait: Gait, step: Step, t: float) -> Pendulum:
    """State of the mass t s after the start of a step."""
    return pendulum_after(step.start, step.zmp, step.support.place, omega=gait.omega, ramp=gait.double, t=t)


def displacement(gait: Gait, request: Request, swinging: int) -> tuple[FloatArray, float]:
    """Way (2,) m from the sole that carries to where the other lands, in its frame, and the turn, rad. Sideways the
    foot on that side makes the whole way, so that soles never come nearer than the width."""
    side, turn = OUTWARD[swinging], request.turn * gait.period
    sideways = 2.0 * request.left * gait.period if side * request.left > 0.0 else 0.0
    half = np.array([0.0, 0.5 * side * gait.width])
    way = half + np.array([request.forward * gait.period, sideways]) + rotated(half, turn)
    return way, turn


def offset(gait: Gait, way: FloatArray, after: FloatArray) -> FloatArray:
    """b (2,) m: divergent component from the new sole at the start of a step which has led by `way`, where steps go on
    as `after`, `way`, `after`, ... for ever."""
    grown, shift = gait.growth, gait.shift
    return (grown * (after - grown * shift * way) + way - grown * shift * after) / (grown * grown - 1.0)


def foothold(gait: Gait, step: Step, request: Request) -> Foothold:
    """Where the foot that swings lands: there the mass goes on as `request` asks (dead beat), within bounds."""
    swinging = 1 - step.carrying
    way, turn = displacement(gait, request, swinging)
    after, _ = displacement(gait, request, step.carrying)
    wanted = offset(gait, way, rotated(after, turn)) + gait.shift * way
    end = in_step(gait, step, gait.period).divergent
    support, shift = step.support, gait.shift
    place = (end - shift * support.place - rotated(wanted, support.yaw)) / (1.0 - shift)
    local = rotated(place - support.place, -support.yaw)
    side = OUTWARD[swinging]
    x = min(max(float(local[0]), -gait.longest), gait.longest)
    y = side * min(max(side * float(local[1]), gait.narrowest), 2.0 * gait.width)
    return support.moved(np.array([x, y]), turn)


def next_step(gait: Gait, step: Step, request: Request) -> Step:
    """The step that follows a step."""
    feet = (step.target, step.feet[1]) if step.carrying == RIGHT else (step.feet[0], step.target)
    start = in_step(gait, step, gait.period)
    made = Step(1 - step.carrying, feet, step.target, start, step.support.place)
    return replace(made, target=foothold(gait, made, request))


def first_step(gait: Gait, feet: tuple[Foothold, Foothold], carrying: int, start: Pendulum, zmp: FloatArray) -> Step:
    """The first step from a stand, in place, with the zero-moment point at `zmp` (2,) m until then."""
    made = Step(carrying, feet, feet[1 - carrying], start, zmp)
    return replace(made, target=foothold(gait, made, Request()))


def sway_target(gait: Gait, feet: tuple[Foothold, Foothold], carrying: int, zmp: FloatArray) -> FloatArray:
    """Divergent component (2,) m from which a first step in place goes on for ever."""
    way, _ = displacement(gait, Request(), 1 - carrying)
    support = feet[carrying]
    wanted = rotated(offset(gait, -way, way) + gait.shift * -way, support.yaw)
    return support.place + wanted - gait.shift * (support.place - zmp)


def swing(gait: Gait, start: Foothold, target: Foothold, t: float) -> SolePose:
    """Pose of the foot that swings, t s after the start of a step."""
    u = (t - gait.double) / (gait.period - gait.double)
    share = modified_sine(u)
    flat = start.place + share * (target.place - start.place)
    yaw = start.yaw + share * (target.yaw - start.yaw)
    return SolePose(np.array([flat[0], flat[1], gait.lift * bump(u)]), yaw)


def moment(gait: Gait, step: Step, t: float) -> PatternState:
    """The pattern t s after the start of a step."""
    carrying, swinging = step.carrying, 1 - step.carrying
    loaded = smooth(t / gait.double)
    zmp = step.zmp + loaded * (step.support.place - step.zmp)
    support = SolePose(np.array([*step.support.place, 0.0]), step.support.yaw)
    moving = swing(gait, step.feet[swinging], step.target, t)
    soles = (support, moving) if carrying == LEFT else (moving, support)
    # The trunk turns evenly: from mid-way between the feet of the start to mid-way between those of the end.
    yaw = support.yaw + 0.5 * (moving.yaw - support.yaw)
    double = t < gait.double
    carries = double or carrying == LEFT, double or carrying == RIGHT
    return PatternState(in_step(gait, step, t), zmp, soles, yaw, carries)


@dataclass(frozen=True, eq=False)
class Halt:
    """The end of a walk on both feet: the zero-moment point goes from `zmp` to `catch` within a double support, stays,
    for `hold` s since the start, and goes on to the middle within `ease` s, where the mass comes to rest. feet: where
    both soles stay. start: state of the mass."""

    feet: tuple[Foothold, Foothold]
    start: Pendulum
    zmp: FloatArray
    catch: FloatArray
    hold: float
    ease: float

    @property
    def middle(self) -> FloatArray:
        """Mid-way between the soles (2,) m."""
        return 0.5 * (self.feet[0].place + self.feet[1].place)


HOLD, EASE = 1.3, 2.6
"""Times of the end of a walk, in 1/w: until the mass is caught, and until it rests from there. The shorter, the nearer
the zero-moment point comes to the edge of the soles."""


def halt(gait: Gait, step: Step) -> Halt:
    """The end of a walk after a step."""
    hold, ease = HOLD / gait.omega, EASE / gait.omega
    last = next_step(gait, step, Request())
    feet, start, zmp = last.feet, last.start, last.zmp
    middle = 0.5 * (feet[0].place + feet[1].place)

    def missed(catch: FloatArray) -> FloatArray:
        caught = pendulum_after(start, zmp, catch, omega=gait.omega, ramp=gait.double, t=hold)
        return pendulum_after(caught, catch, middle, omega=gait.omega, ramp=ease, t=ease).divergent - middle

    # What is missed is linear in the point that catches.
    none, one = missed(middle), missed(middle + 1.0)
    return Halt(feet, start, zmp, middle + none / (none - one), hold, ease)


def in_halt(gait: Gait, end: Halt, t: float) -> PatternState:
    """The pattern t s after the start of the end of a walk."""
    omega, middle = gait.omega, end.middle
    pendulum = pendulum_after(end.start, end.zmp, end.catch, omega=omega, ramp=gait.double, t=min(t, end.hold))
    zmp = end.zmp + smooth(t / gait.double) * (end.catch - end.zmp)
    if t > end.hold:
        pendulum = pendulum_after(pendulum, end.catch, middle, omega=omega, ramp=end.ease, t=t - end.hold)
        zmp = end.catch + smooth((t - end.hold) / end.ease) * (middle - end.catch)
        # The convergent component would take seconds to get there, and what is left of rounding in the other would
        # grow.
        left = 1.0 - smooth((t - end.hold) / end.ease)
        divergent = pendulum.divergent if left else middle
        pendulum = Pendulum(divergent, middle + left * (pendulum.convergent - middle))
    return standing(end.feet, pendulum, zmp)


def standing(feet: tuple[Foothold, Foothold], pendulum: Pendulum, zmp: FloatArray) -> PatternState:
    """A moment of a robot on both feet."""
    left, right = (SolePose(np.array([*foot.place, 0.0]), foot.yaw) for foot in feet)
    return PatternState(pendulum, zmp, (left, right), 0.5 * (left.yaw + right.yaw), (True, True))


SWAY_S = 0.5
"""Time in which the weight of a robot that stands sways to where its first step begins."""
STOPPING = 2
"""Steps after the one that is under way until a walk is over: one takes the speed out, one brings the feet together."""


def sway(gait: Gait, feet: tuple[Foothold, Foothold], carrying: int) -> tuple[list[PatternState], Step]:
    """From a stand with the mass mid-way between the feet to a first step in place on the foot `carrying`: the moments
    tick by tick, and the step. The mass is pushed from beside, until it falls to where the step begins."""
    time = SWAY_S
    middle = 0.5 * (feet[0].place + feet[1].place)
    # xi = z - (z - m) exp(w t) with a zero-moment point z that stays; where it is to be depends on z by little.
    pushed = np.zeros(2)
    for _ in range(20):
        pushed = (sway_target(gait, feet, carrying, middle + pushed) - middle) / (1.0 - exp(gait.omega * time))
    moments, pendulum = list[PatternState](), Pendulum(middle, middle)
    for tick in range(1, round(time / gait.dt) + 1):
        t = tick * gait.dt
        far, near = exp(gait.omega * t), exp(-gait.omega * t)
        pendulum = Pendulum(middle + pushed * (1.0 - far), middle + pushed * (1.0 - near))
        moments.append(standing(feet, pendulum, middle + pushed))
    return moments, first_step(gait, feet, carrying, pendulum, middle + pushed)


def stepped(gait: Gait, step: Step) -> list[PatternState]:
    """The moments of a step, tick by tick."""
    return [moment(gait, step, tick * gait.dt) for tick in range(1, gait.ticks + 1)]


def way_to_stand(gait: Gait, step: Step) -> list[PatternState]:
    """The moments after a step until the robot stands with its feet side by side."""
    moments = list[PatternState]()
    for _ in range(STOPPING):
        step = next_step(gait, step, Request())
        moments += stepped(gait, step)
    end = halt(gait, step)
    ticks = round((end.hold + end.ease) / gait.dt) + 1
    return moments + [in_halt(gait, end, tick * gait.dt) for tick in range(1, ticks + 1)]
