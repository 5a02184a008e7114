"""Angles between the limbs of a robot and of its performer."""

import numpy as np

from followers import DT, dimensions, follower, op3, performer, postures
from retarget.report.likeness import LEAN, LIMBS, limb_angles
from retarget.report.tracking import Performance, hands_from_shoulders
from retarget.types import FloatArray, HumanPosture


def performance(human: list[HumanPosture], landmarks: FloatArray) -> Performance:
    return Performance(
        dimensions=dimensions(performer()),
        joint_names=human[0].joint_names,
        joints=np.array([posture.joints for posture in human]),
        pelvis=np.array([posture.orientation("pelvis") for posture in human]),
        landmark_names=tuple(op3().profile.landmarks),
        landmarks=landmarks,
        dt=DT,
    )


def followed(priorities: str) -> tuple[Performance, FloatArray, FloatArray]:
    """What was asked, the postures (T, nq) and the landmarks reached (T, k, 3) m of OP3."""
    human, robot = postures(performer())[:250], follower(priorities=priorities)
    robot.start(human[0])
    done = [robot.step(posture, DT) for posture in human]
    asked = performance(human, np.array([one.landmarks_asked for one in done]))
    return asked, np.array([one.q for one in done]), np.array([one.landmarks_reached for one in done])


def test_a_limb_that_is_turned_is_off_by_its_angle() -> None:
    asked, q, _ = followed("servo")
    found = limb_angles(op3(), q, asked)
    assert set(found) == {*LIMBS, LEAN} and all(len(angles) == len(q) for angles in found.values())
    elbow = op3().body.joint_qpos[op3().body.joint_index("l_el")]
    points = op3().points(q, ("l_elbow", "l_hand"))
    q[:, elbow] += 0.4
    turned = op3().points(q, ("l_elbow", "l_hand"))
    before, after = points[:, 1] - points[:, 0], turned[:, 1] - turned[:, 0]
    moved = np.arccos(np.sum(before * after, axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1))
    again = limb_angles(op3(), q, asked)
    assert (np.abs(again["forearms"][:, 0] - found["forearms"][:, 0]) <= moved + 1e-9).all()
    for name in ("upper_arms", "thighs", "shanks", LEAN):
        np.testing.assert_allclose(again[name], found[name], atol=1e-9)
    np.testing.assert_allclose(again["forearms"][:, 1], found["forearms"][:, 1], atol=1e-9)


def test_a_trunk_that_leans_as_the_performers_does_is_no_error() -> None:
    asked, q, _ = followed("servo")
    lean = limb_angles(op3(), q, asked)[LEAN]
    assert np.degrees(lean[100:].mean()) < 6.0
    stood = np.tile(q[0], (len(q), 1))
    assert np.degrees(limb_angles(op3(), stood, asked)[LEAN].max()) > 15.0  # it is seen to stand still


def test_hands_first_puts_hands_where_the_arm_has_them_seen_from_the_shoulder() -> None:
    off = {}
    for priorities in ("servo", "hands_first"):
        asked, q, reached = followed(priorities)
        seen = hands_from_shoulders(op3(), asked, q, reached)
        hands = [asked.landmark_names.index(name) for name in ("l_hand", "r_hand")]
        off[priorities] = np.linalg.norm(seen - asked.landmarks, axis=2)[150:, hands].mean()
        others = [column for column in range(len(asked.landmark_names)) if column not in hands]
        np.testing.assert_array_equal(seen[:, others], reached[:, others])
    assert off["hands_first"] < 0.008 < off["servo"] < 0.06
