"""Perturbations of a simulated robot as data, so that a run can be repeated: masses, friction, latency, pushes."""

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
    """A force (3,) N, world, from `start` on for `duration` s on the bus's time since it was opened. frame: point of
    the profile that is pushed; None: the centre of mass of the root link."""

    force: tuple[float, float, float]
    start: float
    duration: float
    frame: str | None = None

    @property
    def end(self) -> float:
        """Time, s, at which the push is over."""
        return self.start + self.duration


@dataclass(frozen=True)
class Perturbation:
    """mass_scale: of every link, inertia with it. com_offset (3,) m: of the whole robot's centre of mass, along the
    axes of the root link, whose own mass is moved for it. friction: sliding coefficient of the floor. latency_s: by
    which every goal takes effect later than usual. stiffness_scale: of every servo, which the plan does not know."""

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
"""Kinds that are one number: its name, and the range from which it is drawn."""

_FRONT, _BACK, _SIDE = (-1.0, 0.0), (1.0, 0.0), (0.0, 1.0)
"""Directions of a push, x forward and y left."""


def combined(parts: Sequence[Perturbation]) -> Perturbation:
    """Combine perturbations. Where two change the same value, the later one holds."""
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
    """Draw a perturbation of one kind: mass +-10 %, CoM off by 10 mm, friction 0.5 to 1, latency 30 ms, stiffness
    +-30 %, a push of 3 N for 0.2 s. The same seed draws the same.

    within: times between which a push begins, s. frame: what is pushed, from the front, the back and the side in turn.
    value: of a kind that is one number, instead of a drawn one.
    """
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
