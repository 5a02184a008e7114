"""What `run` and `demo` share: prepare a run, play it, write its files, say how it went."""

from collections.abc import Callable
from contextlib import ExitStack

import typer
from rich.console import Console

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from retarget.cli.boundary import DONE, STOPPED
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.outputs import Outputs, Written
from retarget.cli.progress import progress_bar
from retarget.cli.summary import show_summary
from retarget.frames import SensorFrames
from retarget.metrics.measure import measure
from retarget.options import RunOptions
from retarget.pipeline import Watch
from retarget.prepare import prepare
from retarget.report import Report
from retarget.robot_body import RobotBody

__all__ = ["follow_clip"]


def follow_clip(read: Callable[[], SensorFrames], options: RunOptions, outputs: Outputs) -> int:
    """Run, write the files, show a summary. Returns the exit code: done, or stopped (also: a file is not written).

    read: opens the source. Raises RetargetError for what cannot be run; then nothing has moved and nothing is written.
    """
    clock = VirtualClock()
    with ExitStack() as signals:
        with prepare(read, options, clock=clock, make_bus=_make_bus) as prepared:
            stop = signals.enter_context(stop_on_signals())
            with progress_bar(options.robot, prepared.clip.ticks) as show:
                run = prepared.run(Watch(show, stop, stop.insisted))
        # Still heard and not raised: what was recorded is written, whoever is in a hurry.
        report = measure(run)
        written = outputs.write(run, report)
    _tell(report, written)
    return STOPPED if run.reason is not None or written.problems else DONE


def _tell(report: Report, written: Written) -> None:
    """Last of all, because a terminal may be gone or full."""
    show_summary(report, Console())
    for line in written.lines:
        typer.echo(line)
    for problem in written.problems:
        typer.echo(f"error: {problem}", err=True)


def _make_bus(name: str, robot: RobotBody, clock: Clock) -> ServoBus:
    """The bus of that name; servos begin in the robot's `stand` posture."""
    start = robot.joint_map.to_ticks(robot.posture(robot.profile.postures.stand)[robot.servo_columns])
    if name == "none":
        from sim.no_bus import NoBus

        return NoBus(clock, start=start)
    from sim.mock_bus import MockBus

    return MockBus(robot.joint_map.servos, clock, start=start)
