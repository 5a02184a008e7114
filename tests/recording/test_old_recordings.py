"""Recordings of an earlier version are read, and replay to the tick with the robot that they hold."""

from pathlib import Path
from typing import NamedTuple

import pytest

from hardware.guard_state import StopCause
from messages import refuses
from retarget.errors import UsageError
from retarget.recording.reading import read_recording
from retarget.recording.replay import replay

FIXTURES = Path(__file__).parent / "fixtures"
"""Made once, by the version of then: they are never remade."""


class Old(NamedTuple):
    """A recording. cycles, sensors: messages of `/tick` and of `/sensors`. goals: what was sent; of a human alone:
    postures. state: the last of the run. cause, reason: of the stop, the reason in part. planned: a robot followed,
    whose goals are planned otherwise today."""

    robot: str
    bus: str
    cycles: int
    sensors: int
    goals: int
    state: str | None
    cause: StopCause | None = None
    reason: str = ""
    planned: bool = True


RECORDINGS = {
    # Today's goals go back to the stance for longer than was recorded.
    "op3_to_rest": Old("op3", "mock", 889, 52, 888, "fault", StopCause.REQUESTED, "torque off before the robot stood"),
    "human_alone": Old("human", "none", 46, 46, 46, None, planned=False),
    "poppy_physics": Old("poppy", "physics", 505, 52, 504, "off"),
    "toddlerbot_upper_at_wall": Old("toddlerbot", "mock", 350, 62, 350, "standing"),
    "emulator_lost_and_hot": Old("op3", "emulator", 364, 1, 363, "fault", StopCause.LIMB_LOST, "OVERHEATING"),
    "live_hold": Old("op3", "mock", 745, 191, 744, "fault", StopCause.REQUESTED, "torque off"),
    "live_paused": Old(
        "op3", "mock", 1766, 72, 1765, "fault", StopCause.REQUESTED, "torque off before the robot stood"
    ),
    "stop_then_torque_off": Old("op3", "mock", 543, 45, 542, "fault", StopCause.REQUESTED, "stopped, as recorded"),
    "stop_from_outside": Old("op3", "mock", 186, 1, 185, "fault", StopCause.FALLEN, "fallen: over a wire"),
    "bus_read_fails": Old("op3", "mock", 441, 43, 440, "fault", StopCause.BUS, "no answer from any servo"),
    "bus_write_fails": Old("op3", "mock", 171, 1, 171, "fault", StopCause.BUS, "the port takes no data"),
    "killed": Old("op3", "mock", 450, 53, 450, "fault", StopCause.REQUESTED, "torque off"),
}


@pytest.mark.parametrize("name", RECORDINGS)
def test_an_old_recording_is_read_and_replays_to_its_end(name: str) -> None:
    recording, old = read_recording(FIXTURES / f"{name}.mcap"), RECORDINGS[name]
    session, cut_off = recording.session, name == "killed"
    cycles, sensors = (len(recording.topic(topic).rows) for topic in ("/tick", "/sensors"))
    assert (session.robot, session.bus, cycles, sensors) == old[:4]
    assert bool(recording.damage) == cut_off

    # Every config file is taken from the recording, so a shipped robot may change.
    assert not any(Path(file.path).exists() for file in session.files)

    again = replay(recording)
    difference, result = again.difference, again.result
    assert difference.compared == old.goals and (old.planned or difference.none), difference.lines()
    assert difference.whole != cut_off
    assert result.state == old.state
    assert (None if result.stop is None else result.stop.cause) == old.cause
    assert old.reason in (result.reason or "")


def test_steps_in_place_are_read_and_cannot_be_replayed() -> None:
    """Robots walk instead since 0.2."""
    recording = read_recording(FIXTURES / "one_step.mcap")
    assert recording.session.steps == "shift" and len(recording.topic("/tick").rows) == 655
    with refuses(UsageError, "--steps", "shift", "planted, walk, follow"):
        replay(recording)


def test_all_recordings_are_tried() -> None:
    assert {path.stem for path in FIXTURES.iterdir()} == {*RECORDINGS, "one_step"}
