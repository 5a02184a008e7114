"""A batch: what is still to be done, an engine that does it, and the index that keeps every row."""

from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, field

from hardware.clock import Clock, MonotonicClock
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus
from retarget.batch.index import BatchIndex, remove_parts, still_to_do

Engine = Callable[[Sequence[BatchClip], BatchSettings], Generator[ClipRow, None, None]]
"""`on_processes` or `on_ray`, with all its options."""
KILLED = (ClipStatus.TIMED_OUT, ClipStatus.CRASHED, ClipStatus.OUT_OF_MEMORY)
"""What may leave files behind that are half written."""


@dataclass
class BatchTally:
    """todo: clips of this batch. done_before, failed_before: those of the index that are not run again. counts: rows
    of this batch, by status. seconds: since it began."""

    todo: int
    done_before: int
    failed_before: int
    counts: Counter[ClipStatus] = field(default_factory=Counter)
    seconds: float = 0.0

    @property
    def over(self) -> int:
        """Clips of this batch that are over."""
        return self.counts.total()

    @property
    def failed(self) -> int:
        """Those of them without an output."""
        return sum(count for status, count in self.counts.items() if not status.has_output)

    @property
    def seconds_left(self) -> float | None:
        """How long the rest takes at the rate so far, s; None before there is one."""
        return (self.todo - self.over) * self.seconds / self.over if self.over else None


def run_batch(
    clips: Sequence[BatchClip],
    settings: BatchSettings,
    index: BatchIndex,
    engine: Engine,
    *,
    retry_failed: bool = False,
    look: Callable[[BatchTally, ClipRow | None], None] = lambda tally, row: None,
    clock: Clock | None = None,
) -> BatchTally:
    """Run the clips that are not done yet, and keep each row in the index. look: sees the tally at the beginning, and
    with each row. Whatever ends it, it can be called again. Raises RetargetError where no clip can be begun, or
    one would replace what was not made of its source."""
    clock = clock or MonotonicClock()
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
