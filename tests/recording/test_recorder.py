"""`--record`: what is in the file is what happened, for any tool that reads MCAP; the run is the same as without."""

import errno
import io
import os
import random
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from faulty_bus import FaultKind, MockFault
from hardware.clock import MonotonicClock, VirtualClock, wall_to_monotonic
from hardware.errors import RetargetError
from messages import Facts, refuses, shows
from operators import Asks
from recordings import Recorded, mock_bus, performer, record
from retarget.errors import UsageError
from retarget.recording import mcap_writer
from retarget.recording.cycles import STATES_OF_RUN, Done
from retarget.recording.mcap_writer import FLUSH_S, Ring, check_target
from retarget.recording.reading import read_recording
from retarget.recording.recorder import Recorder
from retarget.recording.topics import GOALS, JOINTS, SENSORS, TICK
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.types import RunState


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("recorded") / "run.mcap")


def assert_same(run: Recorded, whole: Recorded) -> None:
    np.testing.assert_array_equal(run.result.record.goal_ticks, whole.result.record.goal_ticks)


def test_it_is_opened_by_the_library_with_its_checks_on(whole: Recorded) -> None:
    with whole.path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None and reader.get_header().profile == "ros2"
        kinds = {summary.channels[key].topic: summary.channels[key] for key in summary.channels}
        schemas = {topic: summary.schemas[channel.schema_id] for topic, channel in kinds.items()}
        stamps = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        names = [attachment.name for attachment in reader.iter_attachments()]
    assert stamps == sorted(stamps)
    assert {schema.encoding for schema in schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in kinds.values()} == {"cdr"}
    assert schemas[GOALS].name == schemas[JOINTS].name == "sensor_msgs/msg/JointState"
    assert schemas[SENSORS].name == "geometry_msgs/msg/PoseArray" and schemas["/tf"].name == "tf2_msgs/msg/TFMessage"
    assert schemas["/events"].name == "rcl_interfaces/msg/Log"
    assert names == ["performer.yaml", "priorities_of_the_human.yaml", "priorities_of_the_robot.yaml", *names[3:]]
    assert names[3:] == ["robot.yaml", "body.xml"]


def test_every_tick_is_in_it(whole: Recorded) -> None:
    recording = read_recording(whole.path)
    result, cycles = whole.result, whole.read().cycles
    sent, robot = result.record, result.robot
    assert robot is not None
    kept = cycles.kept
    assert recording.damage == "" and cycles.index.tolist() == list(range(len(sent.q) + 2))
    np.testing.assert_array_equal(cycles.goal_ticks[kept], sent.goal_ticks)
    np.testing.assert_allclose(cycles.q_servos[kept], sent.q[:, robot.servo_columns], atol=2e-7)
    np.testing.assert_array_equal(cycles.phase[kept], result.record.phase)
    np.testing.assert_array_equal(robot.joint_map.to_radians(cycles.position[kept]), sent.present)
    np.testing.assert_array_equal(cycles.temperature[kept], sent.temperature)
    rows = recording.topic(TICK).rows
    assert rows["observer_modes"].shape[1] == len(recording.session.observers)
    assert set(rows["state"][1:].tolist()) <= {STATES_OF_RUN[state] for state in RunState}
    followed = cycles.phase == 1
    asked = [result.clip.sample(tick).position for tick in range(result.clip.ticks)]
    np.testing.assert_array_equal(cycles.sensor_position[kept & followed], asked)


@pytest.mark.long
def test_recording_changes_nothing(whole: Recorded) -> None:
    assert_same(record(None), whole)


def use_disk(monkeypatch: pytest.MonkeyPatch, *, room: int, hangs: threading.Event | None = None) -> None:
    """Let new files lie on a disk that is full, or hangs, when it has so many bytes of them."""
    usual = Path.open

    class Disk(io.FileIO):
        def write(self, data: Any) -> int:
            if self.tell() + len(data) > room:
                if hangs is None:
                    super().write(data[: max(room - self.tell(), 0)])
                    raise OSError(errno.ENOSPC, "No space left on device")
                hangs.wait(20.0)
            return super().write(data)

    def opened(path: Path, mode: str = "r", **more: Any) -> Any:
        return io.BufferedWriter(Disk(path, mode)) if mode == "xb" else usual(path, mode, **more)

    monkeypatch.setattr(Path, "open", opened)


@pytest.mark.long
def test_a_full_disk_ends_the_recording_and_nothing_else(
    whole: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_disk(monkeypatch, room=60_000)
    monkeypatch.setattr("retarget.recording.recorder.Ring", lambda shape, patient: Ring(shape, patient=True, rows=32))
    run = record(tmp_path / "run.mcap")  # which waits for the disk, so knows in time that it is full
    assert_same(run, whole)
    assert run.recorder.failure == "No space left on device" and run.recorder.code(0) == 1
    warned = [text for text in run.notes if "the recording is not whole, the robot goes on" in text]
    assert len(warned) == 1 and warned[0].endswith("No space left on device")
    assert read_recording(run.path).damage


@pytest.mark.parametrize(
    ("limit", "spare", "room"), [("MAX_BYTES", "SPARE_BYTES", 60_000), ("MOST_RECORDS", "SPARE_RECORDS", 150)]
)
def test_no_more_is_written_than_is_read(
    limit: str, spare: str, room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_writer, limit, getattr(mcap_writer, spare) + room)
    monkeypatch.setattr("retarget.recording.recorder.Ring", lambda shape, patient: Ring(shape, patient=True, rows=8))
    run = record(tmp_path / "run.mcap", options=RunOptions(robot="human"), seconds=1.0)
    shows(run.recorder.failure, "full")
    assert run.recorder.code(0) == 1 and len(run.notes) == 1
    found = run.read()
    assert not found.damage and 10 < len(found.cycles) < len(run.result.record) - 10
    rows = [topic.rows for topic in found.topics.values()]
    used = sum(len(row) for row in rows), sum(row.nbytes + 31 * len(row) for row in rows)
    assert used[limit == "MAX_BYTES"] <= room


def test_a_disk_that_is_full_from_the_start_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_disk(monkeypatch, room=100)
    with refuses(UsageError):
        record(tmp_path / "run.mcap")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_disk_that_hangs_holds_up_no_tick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: Recorded) -> None:
    hangs = threading.Event()
    use_disk(monkeypatch, room=40_000, hangs=hangs)
    monkeypatch.setattr("retarget.recording.mcap_writer.PATIENCE_S", 0.05)
    monkeypatch.setattr("retarget.recording.recorder.Ring", lambda shape, patient: Ring(shape, rows=64))
    run = record(tmp_path / "run.mcap")
    hangs.set()
    assert_same(run, whole)
    assert run.recorder.failure and run.recorder.code(0) == 1
    shows(run.notes[0])
    shows(run.notes[-1])
    assert len(run.notes) == 2


@pytest.mark.parametrize(("kind", "what"), [(FaultKind.READ_FAILS, "read"), (FaultKind.WRITE_FAILS, "write")])
def test_what_the_bus_fails_with_is_in_it(kind: FaultKind, what: str, tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", faults=(MockFault(kind, first=40, cycles=1000),))
    reason = run.result.reason or ""
    shows(reason)
    cycles, texts = run.read().cycles, read_recording(run.path).texts
    done = cycles.read if what == "read" else cycles.written
    assert np.flatnonzero(done == Done.FAILED).tolist() == [len(cycles) - 1]
    last = {who: text for (cycle, who), text in texts.items() if cycle == len(cycles) - 1}
    assert last[f"bus {what}"] in reason and reason in last["guard"]


def test_states_and_messages_are_in_it_when_they_are_new(whole: Recorded, tmp_path: Path) -> None:
    states = [RunState.ARMING, RunState.APPROACH, RunState.FOLLOW, RunState.STOPPING, RunState.OFF]
    names = [state.value for state in states]
    texts = [text for _, text in sorted(read_recording(whole.path).texts.items())]
    assert [text for text in texts if text in names] == names
    assert [text for text in texts if text.startswith("torque")] == ["torque on", "torque off"]
    said, clock, options = list[str](), VirtualClock(), RunOptions(robot="op3")
    recorder = Recorder(tmp_path / "run.mcap", options, clock=clock, notify=said.append)
    notify = recorder.recorded_notify(said.append)
    notify("too early")
    with (
        prepare(performer(0.1), options, clock=clock, make_bus=mock_bus) as prepared,
        recorder.recording(prepared, source="synthetic") as recorded,
    ):
        recorded.run(Asks(stop=lambda: notify("hello") is not None), [recorder.observer])
    notify("too late")
    texts = [*read_recording(tmp_path / "run.mcap").texts.values()]
    assert "hello" in texts and not {"too early", "too late"} & {*texts}
    assert {"too early", "hello", "too late"} <= {*said}


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (MockFault(FaultKind.MISSING, first=0, cycles=10, servo=2), "r_sho_roll"),
        (MockFault(FaultKind.READ_FAILS, first=0, cycles=10), ()),
        (MockFault(FaultKind.WRITE_FAILS, first=0, cycles=10), ()),
    ],
)
def test_a_robot_that_never_moved_leaves_no_file(fault: MockFault, message: Facts, tmp_path: Path) -> None:
    """Also where goals were written already: what is refused while it is armed has no tick."""
    with refuses(RetargetError, message):
        record(tmp_path / "run.mcap", faults=(fault,))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["run.npz", "no/such/folder/run.mcap", "."])
def test_a_place_that_cannot_be_is_refused(name: str, tmp_path: Path) -> None:
    with refuses(UsageError, "--record"):
        check_target(tmp_path / name)


def test_without_the_library_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mcap.writer", None)
    with refuses(UsageError, "pip install", "'mcap>="):
        check_target(tmp_path / "run.mcap")


# A recording whose process is killed at any time loses at most its last second; ten minutes of it are small.

CLOCK = MonotonicClock()
PROCESS = Path(__file__).parents[1] / "support" / "recording_process.py"
OURS = os.environ | {"PYTHONPATH": str(PROCESS.parents[2])}
LOST_S = 1.0


def kill_while_it_moves(path: Path, *, after: float) -> float:
    """Kill -9 so many seconds after it moves. Returns how much of what had happened is not in the file, s."""
    words = [sys.executable, str(PROCESS), str(path), "15"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=OURS) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "moves\n"
        CLOCK.sleep_until(CLOCK.now() + after)
        killed_ns = round(CLOCK.now() * 1e9) - wall_to_monotonic()
        process.kill()
    recording = read_recording(path)
    cycles = recording.cycles
    last = recording.topic(TICK).rows[-1]
    assert recording.damage and len(cycles) > 50 and cycles.index.tolist() == list(range(len(cycles)))
    return 1e-9 * (killed_ns - (int(last["stamp.sec"]) * 10**9 + int(last["stamp.nanosec"])))


def test_a_killed_run_is_there_but_for_the_last_second(tmp_path: Path) -> None:
    assert FLUSH_S <= 0.5
    assert kill_while_it_moves(tmp_path / "run.mcap", after=0.3) < LOST_S


@pytest.mark.long
def test_fifty_killed_runs_are_there_but_for_the_last_second(tmp_path: Path) -> None:
    times = random.Random(50)
    lost = [kill_while_it_moves(tmp_path / f"{run}.mcap", after=times.uniform(0.0, 2.0)) for run in range(50)]
    assert max(lost) < LOST_S, sorted(lost)[-5:]


@pytest.mark.long
def test_it_is_small_and_costs_little(tmp_path: Path) -> None:
    """In real time: bytes of ten minutes, and CPU of the thread that writes."""
    words = [sys.executable, str(PROCESS), str(tmp_path / "run.mcap"), "18"]
    said = subprocess.run(words, capture_output=True, text=True, check=True, timeout=120, env=OURS).stdout.split()
    percent, per_second = float(said[said.index("cpu") + 1]), float(said[said.index("bytes") - 1])
    assert percent < 2.0 and 600.0 * per_second < 60e6
