"""The cycles of a recording: where a cycle ends, and which one a replayed cycle matches. A cycle is a row, from the end
of one tick to the end of the next."""

from collections.abc import Callable
from enum import IntEnum, IntFlag

import numpy as np

from retarget.run.table import RunTable


class Asked(IntFlag):
    """What was asked before a cycle, and answered with yes."""

    STOP = 1
    """The operator asked for a stop."""
    TORQUE_OFF = 2
    """The operator asked for torque off at once."""
    OVER = 4
    """The stream was at its end."""
    PAUSED = 8
    """The operator holds the robot on purpose."""
    APPROACH = 16
    """The robot might go on with its approach."""
    OUTSIDE = 32
    """The watch stopped the guard itself, instead of answering that it wants a stop."""


class Done(IntEnum):
    """What became of a read, a write or a sample."""

    NOT = 0
    WELL = 1
    FAILED = 2
    """The bus failed. Of a sample: no valid one was there."""


# Where one cycle ends and the next begins: one rule for recording and for replay.


class Boundary:
    """A cycle holds one look at the servos (of a human alone: one posture). What comes before the next look and is not
    part of the tick any more belongs to the next cycle. turn: called where one begins."""

    def __init__(self, turn: Callable[[], None]) -> None:
        self._turn = turn
        self._looked = False

    def before(self) -> None:
        """The run does what it does between ticks: it waits, or asks whether to stop."""
        if self._looked:
            self._looked = False
            self._turn()

    def look(self) -> None:
        """The servos are read."""
        self.before()
        self._looked = True


# Which recorded cycle a replayed one corresponds to, also where the approach of another version ends earlier or later.


class Cursor:
    """Goes along recorded cycles, as the replayed run does. row: of the recording, or its last.

    The approach may last longer or shorter than it did: following begins in both with the same cycle. clock_lead: s by
    which the recorded clock is then ahead of the replayed one, whose ticks are `dt` s apart; else 0.
    """

    def __init__(self, cycles: RunTable, *, has_robot: bool, dt: float) -> None:
        self.cycles = cycles
        self.clock_lead = 0.0
        self._dt = dt
        self.cycle = 0
        """Of the replayed run."""
        self._boundary = Boundary(self._turn)
        follows = np.flatnonzero(cycles.sampled != Done.NOT)
        later = follows[follows > 0] if has_robot else follows
        self._first = int(cycles.index[later[0]]) if later.size else int(cycles.index[-1]) + 1
        self._begun: int | None = None if has_robot else 0

    @property
    def row(self) -> int:
        """Row of the recorded cycle that corresponds, or of the last before it that was written."""
        return max(int(np.searchsorted(self.cycles.index, self._wanted, side="right")) - 1, 0)

    @property
    def recorded(self) -> bool:
        """Whether just this cycle was recorded."""
        return int(self.cycles.index[self.row]) == self._wanted

    @property
    def over(self) -> bool:
        """True after the last cycle that was recorded."""
        return self._wanted > int(self.cycles.index[-1])

    @property
    def follows(self) -> bool:
        """Whether the replayed run has begun to follow."""
        return self._begun is not None

    def before(self) -> None:
        """Something between ticks, see `Boundary`."""
        self._boundary.before()

    def look(self) -> None:
        """The servos are read."""
        self._boundary.look()

    def follow(self) -> None:
        """The replayed run begins to follow, in this cycle."""
        if self._begun is None:
            row = self.row
            self._begun = self.cycle
            if self.row != row:
                self._go_on(row, 0.0)

    def asked(self, what: Asked) -> bool:
        """Whether it was answered with yes before this cycle."""
        return self.recorded and bool(int(self.cycles.asked[self.row]) & what)

    @property
    def late(self) -> bool:
        """Whether the replayed run is still approaching where the recorded one had begun to follow."""
        return self._begun is None and self.cycle >= self._first

    @property
    def _wanted(self) -> int:
        """The number of the recorded cycle."""
        if self._begun is None:
            return min(self.cycle, self._first)
        return self.cycle if self._first == 0 else self._first + self.cycle - self._begun

    def _turn(self) -> None:
        row = self.row
        self.cycle += 1
        if self.cycles.index[self.row] - self.cycles.index[row] != 1:
            self._go_on(row, self._dt)

    def _go_on(self, row: int, seconds: float) -> None:
        """Let the present cycle begin so many seconds after the one of a row, whatever the recorded clock says."""
        clock = self.cycles.clock
        self.clock_lead += float(clock[self.row, 0] - clock[row, 0]) - seconds
