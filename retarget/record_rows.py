"""Which row of the record each tick fills, where a run lasts longer than there is room for."""

from dataclasses import replace

import numpy as np

from retarget.record import Record, arrays_per_tick

__all__ = ["RecordRows"]


class RecordRows:
    """Rows for so many ticks of approach, of following and of braking, filled one after the other.

    What is kept has no gap, or rates, limits and missed ticks would be told of ticks that do not follow one another: of
    an approach that was held up, the end is kept; of what comes after `close`, nothing.
    """

    def __init__(self, *, approach: int, follow: int, brake: int) -> None:
        self.room = approach + follow + brake + 1
        """Rows of the record; the last is for ticks that are not kept."""
        self.row = 0
        """The row that the next tick fills."""
        self._approach, self._around = approach, False
        self._oldest: int | None = None  # row of the approach, once it is over
        self._end: int | None = None  # rows that are kept, once no more are

    def filled(self, *, approaches: bool) -> None:
        """A tick has filled its row. approaches: the tick that comes is still one of the approach."""
        if self._end is not None or self.row == self.room - 1:
            self.close()
            return
        self.row += 1
        if approaches:
            if self.row == self._approach:
                self._around, self.row = True, 0
        elif self._around and self._oldest is None:
            self._oldest, self.row = self.row % self._approach, self._approach

    def close(self) -> None:
        """Keep none of the ticks that come."""
        if self._end is None:
            self._end, self.row = self.row, self.room - 1

    def of(self, record: Record) -> Record:
        """The rows of the record that are kept, in the order of their ticks; it is changed in place."""
        end, first = self.row if self._end is None else self._end, 0
        if self._around:
            oldest, first = self.row if self._oldest is None else self._oldest, 1
            end = end if self._oldest is not None else self._approach
            for array in arrays_per_tick(record):
                array[: self._approach] = np.roll(array[: self._approach], -oldest, axis=0)
            if record.robot is not None:  # what the oldest row sent is where those that are kept begin
                record.robot.start[:] = record.robot.goals[0]
        return replace(record.rows(first, end), from_start=not self._around, to_end=self._end is None)
