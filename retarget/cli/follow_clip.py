"""What `run` and `demo` share: prepare a run, play it, write its files, say how it went."""

from collections.abc import Callable
from contextlib import ExitStack

import typer
from rich.console import Console

from hardware.clock import Clock, MonotonicClock, PacedClock, VirtualClock
from hardware.guard_state import StopCause
from retarget.cli.boundary import DONE, STOPPED
from retarget.cli.detached import detached_screens
from retarget.cli.in_time import in_time
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.outputs import Outputs, Written
from retarget.cli.physics_bench import PhysicsBench
from retarget.cli.progress import progress_bar
from retarget.cli.summary import show_summary
from retarget.cli.viewing import viewing
from retarget.frames import SensorFrames
from retarget.metrics.latest import measure_latest
from retarget.metrics.measure import measure
from retarget.options import RunOptions
from retarget.pipeline import Watch
from retarget.prepare import prepare
from retarget.recording.recorder import Recorder
from retarget.report import Report
from retarget.run_result import RunResult

__all__ = ["finished", "follow_clip", "recorder_for"]


def follow_clip(read: Callable[[], SensorFrames], options: RunOptions, outputs: Outputs, *, source: str = "") -> int:
    """Run, write the files, show a summary. Returns the exit code: done, or stopped (also: a file is not written).

    read: opens the source, which a recording calls `source`. Raises RetargetError for what cannot be run; then nothing
    has moved and nothing is written.
    """
    clock: Clock = MonotonicClock()
    if options.simulated:  # whoever looks on sees it as fast as it would be
        clock = VirtualClock() if outputs.view is None else PacedClock()
    bench = PhysicsBench(options, _note)
    recorder = recorder_for(outputs, options, bench, clock=clock, parks=options.has_mass)
    with detached_screens(), ExitStack() as signals:
        with prepare(
            read,
            options,
            clock=recorder.clock,
            make_bus=recorder.make_bus(bench.make_bus),
            parks=options.has_mass,
            tell=recorder.hears(_note),
        ) as prepared:
            stop = signals.enter_context(stop_on_signals(moves=True))
            with (
                viewing(outputs.view, prepared, options, truth=bench.truth, tell=_note) as page,
                recorder.recording(prepared, source=source) as recorded,
                progress_bar(options.robot, prepared.samples.ticks) as show,
            ):
                asked = page.heard(bench.watching(stop, prepared), stop)
                if prepared.side is None and outputs.view is not None:
                    asked = in_time(asked, prepared.samples.dt, clock)
                watch = Watch(show, asked, stop.insisted, stop.why)
                run = recorded.run(page.watch(recorder.watch(watch, prepared)))
        # Still heard and not raised: what was recorded is written, whoever is in a hurry.
        return recorder.code(finished(bench.seen(run), outputs))


def recorder_for(outputs: Outputs, options: RunOptions, bench: PhysicsBench, *, clock: Clock, parks: bool) -> Recorder:
    """What records the run if `outputs` ask for it, and tells on stderr; see `Recorder` for parks and errors."""
    truth, overwrite = bench.truth_numbers, outputs.overwrite
    return Recorder(outputs.record, options, clock=clock, parks=parks, tell=_note, overwrite=overwrite, truth=truth)


def finished(run: RunResult, outputs: Outputs) -> int:
    """Write the files of a run, show its summary, return the exit code. Who asked it to end, and for no file that is
    measured, does not wait for the whole of it to be."""
    hurry = run.stop is not None and run.stop.cause is StopCause.REQUESTED and not outputs.measured
    report = measure_latest(run) if hurry else measure(run)
    written = outputs.write(run, report)
    _tell(report, written)
    return STOPPED if run.reason is not None or report.fallen or written.problems else DONE


def _note(text: str) -> None:
    typer.echo(text, err=True)


def _tell(report: Report, written: Written) -> None:
    """Last of all, because a terminal may be gone or full."""
    show_summary(report, Console())
    for line in written.lines:
        typer.echo(line)
    for problem in written.problems:
        typer.echo(f"error: {problem}", err=True)
