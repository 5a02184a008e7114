"""Short runs of an OP3 that are recorded, for every test that needs a recording."""

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
from retarget.recording.reading import Played, played, read_recording
from retarget.recording.recorder import Recorder
from retarget.run.loop import Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare
from retarget.run.run_result import RunResult
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
) -> Recorded:
    """Run a synthetic performer, and record it; without a path only run."""
    chosen, clock, notes = options or RunOptions(robot="op3"), VirtualClock(), list[str]()
    recorder = Recorder(path, chosen, clock=clock, goes_to_rest=False, notify=notes.append)

    def make(robot: RobotBody, clock: Clock) -> ServoBus:
        return mock_bus(robot, clock, faults=faults)

    with prepare(performer(seconds), chosen, clock=recorder.clock, make_bus=recorder.make_bus(make)) as loaded:
        prepared = replace(loaded, samples=samples(loaded.samples))
        with recorder.recording(prepared, source="synthetic") as recorded:
            result = recorded.run(recorder.watch(watch(prepared), prepared))
    return Recorded(result, recorder, notes, path or Path())


def messages(path: Path, topic: str) -> list[bytes]:
    """By the mcap library, with its checks on."""
    with path.open("rb") as stream:
        return [message.data for _, _, message in make_reader(stream, validate_crcs=True).iter_messages(topics=[topic])]
