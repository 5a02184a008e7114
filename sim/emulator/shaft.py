"""The shaft of an emulated servo: its profile generator, and its motion under control loop, limits and a load.

All in the servo's own ticks and sense of rotation. The motor has no inertia: its speed is its drive's share of full
drive times the top speed. In the plain case - position loop, no profile, no I gain - the motion is exact over any time
and the same as `sim.servo_model.saturated_lag`; otherwise it goes in steps, at most MAX_STEPS per call, each exact for
a goal that moves evenly.
"""

import math
from enum import Enum, auto
from math import ceil, inf
from typing import NamedTuple, Protocol

from retarget.arithmetic import exp
from sim.servo_model import FRICTION_CURRENT, LARGEST_CURRENT, SPEED_CURRENT

# The profile generator of a servo: how its goal travels from where it is to a new goal position.
#
# Source: e-Manual, Profile Velocity (112), Profile Acceleration (108), Drive Mode (10) bit 2. A new goal on the way
# starts from the velocity that the old path has at that moment.

NO_PROFILE, RECTANGLE, TRIANGLE, TRAPEZOID = range(4)
"""Kinds of profile, as Moving Status (123) shows them in bits 4 and 5."""


class PathSegment(NamedTuple):
    """A stretch of constant acceleration: duration s, and what holds at its start, tick, tick/s, tick/s^2."""

    duration: float
    position: float
    velocity: float
    acceleration: float


class Point(NamedTuple):
    """A point of a path: tick, tick/s, tick/s^2."""

    position: float
    velocity: float
    acceleration: float


class ProfilePath:
    """Phases that begin at time `start` s and end at rest at `goal` (tick). `kind`: what Moving Status calls it."""

    def __init__(self, goal: float, start: float, phases: tuple[PathSegment, ...], kind: int) -> None:
        self.goal = goal
        self.kind = kind
        self._start = start
        self._phases = phases
        self.end = start + math.fsum(phase.duration for phase in phases)
        """When it reaches its goal, s."""

    def at(self, now: float) -> Point:
        """Return where the path is at `now` (s); its goal, at rest, from its end on."""
        if now >= self.end:
            return Point(self.goal, 0.0, 0.0)
        left = now - self._start
        for phase in self._phases:
            if left < phase.duration:
                left = max(left, 0.0)
                velocity = phase.velocity + phase.acceleration * left
                return Point(phase.position + 0.5 * (phase.velocity + velocity) * left, velocity, phase.acceleration)
            left -= phase.duration
        return Point(self.goal, 0.0, 0.0)


def path_by_velocity(
    goal: float, *, position: float, velocity: float, top: float, acceleration: float, now: float
) -> ProfilePath:
    """Return the path to `goal` (tick) from `position` (tick) at `velocity` (tick/s), never faster than `top` (tick/s)
    once it has slowed down to that; `acceleration` tick/s^2, 0: without bound (rectangle). `top` above 0."""
    way = goal - position
    if acceleration <= 0.0:
        speed = math.copysign(top, way)
        return ProfilePath(goal, now, (PathSegment(abs(way) / top, position, speed, 0.0),), RECTANGLE)
    # Where it would stop if it braked at once decides the direction of travel.
    beyond = way - 0.5 * velocity * abs(velocity) / acceleration
    side = math.copysign(1.0, beyond)
    along, speed = side * way, side * velocity  # seen in the direction of travel
    peak = math.sqrt(max(acceleration * along + 0.5 * speed * speed, 0.0))
    kind = TRAPEZOID if peak > top else TRIANGLE
    peak = min(peak, top)
    rise = math.copysign(acceleration, peak - speed)
    ramp = (peak - speed) / rise
    brake = peak / acceleration
    covered = 0.5 * (speed + peak) * ramp + 0.5 * peak * brake
    cruise = max(along - covered, 0.0) / peak if peak > 0.0 else 0.0
    return _three(goal, (position, velocity), (ramp, cruise, brake), side * peak, now, kind)


def path_by_time(
    goal: float, *, position: float, velocity: float, total: float, ramp: float, now: float
) -> ProfilePath:
    """Return the path to `goal` (tick) from `position` (tick) at `velocity` (tick/s) that takes `total` s, `ramp` s of
    them to speed up and as long to slow down: at most half of it (e-Manual). `total` above 0."""
    ramp = min(ramp, 0.5 * total)
    cruise = total - 2.0 * ramp
    peak = (goal - position - 0.5 * velocity * ramp) / (total - ramp)
    kind = RECTANGLE if ramp <= 0.0 else TRIANGLE if cruise <= 0.0 else TRAPEZOID
    return _three(goal, (position, velocity), (ramp, max(cruise, 0.0), ramp), peak, now, kind)


def _three(
    goal: float,
    at: tuple[float, float],
    durations: tuple[float, float, float],
    peak: float,
    now: float,
    kind: int,
) -> ProfilePath:
    """Ramp from `at` (tick, tick/s) to the velocity `peak`, cruise, brake to rest."""
    position, velocity = at
    ramp, cruise, brake = durations
    phases: list[PathSegment] = []
    if ramp > 0.0:
        phases.append(PathSegment(ramp, position, velocity, (peak - velocity) / ramp))
        position += 0.5 * (velocity + peak) * ramp
    if cruise > 0.0:
        phases.append(PathSegment(cruise, position, peak, 0.0))
        position += peak * cruise
    if brake > 0.0:
        phases.append(PathSegment(brake, position, peak, -peak / brake))
    return ProfilePath(goal, now, tuple(phases), kind)


# The law of `sim.servo_model.saturated_lag` for one servo, in plain floats: a bus asks one servo at a time, often.


def follow(error: float, lag: float, top: float, elapsed: float) -> tuple[float, float]:
    """Return the error (tick) and the velocity (tick/s) that are left `elapsed` s after an `error` (tick).

    d/dt x = clip((goal - x) / lag, -top, top); `lag` s, above 0, `top` tick/s, above 0. Exact for any `elapsed`.
    """
    speed = error / lag
    if -top <= speed <= top:
        left = error * exp(-elapsed / lag)
        return left, left / lag
    limit = top if speed > 0.0 else -top
    cruise = error / limit - lag  # [s] until the loop no longer saturates
    if cruise >= elapsed:
        return error - limit * elapsed, limit
    left = limit * lag * exp((cruise - elapsed) / lag)
    return left, left / lag


STEP = 4e-3  # [s] longest step, while a call spans less than MAX_STEPS of them
MAX_STEPS = 250  # in a call: one second of STEP; where more time has passed, steps are longer
SPEED_LAG = 0.02  # [s] of the loops of velocity, current and PWM


class Law(Enum):
    """What the servo controls."""

    POSITION = auto()
    VELOCITY = auto()
    CURRENT = auto()
    PWM = auto()


class Mechanics(Protocol):
    """What turns a shaft in place of the motion here: a simulation with mass, say."""

    def follow(self, shaft: "Shaft", now: float) -> tuple[float, float]:
        """Go on to `now` (s); return the position that the shaft has then, tick, and its velocity, tick/s."""

    def effort(self, shaft: "Shaft") -> float:
        """Return the torque of the motor as a share of its stall torque, signed."""

    def current(self, shaft: "Shaft") -> float:
        """Return the current of the motor, A, signed."""


class Shaft:
    """Position of the shaft, and its goal. `top`: no-load speed in tick/s at full drive.

    Set attributes only at the time that `advance` last reached, then call `refresh`.
    """

    def __init__(self, position: float, top: float) -> None:
        self.position = position
        self.velocity = 0.0
        """tick/s."""
        self.torque = False
        self.law = Law.POSITION
        self.lag = 0.045
        """Of the position loop at the present supply, s; inf without a P gain."""
        self.integral = 0.0
        """I gain over P gain, 1/s."""
        self.forward = 0.0
        """First feedforward gain over P gain, s."""
        self.full = top
        """No-load speed at full drive and the present supply, tick/s."""
        self.drive_limit = 1.0
        """Share of full drive that the PWM limits leave."""
        self.current_limit = inf
        """Most current that the loop may use, A."""
        self.stuck = False
        self.target = position
        """Goal position, tick."""
        self.speed = 0.0
        """Goal of the other laws: velocity tick/s, current A, or share of full drive."""
        self.ramp = inf
        """Acceleration towards a goal velocity, tick/s^2."""
        self.path: ProfilePath | None = None
        self.time = 0.0
        self.mechanics: Mechanics | None = None
        """What turns it; None: the motion here."""
        self._bias = 0.0  # [tick] error that the I gain adds
        self._reference = 0.0  # [tick/s] where the ramp of the velocity law is
        self._plain = False
        self._top = top  # [tick/s]
        self.refresh()

    def refresh(self) -> None:
        """Take note of changed attributes."""
        # Friction takes all of the current limit at this share of the top speed.
        share = min(max((self.current_limit - FRICTION_CURRENT) / SPEED_CURRENT, 0.0), 1.0)
        self._top = self.full * self.drive_limit * share
        if self.law is not Law.VELOCITY or not self.torque:
            self._reference = self.velocity
        if not self.integral or not self.torque:
            self._bias = 0.0
        self._plain = (
            self.torque
            and self.law is Law.POSITION
            and self.path is None
            and not self.stuck
            and self.integral == 0.0
            and self._top > 0.0
        )
        if (not self.torque or self.stuck) and self.mechanics is None:
            self.velocity = 0.0

    def advance(self, now: float) -> None:
        """Move on to `now` (s); a time that has passed changes nothing."""
        elapsed = now - self.time
        if elapsed <= 0.0:
            return
        self.time = now
        if self.mechanics is not None:
            self.position, self.velocity = self.mechanics.follow(self, now)
            self._end_path(now)
        elif self._plain:
            left, self.velocity = follow(self.target - self.position, self.lag, self._top, elapsed)
            self.position = self.target - left
        elif self.torque:
            self._in_steps(now, elapsed)

    def effort(self) -> float:
        """Torque of the motor as a share of its stall torque, signed: what it holds against a jam."""
        if self.mechanics is not None:
            return self.mechanics.effort(self)
        if not self.torque or not self.stuck:
            return 0.0
        most = self.current_limit / LARGEST_CURRENT
        return min(max(self.drive(), -most, -1.0), most, 1.0)

    def drive(self) -> float:
        """Present drive as a share of full drive, signed."""
        if not self.torque or self.full <= 0.0:
            return 0.0
        if not self.stuck:
            return min(max(self.velocity / self.full, -self.drive_limit), self.drive_limit)
        return min(max(self._asked_speed() / self.full, -self.drive_limit), self.drive_limit)

    def trajectory(self) -> tuple[float, float]:
        """Position and speed of the motion profile, (tick, tick/s)."""
        if self.law is not Law.POSITION:
            return self.position, self._reference if self.law is Law.VELOCITY else self.velocity
        if self.path is None:
            return self.target, 0.0
        point = self.path.at(self.time)
        return point.position, point.velocity

    def hold(self) -> None:
        """Hold the present position; a current or PWM goal becomes 0."""
        self.path = None
        self.target = self.position
        self.speed = 0.0
        self.refresh()

    def _asked_speed(self) -> float:
        """Speed, tick/s, that the law asks for, before any limit."""
        if self.law is Law.POSITION:
            place, speed = self.trajectory()
            return (place - self.position + self._bias + self.forward * speed) / self.lag
        if self.law is Law.VELOCITY:
            return self._reference
        if self.law is Law.PWM:
            return self.full * self.speed
        beyond = max(abs(self.speed) - FRICTION_CURRENT, 0.0) / SPEED_CURRENT
        return self.full * min(beyond, 1.0) * (1.0 if self.speed >= 0.0 else -1.0)

    def _in_steps(self, now: float, elapsed: float) -> None:
        """Move on by `elapsed` s that end at `now`."""
        count = min(ceil(elapsed / STEP), MAX_STEPS)
        step = elapsed / count
        for index in range(count):
            if self.law is Law.POSITION:
                self._follow_path(now - elapsed + index * step, step)
            elif self.stuck:
                self.velocity = 0.0
            else:
                self._follow_speed(step)
        self._end_path(now)

    def _end_path(self, now: float) -> None:
        """Forget a profile that is over."""
        if self.path is not None and now >= self.path.end:
            self.path = None
            self.refresh()

    def _follow_path(self, start: float, step: float) -> None:
        """One step of the position loop."""
        begin, end = self.target, self.target
        speed = 0.0
        if self.path is not None:
            begin = self.path.at(start).position
            end, speed, _ = self.path.at(start + step)
        error = begin - self.position
        if self.integral:
            most = self.full * self.lag if self.lag < inf else 0.0
            self._bias = min(max(self._bias + self.integral * error * step, -most), most)
        if self.stuck or self.lag == inf:
            self.velocity = 0.0
            return
        shift = self._bias + self.forward * speed
        rate = (end - begin) / step
        settled = rate * self.lag - shift  # error at which it moves as fast as its goal
        left = settled + (error - settled) * exp(-step / self.lag)
        moved = min(max(end - begin - (left - error), -self._top * step), self._top * step)
        self.velocity = min(max((end - self.position - moved + shift) / self.lag, -self._top), self._top)
        self.position += moved

    def _follow_speed(self, step: float) -> None:
        """One step of the velocity, current and PWM laws."""
        if self.law is Law.VELOCITY:
            change = min(max(self.speed - self._reference, -self.ramp * step), self.ramp * step)
            self._reference += change
        asked = min(max(self._asked_speed(), -self._top), self._top)
        keep = exp(-step / SPEED_LAG)
        self.position += asked * step + (self.velocity - asked) * SPEED_LAG * (1.0 - keep)
        self.velocity = asked + (self.velocity - asked) * keep
