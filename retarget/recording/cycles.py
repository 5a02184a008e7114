"""The cycles of a recording: one row per tick, with its input, goal and record. Cycle 0 of a robot is its arming."""

from enum import IntEnum, IntFlag

import numpy as np

from retarget.run.table import RunTable
from retarget.types import FloatArray, RunState

STATES_OF_RUN = {state: place for place, state in enumerate(RunState)}
"""Numbers of the states of a run."""


class InputFlag(IntFlag):
    """Flags of the input of a tick."""

    STOP = 1
    """Stop."""
    TORQUE_OFF = 2
    """Torque off at once."""
    OVER = 4
    """End of the performance."""
    PAUSED = 8
    """Pause."""
    APPROACH = 16
    """The approach may go on."""
    OUTSIDE = 32
    """Fault that servos do not report, such as a fall."""


class Done(IntEnum):
    """Result of a read, a write or a sample."""

    NOT = 0
    WELL = 1
    FAILED = 2
    """The bus failed, or no valid sample was there."""


def now_of(cycles: RunTable) -> FloatArray:
    """Times (T,), s, of the inputs on the run's clock. Old recordings hold several readings of it."""
    return np.where(cycles.readings > 1, cycles.clock[:, 1], cycles.clock[:, 0])
