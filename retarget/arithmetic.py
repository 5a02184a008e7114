"""Arithmetic with the same bits on every machine, for the path from a sensor to a servo goal.

Sines of the C library and products of the BLAS differ between machines in the last bit, so recordings would not replay.
NumPy's +, -, *, /, `sqrt`, comparisons, `sum` and `mean`, and `math.fsum`, may be used too (the built-in `sum` changed
in Python 3.12). `tests/test_arithmetic.py` checks this.
"""

from dataclasses import dataclass
from typing import TypeVar

from retarget._solver import (
    arccos,
    arcsin,
    arctan2,
    cos,
    dot,
    exp,
    expm1,
    hypot,
    log,
    matmul,
    norm,
    norms,
    sin,
    squares,
)
from retarget.types import FloatArray

__all__ = [
    "Dwell",
    "arccos",
    "arcsin",
    "arctan2",
    "cos",
    "dot",
    "exp",
    "expm1",
    "hypot",
    "log",
    "low_pass",
    "matmul",
    "norm",
    "norms",
    "sin",
    "soft_cap",
    "squares",
]

Value = TypeVar("Value", float, complex, FloatArray)


def soft_cap(value: float, most: float, knee: float) -> float:
    """The value itself up to (1 - knee) most; beyond, it approaches `most` smoothly."""
    free = (1.0 - knee) * most
    if value <= free:
        return value
    room = most - free
    if room <= 0.0:
        return most
    return most - room * exp(-(value - free) / room)


def low_pass(value: Value, to: Value, times: float) -> Value:
    """The low pass dv/dt = (to - v) / T after `times` time constants T, exact for a constant `to`."""
    return value + (1.0 - exp(-times)) * (to - value)


@dataclass(slots=True)
class Dwell:
    """The time `held`, s, for which a condition has held without a break. Sums of steps are rounded."""

    held: float = 0.0

    def step(self, dt: float, *, holds: bool) -> float:
        """The time `held` after another `dt` s."""
        self.held = self.held + dt if holds else 0.0
        return self.held
