"""A process that records a robot in real time, until it is killed: `python recording_process.py FILE SECONDS`."""

import sys
from pathlib import Path

from hardware.bus import ServoBus
from hardware.clock import Clock, MonotonicClock
from retarget.cli.buses import make_bus
from retarget.model.robot import RobotBody
from retarget.recording.recorder import Recorder
from retarget.run.loop import Progress
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from sim.performer import synthetic_performer


def main(path: Path, seconds: float) -> None:
    """Print when the robot moves, and at the end what writing cost."""
    clock, options = MonotonicClock(), RunOptions(robot="op3")
    recorder = Recorder(path, options, clock=clock, notify=say)

    def mock(robot: RobotBody, clock: Clock) -> ServoBus:
        return make_bus("mock", robot, clock)

    with (
        prepare(lambda: synthetic_performer().cut(0.0, seconds), options, clock=clock, make_bus=mock) as prepared,
        recorder.recording(prepared, source="synthetic") as recorded,
    ):
        begun = clock.now()
        recorded.run(observers=[recorder.observer, Progress(lambda done: say("moves"), every=25)])
        lasted = clock.now() - begun
    say(f"cpu {100.0 * recorder.cpu_s / lasted:.3f} percent, {path.stat().st_size / lasted:.0f} bytes a second")


def say(text: str) -> None:
    """Write a line that the other end of the pipe gets at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]))
