"""Arithmetic with the same bits on every machine, for all that stands between a sensor and a servo goal.

The last bit of a sine depends on the C library and the processor, that of a matrix product on the BLAS that NumPy
picks for the processor, and a motion path may make millimetres of a bit. So goals would differ between two machines,
and a recording of one would not replay on the other. These functions are compiled into the crate: elementary
functions of the Rust library `libm`, sums in the order of their indices, no product fused with a sum.

NumPy's own +, -, *, /, `sqrt`, comparisons, `sum` and `mean` are exact or of one order, and may be used beside them.
`math.fsum` adds floats; the built-in `sum` does it otherwise from Python 3.12 on. `tests/test_arithmetic.py`
lists the modules that hold to this, and fails on anything else there.

Two things that go on from tick to tick stand here too: how long a condition has held, and the first-order low pass.
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
    """The value itself up to the last share `knee` before `most`; beyond, it approaches `most` smoothly."""
    free = (1.0 - knee) * most
    if value <= free:
        return value
    room = most - free
    if room <= 0.0:  # nothing is possible at all
        return most
    return most - room * exp(-(value - free) / room)


def low_pass(value: Value, to: Value, times: float) -> Value:
    """A value that goes to another as a first-order low pass does, after `times` of its time constants; inf: at once.

    dv/dt = (to - v) / T, exact while `to` stands still: it closes the share 1 - exp(-dt / T) of the gap.
    """
    return value + (1.0 - exp(-times)) * (to - value)


@dataclass(slots=True)
class Dwell:
    """How long a condition has held without a break, `held`, s: to be set to start anew.

    It is a sum of steps, rounded in each: five of 0.01 s may miss 0.05 s by a last bit, either way.
    """

    held: float = 0.0

    def step(self, dt: float, *, holds: bool) -> float:
        """`held` after another `dt` s in which the condition holds, or does not."""
        self.held = self.held + dt if holds else 0.0
        return self.held
