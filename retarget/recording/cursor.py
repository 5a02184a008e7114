"""Which recorded cycle a replayed one corresponds to, also where another version arrives earlier or later."""

import numpy as np

from retarget.recording.boundary import Boundary
from retarget.recording.cycles import Asked, Cycles, Done

__all__ = ["Cursor"]


class Cursor:
    """Goes along recorded cycles, as the replayed run does. row: of the recording, or its last.

    The approach may last longer or shorter than it did: following begins in both with the same cycle. ahead: s by which
    the recorded clock is then ahead of that of the replayed run, in which a tick of `dt` s follows the other; else 0.
    """

    def __init__(self, cycles: Cycles, *, has_robot: bool, dt: float) -> None:
        self.cycles = cycles
        self.ahead = 0.0
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
        """Of the recorded cycle that corresponds, or of the last before it that was written."""
        return max(int(np.searchsorted(self.cycles.index, self._wanted, side="right")) - 1, 0)

    @property
    def recorded(self) -> bool:
        """Whether just this cycle was recorded."""
        return int(self.cycles.index[self.row]) == self._wanted

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
        """Whether the replayed run is still on its way where the recorded one had arrived."""
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
        """What happens now happens so many seconds after what is in a row, whatever the recording says."""
        clock = self.cycles.clock
        self.ahead += float(clock[self.row, 0] - clock[row, 0]) - seconds
