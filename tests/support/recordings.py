"""Short runs of the synthetic performer that are recorded, or kept as `--save` keeps them."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from faulty_bus import FaultyBus, MockFault
from hardware.bus import ServoBus, ServoGoals
from hardware.clock import Clock, VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.guard import Guard
from hardware.guard_state import StopCause
from operators import Asks
from retarget.cli import main
from retarget.frames import SensorFrames
from retarget.human.samples import Samples
from retarget.model.body import BodyModel, load_body, load_body_text
from retarget.model.robot import RobotBody, load_robot
from retarget.recording.cdr import schema
from retarget.recording.motion import Motion
from retarget.recording.npz import write_npz
from retarget.recording.reading import Recording, read_recording
from retarget.recording.recorder import Recorder
from retarget.rotations import from_rotation_vector
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import PHASE_NAMES, Phase
from retarget.run.run_result import RunResult
from retarget.run.table import RunTable
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

    def read(self) -> Recording:
        return read_recording(self.path)


def with_cycles(recording: Recording, cycles: RunTable) -> Recording:
    """A recording that was made of other cycles."""
    other = replace(recording)
    vars(other)["cycles"] = cycles  # where `cached_property` keeps them
    return other


def performer(seconds: float = SECONDS) -> Callable[[], SensorFrames]:
    return lambda: synthetic_performer().cut(0.0, seconds)


def mock_bus(robot: RobotBody, clock: Clock, *, faults: tuple[MockFault, ...] = ()) -> ServoBus:
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    start = robot.joint_map.to_ticks(stand)
    return FaultyBus(robot.joint_map.servos, clock, start=start, faults=faults, imu_of=robot)


def record(
    path: Path | None,
    *,
    options: RunOptions | None = None,
    seconds: float = SECONDS,
    faults: tuple[MockFault, ...] = (),
    operator: Operator | None = None,
    samples: Callable[[Samples], Samples] = lambda samples: samples,
    truth: Callable[[], FloatArray | None] = lambda: None,
    goes_to_rest: bool = False,
) -> Recorded:
    """Run a synthetic performer, and record it; without a path only run. truth: as if there were physics."""
    chosen, clock, notes = options or RunOptions(robot="op3"), VirtualClock(), list[str]()
    recorder = Recorder(path, chosen, clock=clock, notify=notes.append, truth=truth)

    def bus(robot: RobotBody, clock: Clock) -> ServoBus:
        return mock_bus(robot, clock, faults=faults)

    with prepare(performer(seconds), chosen, clock=clock, make_bus=bus, goes_to_rest=goes_to_rest) as loaded:
        prepared = replace(loaded, samples=samples(loaded.samples))
        with recorder.recording(prepared, source="synthetic") as recorded:
            result = recorded.run(operator, [recorder.observer])
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
    operator = Asks(stop=lambda: next(ticks) >= stop, why="the space bar")
    return record(path, options=options, seconds=1.0, operator=operator, truth=truth or (lambda: None)).result


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


# How a pose was found, as `retarget._solver.PoseRing` counts it.


class How(IntEnum):
    """The values of `PlayoutSample.how`."""

    NONE = 0
    """No pose was ever sent: NaN."""
    INTERPOLATED = 1
    LATEST = 2
    """A pose as sent: the newest, or the first of all while the playout has not reached it."""
    EXTRAPOLATED = 3
    HELD = 4
    """No new pose for longer than may be extrapolated: the pose at the end of extrapolation."""


# `python stamped_run.py WORDS`: the command line, which prints at its end when a stop reached the emulated servos.

STAMP = "first stopping goal at unix time"


def stamped() -> list[float]:
    """From now on goals are watched. Returns the list in which the time will be."""
    latch, write = Guard.latch, DynamixelBus.write
    asked: list[float] = []
    stamps: list[float] = []

    def latching(self: Guard, cause: StopCause, reason: str) -> None:
        asked.append(0.0)
        latch(self, cause, reason)

    def writing(self: DynamixelBus, goals: ServoGoals) -> None:
        write(self, goals)
        if asked and not stamps:
            stamps.append(datetime.now(UTC).timestamp())

    Guard.latch, DynamixelBus.write = latching, writing  # type: ignore[method-assign]
    return stamps


if __name__ == "__main__":
    found = stamped()
    try:
        main(sys.argv[1:])
    finally:
        sys.stderr.write(f"{STAMP} {found[0] if found else 'never':}\n")


# Messages of ROS 2 by the library with which its users read MCAP: an oracle for bytes and definitions of ours.


def decoded(name: str, data: bytes) -> Any:
    """A message (pkg/msg/Name) by its definition."""
    of = Schema(id=1, name=name, encoding="ros2msg", data=schema(name).encode())
    decode = DecoderFactory().decoder_for("cdr", of)
    assert decode is not None
    return decode(data)


# Small motions of known bodies, and saved runs, for the tests of the exports.

RATE = 50.0
SLIDER = """<mujoco><worldbody><body name="base"><freejoint name="root"/><geom size="0.1"/>
  <body name="my arm" pos="0.1 0 0.3" euler="30 20 10"><joint name="lift" type="slide" axis="0 0 1"/>
    <geom size="0.1" pos="0 0 0.2"/>
    <body name="tip" pos="0 0.2 0"><joint name="swing" axis="1 0 0" pos="0.02 0.03 0"/><geom size="0.02"/></body></body>
  <body name="my{arm" pos="-0.1 0 0.3"><joint name="roll" axis="1 1 0"/><geom size="0.1"/></body></body>
</worldbody></mujoco>"""
"""A slide, a hinge that does not turn about its link's origin, turned frames, names with a blank and a brace."""


def slider() -> BodyModel:
    return load_body_text(SLIDER, source="slider")


def moved(body: BodyModel, *, rows: int = 40, seed: int = 7, robot: str = "slider", rate_hz: float = RATE) -> Motion:
    """A body that sways through large angles while its root wanders and turns all around."""
    rng = np.random.default_rng(seed)
    time = np.arange(rows) / rate_hz
    single, address = body.scalar_joints()
    joints = int(np.count_nonzero(single))
    q = np.tile(body.qpos0, (rows, 1))
    phase, rate = rng.uniform(0.0, 6.3, joints), rng.uniform(0.5, 3.0, joints)
    q[:, address[single]] = 1.2 * np.sin(phase + np.outer(time, 6.3 * rate))
    q[:, :3] = np.cumsum(rng.normal(0.0, 0.01, (rows, 3)), axis=0) + np.array([0.1, 0.2, 0.4])
    q[:, 3:7] = from_rotation_vector(np.outer(np.linspace(0.0, 5.0, rows), [0.2, 0.4, 0.89]))
    follow = np.full(rows, Phase.FOLLOW, dtype=np.int8)
    return Motion(source="test.npz", robot=robot, body=body, time=time, phase=follow, q=q)


def with_servos(motion: Motion) -> Motion:
    """With servos behind what was sent on all joints but the last, and one landmark that is not always known."""
    from dataclasses import replace

    servos = motion.joints - 0.01
    servos[:, -1] = np.nan
    goals = np.rint(motion.joints * 650).astype(np.int64) + 2048
    goals[:, -1] = -1
    asked = np.zeros((len(motion), 2, 3)) + np.arange(len(motion))[:, None, None]
    asked[0, 1] = np.nan
    names = ("hand", "lost")
    return replace(motion, present=servos, goal_ticks=goals, landmarks_asked=asked, landmark_names=names)


def op3() -> BodyModel:
    return load_body(load_robot("op3").profile.body_path)


def saved(motion: Motion, path: Path, body: Path, **other: Any) -> Path:
    """A motion in the keys of `--save`; `other` replaces keys, None leaves one out."""
    arrays: dict[str, NDArray[Any] | None] = {
        "time": motion.time,
        "phase": np.array(PHASE_NAMES)[motion.phase],
        "joint_names": np.array(motion.joint_names),
        "joint_positions": motion.joints,
        "root_position": motion.root_position,
        "root_quaternion": motion.root_quaternion,
        "body": np.array(str(body)),
        "goal_ticks": motion.goal_ticks,
        "servo_positions": motion.present,
        "landmark_names": np.array(motion.landmark_names) if "landmarks_asked" in motion else None,
        "landmarks_asked": motion.landmarks_asked,
    }
    np.savez(path, allow_pickle=False, **{key: value for key, value in (arrays | other).items() if value is not None})
    return path


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (...) rad between orientations, whatever the sign of the quaternions."""
    cosine = np.clip(np.abs(np.sum(a * b, axis=-1)), 0.0, 1.0)
    return np.asarray(2.0 * np.arccos(cosine))
