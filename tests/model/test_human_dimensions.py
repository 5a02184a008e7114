"""Sizes of a person: proportions, plausibility, and data that cannot be changed behind one's back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from messages import refuses
from people import place
from retarget.errors import InputError
from retarget.frames import JOINTS
from retarget.model.human import Human, build_human
from retarget.model.human_dimensions import (
    FRACTIONS,
    HUMAN_JOINTS,
    PARENTS,
    POINTS,
    SEGMENTS,
    TRUNK_LEVELS,
    check_plausible,
    mirrored_dimensions,
    proportional_dimensions,
)

TRUNK = ("pelvis", "spine", "chest", "neck")


def test_masses_of_both_sides_sum_to_the_body() -> None:
    assert sum(s.mass * (1 if s.body in TRUNK else 2) for s in SEGMENTS) == pytest.approx(1.0, abs=1e-12)


def test_the_parts_of_the_trunk_have_the_trunks_own_mass_and_centre() -> None:
    level = TRUNK_LEVELS
    parts = [s for s in SEGMENTS if s.body in TRUNK[:3]]
    masses = np.array([s.mass for s in parts])
    centres = np.array([level[s.start] + s.com * (level[s.end] - level[s.start]) for s in parts])
    assert masses.sum() == pytest.approx(0.497)  # Winter (2009), Table 4.1, trunk
    assert masses @ centres / masses.sum() == pytest.approx(0.50, abs=1e-3)


def test_heights_of_the_standing_body_agree_with_drillis_and_contini() -> None:
    body, f = proportional_dimensions(1.0), FRACTIONS
    hip = f.ankle_height + body.length("l_ankle") + body.length("l_knee")
    assert hip == pytest.approx(0.530)
    neck = hip - body.of("l_hip")[2] + sum(body.length(name) for name in ("spine", "chest", "neck"))
    assert neck + body.of("l_shoulder")[2] == pytest.approx(0.818)
    assert neck + body.length("head") == pytest.approx(f.head_height, abs=0.003)
    assert f.heel_back + body.of("l_toe")[0] + f.toe_tip == pytest.approx(0.152)


def test_the_points_are_the_canonical_joints_parents_first() -> None:
    assert set(POINTS) == set(JOINTS) and len(POINTS) == 23
    assert all(parent < i for i, parent in enumerate(PARENTS))


def test_average_proportions_scale_with_stature() -> None:
    person = proportional_dimensions(1.8)
    assert_allclose(person.offset, 1.8 * proportional_dimensions(1.0).offset)
    assert person.length("l_knee") == pytest.approx(0.245 * 1.8)
    assert person.mass == pytest.approx(22.5 * 1.8**2)
    assert proportional_dimensions(1.8, mass=80.0).mass == 80.0


def test_mirrored_left_is_right_and_twice_is_nothing() -> None:
    usual = proportional_dimensions(1.7)
    offset = usual.offset.copy()
    offset[POINTS.index("l_knee")] *= 1.1
    offset[POINTS.index("spine"), 1] = 0.01
    person = replace(usual, offset=offset)
    mirrored = mirrored_dimensions(person)
    assert mirrored.length("r_knee") == person.length("l_knee") > mirrored.length("l_knee")
    assert mirrored.of("spine")[1] == -0.01 and mirrored.of("l_hip")[1] > 0.0
    assert_allclose(mirrored_dimensions(mirrored).offset, person.offset)


def test_offsets_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        proportional_dimensions(1.7).offset[0] = 1.0


def test_what_is_no_human_is_refused() -> None:
    check_plausible(proportional_dimensions(1.7), source="file")
    with refuses(InputError, 170):
        check_plausible(proportional_dimensions(170.0), source="file")
    stretched = proportional_dimensions(1.7)
    offset = np.array(stretched.offset)
    offset[[POINTS.index("l_knee"), POINTS.index("r_wrist")]] *= [[5.0], [0.1]]
    with refuses(InputError, "l_hip", "l_knee", "r_elbow", "r_wrist"):
        check_plausible(replace(stretched, offset=offset), source="file")


FORWARD, LEFT, UP = np.eye(3)
OUTWARD = LEFT  # of the left side


@pytest.fixture(scope="module")
def human() -> Human:
    return build_human(proportional_dimensions(1.75), reading="A")


@pytest.mark.parametrize(
    ("motion", "point", "way"),
    [
        ("spine_flexion", "head", FORWARD),
        ("spine_lateral", "head", LEFT),
        ("chest_flexion", "head", FORWARD),
        ("chest_lateral", "head", LEFT),
        ("neck_flexion", "head", FORWARD),
        ("neck_lateral", "head", LEFT),
        ("spine_rotation", "r_shoulder", FORWARD),
        ("chest_rotation", "r_shoulder", FORWARD),
        ("l_collar_protraction", "l_shoulder", FORWARD),
        ("l_collar_elevation", "l_shoulder", UP),
        ("l_shoulder_elevation", "l_wrist", FORWARD + OUTWARD),
        ("l_shoulder_swing", "l_wrist", FORWARD - OUTWARD),
        ("l_elbow_flexion", "l_wrist", FORWARD),
        ("l_wrist_flexion", "l_hand", -OUTWARD),
        ("l_wrist_deviation", "l_hand", FORWARD),
        ("l_hip_flexion", "l_ankle", FORWARD),
        ("l_hip_abduction", "l_ankle", OUTWARD),
        ("l_hip_rotation", "l_toe", -OUTWARD),
        ("l_knee_flexion", "l_ankle", -FORWARD),
        ("l_ankle_dorsiflexion", "l_toe", UP),
        ("l_ankle_rotation", "l_toe", -OUTWARD),
    ],
)
def test_a_positive_angle_moves_the_body_as_the_name_says(
    human: Human, motion: str, point: str, way: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> None:
    for name, target, mirror in [
        (motion, point, np.ones(3)),
        (motion.replace("l_", "r_", 1), point.replace("l_", "r_", 1), np.array([1.0, -1.0, 1.0])),
    ]:
        q = human.posture("stand")
        dof = human.body.dof_index(name)
        q[human.body.scalar_joints()[1][dof]] = 1e-3
        moved = place(human, q, [target])[0] - place(human, human.posture("stand"), [target])[0]
        direction = way * mirror / np.linalg.norm(way)
        assert moved @ direction > 0.9 * np.linalg.norm(moved) > 0.0, name
        if not motion.startswith("l_"):
            break


def test_turns_about_the_arm_show_when_the_elbow_is_bent(human: Human) -> None:
    bent = [("elbow_flexion", 90.0)]
    before = place(human, human.posture_from(bent), ["l_wrist", "r_wrist"])
    after = place(human, human.posture_from([*bent, ("shoulder_rotation", 10.0)]), ["l_wrist", "r_wrist"])
    assert after[0, 1] < before[0, 1] and after[1, 1] > before[1, 1], "medial rotation turns the forearms inward"


def test_seventeen_joints_of_three_hinges_six_of_them_locked() -> None:
    assert len(HUMAN_JOINTS) == 18 and [len(joint.hinges) for joint in HUMAN_JOINTS] == [0] + [3] * 17
    locked = [f"{j.name}_{h.motion}" for j in HUMAN_JOINTS for h in j.hinges if h.locked]
    assert sorted(locked) == sorted(
        f"{side}_{motion}" for side in "lr" for motion in ("knee_abduction", "knee_rotation", "elbow_abduction")
    )


def test_every_limit_box_holds_zero() -> None:
    for joint in HUMAN_JOINTS:
        for hinge in joint.hinges:
            lower, upper = hinge.limits
            assert lower <= 0.0 <= upper and lower < upper


@pytest.mark.parametrize(
    ("elevation", "swing", "way"),
    [(0.0, 0.0, -UP), (180.0, 0.0, UP), (90.0, 45.0, FORWARD), (90.0, -45.0, OUTWARD), (-50.8, -37.8, None)],
)
def test_common_arm_postures_are_far_from_the_shoulders_lock(
    human: Human, elevation: float, swing: float, way: np.ndarray[tuple[int], np.dtype[np.float64]] | None
) -> None:
    q = human.posture_from([("shoulder_elevation", elevation), ("shoulder_swing", swing)])
    shoulder, elbow = place(human, q, ["l_shoulder", "l_elbow"])
    arm = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    if way is None:  # 60 degrees of extension, straight back
        way = np.array([-np.sin(np.pi / 3), 0.0, -np.cos(np.pi / 3)])
    assert_allclose(arm, way, atol=2e-3)
    body = human.body.solver_body()
    columns = [human.body.dof_index(f"l_shoulder_{m}") for m in ("elevation", "swing", "rotation")]
    link = human.body.body_index("l_shoulder")
    axes = np.array(body.frame_jacobian(q, link, (0.0, 0.0, 0.0)))[3:, columns]
    assert np.linalg.svd(axes, compute_uv=False)[-1] > 0.5  # 0 is gimbal lock, 1 is three axes at right angles
