"""The synthetic performer: a plausible human whose feet stay where they are."""

from itertools import pairwise

import numpy as np
import pytest

from retarget import rotations
from retarget.frames import JOINTS, SENSORS, JointTracks, SensorFrames, Skeleton
from retarget.rotations import FloatArray
from sim.performer import CYCLES, minimum_jerk, synthetic_performer

SEEDS = range(8)

BONES = [
    *pairwise(("pelvis", "spine", "chest", "neck", "head")),
    *(
        (f"{side}_{a}", f"{side}_{b}")
        for side in "lr"
        for a, b in [
            *pairwise(("collar", "shoulder", "elbow", "wrist", "hand")),
            *pairwise(("hip", "knee", "ankle", "toe")),
        ]
    ),
    ("chest", "l_collar"),
    ("pelvis", "r_hip"),
]


def parts(frames: SensorFrames) -> tuple[JointTracks, Skeleton]:
    assert frames.joints is not None and frames.skeleton is not None
    return frames.joints, frames.skeleton


def extremes(track: FloatArray, *, highest: bool, beyond: float) -> list[int]:
    """Frames of the local maxima (or minima) beyond a height."""
    signed = track if highest else -track
    limit = beyond if highest else -beyond
    inner = (signed[1:-1] > signed[:-2]) & (signed[1:-1] >= signed[2:]) & (signed[1:-1] > limit)
    return [int(i) + 1 for i in np.flatnonzero(inner)]


def test_it_yields_every_sensor_and_every_joint() -> None:
    frames = synthetic_performer()
    joints, skeleton = parts(frames)
    assert frames.names == SENSORS and joints.names == skeleton.names == JOINTS
    assert frames.valid.all() and np.isfinite(frames.position).all() and np.isfinite(joints.position).all()
    assert 17.5 < frames.duration_s < 19.0 and frames.rate_hz == 120.0
    for name in SENSORS:
        np.testing.assert_array_equal(frames.position[:, frames.index(name)], joints.of(name))


@pytest.mark.parametrize("seed", SEEDS)
def test_cycles_are_those_of_the_recording(seed: int) -> None:
    frames = synthetic_performer(seed)
    pelvis, hand = frames.position[:, frames.index("pelvis"), 2], parts(frames)[0].of("r_hand")[:, 2]
    crouches = extremes(pelvis, highest=False, beyond=0.7)
    reaches = extremes(hand, highest=True, beyond=1.5)
    assert len(crouches) == len(reaches) == CYCLES
    assert np.all((pelvis[crouches] > 0.54) & (pelvis[crouches] < 0.60))
    assert np.all((pelvis.max() - pelvis[crouches] > 0.37) & (pelvis.max() - pelvis[crouches] < 0.43))
    assert np.all((hand[reaches] > 1.88) & (hand[reaches] < 1.95))
    assert np.all(np.abs(np.diff(crouches) - 328) < 15)
    assert np.all(np.abs(np.array(crouches) - [146, 475, 802, 1128, 1462, 1782]) < 15)
    assert np.all(np.abs(np.array(reaches) - [297, 626, 949, 1279, 1605, 1928]) < 15)


@pytest.mark.parametrize("seed", SEEDS)
def test_bone_lengths_are_constant_and_those_of_the_skeleton(seed: int) -> None:
    joints, skeleton = parts(synthetic_performer(seed))
    for a, b in BONES:
        length = np.linalg.norm(joints.of(a) - joints.of(b), axis=1)
        np.testing.assert_allclose(length, skeleton.distance(a, b), atol=1e-12, err_msg=f"{a} to {b}")


@pytest.mark.parametrize("seed", SEEDS)
def test_feet_are_planted(seed: int) -> None:
    joints = parts(synthetic_performer(seed))[0]
    for name in ("l_ankle", "r_ankle", "l_toe", "r_toe"):
        assert np.ptp(joints.of(name), axis=0).max() == 0.0
        assert 0.0 < joints.of(name)[0, 2] < 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_speeds_and_accelerations_are_human_and_there_is_no_jump(seed: int) -> None:
    frames = synthetic_performer(seed)
    velocity = np.diff(frames.position, axis=0) * frames.rate_hz
    acceleration = np.diff(velocity, axis=0) * frames.rate_hz
    jerk = np.diff(acceleration, axis=0) * frames.rate_hz
    assert np.linalg.norm(velocity, axis=-1).max() < 4.0
    assert np.linalg.norm(acceleration, axis=-1).max() < 15.0
    assert np.linalg.norm(jerk, axis=-1).max() < 150.0  # a step in acceleration would show as thousands
    turn = rotations.angle_between(frames.orientation[:-1], frames.orientation[1:]) * frames.rate_hz
    assert np.degrees(turn.max()) < 400.0


@pytest.mark.parametrize("seed", SEEDS)
def test_joints_bend_as_a_human_can(seed: int) -> None:
    frames = synthetic_performer(seed)
    joints = parts(frames)[0]
    for side in "lr":
        for a, b, c, most in (("hip", "knee", "ankle", 140.0), ("shoulder", "elbow", "wrist", 150.0)):
            first, middle, last = (joints.of(f"{side}_{name}") for name in (a, b, c))
            upper, lower = middle - first, last - middle
            cosine = np.sum(upper * lower, axis=1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
            bend = np.degrees(np.arccos(cosine))
            assert bend.min() > 2.0 and bend.max() < most
        assert np.all(joints.of(f"{side}_knee")[:, 0] > joints.of(f"{side}_ankle")[:, 0]), "knees point forward"
    low = np.argmin(frames.position[:, frames.index("pelvis"), 2])
    lean = joints.of("neck")[low] - joints.of("pelvis")[low]
    assert np.degrees(np.arctan2(lean[0], lean[2])) > 30.0, "the trunk bends"
    assert np.ptp(joints.of("l_wrist"), axis=0).max() > 0.3 and np.ptp(joints.of("r_wrist"), axis=0).max() > 0.3


def test_orientations_turn_the_rest_pose_into_the_posture() -> None:
    frames = synthetic_performer()
    joints, skeleton = parts(frames)
    segments = [
        ("elbow", "wrist"),
        ("shoulder", "elbow"),
        ("wrist", "hand"),
        ("hip", "knee"),
        ("knee", "ankle"),
        ("ankle", "toe"),
    ]
    for a, b in [(f"{side}_{a}", f"{side}_{b}") for side in "lr" for a, b in segments] + [
        ("pelvis", "spine"),
        ("pelvis", "l_hip"),
    ]:
        bone = skeleton.of(b) - skeleton.of(a)
        turned = joints.of(a) + rotations.rotate(frames.orientation[:, frames.index(a)], bone)
        np.testing.assert_allclose(turned, joints.of(b), atol=1e-12)


def test_a_seed_gives_the_same_bits_and_another_seed_another_motion() -> None:
    first, again, other = synthetic_performer(3), synthetic_performer(3), synthetic_performer(4)
    np.testing.assert_array_equal(first.position, again.position)
    assert np.abs(first.position - other.position).max() > 0.005


def test_any_rate_shows_the_same_motion() -> None:
    slow, fast = synthetic_performer(rate_hz=30.0), synthetic_performer(rate_hz=240.0)
    np.testing.assert_allclose(slow.position, fast.position[::8][: len(slow)], atol=1e-12)


def test_minimum_jerk_rests_at_its_keys_and_holds_outside() -> None:
    time = np.linspace(-1.0, 3.0, 4001)
    path = minimum_jerk(time, np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.5]))
    assert path[0] == 0.0 and path[-1] == 0.5
    speed = np.gradient(path, time)
    acceleration = np.gradient(speed, time)
    for key in (1000, 2000, 3000):
        assert abs(speed[key]) < 1e-4 and abs(acceleration[key]) < 0.1
    assert np.abs(np.diff(acceleration)).max() < 0.1
