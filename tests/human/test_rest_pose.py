"""Sensors alone: N, A and T poses of recorded people of known size, turned and moved; and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike

from messages import Facts, refuses, shows
from people import TRIALS, at_rest, place, trial
from retarget.errors import InputError
from retarget.frames import SensorFrames, Skeleton
from retarget.human import rest_pose
from retarget.human.calibration import calibrate, dimensions_from_skeleton
from retarget.human.rest_pose import find_rest_frames, fit_rest_pose
from retarget.model.human import build_human
from retarget.model.human_dimensions import PARENTS, POINTS, HumanDimensions, proportional_dimensions
from retarget.types import FloatArray


def parameters(**values: ArrayLike) -> FloatArray:
    result = np.zeros(rest_pose.COUNT)
    result[rest_pose.STATURE] = np.log(1.7)
    for name, value in values.items():
        result[getattr(rest_pose, name)] = value
    return result


@pytest.mark.parametrize(
    ("proportion", "longer"),
    [(0, "chest"), (1, "head"), (2, "l_elbow"), (3, "r_wrist"), (4, "l_knee"), (5, "r_ankle")],
)
def test_a_proportion_stretches_its_segment_alone(proportion: int, longer: str) -> None:
    stretched = np.zeros(7)
    stretched[proportion] = 0.1
    ratio = np.linalg.norm(rest_pose.offsets(parameters(PROPORTIONS=stretched)), axis=1)[1:]
    ratio /= np.linalg.norm(rest_pose.offsets(parameters()), axis=1)[1:]
    assert ratio[POINTS.index(longer) - 1] == pytest.approx(np.exp(0.1))
    others = [name for name in ("chest", "head", "l_elbow", "r_wrist", "l_knee", "r_ankle") if name != longer]
    assert all(ratio[POINTS.index(name) - 1] == pytest.approx(1.0) for name in others)


def test_limbs_point_where_their_angles_say() -> None:
    angles = np.zeros((4, 2, 2))
    angles[0, :, 0] = np.pi / 2  # left arm straight out
    angles[1, 1, 1] = np.pi / 2  # right forearm forward
    points = dict(zip(POINTS, rest_pose.body_points(parameters(ANGLES=angles.ravel())), strict=True))
    usual = proportional_dimensions(1.7)
    reach = usual.length("l_elbow") + usual.length("l_wrist") + usual.length("l_hand")
    assert_allclose(points["l_hand"] - points["l_shoulder"], [0.0, reach, 0.0], atol=1e-12)
    assert_allclose(points["r_wrist"] - points["r_elbow"], [usual.length("r_wrist"), 0.0, 0.0], atol=1e-12)


FIVE = ("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")
POSES = {"N": 0.1, "A": 0.8, "T": np.pi / 2}


def fitted(points: dict[str, FloatArray], names: tuple[str, ...] = FIVE) -> HumanDimensions:
    return fit_rest_pose(names, np.array([points[name] for name in names]), source="test").dimensions


def arm(person: HumanDimensions) -> float:
    return person.length("l_elbow") + person.length("l_wrist")


def leg(person: HumanDimensions) -> float:
    return person.length("l_knee") + person.length("l_ankle")


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("turn", [0.0, 2.5])
def test_an_average_person_is_found_exactly(pose: str, turn: float) -> None:
    for stature in (0.9, 1.7, 2.1):
        person = fitted(at_rest(proportional_dimensions(stature), POSES[pose], turn=turn))
        assert person.origin.startswith(f"{pose}-pose")
        assert person.stature == pytest.approx(stature, rel=5e-3)
        assert arm(person) == pytest.approx(arm(proportional_dimensions(stature)), rel=2e-2)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("name", TRIALS)
def test_recorded_people_are_found_within_the_stated_error(shared: Path, name: str, pose: str) -> None:
    skeleton = trial(shared, name).skeleton
    assert skeleton is not None
    known = dimensions_from_skeleton(skeleton)
    person = fitted(at_rest(known, POSES[pose], turn=1.0, splay=0.1))
    assert person.stature == pytest.approx(known.stature, abs=0.010)
    assert arm(person) == pytest.approx(arm(known), abs=0.035)
    assert leg(person) == pytest.approx(leg(known), abs=0.020)


def test_more_sensors_see_more() -> None:
    long_forearms = proportional_dimensions(1.7)
    offset = np.array(long_forearms.offset)
    for name in ("l_wrist", "r_wrist"):
        offset[POINTS.index(name)] *= 1.15
    person = HumanDimensions(offset=offset, stature=1.7, mass=65.0, origin="")
    points = at_rest(person, POSES["A"])
    errors = [
        abs(fitted(points, names).length("l_wrist") - person.length("l_wrist"))
        for names in (FIVE, (*FIVE, "l_elbow", "r_elbow", "l_shoulder", "r_shoulder"))
    ]
    assert errors[1] < 0.6 * errors[0]


def test_head_and_hands_alone_stand_on_the_ground() -> None:
    person = fitted(at_rest(proportional_dimensions(1.8), POSES["N"]), ("head", "l_wrist", "r_wrist"))
    assert person.stature == pytest.approx(1.8, rel=0.02)


def test_what_is_no_rest_pose_is_refused() -> None:
    points = at_rest(proportional_dimensions(1.7), POSES["N"])
    with refuses(InputError, "r_wrist"):
        fitted(points, ("head", "l_wrist", "l_ankle", "r_ankle"))
    with refuses(InputError, "head", "0.30"):
        fitted(dict(points, head=points["l_ankle"] + [0.0, 0.0, 0.3]))
    with refuses(InputError):
        fitted({name: 1000.0 * point for name, point in points.items()})
    with refuses(InputError):
        fitted(dict(points, l_wrist=points["head"] + [0.0, 0.9, 0.9]))


def test_the_still_and_tall_frame_is_found() -> None:
    still = at_rest(proportional_dimensions(1.7), POSES["N"])
    position = np.tile(np.array([still[name] for name in FIVE]), (300, 1, 1))
    position[:150, 0, 2] -= 0.2  # the head is low in the first half
    position[200:, 1] += np.random.default_rng(1).normal(scale=0.05, size=(100, 3))  # a hand shakes at the end
    frames = SensorFrames(
        time=np.arange(300) / 120.0, names=FIVE, position=position, orientation=np.full((300, 5, 4), np.nan),
        valid=np.ones((300, 5), bool), rate_hz=120.0,
    )  # fmt: skip
    best = find_rest_frames(frames)
    assert 151 <= best[0] < 199
    blind = np.ones((300, 5), bool)
    blind[:, 0] = False
    with refuses(InputError):
        find_rest_frames(SensorFrames(frames.time, FIVE, position, frames.orientation, blind))


# The performer's size from a skeleton: exact lengths, rest frame, filling, and what is refused.


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
    wrong: list[tuple[dict[str, FloatArray], Facts]] = [
        (dict(points, r_knee=np.full(3, np.nan)), "r_knee"),
        ({n: np.array([p[1], -p[0], p[2]]) for n, p in points.items()}, ()),  # turned
        ({n: np.array([p[2], p[1], -p[0]]) for n, p in points.items()}, ()),  # lying
        ({n: 100.0 * p for n, p in points.items()}, ()),
        (dict(points, l_wrist=points["l_elbow"] + [0.0, 0.01, 0.0]), ("l_elbow", "l_wrist")),
    ]
    for one, facts in wrong:
        with refuses(InputError, facts):
            dimensions_from_skeleton(skeleton_of(one))


def test_a_recording_with_a_skeleton_uses_it_and_one_without_a_rest_pose(shared: Path) -> None:
    frames = trial(shared, "02_01")
    known = calibrate(frames)
    assert "skeleton" in known.origin
    sensors = replace(frames.select(("head", "l_wrist", "r_wrist", "l_ankle", "r_ankle")), skeleton=None, joints=None)
    guessed = calibrate(sensors)
    shows(guessed.origin)
    assert guessed.stature == pytest.approx(known.stature, abs=0.05)
