"""The profile generator of a servo: how its goal travels from where it is to a new goal position.

Source: e-Manual, Profile Velocity (112), Profile Acceleration (108), Drive Mode (10) bit 2. A new goal on the way
starts from the velocity that the old path has at that moment.
"""

import math
from typing import NamedTuple

NO_PROFILE, RECTANGLE, TRIANGLE, TRAPEZOID = range(4)
"""Kinds of profile, as Moving Status (123) shows them in bits 4 and 5."""


class Phase(NamedTuple):
    """A stretch of constant acceleration: duration s, and what holds at its start, tick, tick/s, tick/s^2."""

    duration: float
    position: float
    velocity: float
    acceleration: float


class Point(NamedTuple):
    """Where a path is: tick, tick/s, tick/s^2."""

    position: float
    velocity: float
    acceleration: float


class ProfilePath:
    """Phases that begin at time `start` s and end at rest at `goal` (tick). `kind`: what Moving Status calls it."""

    def __init__(self, goal: float, start: float, phases: tuple[Phase, ...], kind: int) -> None:
        self.goal = goal
        self.kind = kind
        self._start = start
        self._phases = phases
        self.end = start + sum(phase.duration for phase in phases)
        """When it arrives, s."""

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
        return ProfilePath(goal, now, (Phase(abs(way) / top, position, speed, 0.0),), RECTANGLE)
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
    phases: list[Phase] = []
    if ramp > 0.0:
        phases.append(Phase(ramp, position, velocity, (peak - velocity) / ramp))
        position += 0.5 * (velocity + peak) * ramp
    if cruise > 0.0:
        phases.append(Phase(cruise, position, peak, 0.0))
        position += peak * cruise
    if brake > 0.0:
        phases.append(Phase(brake, position, peak, -peak / brake))
    return ProfilePath(goal, now, tuple(phases), kind)
