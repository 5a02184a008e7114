"""A batch: an engine runs the remaining clips, and the index keeps their rows."""

from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, field

from hardware.clock import MonotonicClock
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus
from retarget.batch.index import BatchIndex, remove_parts, still_to_do

Engine = Callable[[Sequence[BatchClip], BatchSettings], Generator[ClipRow, None, None]]
"""`on_processes` or `on_ray` with their options."""
KILLED = (ClipStatus.TIMED_OUT, ClipStatus.CRASHED, ClipStatus.OUT_OF_MEMORY)
"""Ends of a clip that may leave partly written files behind."""


@dataclass
class BatchTally:
    """Progress of a batch. todo: number of its clips. done_before, failed_before: clips of the index that are not run
    again. counts: rows by status. seconds: since the start."""

    todo: int
    done_before: int
    failed_before: int
    counts: Counter[ClipStatus] = field(default_factory=Counter)
    seconds: float = 0.0

    @property
    def over(self) -> int:
        """Number of clips with a row."""
        return self.counts.total()

    @property
    def failed(self) -> int:
        """Number of clips with a row and without an output."""
        return sum(count for status, count in self.counts.items() if not status.has_output)

    @property
    def seconds_left(self) -> float | None:
        """Estimated time for the remaining clips, s; None before the first row."""
        return (self.todo - self.over) * self.seconds / self.over if self.over else None


def run_batch(
    clips: Sequence[BatchClip],
    settings: BatchSettings,
    index: BatchIndex,
    engine: Engine,
    *,
    retry_failed: bool = False,
    look: Callable[[BatchTally, ClipRow | None], None] = lambda tally, row: None,
) -> BatchTally:
    """Run the remaining clips, and keep each row in the index. look: receives the tally at the beginning and with each
    row. Raises RetargetError if no clip can be begun, or an output would replace a file of another source."""
    clock = MonotonicClock()
    known = index.known()
    todo = still_to_do(clips, settings, known, retry_failed=retry_failed)
    index.begin(todo.clips, settings, known)
    remove_parts(settings.out, todo.clips)
    tally, begun = BatchTally(len(todo.clips), todo.done, todo.failed), clock.now()
    look(tally, None)
    if not todo.clips:
        return tally
    with closing(engine(todo.clips, settings)) as rows:
        for row in rows:
            index.add(row)
            tally.counts[row.status] += 1
            tally.seconds = clock.now() - begun
            if row.status in KILLED:
                remove_parts(settings.out, [BatchClip(row.source, row.output)])
            look(tally, row)
    return tally
