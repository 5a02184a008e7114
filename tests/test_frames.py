"""Sensor frames: interpolation, cutting, mirroring and choosing of sensors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget import rotations
from retarget.errors import UsageError
from retarget.frames import JOINTS, SENSORS, JointTracks, SensorFrames, Skeleton, mirrored_name
from support.messages import refuses

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


def test_rounding_of_the_clock_does_not_drag_a_lost_neighbour_in() -> None:
    frames = make_frames()
    for nudge in (-1e-14, 1e-14):
        sample = frames.sample(float(frames.time[4]) + nudge)
        assert sample.valid.all()
        np.testing.assert_array_equal(sample.position, frames.position[4])


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


def test_outside_the_recording_its_ends_are_held() -> None:
    frames = make_frames()
    np.testing.assert_array_equal(frames.sample(-1.0).position, frames.position[0])
    np.testing.assert_array_equal(frames.sample(99.0).position, frames.position[-1])


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


def test_a_single_frame_can_be_sampled_anywhere() -> None:
    frames = make_frames().cut(0.0, 0.0)
    assert len(frames) == 1 and frames.duration_s == 0.0
    np.testing.assert_array_equal(frames.sample(3.0).position, frames.position[0])
    assert frames.resample([0.0]).rate_hz == RATE


def test_cut_counts_time_from_zero_and_includes_both_ends() -> None:
    frames = make_frames()
    part = frames.cut(3 / RATE, 7 / RATE)
    assert len(part) == 5 and part.time[0] == 0.0
    np.testing.assert_array_equal(part.position, frames.position[3:8])
    assert part.joints is not None and len(part.joints.position) == 5
    assert len(frames.cut()) == COUNT
    assert len(frames.cut(end=2 / RATE)) == 3


@pytest.mark.parametrize(("start", "end"), [(0.05, 0.01), (9.0, 10.0), (float("nan"), None), (0.0001, 0.0002)])
def test_a_cut_that_encloses_nothing_is_refused(start: float, end: float | None) -> None:
    with refuses(UsageError):
        make_frames().cut(start, end)


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


def test_mirroring_one_side_alone_renames_it() -> None:
    assert make_frames(("head", "l_wrist")).mirror().names == ("head", "r_wrist")
    assert [mirrored_name(name) for name in ("l_toe", "r_toe", "chest")] == ["r_toe", "l_toe", "chest"]


def test_joints_and_skeleton_are_looked_up_by_name() -> None:
    frames = make_frames()
    assert frames.joints is not None and frames.skeleton is not None
    np.testing.assert_array_equal(frames.joints.of("l_hip"), frames.joints.position[:, 1])
    assert frames.skeleton.distance("l_hip", "r_hip") == pytest.approx(0.2)
    with refuses(UsageError):
        frames.joints.of("tail")


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
