"""What is asked of the hands is judged by what is asked of the torso; what the robot does takes no part."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from followers import DT, follower, op3, performance, performer, postures
from retarget import rotations
from retarget.report.tracking import AWAY_M, HANDS, hand_references, longest, reachable_hands, within_reach
from retarget.robot.arm_branches import chain_to_anchor
from retarget.robot.landmarks import DesiredLandmarks
from retarget.types import FloatArray, HumanPosture


@cache
def performed() -> tuple[list[HumanPosture], list[DesiredLandmarks]]:
    """A performer who turns on the spot while reaching and crouching, and what that asks."""
    human = postures(performer())
    for tick, posture in enumerate(human):
        turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), 0.3 * np.sin(0.002 * tick))
        joints, orientations = rotations.rotate(turn, posture.joints), rotations.multiply(turn, posture.orientations)
        human[tick] = replace(posture, joints=joints, orientations=orientations)
    landmarks = follower().landmark_map
    landmarks.restart()
    return human, [landmarks.desired(posture, DT) for posture in human]


def points() -> FloatArray:
    return np.array([asked.landmarks for asked in performed()[1]])


@pytest.mark.long
def test_the_asked_torso_is_found_again() -> None:
    human, asked = performed()
    names, stance = follower().landmark_map.names, follower().stance
    found = hand_references(op3(), stance, performance(human, names, points()))
    assert tuple(found) == HANDS
    back = rotations.conjugate(np.array([one.trunk for one in asked]))
    pelvis = points()[:, names.index("pelvis")]
    for name in HANDS:
        expected = stance.points["pelvis"] + rotations.rotate(back, points()[:, names.index(name)] - pelvis)
        np.testing.assert_allclose(found[name], expected, atol=1e-9)
    assert np.ptp(np.array([one.trunk for one in asked])[:, 2]) > 0.2  # it did lean


def test_without_both_hands_nothing_is_said() -> None:
    human, _ = performed()
    one = performance(human, ("l_hand", "pelvis"), points()[:, :2])
    assert hand_references(op3(), follower().stance, one) == {}
    assert reachable_hands(op3(), one, points()[:, :2]) == {}


def test_an_arm_knows_its_joints_and_its_ends() -> None:
    chain = [op3().body.joint_names[joint] for joint in chain_to_anchor(op3(), "l_hand")]
    assert chain == ["l_el", "l_sho_roll", "l_sho_pitch"]
    stance = follower().stance
    shoulder = stance.points["l_shoulder"]
    bent = stance.q.copy()
    for joint, angle in (("l_sho_pitch", -1.2), ("l_sho_roll", 0.2), ("l_el", -1.3)):
        bent[op3().body.joint_qpos[op3().body.joint_index(joint)]] = angle
    within = op3().points(bent[None], ("l_hand",))[0, 0]
    stretched = shoulder + np.array([0.0, 0.245, 0.0])
    folded = shoulder + np.array([0.05, 0.0, 0.0])  # the elbow bends by 90 degrees only
    places = np.array([within, stretched, folded, shoulder + np.array([0.0, 1.0, 0.0])])
    assert within_reach(op3(), stance, "l_hand", places).tolist() == [True, False, False, False]


@pytest.mark.parametrize("frozen", [False, True])
def test_a_frozen_robot_hides_nothing(frozen: bool) -> None:
    human, _ = performed()
    names = follower().landmark_map.names
    asked = performance(human, names, points())
    reached = np.repeat(points()[:1], len(points()), axis=0) if frozen else points() + np.array([0.003, 0.0, 0.0])
    honest = reachable_hands(op3(), asked, points())
    for name, hand in reachable_hands(op3(), asked, reached).items():
        assert hand.share == honest[name].share > 0.2
        assert hand.error is not None
        assert hand.error > 0.02 if frozen else hand.error == pytest.approx(0.003)


def test_a_hand_that_is_away_is_away_for_as_long_as_in_one_piece() -> None:
    human, _ = performed()
    asked = performance(human, follower().landmark_map.names, points())
    gone = points().copy()
    column = asked.landmark_names.index("l_hand")
    for first, last in ((20, 60), (100, 180)):
        gone[first:last, column] += AWAY_M + 0.01
    found = reachable_hands(op3(), asked, gone)
    assert found["r_hand"].away == 0.0
    assert 0.0 < found["l_hand"].away <= 80 * asked.dt
    assert [longest(np.array(bits) > 0) for bits in ([0, 0], [1, 1, 0, 1], [0, 1, 1, 1])] == [0, 2, 3]
