"""An arm in a wrong branch of its postures is driven out of it while the performer's arm is still, and only then."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from followers import DT, dimensions, performer, postures, settled, shipped
from retarget.model.robot import RobotBody
from retarget.robot import arm_branches
from retarget.robot.arm_branches import arm_postures, chain_to_anchor
from retarget.robot.follower import Follower
from retarget.robot.landmarks import robot_limbs
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray

STARTS = 5
"""Postures of an arm, spread over all that its joints can do, from which it is to find back."""
WRONG = 0.5  # rad


def following(name: str) -> Follower:
    return Follower(shipped(name), load_priorities("servo"), dimensions(performer()))


def arm(robot: RobotBody, q: FloatArray) -> FloatArray:
    """Unit lines (2, 3) of the left upper arm and forearm in posture q (nq,)."""
    limbs = [robot_limbs(robot)[name] for name in ("l_upper_arm", "l_forearm")]
    ends = [at for limb in limbs for at in (limb.begin, limb.end)]
    places = robot.kinematics.points(q[None], [at.body for at in ends], np.array([at.position for at in ends]))[0]
    lines = places[1::2] - places[::2]
    return np.asarray(lines / np.linalg.norm(lines, axis=1, keepdims=True))


def off_from_anywhere(name: str) -> FloatArray:
    """Larger angle (STARTS,), rad, between the limbs of a left arm that began anywhere while the performer stands, and
    where it is in a run from the stance. Asserts that it keeps its limits on the way."""
    robot, follower = shipped(name), following(name)
    human = postures(performer())[0]
    follower.start(human)
    good = settled(follower, human)[-1].q
    columns = robot.body.scalar_joints()[1][robot.body.joint_dof[list(chain_to_anchor(robot, "l_hand"))]]
    limits, off = robot.limits, []
    for start in arm_postures(robot, follower.stance, "l_hand", STARTS):
        follower.start(human)
        q = good.copy()
        q[columns] = start[columns]
        follower.reseed(q, np.zeros(robot.body.nv))
        for _ in range(round(4.0 / DT)):
            before, q = q, follower.step(human, DT).q
            joints, moved = q[robot.servo_columns], (q - before)[robot.servo_columns]
            assert (joints >= limits.lower - 1e-9).all() and (joints <= limits.upper + 1e-9).all()
            assert (np.abs(moved) <= limits.max_velocity * DT + 1e-9).all()
        off.append(np.arccos(np.clip(np.sum(arm(robot, q) * arm(robot, good), axis=1), -1.0, 1.0)).max())
    return np.array(off)


@pytest.mark.long
@pytest.mark.parametrize("name", ["wolfgang", "op3"])
def test_an_arm_finds_back_from_any_branch(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without that it stays in a wrong one for ever."""
    assert off_from_anywhere(name).max() < WRONG
    monkeypatch.setattr(arm_branches, "UNLIKE_S", inf)
    assert off_from_anywhere(name).max() > WRONG


def test_an_arm_that_only_lags_is_not_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    """A jump of the performer's arms is caught up with on the shortest way, to the bit."""
    clip = postures(performer())
    raised = max(clip, key=lambda human: human.joints[human.joint_names.index("l_wrist"), 2])

    def jumped() -> FloatArray:
        follower = following("wolfgang")
        follower.start(clip[0])
        return np.array([follower.step(raised, DT).q for _ in range(round(2.0 / DT))])

    free = jumped()
    monkeypatch.setattr(arm_branches, "UNLIKE_S", inf)
    assert np.array_equal(free, jumped())


@pytest.mark.long
def test_an_arm_that_does_not_arrive_is_driven_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its limbs are its targets again, and it is driven no more while the performer stands."""
    monkeypatch.setattr(arm_branches, "LONGEST_DRIVE_S", 0.02)
    assert off_from_anywhere("wolfgang").max() > WRONG


@pytest.mark.long
def test_an_arm_that_stays_unlike_hardly_bends_the_trunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """ToddlerBot's shoulder does not turn as far back as a performer's."""
    start = postures(performer())[0]
    joints, at = start.joints.copy(), start.joint_names.index
    for joint, length in (("r_elbow", 0.3), ("r_wrist", 0.55)):
        joints[at(joint)] = joints[at("r_shoulder")] + length * np.array([-0.905, -0.302, 0.302])
    human = replace(start, joints=joints)

    def trunk(robot: RobotBody, q: FloatArray) -> FloatArray:
        pelvis, neck = robot.points(q[None], ("pelvis", "neck"))[0]
        return np.asarray((neck - pelvis) / np.linalg.norm(neck - pelvis))

    def bent() -> float:
        robot, follower = shipped("toddlerbot"), following("toddlerbot")
        follower.start(start)
        q = [follower.step(human, DT).q for _ in range(round(2.0 / DT))][-1]
        return float(np.linalg.norm(trunk(robot, q) - trunk(robot, follower.stance.q)))

    hardly = bent()
    monkeypatch.setattr(arm_branches, "TRUNK_WEIGHT", 1.0)
    assert hardly < 0.3 * bent()
