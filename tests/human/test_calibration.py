"""The performer's size from a skeleton: exact lengths, rest frame, filling, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from messages import refuses, shows
from people import TRIALS, place, trial
from retarget import rotations
from retarget.errors import InputError
from retarget.frames import Skeleton
from retarget.human.calibration import calibrate, dimensions_from_skeleton, rest_orientations
from retarget.model.human import build_human
from retarget.model.human_dimensions import HUMAN_JOINTS, PARENTS, POINTS, proportional_dimensions
from retarget.types import FloatArray


def skeleton_of(points: dict[str, FloatArray]) -> Skeleton:
    return Skeleton(tuple(points), np.array(list(points.values())))


def t_pose(stature: float = 1.7) -> dict[str, FloatArray]:
    human = build_human(proportional_dimensions(stature))
    return dict(zip(POINTS, place(human, human.posture("t_pose"), POINTS), strict=True))


@pytest.mark.parametrize("name", TRIALS)
def test_a_recorded_skeleton_keeps_every_bone_length(shared: Path, name: str) -> None:
    skeleton = trial(shared, name).skeleton
    assert skeleton is not None
    person = dimensions_from_skeleton(skeleton, source=name)
    for point, parent in zip(POINTS, PARENTS, strict=True):
        if parent >= 0:
            assert person.length(point) == pytest.approx(skeleton.distance(point, POINTS[parent]), abs=1e-12)
    assert 1.6 < person.stature < 1.8
    assert_allclose(person.of("l_toe")[1], 0.0, atol=1e-6)  # the splay of the legs at rest is undone
    assert person.of("l_toe")[0] > 0.1 > 0.0 > person.of("l_toe")[2]


def test_a_t_pose_and_hanging_arms_give_the_same_person() -> None:
    human = build_human(proportional_dimensions(1.7))
    hanging = dict(zip(POINTS, place(human, human.posture("stand"), POINTS), strict=True))
    for points in (t_pose(), hanging):
        person = dimensions_from_skeleton(skeleton_of(points))
        assert_allclose(person.offset, human.dimensions.offset, atol=1e-9)
        assert person.stature == pytest.approx(1.7, abs=0.01)


def test_points_that_a_file_lacks_come_from_proportions() -> None:
    points = t_pose()
    kept = {n: p for n, p in points.items() if n[2:] not in ("hand", "toe", "collar") and n not in ("spine", "chest")}
    person = dimensions_from_skeleton(skeleton_of(kept))
    usual = proportional_dimensions(1.7)
    for name in ("spine", "chest", "neck", "l_collar", "l_shoulder", "r_hand", "r_toe"):
        assert_allclose(person.of(name), usual.of(name), atol=2e-3)
    kept.pop("neck")
    kept.pop("pelvis")
    assert_allclose(dimensions_from_skeleton(skeleton_of(kept)).standing(), person.standing(), atol=5e-3)


def test_what_is_no_standing_human_is_refused() -> None:
    points = t_pose()
    with refuses(InputError, "l_wrist"):
        dimensions_from_skeleton(skeleton_of({n: p for n, p in points.items() if n != "l_wrist"}), source="a.bvh")
    unknown = dict(points, r_knee=np.full(3, np.nan))
    with refuses(InputError, "r_knee"):
        dimensions_from_skeleton(skeleton_of(unknown))
    turned = {n: np.array([p[1], -p[0], p[2]]) for n, p in points.items()}
    with refuses(InputError):
        dimensions_from_skeleton(skeleton_of(turned))
    lying = {n: np.array([p[2], p[1], -p[0]]) for n, p in points.items()}
    with refuses(InputError):
        dimensions_from_skeleton(skeleton_of(lying))
    with refuses(InputError):
        dimensions_from_skeleton(skeleton_of({n: 100.0 * p for n, p in points.items()}))
    with refuses(InputError, "l_elbow", "l_wrist"):
        dimensions_from_skeleton(skeleton_of(dict(points, l_wrist=points["l_elbow"] + [0.0, 0.01, 0.0])))


def test_rest_orientations_place_the_human_in_the_skeletons_rest_pose() -> None:
    points = t_pose()
    turns = rest_orientations(skeleton_of(points))
    person = proportional_dimensions(1.7)
    for side in ("l_", "r_"):
        for joint, end in (
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "toe"),
        ):
            link = [j.name for j in HUMAN_JOINTS].index(side + joint)
            bone = points[side + end] - points[side + joint]
            assert_allclose(rotations.rotate(turns[link], person.of(side + end)), bone, atol=1e-9)
    assert_allclose(turns[0], rotations.IDENTITY)


def test_a_recording_with_a_skeleton_uses_it_and_one_without_a_rest_pose(shared: Path) -> None:
    frames = trial(shared, "02_01")
    known = calibrate(frames, mass=61.0)
    assert known.mass == 61.0 and "skeleton" in known.origin
    sensors = replace(frames.select(("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")), skeleton=None, joints=None)
    guessed = calibrate(sensors)
    shows(guessed.origin)
    assert guessed.stature == pytest.approx(known.stature, abs=0.05)
