"""Short runs of the synthetic performer that are recorded, or kept as `--save` keeps them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.reader import make_reader

from faulty_bus import FaultyBus, MockFault
from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from retarget.frames import SensorFrames
from retarget.human.samples import Samples
from retarget.model.robot import RobotBody
from retarget.recording.npz import write_npz
from retarget.recording.reading import Played, played, read_recording
from retarget.recording.recorder import Recorder
from retarget.run.loop import Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from sim.performer import synthetic_performer

SECONDS = 0.4


@dataclass(frozen=True)
class Recorded:
    """A run, its recorder and the recorder's messages."""

    result: RunResult
    recorder: Recorder
    notes: list[str]
    path: Path

    def played(self) -> Played:
        return played(read_recording(self.path))


def performer(seconds: float = SECONDS) -> Callable[[], SensorFrames]:
    return lambda: synthetic_performer().cut(0.0, seconds)


def mock_bus(robot: RobotBody, clock: Clock, *, faults: tuple[MockFault, ...] = ()) -> ServoBus:
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    return FaultyBus(robot.joint_map.servos, clock, start=robot.joint_map.to_ticks(stand), faults=faults)


def record(
    path: Path | None,
    *,
    options: RunOptions | None = None,
    seconds: float = SECONDS,
    faults: tuple[MockFault, ...] = (),
    watch: Callable[[Prepared], Watch] = lambda prepared: Watch(),
    samples: Callable[[Samples], Samples] = lambda samples: samples,
    truth: Callable[[], FloatArray | None] = lambda: None,
) -> Recorded:
    """Run a synthetic performer, and record it; without a path only run. truth: as if there were physics."""
    chosen, clock, notes = options or RunOptions(robot="op3"), VirtualClock(), list[str]()
    recorder = Recorder(path, chosen, clock=clock, goes_to_rest=False, notify=notes.append, truth=truth)

    def make(robot: RobotBody, clock: Clock) -> ServoBus:
        return mock_bus(robot, clock, faults=faults)

    with prepare(performer(seconds), chosen, clock=recorder.clock, make_bus=recorder.make_bus(make)) as loaded:
        prepared = replace(loaded, samples=samples(loaded.samples))
        with recorder.recording(prepared, source="synthetic") as recorded:
            result = recorded.run(recorder.watch(watch(prepared), prepared))
    return Recorded(result, recorder, notes, path or Path())


def recorded(
    path: Path,
    *,
    robot: str,
    stop: int = 10**9,
    scene: str | None = None,
    truth: Callable[[], FloatArray | None] | None = None,
) -> RunResult:
    """The first second of the performer, stopped after so many ticks. truth: as if there were physics."""
    options = RunOptions(robot=robot, bus="mock" if truth is None else "physics", scene=scene)
    ticks = iter(range(10**9))
    watch = Watch(stop_asked=lambda: next(ticks) >= stop, why=lambda: "the space bar")
    known = truth or (lambda: None)
    return record(path, options=options, seconds=1.0, watch=lambda prepared: watch, truth=known).result


def saved_run(path: Path, *, robot: str, seconds: float = 1.0) -> Path:
    """So much of the performer as `--save` keeps it."""
    result = record(None, options=RunOptions(robot=robot), seconds=seconds).result
    write_npz(result, path)
    assert len(result.record) > 50
    return path


def messages(path: Path, topic: str) -> list[bytes]:
    """By the mcap library, with its checks on."""
    with path.open("rb") as stream:
        return [message.data for _, _, message in make_reader(stream, validate_crcs=True).iter_messages(topics=[topic])]
