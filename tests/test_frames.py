"""Sensor frames: interpolation, cutting, mirroring and choosing of sensors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from retarget import rotations
from retarget.errors import UsageError
from retarget.frames import (
    ANKLE,
    HEAD_CENTRE,
    JOINTS,
    SENSORS,
    STEP_M,
    STEP_TURN,
    JointTracks,
    SensorFrames,
    SensorSample,
    Skeleton,
    along_arcs,
    locate,
    on_grid,
    stature,
)

RATE = 120.0
COUNT = 12


def make_frames(names: tuple[str, ...] = ("head", "l_wrist", "r_wrist"), seed: int = 0) -> SensorFrames:
    """Random tracks with one sensor lost in one frame."""
    generator = np.random.default_rng(seed)
    orientation = rotations.normalise(generator.normal(size=(COUNT, len(names), 4)))
    position = generator.normal(size=(COUNT, len(names), 3))
    valid = np.ones((COUNT, len(names)), bool)
    valid[5, 0] = False
    position[5, 0] = np.nan
    orientation[5, 0] = np.nan
    joints = JointTracks(("pelvis", "l_hip", "r_hip"), generator.normal(size=(COUNT, 3, 3)))
    skeleton = Skeleton(("pelvis", "l_hip", "r_hip"), np.array([[0.0, 0, 0], [0, 0.1, -0.1], [0, -0.1, -0.1]]))
    time = np.arange(COUNT) / RATE
    return SensorFrames(time, names, position, orientation, valid, joints, skeleton, "made here", RATE)


def test_default_sensors_come_first_and_all_sensors_but_none_else_are_joints() -> None:
    assert SENSORS[:5] == ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
    assert set(SENSORS) <= set(JOINTS)
    assert len(set(JOINTS)) == len(JOINTS) == 23


def test_at_a_frame_time_the_frame_comes_back_bit_for_bit() -> None:
    frames = make_frames()
    for i, time in enumerate(frames.time):
        sample = frames.sample(float(time))
        np.testing.assert_array_equal(sample.position, frames.position[i])
        np.testing.assert_array_equal(sample.orientation, frames.orientation[i])
        np.testing.assert_array_equal(sample.valid, frames.valid[i])
    again = frames.resample(frames.time)
    np.testing.assert_array_equal(again.position, frames.position)
    np.testing.assert_array_equal(again.orientation, frames.orientation)
    assert again.joints is not None and frames.joints is not None
    np.testing.assert_array_equal(again.joints.position, frames.joints.position)


def test_between_frames_positions_go_straight_and_orientations_along_the_arc() -> None:
    frames = make_frames()
    sample = frames.sample(float(0.25 * frames.time[1] + 0.75 * frames.time[2]))
    np.testing.assert_allclose(sample.position, 0.25 * frames.position[1] + 0.75 * frames.position[2], atol=1e-12)
    whole = rotations.angle_between(frames.orientation[1], frames.orientation[2])
    np.testing.assert_allclose(rotations.angle_between(frames.orientation[1], sample.orientation), 0.75 * whole)


def test_a_lost_frame_spoils_both_its_intervals_and_only_its_sensor() -> None:
    frames = make_frames()
    for time in (4.5 / RATE, 5.0 / RATE, 5.5 / RATE):
        sample = frames.sample(time)
        assert list(sample.valid) == [False, True, True]
        assert np.isnan(sample.position[0]).all() and np.isfinite(sample.position[1:]).all()
    assert frames.sample(6.0 / RATE).valid.all()


@given(rate=st.floats(1.0, 1000.0), seed=st.integers(0, 100))
def test_resampling_keeps_within_the_frames(rate: float, seed: int) -> None:
    frames = make_frames(seed=seed)
    time = np.arange(int(frames.duration_s * rate) + 1) / rate
    other = frames.resample(time)
    assert len(other) == len(time)
    good = other.valid
    assert np.all(np.isfinite(other.position[good])) and np.all(np.isnan(other.position[~good]))
    assert np.all(other.position[good] <= np.nanmax(frames.position) + 1e-12)
    np.testing.assert_allclose(np.linalg.norm(other.orientation[good], axis=-1), 1.0, atol=1e-12)


def test_cut_counts_time_from_zero_and_includes_both_ends() -> None:
    frames = make_frames()
    part = frames.cut(3 / RATE, 7 / RATE)
    assert len(part) == 5 and part.time[0] == 0.0
    np.testing.assert_array_equal(part.position, frames.position[3:8])
    assert part.joints is not None and len(part.joints.position) == 5
    assert len(frames.cut()) == COUNT
    assert len(frames.cut(end=2 / RATE)) == 3


def test_select_keeps_the_order_asked_and_names_the_nearest_for_an_unknown_sensor() -> None:
    frames = make_frames()
    assert frames.select(["r_wrist", "head"]).names == ("r_wrist", "head")
    np.testing.assert_array_equal(frames.select(["r_wrist"]).position[:, 0], frames.position[:, 2])
    with refuses(UsageError, "'l_wirst'", next_step="l_wrist"):
        frames.select(["l_wirst"])


def test_mirroring_twice_gives_the_motion_back() -> None:
    frames = make_frames()
    mirrored = frames.mirror()
    assert mirrored.names == frames.names
    np.testing.assert_array_equal(mirrored.position[:, 1], frames.position[:, 2] * [1, -1, 1])
    again = mirrored.mirror()
    np.testing.assert_array_equal(again.position, frames.position)
    np.testing.assert_array_equal(again.orientation, frames.orientation)
    assert again.joints is not None and frames.joints is not None
    np.testing.assert_array_equal(again.joints.position, frames.joints.position)


def test_mirrored_orientations_are_the_mirror_images() -> None:
    frames = make_frames()
    reflection = np.diag([1.0, -1.0, 1.0])
    expected = reflection @ rotations.to_matrix(frames.orientation[0, 1]) @ reflection
    actual = rotations.to_matrix(frames.mirror().orientation[0, 2])
    np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_arrays_are_read_only_and_the_callers_are_left_alone() -> None:
    frames = make_frames()
    with pytest.raises(ValueError, match="read-only"):
        frames.position[0, 0, 0] = 1.0
    mine = np.zeros((COUNT, 3, 3))
    assert not replace(frames, position=mine).position.flags.writeable
    mine[0] = 1.0


def test_shapes_that_do_not_fit_are_programmer_errors() -> None:
    frames = make_frames()
    with refuses(AssertionError):
        replace(frames, position=np.zeros((COUNT, 2, 3)))
    with refuses(AssertionError):
        replace(frames, time=np.zeros(COUNT))


CLOCK = np.array([0.0, 0.1, 0.3, 0.35])


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=20))
def test_any_time_has_a_share_below_one(times: list[float]) -> None:
    at = locate(CLOCK, np.array(times))
    assert np.all((at.share >= 0.0) & (at.share < 1.0)) and np.all(at.after < len(CLOCK))
    held = np.clip(times, CLOCK[0], CLOCK[-1])
    np.testing.assert_allclose(CLOCK[at.before] + at.share * (CLOCK[at.after] - CLOCK[at.before]), held, atol=1e-9)


def test_orientations_take_the_short_arc() -> None:
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], np.array([0.0, 0.2, 0.6, 0.8]))[:, None]
    turn[2] *= -1.0
    half = along_arcs(turn, locate(CLOCK, np.array([0.2])))
    np.testing.assert_allclose(np.abs(rotations.log(half[0, 0])), [0.0, 0.0, 0.4], atol=1e-12)


def sample(count: int = 500) -> SensorSample:
    random = np.random.default_rng(7)
    turn = random.normal(size=(count, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    names = tuple(str(number) for number in range(count))
    return SensorSample(names, random.uniform(-3.0, 3.0, (count, 3)), turn, np.ones(count, dtype=bool))


def test_nothing_moves_by_more_than_half_a_step_and_only_once() -> None:
    before = sample()
    before.position[3], before.orientation[5] = np.nan, np.nan
    after = on_grid(before)
    assert np.nanmax(np.abs(after.position - before.position)) <= STEP_M / 2
    assert np.nanmax(np.abs(after.orientation - before.orientation)) <= STEP_TURN / 2
    assert np.nanmax(np.abs(np.linalg.norm(after.orientation, axis=1) - 1.0)) < 5e-7
    assert np.isnan(after.position[3]).all() and np.isnan(after.orientation[5]).all()
    again = on_grid(after)
    np.testing.assert_array_equal(again.position, after.position)
    np.testing.assert_array_equal(again.orientation, after.orientation)


NAMES = ("l_hip", "r_hip", "l_knee", "l_ankle", "chest", "neck", "head")


def body(spread: float) -> Skeleton:
    """A body of 1.8 (proportions of Drillis and Contini) with its legs spread (rad) in the rest pose."""
    down = np.array([0.0, np.sin(spread), -np.cos(spread)])
    hip = np.array([0.0, 0.1, 0.0])
    knee = hip + 0.245 * 1.8 * down
    heights = np.array([0.65, 0.82, HEAD_CENTRE]) - ANKLE - 0.491
    trunk = np.outer(heights * 1.8, [0.0, 0.0, 1.0])
    return Skeleton(NAMES, np.stack([hip, -hip, knee, knee + 0.246 * 1.8 * down, *trunk]))


def test_a_missing_chest_is_left_out_and_a_missing_leg_is_not() -> None:
    whole = body(0.2)
    without = [i for i, name in enumerate(NAMES) if name != "chest"]
    assert stature(Skeleton(tuple(NAMES[i] for i in without), whole.position[without])) == pytest.approx(1.8)
    assert stature(Skeleton(NAMES[1:], whole.position[1:])) is None
