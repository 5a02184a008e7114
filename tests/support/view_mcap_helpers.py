"""Recorded runs of the synthetic performer, for the tests of the viewer."""

from collections.abc import Callable
from pathlib import Path

from hardware.clock import VirtualClock
from retarget.cli.buses import make_bus
from retarget.human.samples import Playback
from retarget.recording.recorder import Recorder
from retarget.run.loop import Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from sim.performer import synthetic_performer

GivenTruth = Callable[[], FloatArray | None] | None


def recorded(
    path: Path, *, robot: str, stop: int = 10**9, scene: str | None = None, truth: GivenTruth = None
) -> RunResult:
    """The first second of the performer, stopped after so many ticks. truth: as if there were physics."""
    bus = "mock" if truth is None else "physics"
    options = RunOptions(robot=robot, bus=bus, scene=scene, playback=Playback(end=1.0))
    truth_of, clock = truth or (lambda: None), VirtualClock()
    recorder = Recorder(path, options, clock=clock, goes_to_rest=False, notify=lambda text: None, truth=truth_of)
    asked = 0

    def stop_asked() -> bool:
        nonlocal asked
        asked += 1
        return asked > stop

    make = recorder.make_bus(lambda body, clock: make_bus("mock", body, clock))
    with (
        prepare(synthetic_performer, options, clock=recorder.clock, make_bus=make) as prepared,
        recorder.recording(prepared, source="synthetic") as taped,
    ):
        return taped.run(recorder.watch(Watch(stop_asked=stop_asked, why=lambda: "the space bar"), taped))
