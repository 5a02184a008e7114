"""What `run` and `demo` share: prepare a run, play it, say how it went, write its files."""

from collections.abc import Callable

from rich.console import Console

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from retarget.cli.boundary import DONE, STOPPED
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.outputs import Outputs
from retarget.cli.progress import progress_bar
from retarget.cli.summary import show_summary
from retarget.frames import SensorFrames
from retarget.metrics.measure import measure
from retarget.options import RunOptions
from retarget.pipeline import Watch
from retarget.prepare import prepare
from retarget.robot_body import RobotBody

__all__ = ["follow_clip"]


def follow_clip(read: Callable[[], SensorFrames], options: RunOptions, outputs: Outputs) -> int:
    """Run, show a summary, write the files. Returns the exit code: done, or stopped.

    read: opens the source. Raises RetargetError for what cannot be run; then nothing has moved and nothing is written.
    """
    clock = VirtualClock()
    with (
        prepare(read, options, clock=clock, make_bus=_make_bus) as prepared,
        stop_on_signals() as stop,
        progress_bar(options.robot, prepared.clip.ticks) as show,
    ):
        run = prepared.run(Watch(show, stop, stop.insisted))
    report = measure(run)
    show_summary(report, Console())
    outputs.write(run, report)
    return STOPPED if run.reason is not None else DONE


def _make_bus(name: str, robot: RobotBody, clock: Clock) -> ServoBus:
    """The bus of that name; servos begin in the robot's `stand` posture."""
    start = robot.joint_map.to_ticks(robot.posture(robot.profile.postures.stand)[robot.servo_columns])
    if name == "none":
        from sim.no_bus import NoBus

        return NoBus(clock, start=start)
    from sim.mock_bus import MockBus

    return MockBus(robot.joint_map.servos, clock, start=start)
