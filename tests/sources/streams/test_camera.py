"""A camera's landmarks become a body: known bodies come back, feet stay, nothing is made up, bad input is dropped."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camera_clips import CLIPS, EVERY
from camera_figures import Decoded, check, check_wave, decoded, errors
from camera_people import datagram, datagrams, landmarks
from landmarks import read_frames
from rendered import Motion, crouching, performer, raising, standing, stepping
from retarget import rotations
from retarget.frames import SensorSample
from retarget.human.side_check import RAISED, SideCheck
from retarget.live.rest_capture import RestCapture
from retarget.sources.streams.camera import (
    ANKLES,
    CAMERA_SENSORS,
    HIPS,
    LANDMARKS,
    SHOULDERS,
    WRISTS,
    CameraDecoder,
    WebDecoder,
)
from retarget.sources.streams.json_pose import JsonPoseDecoder
from retarget.types import FloatArray

FOLDER = Path(__file__).parent / "camera"
"""Landmarks of rendered performers as the real tracker saw them, by `camera_clips`."""
PERSON = performer(1.70)
BODIES: dict[str, Callable[[], Motion]] = {
    "standing": lambda: standing(PERSON, 3.0),
    "to the front": lambda: raising(PERSON, "l", seconds=4.0),
    "aside": lambda: raising(PERSON, "lr", seconds=4.0, swing=-45.0),
    "crouching": lambda: crouching(PERSON, 0.3, seconds=6.0),
    "on one foot": lambda: stepping(PERSON),
}


def after(rows: FloatArray, **places: float) -> Decoded:
    return decoded(datagrams(rows, **places), every=1)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_known_body_comes_back(name: str, noise: float) -> None:
    motion = BODIES[name]()
    clip = after(landmarks(motion, noise=noise))
    assert clip.tracked.all()
    off = errors(clip, motion, ["head", "l_wrist", "r_wrist", "pelvis", "l_elbow", "r_elbow", "l_knee", "r_knee"])
    assert np.median(off) < 0.04
    assert np.quantile(off, 0.95) < 0.15
    dropped = motion.of("pelvis")[0, 2] - motion.of("pelvis")[:, 2].min()
    assert clip.of("pelvis")[10, 2] - clip.of("pelvis")[:, 2].min() == pytest.approx(dropped, abs=0.06)


@pytest.mark.parametrize("tall", [1.5, 1.95])
def test_the_body_is_the_same_at_any_distance_and_stature(tall: float) -> None:
    near = [after(landmarks(crouching(PERSON, 0.17 * 1.70), distance=at)).position for at in (2.3, 4.5)]
    np.testing.assert_allclose(near[0], near[1], atol=0.04)
    other = after(landmarks(crouching(performer(tall), 0.17 * tall))).position
    np.testing.assert_allclose(near[0], other, atol=0.04)


@pytest.mark.parametrize("to", [2.5, 3.5])
def test_coming_nearer_or_going_back_is_no_crouch_and_no_step(to: float) -> None:
    motion = standing(PERSON, 10.0)
    clip = after(landmarks(motion, distance=np.linspace(3.0, to, len(motion.q))))
    assert np.ptp(clip.of("pelvis")[:, 2]) < 0.08
    assert np.ptp(clip.of("l_ankle"), axis=0).max() < 0.01


def test_who_sits_at_first_has_a_standing_height_once_they_stand() -> None:
    low = crouching(PERSON, 0.4, seconds=6.0)
    rows = landmarks(low)
    down = int(low.of("pelvis")[:, 2].argmin())
    sits, stands = np.repeat(rows[[down]], 150, axis=0), np.repeat(rows[[-1]], 60, axis=0)
    clip = after(np.concatenate([sits, rows[down:], stands, rows]))
    height = clip.of("pelvis")[:, 2]
    stood = height[-len(rows) - 1]
    assert stood == pytest.approx(low.of("pelvis")[0, 2], abs=0.03)
    assert stood - height[-len(rows) :].min() == pytest.approx(np.ptp(low.of("pelvis")[:, 2]), abs=0.12)


@pytest.mark.parametrize("name", ["standing", "aside", "crouching"])
def test_planted_feet_do_not_slide(name: str) -> None:
    clip = after(landmarks(BODIES[name](), noise=0.01))
    for foot in ("l_ankle", "r_ankle"):
        assert np.ptp(clip.of(foot), axis=0).max() < 0.02
        # A sensor that repeats one value to the bit while others move is taken for lost.
        assert np.all(np.abs(np.diff(clip.of(foot), axis=0)).max(axis=1) > 0.0)


def test_a_lifted_foot_follows_and_the_other_stays() -> None:
    motion = BODIES["on one foot"]()
    clip = after(landmarks(motion, noise=0.003))
    up = np.ptp(motion.of("l_ankle")[:, 2])
    assert 0.8 * up < np.ptp(clip.of("l_ankle")[:, 2]) < 1.1 * up
    assert np.ptp(clip.of("r_ankle"), axis=0).max() < 0.02
    assert np.ptp(clip.of("pelvis"), axis=0).max() < 0.06


@pytest.mark.parametrize(
    ("hidden", "lost"),
    [
        ([WRISTS[0]], {"l_wrist"}),
        ([*ANKLES], {"l_ankle", "r_ankle", "l_knee", "r_knee", "pelvis"}),
        ([*range(HIPS[0], LANDMARKS)], {"l_ankle", "r_ankle", "l_knee", "r_knee", "pelvis"}),
        ([SHOULDERS[1]], set(CAMERA_SENSORS)),
    ],
)
@pytest.mark.parametrize("how", ["invisible", "outside"])
def test_what_is_not_seen_is_not_tracked(hidden: list[int], lost: set[str], how: str) -> None:
    """A body tracker invents what is outside of the picture, and may call it visible."""
    rows = landmarks(standing(PERSON, 2.0))
    if how == "invisible":
        rows[30:, hidden, 5] = 0.1
    else:
        rows[30:, hidden, 1] = 1.2
    clip = after(rows)
    assert clip.tracked[:30].all()
    found = {name for name, seen in zip(CAMERA_SENSORS, clip.tracked[-1], strict=True) if not seen}
    assert found == lost
    assert np.isnan(clip.position[-1][~clip.tracked[-1]]).all()
    assert np.isfinite(clip.position[-1][clip.tracked[-1]]).all()


def test_limbs_that_change_places_are_not_tracked_until_they_stay_so() -> None:
    rows = landmarks(BODIES["standing"]())
    rows[40:43, WRISTS] = rows[40:43, WRISTS[::-1]]
    rows[60:, WRISTS] = rows[60:, WRISTS[::-1]]
    clip = after(rows)
    wrists = clip.tracked[:, [CAMERA_SENSORS.index("l_wrist"), CAMERA_SENSORS.index("r_wrist")]]
    assert not wrists[40:43].any() and not wrists[60:66].any()
    assert wrists[:40].all() and wrists[43:60].all() and wrists[75:].all()
    assert np.ptp(clip.of("l_wrist")[:60][clip.tracked[:60, 1]], axis=0).max() < 0.01


def test_a_back_is_not_tracked_and_a_mirror_is_seen_by_the_check_of_sides() -> None:
    rows = landmarks(raising(PERSON, "l", seconds=5.0))
    pairs = [*range(LANDMARKS)]
    for left in (7, 11, 13, 15, 23, 25, 27):
        pairs[left], pairs[left + 1] = left + 1, left
    decoder = CameraDecoder()
    frames = [frame for one in datagrams(rows[:, pairs]) for frame in decoder.decode(one)]
    assert len(frames) == len(rows) and not any(frame.tracked.any() for frame in frames)
    assert decoder.dropped.count == len(rows)
    mirrored = rows[:, pairs] * [1.0, 1.0, -1.0, 1.0, 1.0, 1.0]
    mirrored[:, :, 0] = 1.0 - mirrored[:, :, 0]
    clip = after(mirrored)
    hands = np.stack([clip.of("l_wrist"), clip.of("r_wrist")], axis=1)
    sides = SideCheck(hands[20])
    seen = set[str]()
    for time, both in zip(clip.time[20:], hands[20:], strict=True):
        sides.take(time, both)
        seen.add(sides.seen)
    assert seen == {"", "right rose"}


def test_a_head_turns_and_a_head_held_low_is_level() -> None:
    motion = standing(PERSON, 3.0)
    turned = np.concatenate([landmarks(motion), landmarks(motion, turn=0.6)])
    decoder = CameraDecoder()
    frames = [frame for one in datagrams(turned) for frame in decoder.decode(one)]
    angle = rotations.angle_between(frames[80].orientation[0], frames[-1].orientation[0])
    assert angle == pytest.approx(0.6, abs=0.03)
    ahead = rotations.rotate(frames[-1].orientation[0], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(ahead, [np.cos(0.6), np.sin(0.6), 0.0], atol=0.05)
    assert np.isnan(frames[-1].orientation[1:]).all()


@pytest.mark.parametrize("name", sorted(path.name.removesuffix(".jsonl.gz") for path in FOLDER.iterdir()))
def test_a_rendered_performer_comes_out_as_near_as_promised(name: str) -> None:
    check(name, read_frames(FOLDER / f"{name}.jsonl.gz"), CLIPS[name].motion(), every=EVERY)


def test_a_run_measures_what_a_camera_sees_and_knows_its_left() -> None:
    """As it begins: a second of standing, then the left arm to the front."""
    clip = decoded(read_frames(FOLDER / "front.jsonl.gz"), every=EVERY)
    capture, nothing = RestCapture(where="web://"), np.full((len(CAMERA_SENSORS), 4), np.nan)
    for time, position, tracked in zip(clip.time, clip.position, clip.tracked, strict=True):
        for later in (0.0, 0.03) if time < clip.time[0] + 1.0 else ():  # polled oftener than pictures come
            capture.take(time + later, SensorSample(CAMERA_SENSORS, position, nothing, tracked))
    measured = capture.result()
    assert measured.dimensions.stature == pytest.approx(1.70, abs=0.02) and not measured.missing
    hands = [CAMERA_SENSORS.index("l_wrist"), CAMERA_SENSORS.index("r_wrist")]
    sides = SideCheck(measured.position[hands])
    seen = []
    for time, position in zip(clip.time, clip.position, strict=True):
        sides.take(time, measured.alignment.positions(position)[hands])
        seen.append(sides.seen)
    assert set(seen) == {"", RAISED}


def test_a_wave_keeps_its_amplitude_and_time() -> None:
    check_wave(read_frames(FOLDER / "wave.jsonl.gz"), 0.5, every=EVERY)


def test_the_tracker_takes_a_performer_without_a_face_for_a_back() -> None:
    """They raise the left arm, and it sees the right one rise, both well visible: what must never be followed."""
    frames = [json.loads(line)["landmarks"] for line in read_frames(FOLDER / "bare.jsonl.gz")]
    left, right = np.array(frames)[:, WRISTS].transpose(1, 0, 2)
    up = slice(33, 45)  # y is down
    assert np.median(right[up, 3]) < -0.4 and np.median(left[up, 3]) > -0.25
    assert min(left[:, 5].mean(), right[:, 5].mean()) > 0.6


# What arrives.

ROWS = landmarks(standing(PERSON, 0.1))[0]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"pose": []}, "a key other than"),
        ({"time": None}, '"time"'),
        ({"time": 1e13}, '"time"'),
        ({"frame": -1}, '"frame"'),
        ({"frame": True}, '"frame"'),
        ({"size": [0, 480]}, '"size"'),
        ({"size": [640]}, '"size"'),
        ({"landmarks": ROWS[:32].tolist()}, "33"),
        ({"landmarks": [[0.5] * 5] * 33}, "6 numbers"),
        ({"landmarks": [[True] * 6] * 33}, "6 numbers"),
        ({"landmarks": [["0"] * 6] * 33}, "6 numbers"),
        ({"landmarks": [[1e300] * 6] * 33}, "no part of a body"),
        ({"landmarks": [[10**200] * 6] * 33}, "no part of a body"),
        ({"landmarks": [[float("nan")] * 6] * 33}, "NaN"),
        ({"landmarks": [[float("inf")] * 6] * 33}, "NaN"),
        ({"axes": "webxr"}, '"axes"'),
    ],
)
def test_what_is_no_frame_is_dropped_with_a_reason(changed: dict[str, object], reason: str) -> None:
    decoder = CameraDecoder()
    assert decoder.decode(datagram(ROWS, time=1.0, changed=changed)) == []
    assert decoder.dropped.count == 1 and reason in next(iter(decoder.dropped.reasons))
    assert len(decoder.decode(datagram(ROWS, time=2.0, number=1))) == 1


number = st.one_of(st.floats(-5.0, 5.0), st.sampled_from([0.0, -5.0, 5.0, 1e-300]))
rows = st.one_of(
    st.just([]),
    st.lists(st.lists(number, min_size=6, max_size=6), min_size=LANDMARKS, max_size=LANDMARKS),
    st.tuples(st.integers(0, 32), st.integers(0, 4), number).map(
        lambda at: [
            [at[2] if (i, j) == at[:2] else value for j, value in enumerate(row)] for i, row in enumerate(ROWS.tolist())
        ]
    ),
)


@pytest.mark.long
@given(st.lists(st.tuples(rows, st.floats(-0.5, 2.0)), min_size=1, max_size=6))
def test_any_landmarks_give_finite_poses_or_none(frames: list[tuple[list[list[float]], float]]) -> None:
    decoder, time = CameraDecoder(), 100.0
    for table, step in frames:
        time += step
        message = {"axes": "camera", "time": time, "size": [640, 480], "landmarks": table}
        for frame in decoder.decode(json.dumps(message).encode()):
            assert frame.names == CAMERA_SENSORS
            assert np.isfinite(frame.position[frame.tracked]).all()
            assert (np.abs(frame.position[frame.tracked]) < 20.0).all()
            assert np.isnan(frame.position[~frame.tracked]).all()


def test_time_goes_on_and_a_new_page_is_a_new_performer() -> None:
    decoder = CameraDecoder()
    sent = [(1.0, 1), (1.0, 0), (0.9, 0), (1.05, 1), (9.0, 1), (0.2, 1), (0.25, 1)]
    for time, frames in sent:
        assert len(decoder.decode(datagram(ROWS, time=time))) == frames
    assert not decoder.decode(datagram(np.zeros((0, 6)), time=0.3))[0].tracked.any()


def test_a_page_sends_landmarks_or_poses() -> None:
    """The headset's axes are those of OpenXR, by their own name."""
    pose = {"l_wrist": {"p": [0.1, 1.2, -0.3], "q": [0.0, 0.6, 0.0, 0.8]}}
    message = {"axes": "webxr", "quaternion": "xyzw", "time": 1.0, "poses": pose}
    decoder, plain = WebDecoder(), JsonPoseDecoder()
    (one,) = decoder.decode(json.dumps(message).encode())
    (other,) = plain.decode(json.dumps(message | {"axes": "openxr"}).encode())
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.orientation, other.orientation)
    np.testing.assert_allclose(one.position, [[0.3, -0.1, 1.2]])
    (seen,) = decoder.decode(datagram(ROWS, time=1.0, number=7))
    assert (seen.names, seen.number) == (CAMERA_SENSORS, 7)
    assert decoder.decode(b"{}") == [] and decoder.dropped.count == 1


def test_legs_that_a_headset_makes_up_are_used_only_when_asked_for() -> None:
    poses = {name: {"p": [0.1, 0.5, 0.0]} for name in ("l_ankle", "head", "r_knee", "l_elbow")}
    sent = json.dumps({"axes": "webxr", "time": 1.0, "poses": poses}).encode()
    (taken,), (left_out,) = WebDecoder(use_generated_legs=True).decode(sent), WebDecoder().decode(sent)
    assert taken.names == tuple(poses) and left_out.names == ("head", "l_elbow")
    assert (left_out.position.shape, left_out.stamp) == ((2, 3), 1.0)
    np.testing.assert_array_equal(left_out.position, taken.position[[1, 3]])
