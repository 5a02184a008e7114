"""Every hinge does what its name says, and the shoulder locks only where arms do not go."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from people import place
from retarget.human import Human, build_human
from retarget.human_dimensions import proportional_dimensions
from retarget.human_joints import HUMAN_JOINTS

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
            assert hinge.lower_deg <= 0.0 <= hinge.upper_deg and hinge.lower_deg < hinge.upper_deg


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
