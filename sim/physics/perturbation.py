"""Perturbations of a simulated robot as data: masses, friction, latency, stiffness, pushes."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from math import cos, pi, sin
from typing import Any

import numpy as np

FRICTION = 0.8
"""Friction of rubber soles on a hard floor, unless a perturbation changes it."""


@dataclass(frozen=True)
class Push:
    """A force (3,) N, world, from `start` s since the bus was opened, for `duration` s. frame: of the profile; None: at
    the centre of mass of the root link."""

    force: tuple[float, float, float]
    start: float
    duration: float
    frame: str | None = None

    @property
    def end(self) -> float:
        """End of the push, s."""
        return self.start + self.duration


@dataclass(frozen=True)
class Perturbation:
    """mass_scale: of mass and inertia of every link. com_offset (3,) m: of the robot's centre of mass, along the axes
    of the root link, whose mass is moved. friction: sliding coefficient of the floor. latency_s: added to that of every
    goal. stiffness_scale: of every servo."""

    mass_scale: float = 1.0
    com_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    friction: float = FRICTION
    latency_s: float = 0.0
    stiffness_scale: float = 1.0
    pushes: tuple[Push, ...] = ()


NOMINAL = Perturbation()
"""No perturbation."""


class PerturbationKind(StrEnum):
    """Kinds of perturbation of the robustness runs."""

    MASS = "mass"
    CENTRE_OF_MASS = "centre_of_mass"
    FRICTION = "friction"
    LATENCY = "latency"
    STIFFNESS = "stiffness"
    PUSH = "push"


_NUMBERS = {
    PerturbationKind.MASS: ("mass_scale", 0.9, 1.1),
    PerturbationKind.FRICTION: ("friction", 0.5, 1.0),
    PerturbationKind.LATENCY: ("latency_s", 0.03, 0.03),
    PerturbationKind.STIFFNESS: ("stiffness_scale", 0.7, 1.3),
}
"""Kinds with one number: its name and range."""

_FRONT, _BACK, _SIDE = (-1.0, 0.0), (1.0, 0.0), (0.0, 1.0)
"""Directions of a push, x forward and y left."""


def combined(parts: Sequence[Perturbation]) -> Perturbation:
    """Combine perturbations. The later of two values for one quantity counts."""
    values = {
        field.name: getattr(part, field.name)
        for part in parts
        for field in fields(Perturbation)
        if getattr(part, field.name) != getattr(NOMINAL, field.name)
    }
    return replace(NOMINAL, **values)


def drawn(
    kind: PerturbationKind,
    seed: int,
    *,
    within: tuple[float, float],
    frame: str | None = None,
    value: float | None = None,
) -> Perturbation:
    """Draw a perturbation of one kind. within: range of the begin of a push, s. frame: the point that is pushed, from
    the front, the back and the side in turn. value: of a kind with one number, instead of a drawn one."""
    chance = np.random.default_rng(seed)
    if kind in _NUMBERS:
        name, low, high = _NUMBERS[kind]
        number: dict[str, Any] = {name: float(chance.uniform(low, high)) if value is None else value}
        return replace(NOMINAL, **number)
    if kind is PerturbationKind.CENTRE_OF_MASS:
        turn = float(chance.uniform(0.0, 2.0 * pi))
        return Perturbation(com_offset=(0.01 * cos(turn), 0.01 * sin(turn), 0.0))
    directions: Sequence[tuple[float, float]] = (_FRONT, _BACK, _SIDE)
    x, y = directions[seed % len(directions)]
    start = float(chance.uniform(*within))
    return Perturbation(pushes=(Push((3.0 * x, 3.0 * y, 0.0), start, 0.2, frame),))
