"""Which row of a recording is shown now: playing, standing, stepping, at any speed, over and over or once."""

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["Timeline"]


class Timeline:
    """times (T,): of the rows, s, rising. Plays by the clock of whoever calls `at`."""

    def __init__(self, times: FloatArray) -> None:
        assert times.size > 0
        self._times = times
        self._here = float(times[0])
        self._last: float | None = None  # s of the clock, while it plays
        self.speed, self.loops = 1.0, True

    @property
    def playing(self) -> bool:
        """Whether time goes by."""
        return self._last is not None

    @property
    def row(self) -> int:
        """The row that is shown."""
        return max(int(np.searchsorted(self._times, self._here, side="right")) - 1, 0)

    def play(self, now: float) -> None:
        """Go on, at `now` s; from the beginning where it ended."""
        if self._here >= self._times[-1]:
            self._here = float(self._times[0])
        self._last = now

    def pause(self) -> None:
        """Stand."""
        self._last = None

    def go_to(self, row: int) -> None:
        """Show a row, the nearest that there is; go on from there if it plays."""
        self._here = float(self._times[min(max(row, 0), len(self._times) - 1)])

    def step(self, rows: int) -> None:
        """Stand, so many rows on (or back)."""
        self.pause()
        self.go_to(self.row + rows)

    def at(self, now: float) -> int:
        """The row for `now`, s."""
        if self._last is None:
            return self.row
        self._here += self.speed * max(now - self._last, 0.0)
        self._last = now
        first, last = float(self._times[0]), float(self._times[-1])
        if self._here > last:
            if self.loops and last > first:
                self._here = first + (self._here - first) % (last - first)
            else:
                self._here = last
                self.pause()
        return self.row
