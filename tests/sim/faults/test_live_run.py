"""A live performer through the whole pipeline on virtual time: followed, held, left out, without any jump.

What a row of the fault table also runs, and judges by its bytes, is marked `long` here.
"""

from dataclasses import replace

import numpy as np
import pytest

from hardware.guard_state import StopCause
from live_rig import LiveRig
from messages import refuses, shows
from retarget.errors import InputError
from retarget.live.begin import LiveOptions
from retarget.report.measure import measure
from retarget.run.run_result import RunResult
from retarget.types import FloatArray, RunState
from sim.faults.sender import STILL_S, FakeSender, frozen, lost, moved, silent, swapped


def run(rig: LiveRig) -> RunResult:
    with rig.prepared() as prepared:
        return prepared.run()


def check_motion(result: RunResult) -> None:
    """Inside every limit, whatever the sender did."""
    assert result.robot is not None and result.record.robot is not None
    violations = measure(result).limit_violations
    assert (violations.position, violations.velocity, violations.acceleration) == (0, 0, 0)


def test_a_performer_is_followed_and_the_robot_goes_to_rest() -> None:
    rig = LiveRig(FakeSender())
    result = run(rig)
    check_motion(result)
    report = measure(result)
    assert any("m tall" in text for text in rig.said)
    shows(rig.said)
    assert report.tracking_mm["l_hand"].mean < 25.0 and report.hand_path_ratio is not None
    assert result.stop is None and not rig.bus.torque_on
    robot, sent = result.robot, result.record.robot
    assert robot is not None and sent is not None
    rest = robot.posture(robot.profile.postures.rest)
    np.testing.assert_allclose(sent.q[-1, robot.servo_columns], rest[robot.servo_columns], atol=1e-6)


@pytest.mark.long
def test_a_silent_stream_is_held_and_followed_again() -> None:
    rig = LiveRig(FakeSender(faults=[silent(5.0, 6.0)]), options=LiveOptions(countdown=0.5, duration=5.5))
    result = run(rig)
    check_motion(result)
    assert rig.said.count("the performer is not followed: the robot holds") == 1
    assert rig.said.count("the performer is followed") == 2
    assert result.stop is None


@pytest.mark.long
def test_a_stream_that_stays_silent_ends_in_a_stop_and_torque_off() -> None:
    rig = LiveRig(FakeSender(faults=[silent(5.0, 99.0)]), options=LiveOptions(countdown=0.5, duration=12.0))
    result = run(rig)
    check_motion(result)
    assert result.stop is not None and result.stop.cause is StopCause.STALE_GOAL
    assert result.state == RunState.OFF.value and not rig.bus.torque_on


@pytest.mark.long
@pytest.mark.parametrize("fault", [lost("l_wrist", 5.0, 6.5), frozen("l_wrist", 5.0, 6.5)])
def test_a_wrist_that_is_lost_is_left_out_and_comes_back(fault: object) -> None:
    rig = LiveRig(FakeSender(faults=[fault]), options=LiveOptions(countdown=0.5, duration=6.0))  # type: ignore[list-item]
    result = run(rig)
    check_motion(result)
    assert rig.said.count("the performer is not followed: the robot holds") == 0
    assert any(text.startswith("l_wrist") for text in rig.said)


@pytest.mark.long
def test_a_foot_that_is_lost_is_held() -> None:
    rig = LiveRig(FakeSender(faults=[lost("l_ankle", 5.0, 6.5)]), options=LiveOptions(countdown=0.5, duration=6.0))
    result = run(rig)
    check_motion(result)
    assert rig.said.count("the performer is not followed: the robot holds") == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "fault", [moved("r_wrist", 5.0, 8.0, (0.0, 0.0, 0.8)), swapped("l_wrist", "r_wrist", 5.0, 8.0)]
)
def test_a_jump_is_held_and_reported(fault: object) -> None:
    rig = LiveRig(FakeSender(faults=[fault]), options=LiveOptions(countdown=0.5, duration=4.5))  # type: ignore[list-item]
    result = run(rig)
    check_motion(result)
    shows(rig.said)
    assert any("wrist" in text and "jumped" in text for text in rig.said)


@pytest.mark.parametrize("part", [pytest.param("wrist", marks=pytest.mark.long), "ankle"])
def test_sides_that_are_swapped_are_held_and_then_followed_by_a_blend(part: str) -> None:
    rig = LiveRig(
        FakeSender(faults=[swapped(f"l_{part}", f"r_{part}", 5.0, 99.0)]),
        options=LiveOptions(countdown=0.5, duration=6.0),
    )
    result = run(rig)
    check_motion(result)
    assert rig.said.count("the performer is not followed: the robot holds") == 1
    shows(rig.said, f"l_{part}, r_{part}", "jumped")
    assert result.stop is None


@pytest.mark.long
def test_clocks_that_jump_are_followed_again() -> None:
    sender = FakeSender()
    sender.stamp = lambda time: time + (5000.0 if time > STILL_S + 3.0 else 1000.0)
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=5.5))
    result = run(rig)
    check_motion(result)
    notes = [text for text in rig.said if "clock jumped" not in text]
    assert notes[-1] == "the performer is followed" and result.stop is None
    assert [text for text in rig.said if text not in notes] == ["the sender's clock jumped forward by 4000.00 s"]


def test_nothing_arrives() -> None:
    rig = LiveRig(FakeSender(faults=[silent(0.0, 99.0)]), options=LiveOptions(patience=2.0))
    with refuses(InputError, 2, where="json://:7000"):
        run(rig)


def test_a_sensor_that_is_missing_in_the_stream_is_named() -> None:
    rig = LiveRig(FakeSender(faults=[lost("head", 0.0, 99.0)]), options=LiveOptions(patience=2.0))
    with refuses(InputError, found="head"):
        run(rig)


def test_a_performer_who_does_not_stand_still_is_not_measured() -> None:
    def dancing(time: float, poses: dict[str, FloatArray]) -> dict[str, FloatArray]:
        aside = np.array([0.0, 0.1 * np.sin(9.0 * time), 0.0])
        return {name: at + aside for name, at in poses.items()}

    rig = LiveRig(FakeSender(faults=[dancing]), options=LiveOptions(countdown=0.5, patience=2.0))
    with refuses(InputError):
        run(rig)


def test_the_human_alone_is_followed_too() -> None:
    rig = LiveRig(FakeSender(), robot="human", options=LiveOptions(countdown=0.5, duration=2.0))
    result = run(rig)
    assert result.robot is None and result.ticks_followed == 200
    assert measure(result).tracking_mm["head"].mean < 60.0


def test_mirrored_left_is_right() -> None:
    options = LiveOptions(countdown=0.5, duration=3.0)
    plain, mirrored = (
        run(LiveRig(FakeSender(), robot="human", options=replace(options, mirror=mirror))) for mirror in (False, True)
    )
    names = plain.clip.frames.names
    left, right = names.index("l_wrist"), names.index("r_wrist")
    rows = slice(200, 350)
    flipped = mirrored.clip.frames.position[rows, right] * [1.0, -1.0, 1.0]
    assert np.abs(plain.clip.frames.position[rows, left] - flipped).max() < 0.03
