"""Arithmetic with the same bits on every machine, for all that stands between a sensor and a servo goal.

The last bit of a sine depends on the C library and the processor, that of a matrix product on the BLAS that NumPy
picks for the processor, and a motion path may make millimetres of a bit. So goals would differ between two machines,
and a recording of one would not replay on the other. These functions are compiled into the crate: elementary
functions of the Rust library `libm`, sums in the order of their indices, no product fused with a sum.

NumPy's own +, -, *, /, `sqrt`, comparisons, `sum` and `mean` are exact or of one order, and may be used beside them.
`math.fsum` adds floats; the built-in `sum` does it otherwise from Python 3.12 on. `tests/test_arithmetic.py`
lists the modules that hold to this, and fails on anything else there.
"""

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

__all__ = [
    "arccos",
    "arcsin",
    "arctan2",
    "cos",
    "dot",
    "exp",
    "expm1",
    "hypot",
    "log",
    "matmul",
    "norm",
    "norms",
    "sin",
    "soft_cap",
    "squares",
]


def soft_cap(value: float, most: float, knee: float) -> float:
    """The value itself up to the last share `knee` before `most`; beyond, it approaches `most` smoothly."""
    free = (1.0 - knee) * most
    if value <= free:
        return value
    room = most - free
    if room <= 0.0:  # nothing is possible at all
        return most
    return most - room * exp(-(value - free) / room)
