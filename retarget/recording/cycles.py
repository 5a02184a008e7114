"""The cycles of a recording, a row each: a tick of the run, with its input, the goal that was sent, and its row of the
record. Cycle 0 of a robot is its arming."""

from enum import IntEnum, IntFlag

import numpy as np

from retarget.run.table import RunTable
from retarget.types import FloatArray, RunState

STATES_OF_RUN = {state: place for place, state in enumerate(RunState)}
"""Numbers of the states of a run."""


class Asked(IntFlag):
    """Parts of the input of a tick that are true or false."""

    STOP = 1
    """The operator asked for a stop."""
    TORQUE_OFF = 2
    """The operator asked for torque off at once."""
    OVER = 4
    """The performance was over."""
    PAUSED = 8
    """The operator paused the robot."""
    APPROACH = 16
    """The robot might go on with its approach."""
    OUTSIDE = 32
    """The robot had a fault that its servos do not report, such as a fall; the events hold cause and reason."""


class Done(IntEnum):
    """What became of a read, a write or a sample."""

    NOT = 0
    WELL = 1
    FAILED = 2
    """The bus failed. Of a sample: no valid one was there."""


def now_of(cycles: RunTable) -> FloatArray:
    """Times (T,), s, on the run's clock, at which the inputs of the ticks were there. Recordings of before a tick had
    one time hold all readings of the clock: one before the servos were read, one after it, and others."""
    return np.where(cycles.readings > 1, cycles.clock[:, 1], cycles.clock[:, 0])
