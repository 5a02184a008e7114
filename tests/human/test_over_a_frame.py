"""Over whole frames: sensors before the human's own shapes, fast ones at any rate; a recording's calibration pose."""

from dataclasses import replace

import numpy as np
import pytest

from messages import refuses
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import CalibrationPose, Playback, calibration_pose, lay_on_ticks
from retarget.model.human import PostureReader, build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray, HumanPosture

DT = 1.0 / 120.0
FIVE = tuple(load_performer("five").sensors)


def standing(arms: float = 0.0) -> FloatArray:
    """Five sensors (5, 3) m of a person of 1.75 m who stands upright. arms: angle from hanging, sideward, rad."""
    size = proportional_dimensions(1.75)
    points = dict(zip(POINTS, size.standing(), strict=True))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        length = size.length(f"{side}_elbow") + size.length(f"{side}_wrist")
        points[f"{side}_wrist"] = points[f"{side}_shoulder"] + length * np.array(
            [0.0, sign * np.sin(arms), -np.cos(arms)]
        )
    return np.array([points[name] for name in FIVE])


def frames_of(position: FloatArray, dt: float = DT) -> SensorFrames:
    """Frames of five sensors (T, 5, 3) m."""
    count = len(position)
    return SensorFrames(
        time=dt * np.arange(count, dtype=np.float64),
        names=FIVE,
        position=position,
        orientation=np.full((count, 5, 4), np.nan),
        valid=np.ones((count, 5), dtype=bool),
        rate_hz=1.0 / dt,
    )


def postures(position: FloatArray, dt: float) -> list[HumanPosture]:
    """The body that follows five sensors (T, 5, 3) m."""
    frames, human = frames_of(position, dt), build_human(proportional_dimensions(1.75))
    reconstructor = Reconstructor(human, load_priorities("human"), load_performer("five"))
    first, *others = (frames.sample(at) for at in frames.time)
    return [reconstructor.start(first), *(reconstructor.step(one, dt) for one in others)]


def errors_mm(position: FloatArray, dt: float = DT) -> FloatArray:
    """How far the body is from each sensor (T, 5), mm."""
    return 1e3 * np.array([posture.sensor_error for posture in postures(position, dt)])


def test_sensors_outrank_the_shapes_of_the_human() -> None:
    """One ankle passes close by the other, as in a walk: nearer than the thickness of two shanks."""
    position = np.repeat(standing(0.15)[None], 120, axis=0)
    share = np.linspace(0.0, 1.0, 120)
    left, right = FIVE.index("l_ankle"), FIVE.index("r_ankle")
    distance = position[0, left, 1] - position[0, right, 1]
    position[:, left, 1] -= distance * np.sin(np.pi * share) * 0.7
    position[:, left, 0] += 0.4 * (share - 0.5)
    position[:, [FIVE.index(name) for name in ("head", "l_wrist", "r_wrist")], 2] -= 0.04  # knees bend
    position[:, left, 2] += 0.05 * np.sin(np.pi * share)
    assert errors_mm(position)[36:].max() < 1.0


@pytest.mark.parametrize("rate", [30.0, 40.0, 60.0, 120.0])
def test_a_fast_hand_is_followed_at_any_rate(rate: float) -> None:
    """A wrist goes 5 m/s, up and down beside the body."""
    time = np.arange(0.0, 2.0, 1.0 / rate)
    swing = 1.2 + 0.9 * np.sin(2.0 * np.pi * 0.9 * time)
    position = np.array([standing(angle) for angle in swing])
    assert errors_mm(position, dt=1.0 / rate)[int(0.3 * rate) :].max() < 10.0


@pytest.mark.parametrize("rate", [50.0, 120.0])
def test_a_tangled_body_begins_anew(rate: float) -> None:
    """A performer who is turned about at once leaves a body with crossed legs and arms behind."""
    position = np.repeat(standing(0.3)[None], 3 * int(rate), axis=0)
    turned = int(rate)
    position[turned:] *= [-1.0, -1.0, 1.0]
    errors = errors_mm(position, dt=1.0 / rate)
    assert errors[turned : turned + int(0.2 * rate)].max() > 100.0
    assert errors[turned + int(0.7 * rate) :].max() < 10.0


def test_a_sensor_where_no_body_goes_makes_no_leap() -> None:
    """A hand asks for more than an arm gives: no second posture helps, and none is seen."""
    position = np.repeat(standing(0.3)[None], 240, axis=0)
    position[30:, FIVE.index("l_wrist")] += [0.0, 2.0, 0.0]
    errors = errors_mm(position)[90:]
    assert errors.max() > 1000.0 and np.abs(np.diff(errors, axis=0)).max() < 5.0


def moving(count: int = 60) -> FloatArray:
    """A person who walks on, arms hanging a little (count, 5, 3) m."""
    position = np.repeat(standing(0.15)[None], count, axis=0)
    position[:, :, 0] += 1.2 * DT * np.arange(count)[:, None]
    return position


@pytest.mark.parametrize(("name", "arms"), [("T", 1.55), ("A", 0.75), ("N", 0.0)])
def test_a_calibration_pose_before_the_motion_is_left_out(name: str, arms: float) -> None:
    position = moving() + np.array([0.3, 0.1, 0.0])
    position[0] = standing(arms)
    frames = frames_of(position)
    assert calibration_pose(frames) == CalibrationPose(name, 1)
    played = lay_on_ticks(frames, performer=load_performer("five"), playback=Playback())
    assert len(played) == 59 and np.allclose(played.frames.position[0], position[1])
    assert played.left_out == CalibrationPose(name, 1)
    with refuses(UsageError, "--keep-calibration-frame"):
        lay_on_ticks(frames, performer=load_performer("five"), playback=Playback(end=0.5 * DT))
    kept = lay_on_ticks(frames, performer=load_performer("five"), playback=Playback(keep_calibration_frame=True))
    assert len(kept) == 60 and kept.left_out is None
    begun = lay_on_ticks(frames, performer=load_performer("five"), playback=Playback(start=0.0))
    assert len(begun) == 60


def test_a_motion_is_no_calibration_pose() -> None:
    assert calibration_pose(frames_of(moving())) is None
    tracker_jumps = moving()
    tracker_jumps[0, FIVE.index("l_wrist")] += [0.9, 0.0, 0.9]
    assert calibration_pose(frames_of(tracker_jumps)) is None
    lost = frames_of(moving())
    assert calibration_pose(replace(lost, valid=np.zeros_like(lost.valid))) is None


# What no sensor measures, while people get down and up again.


def followed(position: FloatArray, dt: float = DT) -> FloatArray:
    """Joint centres (T, 23, 3) m of the body that follows five sensors (T, 5, 3) m."""
    return np.array([posture.joints for posture in postures(position, dt)])


def getting_down(frames: int = 120) -> FloatArray:
    """All points (T, 23, 3) m of a person who stands and gets down in a second, as recorded people do on average: by
    hips, knees and spine, the pelvis leaning forward, the ankles where they were."""
    human = build_human(proportional_dimensions(1.75))
    upright = human.posture("stand")
    legs = {"hip_flexion": 91.0, "knee_flexion": 88.0, "ankle_dorsiflexion": 20.0}
    trunk = {"spine_flexion": 36.0, "neck_flexion": -20.0, "shoulder_elevation": 50.0, "elbow_flexion": 20.0}
    down = human.posture_from({**legs, **trunk}.items())
    shares = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, frames))
    q = upright + shares[:, None] * (down - upright)
    lean = np.deg2rad(40.0) * shares
    q[:, 3:7] = np.stack([np.cos(lean / 2), 0 * lean, np.sin(lean / 2), 0 * lean], axis=1)
    joints = PostureReader(human).joints(q)
    ankles = [POINTS.index(name) for name in ("l_ankle", "r_ankle")]
    return np.asarray(joints + (joints[0, ankles].mean(axis=0) - joints[:, ankles].mean(axis=1))[:, None])


@pytest.mark.long
def test_the_trunk_leans_as_of_recorded_people_while_a_body_gets_down() -> None:
    truth = getting_down()
    sensors = truth[:, [POINTS.index(name) for name in FIVE]]
    pelvis = POINTS.index("pelvis")
    assert 1e3 * np.linalg.norm(followed(sensors)[-1, pelvis] - truth[-1, pelvis]) < 70.0


@pytest.mark.parametrize("rate", [40.0, 120.0])
def test_the_pelvis_does_not_jump_where_straight_legs_begin_to_bend(rate: float) -> None:
    """The head of a person on straight legs goes down by 5 cm in an eighth of a second, and stays there. Legs that
    begin to bend would throw the pelvis aside."""
    position = np.repeat(standing(0.2)[None], round(rate), axis=0)
    time = np.arange(len(position)) / rate
    down = 0.05 * np.clip((time - 0.5) / 0.125, 0.0, 1.0)
    for name in ("head", "l_wrist", "r_wrist"):
        position[:, FIVE.index(name), 2] += 0.012 - down
    pelvis = followed(position, 1.0 / rate)[:, POINTS.index("pelvis")]
    assert np.linalg.norm(np.diff(pelvis, axis=0), axis=1).max() * rate < 1.1


@pytest.mark.parametrize(("ahead", "least", "most"), [(0.55, 30.0, 90.0), (0.1, -20.0, 25.0)])
def test_a_bend_is_distinguished_from_a_crouch(ahead: float, least: float, most: float) -> None:
    """The head goes down by half a metre in a second, ahead of the feet or above them, and the hands below it."""
    share = np.clip(np.arange(180) / 120.0, 0.0, 1.0)[:, None]
    position = np.repeat(standing(0.2)[None], 180, axis=0)
    for name in ("head", "l_wrist", "r_wrist"):
        position[:, FIVE.index(name)] += share * [ahead, 0.0, -0.5]
    joints = dict(zip(POINTS, followed(position)[-1], strict=True))
    trunk = joints["chest"] - joints["pelvis"]
    assert least < np.degrees(np.arctan2(trunk[0], trunk[2])) < most
