"""`retarget batch`: retarget many motion files, with an index of the results."""

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import typer

from hardware.errors import counted
from retarget.batch.batch import BatchTally, Engine, run_batch
from retarget.batch.clip import RUN, ClipRow, ClipStatus, batch_settings
from retarget.batch.engines import on_processes, on_ray, usual_jobs
from retarget.batch.index import BatchIndex, sources_of
from retarget.batch.inputs import Shard, find_clips
from retarget.batch.worker import ClipLimits
from retarget.cli.application import FileOptions, console, log, note
from retarget.cli.exit import DONE, LEAST_MEMORY, STOPPED, echo
from retarget.errors import UsageError, suggest
from retarget.model.robot import load_robot
from retarget.recording.exports.formats import FORMATS, format_named
from retarget.run.options import RunOptions
from retarget.run.trial import try_robot
from retarget.sources.open import refuse_values

BENCH = "retarget.cli.buses:PhysicsBench"
"""The bench of each process, by its import path."""
ENGINES = ("processes", "ray")
TIME_LIMIT_S, MEMORY_GB = 1800.0, 4.0
"""The longest recording that is read takes half of the time and 1 GB."""
MOST_TIME_S, MOST_MEMORY = 30 * 24 * 3600.0, 2**62
"""Bounds, s and bytes, of the timers and limits of the system."""
SHOWN_FAILURES = 20
"""Failures that are printed. All are in the index."""
EVERY_S = 60.0
"""Time, s, between two lines of progress without a terminal."""


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """Options of a batch.

    Batch:
        form (--format) FORMAT: run (NPZ as of `retarget run --save`, usual), or a format of `retarget export`.
        fps N: Rows per second of an export; else as its readers expect, or a row a tick.
        shard i/N: Only every N-th clip of the sorted list, from the i-th.
        jobs N 1..4096: Clips at a time, usually one per processor.
        engine processes|ray: Clips are shared by processes of this machine, or by Ray.
        address A: Ray cluster to join (auto: of this machine); else that of RAY_ADDRESS, else one is started here.
        time_limit S: Wall time that a clip may take.
        memory GB: Memory (address space) that the process of a clip may take; a clip that takes more fails.
        retry_failed: Run also those again that have failed.
    """

    form: str = RUN
    fps: float | None = None
    shard: str | None = None
    jobs: int | None = None
    engine: str = ENGINES[0]
    address: str | None = None
    time_limit: float = TIME_LIMIT_S
    memory: float = MEMORY_GB
    retry_failed: bool = False

    @property
    def ending(self) -> str:
        """Suffix of the outputs. Raises UsageError for an unknown format."""
        if self.form == RUN:
            return ".npz"
        if self.form not in FORMATS:
            known = (RUN, *FORMATS)
            step = suggest(self.form, known)
            found, allowed = self.form[:80], ", ".join(known)
            raise UsageError("unknown format", where="--format", found=found, allowed=allowed, next_step=step)
        return format_named(self.form).ending

    def checked(self, options: RunOptions) -> Engine:
        """The engine. Raises UsageError for impossible values, and options that exclude each other."""
        if self.engine not in ENGINES:
            found, step = self.engine[:80], suggest(self.engine, ENGINES)
            raise UsageError(
                "unknown engine", where="--engine", found=found, allowed=", ".join(ENGINES), next_step=step
            )
        if self.address is not None and self.engine != "ray":
            raise UsageError("only Ray has an address", where="--address", next_step="Add --engine ray")
        if self.fps is not None and self.form == RUN:
            raise UsageError("a whole run has its ticks", where="--fps", next_step="Give another --format")
        if not options.simulated:
            raise UsageError(
                "a batch moves no real servos", where="--bus", found=options.bus, allowed="a simulated bus"
            )
        if options.playback.loop:
            raise UsageError("a clip of a batch ends", where="--loop", next_step="Leave it out")
        if not 0.0 < self.time_limit <= MOST_TIME_S:
            found, allowed = f"{self.time_limit:g} s", f"above 0, up to {MOST_TIME_S:.0f} (30 days)"
            raise UsageError("impossible time", where="--time-limit", found=found, allowed=allowed)
        if not LEAST_MEMORY <= 1e9 * self.memory <= MOST_MEMORY:
            found, allowed = f"{self.memory:g} GB", f"{LEAST_MEMORY / 1e9:g} to {MOST_MEMORY / 1e9:.0f}"
            raise UsageError("impossible memory", where="--memory", found=found, allowed=allowed)
        limits = ClipLimits(self.time_limit, int(1e9 * self.memory))
        if self.engine == "ray":
            return partial(on_ray, limits=limits, jobs=self.jobs, address=self.address)
        return partial(on_processes, limits=limits, jobs=self.jobs or usual_jobs())


def batch(inputs: list[str], out: Path, options: RunOptions, file: FileOptions, batched: BatchOptions) -> None:
    """Retarget many motion files: one output for each, and DIR/index.jsonl with a row for each, also for failures.

    The same command goes on where it ended, and leaves out what is done. Outputs do not depend on --jobs and --engine.

    Examples:
        retarget batch --robot op3 --out op3_data recordings
        retarget batch --robot op3 --out op3_data --format csv --fps 30 'data/**/*.bvh' --retry-failed
        retarget batch --robot op3 --out op3_data --shard 3/100 all.txt

    Exit code 0: each clip is done, 1: some failed, 2: refused before anything ran, 130: Ctrl-C; then call it again.

    Arguments:
        inputs: Motion files, folders, patterns in quotes ('data/**/*.bvh'), or lists (.txt, a path a line).

    Options:
        out DIR: Folder of outputs and index.
    """
    engine, ending = batched.checked(options), batched.ending
    shard = None if batched.shard is None else Shard.parsed(batched.shard)
    clips = find_clips(inputs, out=out, ending=ending, sources=sources_of(out))
    reading = {name: str(value) if isinstance(value, Path) else value for name, value in vars(file).items()}
    refuse_values(**{name: value for name, value in vars(file).items() if name != "performer_root"})
    settings = batch_settings(out, options, bench=BENCH, reading=reading, form=batched.form, fps=batched.fps)
    if not options.is_human:
        try_robot(load_robot(options.robot, root=options.root), options)
    with BatchIndex(settings.out, shard) as index:
        mine = clips if shard is None else shard.of(clips)
        try:
            with _shown() as look:
                tally = run_batch(mine, settings, index, engine, retry_failed=batched.retry_failed, look=look)
        except KeyboardInterrupt:
            log(f"what is done is in {index.path}; the same command goes on from there")
            raise
        for text in _summary(tally, index):
            echo(text)
    failed = tally.failed + tally.failed_before
    raise typer.Exit(STOPPED if failed else DONE)


@contextmanager
def _shown() -> Iterator[Callable[[BatchTally, ClipRow | None], None]]:
    """Yields a function that prints failures and progress."""
    from rich.live import Live
    from rich.text import Text

    shown, last = 0, 0.0

    with Live(Text(), console=console(err=True), transient=True, auto_refresh=False) as live:

        def look(tally: BatchTally, row: ClipRow | None) -> None:
            nonlocal shown, last
            if row is not None and not row.status.has_output:
                shown += 1
                if shown <= SHOWN_FAILURES:
                    log(f"{row.status}: {row.message if row.source in row.message else f'{row.source}: {row.message}'}")
                elif shown == SHOWN_FAILURES + 1:
                    log("more failures are in the index alone")
            if live.console.is_terminal:
                live.update(Text(progress_of(tally)), refresh=True)
            elif row is None or tally.seconds - last >= EVERY_S:
                last = tally.seconds
                log(progress_of(tally))

        yield look


def progress_of(tally: BatchTally) -> str:
    """The progress of a batch, in a line."""
    if not tally.over:
        before = f", {tally.done_before} done before" if tally.done_before else ""
        return f"{counted(tally.todo, 'clip')} to do{before}"
    failed = f", {tally.failed} failed" if tally.failed else ""
    line = f"{tally.over} of {counted(tally.todo, 'clip')}, {tally.over / tally.seconds:.2g} a second{failed}"
    left = tally.seconds_left
    return line if not left else f"{line}, {_duration(left)} left"


def _duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


def _summary(tally: BatchTally, index: BatchIndex) -> Iterator[str]:
    parts = [f"{tally.counts[status]} {status}" for status in ClipStatus if tally.counts[status]]
    if tally.done_before:
        parts.append(f"{tally.done_before} done before")
    if tally.failed_before:
        parts.append(f"{tally.failed_before} failed before (--retry-failed runs them again)")
    yield f"{counted(tally.todo + tally.done_before + tally.failed_before, 'clip')}: {', '.join(parts)}"
    if tally.over:
        yield f"{tally.over / max(tally.seconds, 1e-9):.2g} clips a second, in {_duration(tally.seconds)}"
    yield f"index: {shlex.quote(str(index.path))}"
    try:
        yield f"table: {shlex.quote(str(index.write_table()))}"
    except UsageError as error:
        note(f"no table of the index: {error}")
