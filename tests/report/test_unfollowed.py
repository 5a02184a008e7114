"""Postures that a robot on planted soles cannot take are named with their times, and all others are not."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.physics_runs import play
from hardware.clock import PacedClock, VirtualClock
from messages import shows
from retarget.cli.exit import StopRequest
from retarget.cli.run import CommandRun
from retarget.frames import JointTracks, SensorFrames
from retarget.ik.gravity_torque import GRAVITY
from retarget.pictures.outputs import Outputs
from retarget.report.findings import NOT_FOLLOWED, findings
from retarget.report.measure import measure
from retarget.report.report import Unfollowed
from retarget.report.tracking import reference_of
from retarget.report.unfollowed import (
    INSTEAD,
    JUMPS,
    KNEELS,
    ON_FLOOR,
    SHOWING_JOINTS,
    UnfollowedNotice,
    unfollowed,
    unfollowed_of,
)
from retarget.rotations import from_axis_angle, multiply, rotate
from retarget.run import prepare
from retarget.run.options import RunOptions
from retarget.run.run_result import RunResult
from retarget.types import FloatArray
from rig import scripted_run
from sim.performer import SHANK, THIGH, minimum_jerk, synthetic_performer

RATE_HZ = 60.0
DT = 1.0 / RATE_HZ
KEYS_S = np.array([0.5, 1.1, 2.1, 2.7])
"""When the performer begins to get down, is down, begins to rise and stands again, s."""
LEG = ("knee", "ankle", "toe")


def shares() -> tuple[FloatArray, FloatArray]:
    """Time (T,) s, and how far (T,) the performer has got into the posture."""
    time = np.arange(round(3.2 * RATE_HZ)) / RATE_HZ
    return time, minimum_jerk(time, KEYS_S, np.array([0.0, 1.0, 1.0, 0.0]))


def posed(*, shank: float = 0.0, thigh: float = 0.0, lean: float = 0.0, lift: FloatArray | float = 0.0) -> SensorFrames:
    """A performer whose feet stay while shanks tilt forward, thighs and trunk backward, by so many degrees.

    lift (T,) m: of the whole body.
    """
    time, share = shares()
    frames = synthetic_performer(rate_hz=RATE_HZ).cut(0.0, 0.5)
    assert frames.joints is not None
    names = frames.joints.names
    body = np.repeat(frames.joints.position[:1], len(time), axis=0)
    forward, back, folded = (np.radians(angle) * share for angle in (shank, thigh, lean))
    zero, before = np.zeros_like(share), body[0].copy()
    hips = 0.5 * (body[:, names.index("l_hip")] + body[:, names.index("r_hip")])
    stood, moved = {}, np.zeros_like(hips)
    for side in "lr":
        hip, knee, ankle = (names.index(f"{side}_{part}") for part in ("hip", "knee", "ankle"))
        stood[side] = body[:, hip].copy()
        body[:, knee] = body[:, ankle] + SHANK * np.stack([np.sin(forward), zero, np.cos(forward)], axis=1)
        body[:, hip] = body[:, knee] + THIGH * np.stack([-np.sin(back), zero, np.cos(back)], axis=1)
        moved += 0.5 * (body[:, hip] - stood[side])
    turn = from_axis_angle(np.array([0.0, -1.0, 0.0]), folded)
    trunk = [column for column, name in enumerate(names) if name[2:] not in (*LEG, "hip")]
    body[:, trunk] = (
        hips[:, None]
        + moved[:, None]
        + rotate(turn[:, None], np.broadcast_to(before, body.shape)[:, trunk] - hips[:, None])
    )
    body[..., 2] += np.broadcast_to(lift, time.shape)[:, None]
    orientation = np.repeat(frames.orientation[:1], len(time), axis=0)
    for column, name in enumerate(frames.names):
        if name[2:] not in LEG:
            orientation[:, column] = multiply(turn, orientation[:, column])
    return replace(
        frames,
        time=time,
        position=body[:, [names.index(name) for name in frames.names]],
        orientation=orientation,
        valid=np.ones((len(time), len(frames.names)), bool),
        joints=JointTracks(names, body),
    )


def flight() -> FloatArray:
    """Height (T,) m of a jump of 0.6 s that begins at 1.2 s."""
    since = np.clip(shares()[0] - 1.2, 0.0, 0.6)
    return np.asarray(0.5 * GRAVITY * since * (0.6 - since))


def walking() -> SensorFrames:
    """A walk of 1.2 m/s, in steps of 0.5 s whose ankles rise by 0.2 m and toes by 0.1 m."""
    frames, time = posed(shank=0.0, thigh=0.0), shares()[0]
    assert frames.joints is not None
    names, body = frames.joints.names, frames.joints.position.copy()
    body[..., 0] += 1.2 * time[:, None]
    for side, phase in (("l", 0.0), ("r", np.pi)):
        up = np.clip(np.sin(2.0 * np.pi * time + phase), 0.0, None)
        for part, height in (("knee", 0.1), ("ankle", 0.2), ("toe", 0.1)):
            body[:, names.index(f"{side}_{part}"), 2] += height * up
    return replace(frames, joints=JointTracks(names, body))


CLIPS: dict[str, Callable[[], SensorFrames]] = {
    "stands": posed,
    "squats": lambda: posed(shank=35.0, thigh=110.0, lean=-30.0),
    "kneels": lambda: posed(shank=90.0),
    "is on all fours": lambda: posed(shank=90.0, lean=-85.0),
    "sits on the heels": lambda: posed(shank=90.0, thigh=70.0),
    "sits": lambda: posed(shank=-90.0, thigh=90.0),
    "lies": lambda: posed(shank=-90.0, thigh=90.0, lean=85.0),
    "jumps": lambda: posed(lift=flight()),
    "is held up": lambda: posed(lift=np.where(flight() > 0.0, 0.2, 0.0)),  # for as long as a jump
    "stands on a box": lambda: posed(lift=0.3 * shares()[1]),
    "walks": walking,
}


@cache
def clip(name: str) -> SensorFrames:
    return CLIPS[name]()


def named(frames: SensorFrames, dt: float = DT) -> list[tuple[str, int, int]]:
    assert frames.joints is not None
    columns = [frames.joints.names.index(name) for name in SHOWING_JOINTS]
    return list(unfollowed(frames.joints.position[:, columns], THIGH + SHANK, dt))


@pytest.mark.parametrize(
    ("name", "what"), [("kneels", KNEELS), ("sits on the heels", KNEELS), ("sits", ON_FLOOR), ("lies", ON_FLOOR)]
)
def test_a_posture_on_the_floor_is_named_while_it_lasts(name: str, what: str) -> None:
    ((found, first, last),) = [one for one in named(clip(name)) if one[0] == what]
    assert found == what
    assert KEYS_S[0] + 0.2 < first * DT <= KEYS_S[1] and KEYS_S[2] <= last * DT < KEYS_S[3] - 0.2


def test_a_jump_is_named_while_both_feet_are_off_the_floor() -> None:
    ((what, first, last),) = named(clip("jumps"))
    assert what == JUMPS
    assert first * DT == pytest.approx(1.2, abs=0.04) and last * DT == pytest.approx(1.8, abs=0.04)


@pytest.mark.parametrize("name", ["stands", "squats", "walks", "stands on a box", "is held up", "is on all fours"])
def test_what_a_robot_can_follow_is_not_named(name: str) -> None:
    assert named(clip(name)) == []


def test_a_kneel_for_a_moment_is_not_named() -> None:
    assert named(clip("kneels"), dt=DT / 6.0) == []


def test_neither_a_short_break_nor_another_height_of_the_floor_changes_a_posture() -> None:
    frames = clip("kneels")
    assert frames.joints is not None
    body, neck = frames.joints.position.copy(), frames.joints.names.index("neck")
    body[round(1.6 * RATE_HZ) :][:12, neck] = np.nan
    broken, sunk = replace(frames, joints=JointTracks(frames.joints.names, body)), posed(shank=90.0, lift=-0.4)
    assert named(broken) == named(sunk) == named(frames)


def followed(name: str, *, parts: str = "whole", performer: str = "five") -> RunResult:
    options = RunOptions(robot="op3", performer=performer, parts="upper" if parts == "upper" else "whole")
    return play(clip(name), options)


def said(run: RunResult) -> list[str]:
    return [finding.measured for finding in findings(run, measure(run)) if finding.name == NOT_FOLLOWED]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("kneels", "the performer kneels from 0.9 to 2.3 s: the robot squats instead"),
        ("jumps", "the performer jumps from 1.2 to 1.8 s: the robot stays on its soles instead"),
        pytest.param("squats", "", marks=pytest.mark.long),
        pytest.param("walks", "", marks=pytest.mark.long),
    ],
)
def test_a_run_says_when_and_what_the_robot_does_instead(name: str, words: str) -> None:
    run = followed(name)
    assert said(run) == ([words] if words else [])
    asked = reference_of(run)
    assert unfollowed_of(run, asked) == measure(run).unfollowed is not None
    assert run.robot is not None
    hung = replace(run.robot, profile=run.robot.profile.model_copy(update={"root": "suspended"}))
    assert unfollowed_of(replace(run, robot=hung), asked) is None


@pytest.mark.long
def test_sensors_on_pelvis_and_knees_know_a_kneel_of_a_body_that_is_not_recorded() -> None:
    run = followed("kneels", performer="ten")
    frames = replace(run.clip.frames, joints=None)
    (found,) = measure(replace(run, clip=replace(run.clip, frames=frames))).unfollowed or ()
    assert found.what == KNEELS and found.from_s == pytest.approx(0.9, abs=0.15)


def noticed(run: RunResult) -> list[tuple[float, str]]:
    """What is named while the rows of a run are filled, with the time of the row, s."""
    texts, found = list[str](), list[tuple[float, str]]()
    notice = UnfollowedNotice(run.human.dimensions, dt=run.clip.motion_dt, notify=texts.append)
    for row, time in enumerate(run.record.time.tolist()):
        notice(run.record, row)
        found += [(time, text) for text in texts[len(found) :]]
    return found


@pytest.mark.parametrize(
    ("name", "performer", "what", "from_s", "to_s"),
    [("kneels", "six", KNEELS, 1.0, 1.5), ("kneels", "ten", KNEELS, 1.0, 1.5), ("jumps", "five", JUMPS, 1.7, 2.0)],
)
def test_a_kneel_is_named_while_it_lasts_with_a_sensor_on_the_pelvis_and_a_jump_as_it_is_over(
    name: str, performer: str, what: str, from_s: float, to_s: float
) -> None:
    ((at, words),) = noticed(followed(name, performer=performer))
    shows(words, what, INSTEAD[what])
    assert from_s < at < to_s


@pytest.mark.long
def test_nothing_is_named_while_the_robot_can_follow() -> None:
    assert noticed(followed("squats")) == noticed(followed("walks")) == []


def test_a_posture_that_comes_again_and_again_is_named_once() -> None:
    run = followed("jumps")
    rows = run.record.following
    said: list[str] = []
    notice = UnfollowedNotice(run.human.dimensions, dt=run.clip.motion_dt, notify=said.append)
    for _ in range(3):
        for row in range(rows.start, rows.stop):
            notice(run.record, row)
    assert len(said) == 1


def test_a_run_that_is_watched_names_it_on_the_terminal() -> None:
    options, said = RunOptions(robot="op3", performer="six"), list[str]()
    command = CommandRun(options, Outputs(), recorded=True)
    command.clock, command.notify = PacedClock(wall=VirtualClock()), said.append
    perform = prepare.performance_of(lambda: clip("kneels"), options.playback)
    with command.prepared(perform) as prepared, command.viewing(prepared) as page:
        command.play(prepared, command.operator(prepared, StopRequest()), page)
    (words,) = [text for text in said if KNEELS in text]
    shows(words, INSTEAD[KNEELS])


def test_nothing_is_said_of_legs_that_are_kept_still() -> None:
    assert measure(followed("kneels", parts="upper")).unfollowed is None


def test_many_times_are_counted() -> None:
    run = scripted_run()
    times = tuple(Unfollowed(JUMPS, 1.0 * start, 1.0 * start + 0.4) for start in range(5))
    (found,) = [one for one in findings(run, replace(measure(run), unfollowed=times)) if one.name == NOT_FOLLOWED]
    assert found.measured == (
        "the performer jumps from 0.0 to 0.4 s, from 1.0 to 1.4 s, from 2.0 to 2.4 s, 2 more times: "
        + "the robot stays on its soles instead"
    )
