"""The shaft of an emulated servo: its profile generator and its motion.

Positions are in the servo's own ticks and direction. The motor has no inertia. With a position loop, no profile and no
I gain the motion is exact over any time, as that of `sim.servo_model.saturated_lag`. Otherwise it goes in at most
MAX_STEPS steps per call, each exact for a goal of constant speed.
"""

import math
from enum import Enum, auto
from math import ceil, inf
from typing import NamedTuple, Protocol

from retarget.arithmetic import exp
from sim.servo_model import FRICTION_CURRENT, LARGEST_CURRENT, SPEED_CURRENT

# The profile generator (e-Manual, Profile Velocity 112, Profile Acceleration 108, Drive Mode 10). A new goal during a
# profile starts from its present velocity.

NO_PROFILE, RECTANGLE, TRIANGLE, TRAPEZOID = range(4)
"""Kinds of profile in bits 4 and 5 of Moving Status (123)."""


class PathSegment(NamedTuple):
    """A segment of constant acceleration: duration s; its start, tick, tick/s, tick/s^2."""

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
    """Segments from time `start` s to rest at `goal` (tick) at time `end` s. kind: as in Moving Status."""

    def __init__(self, goal: float, start: float, phases: tuple[PathSegment, ...], kind: int) -> None:
        self.goal = goal
        self.kind = kind
        self._start = start
        self._phases = phases
        self.end = start + math.fsum(phase.duration for phase in phases)

    def at(self, now: float) -> Point:
        """The point of the path at `now` (s); its goal, at rest, from its end on."""
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
    """The path to `goal` (tick) from `position` (tick) at `velocity` (tick/s).

    top: greatest speed, above 0, tick/s. acceleration: tick/s^2, 0: unbounded (rectangle).
    """
    distance = goal - position
    if acceleration <= 0.0:
        speed = math.copysign(top, distance)
        return ProfilePath(goal, now, (PathSegment(abs(distance) / top, position, speed, 0.0),), RECTANGLE)
    # The stop of immediate braking decides the direction of travel.
    beyond = distance - 0.5 * velocity * abs(velocity) / acceleration
    side = math.copysign(1.0, beyond)
    along, speed = side * distance, side * velocity  # seen in the direction of travel
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
    """The path to `goal` (tick) from `position` (tick) at `velocity` (tick/s) in `total` s, above 0.

    ramp: time to speed up, and to slow down, at most half of `total` (e-Manual), s.
    """
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
    """The path that ramps from `at` (tick, tick/s) to the velocity `peak`, cruises and brakes to rest."""
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


def follow(error: float, lag: float, top: float, elapsed: float) -> tuple[float, float]:
    """Return error (tick) and velocity (tick/s) `elapsed` s after an `error` (tick).

    d/dt x = clip((goal - x) / lag, -top, top), `lag` s and `top` tick/s above 0: `sim.servo_model.saturated_lag` in
    plain floats for one servo.
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


STEP = 4e-3  # [s] longest step of a call that spans less than MAX_STEPS of them
MAX_STEPS = 250  # in a call: one second of STEP
SPEED_LAG = 0.02  # [s] of the loops of velocity, current and PWM


class Law(Enum):
    """The quantity that the servo controls."""

    POSITION = auto()
    VELOCITY = auto()
    CURRENT = auto()
    PWM = auto()


class Mechanics(Protocol):
    """Turns a shaft instead of the motion here, as a simulation with mass does."""

    def follow(self, shaft: "Shaft", now: float) -> tuple[float, float]:
        """Go on to `now` (s); return the position of the shaft, tick, and its velocity, tick/s."""

    def effort(self, shaft: "Shaft") -> float:
        """The torque of the motor as a share of its stall torque, signed."""

    def current(self, shaft: "Shaft") -> float:
        """The current of the motor, A, signed."""


class Shaft:
    """A shaft and its goal. Set attributes only at the time of the last `advance`, then `refresh`.

    lag: of the position loop, s; inf without a P gain. integral: I over P gain, 1/s. forward: first feedforward over P
    gain, s. full: no-load speed at full drive, tick/s. drive_limit: share of full drive. target: goal position, tick.
    speed: goal of the other laws: tick/s, A, or share of full drive. ramp: tick/s^2. mechanics: turns it; None: the
    motion here.
    """

    def __init__(self, position: float, top: float) -> None:
        self.position = position
        self.velocity = 0.0
        self.torque = False
        self.law = Law.POSITION
        self.lag = 0.045
        self.integral = 0.0
        self.forward = 0.0
        self.full = top
        self.drive_limit = 1.0
        self.current_limit = inf
        self.stuck = False
        self.target = position
        self.speed = 0.0
        self.ramp = inf
        self.path: ProfilePath | None = None
        self.time = 0.0
        self.mechanics: Mechanics | None = None
        self._bias = 0.0  # [tick] error that the I gain adds
        self._reference = 0.0  # [tick/s] where the ramp of the velocity law is
        self._plain = False
        self._top = top  # [tick/s]
        self.refresh()

    def refresh(self) -> None:
        """Apply changed attributes."""
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
        """Go on to `now` (s); an earlier time changes nothing."""
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
        """The torque of the motor against a jam as a signed share of its stall torque."""
        if self.mechanics is not None:
            return self.mechanics.effort(self)
        if not self.torque or not self.stuck:
            return 0.0
        most = self.current_limit / LARGEST_CURRENT
        return min(max(self.drive(), -most, -1.0), most, 1.0)

    def drive(self) -> float:
        """The present drive as a signed share of full drive."""
        if not self.torque or self.full <= 0.0:
            return 0.0
        if not self.stuck:
            return min(max(self.velocity / self.full, -self.drive_limit), self.drive_limit)
        return min(max(self._desired_speed() / self.full, -self.drive_limit), self.drive_limit)

    def trajectory(self) -> tuple[float, float]:
        """Return position and speed of the profile, (tick, tick/s)."""
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

    def _desired_speed(self) -> float:
        """The speed of the law before any limit, tick/s."""
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
        if self.path is not None and now >= self.path.end:
            self.path = None
            self.refresh()

    def _follow_path(self, start: float, step: float) -> None:
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
        if self.law is Law.VELOCITY:
            change = min(max(self.speed - self._reference, -self.ramp * step), self.ramp * step)
            self._reference += change
        desired = min(max(self._desired_speed(), -self._top), self._top)
        keep = exp(-step / SPEED_LAG)
        self.position += desired * step + (self.velocity - desired) * SPEED_LAG * (1.0 - keep)
        self.velocity = desired + (self.velocity - desired) * keep
