"""`retarget replay`: run a recording again and compare, or send its goals to a bus."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from retarget.cli.boundary import DONE, STOPPED
from retarget.errors import UsageError
from retarget.options import RunOptions
from retarget.physics_options import PhysicsOptions
from retarget.pipeline import Watch

if TYPE_CHECKING:
    from retarget.cli.outputs import Outputs
    from retarget.recording.played import Played

__all__ = ["replay"]

SPEEDS = (0.05, 1.0)
"""Shares of the recorded speed at which goals are sent."""


def replay(
    file: Annotated[Path, typer.Argument(help="What `retarget run --record` wrote.", metavar="FILE.mcap")],
    goals: Annotated[
        bool, typer.Option("--goals", help="Send the goals that were sent then, as they are, to --bus.")
    ] = False,
    bus: Annotated[
        str | None,
        typer.Option(
            help="Where --goals go, as of `run`.", metavar="mock|emulator|physics|physics+wire|none|profile|PORT"
        ),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Of --goals; 1 is as fast as they were recorded.", metavar="X")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write the numbers of the run as it is now.", metavar="FILE.json|DIR")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write every tick of it, for other tools.", metavar="FILE.npz")
    ] = None,
) -> None:
    """Run a recording again: what its sensors, servos and clock said, through this version; and say which goals differ.

    With --goals nothing is computed: the robot is led slowly to the first of the recorded goals, then along them, and
    parked; gate and guard have the last word. Exit code 0: all goals are the same, or were sent; 1: they differ, or
    the guard stopped; 2: a file that is no such recording.
    """
    from retarget.cli.outputs import Outputs
    from retarget.recording.played import played
    from retarget.recording.reading import read_recording

    if goals != (bus is not None):
        raise UsageError("goals need a bus, and nothing else does", where="--goals, --bus", next_step="Give both")
    if speed is not None and not goals:
        raise UsageError("only goals are sent slower", where="--speed", next_step="Leave it out, or add --goals")
    if goals and (report or save):
        raise UsageError("goals alone have no report", where="--report, --save", next_step="Leave them out")
    outputs = Outputs.checked(report=report, save=save, plots=None)
    found = played(read_recording(file))
    _tell_of_damage(found)
    if bus is not None:
        raise typer.Exit(_send(found, bus, 1.0 if speed is None else speed))
    raise typer.Exit(_again(found, outputs))


def _tell_of_damage(found: "Played") -> None:
    """What there is of it, if that is not all."""
    recording, cycles = found.recording, found.cycles
    if recording.damage:
        _note(f"{recording.path}: {recording.damage}; {len(cycles)} ticks before that are read")
    if found.missing:
        _note(f"{recording.path}: {found.missing} ticks were never written: from there on goals may differ")


def _again(found: "Played", outputs: "Outputs") -> int:
    from retarget.cli.progress import progress_bar
    from retarget.metrics.measure import measure
    from retarget.recording.replay import replay as run_again

    session = found.recording.session
    with progress_bar(session.robot, found.last_tick + 1) as show:
        again = run_again(found, watch=Watch(show))
    for changed in again.changed:
        _note(changed)
    typer.echo(f"{found.recording.path}: {session.source or 'a run'} on {session.robot}, --bus {session.bus}")
    for line in again.difference.told():
        typer.echo(line)
    if again.result.reason:
        typer.echo(f"it stops again: {again.result.reason}")
    problems: tuple[str, ...] = ()
    if outputs.report or outputs.save:
        written = outputs.write(again.result, measure(again.result))
        problems = written.problems
        for line in written.lines:
            typer.echo(line)
        for problem in problems:
            typer.echo(f"error: {problem}", err=True)
    return DONE if again.difference.none and not problems else STOPPED


def _send(found: "Played", bus: str, speed: float) -> int:
    from contextlib import ExitStack

    from hardware.clock import Clock, MonotonicClock, VirtualClock
    from retarget.cli.interrupt import stop_on_signals
    from retarget.cli.physics_bench import PhysicsBench
    from retarget.cli.progress import progress_bar
    from retarget.recording.sending import sending

    low, high = SPEEDS
    if not low <= speed <= high:
        raise UsageError("impossible speed", where="--speed", found=f"{speed:g}", allowed=f"{low:g} to {high:g}")
    options = _on_bus(found.recording.session.options, bus)
    clock: Clock = VirtualClock() if options.simulated else MonotonicClock()
    bench = PhysicsBench(options, _note)
    with ExitStack() as signals:
        with sending(found, options, speed=speed, clock=clock, make_bus=bench.make_bus, tell=_note) as prepared:
            stop = signals.enter_context(stop_on_signals())
            with progress_bar(options.robot, prepared.samples.kept // 2) as show:
                run = prepared.run(Watch(show, bench.watching(stop, prepared), stop.insisted, stop.why))
        sent = run.record.robot
        assert sent is not None, "goals are a robot's"
        gated = int(sent.gated.sum())
        typer.echo(f"{run.ticks_followed} goals sent to --bus {bus}; the gate changed {gated} of {len(run.record)}")
        typer.echo(f"end: {run.state}" + (f": {run.reason}" if run.reason else ""))
        return DONE if run.reason is None else STOPPED


def _on_bus(options: RunOptions, bus: str) -> RunOptions:
    """The options of the recording on another bus; what only a simulation has is left where there is none."""
    physics = options.physics if bus.startswith("physics") else PhysicsOptions()
    return replace(options, bus=bus, physics=physics, gate=True)


def _note(text: str) -> None:
    typer.echo(f"note: {text}", err=True)
