"""Goals of one tick: near to where the robot is, towards what is asked, and nothing for what nobody asked."""

from dataclasses import replace

import numpy as np
import pytest

from followers import DT, follower, op3, performer, postures
from hardware.joint_map import JointMap
from retarget.chase import HELD, STANDING, Chase
from retarget.hierarchy import Hierarchy
from retarget.landmarks import AskedLandmarks
from retarget.robot_body import load_robot
from retarget.robot_reader import RobotReader
from retarget.scalar_rotations import Vector
from retarget.stance import plant
from retarget.task_slots import SlotKind

STILL = frozenset({"l_sole", "r_sole"})


def goal(hierarchy: Hierarchy, targets: np.ndarray, name: str) -> np.ndarray:
    _, slots = hierarchy.position_slots([name])
    return np.asarray(targets[slots[0]])


def test_a_goal_is_a_step_from_where_the_robot_is_towards_what_is_asked() -> None:
    robot = follower()
    robot.start(postures(performer())[0])
    hierarchy = robot.hierarchy
    stance = plant(op3(), op3().profile.postures.stand)
    reader = RobotReader(op3(), stance)
    reached = reader.read(stance.q)
    chase = Chase(op3(), hierarchy, still=STILL, trunk_at_stance=reader.trunk_at_stance)
    hand = list(op3().profile.landmarks).index("l_hand")
    landmarks: list[Vector] = list(reached.landmarks)
    x, y, z = landmarks[hand]
    landmarks[hand] = (x + 0.1, y, z)
    asked = AskedLandmarks(landmarks, reached.trunk, reached.gaze)
    targets = hierarchy.blank()
    steps = []
    for _ in range(5):
        chase.aim(targets, asked, reached, DT, haste=1.0)
        weight, *place = goal(hierarchy, targets, "l_hand")
        steps.append(np.array(place) - np.array((x, y, z)))
        assert weight == 1.0
    assert np.allclose(steps, [[step[0], 0.0, 0.0] for step in steps], atol=1e-12)
    assert (np.diff([step[0] for step in steps]) > 0.0).all() and steps[-1][0] < 0.002
    assert np.allclose(goal(hierarchy, targets, "pelvis")[1:], reached.landmarks[3], atol=1e-12)


def test_planted_landmarks_are_not_chased() -> None:
    robot = follower()
    chase = Chase(op3(), robot.hierarchy, still=STILL, trunk_at_stance=(1.0, 0.0, 0.0, 0.0))
    targets = robot.hierarchy.blank()
    stance = plant(op3(), op3().profile.postures.stand)
    reached = RobotReader(op3(), stance).read(stance.q)
    chase.aim(targets, AskedLandmarks(reached.landmarks, reached.trunk, reached.gaze), reached, DT, haste=1.0)
    assert goal(robot.hierarchy, targets, "l_sole")[0] == 0.0
    assert robot.hierarchy.uses(SlotKind.POSITION, "l_sole")


def test_the_pace_of_a_limb_is_that_of_its_own_joints() -> None:
    """A weak joint elsewhere, such as a waist's, holds up no hand."""
    steps = {}
    for weak in ("none", "l_el", "l_ank_roll"):
        servos = [
            replace(servo, max_acceleration=4.0 if servo.joint == weak else 40.0) for servo in op3().joint_map.servos
        ]
        robot, hierarchy = replace(op3(), joint_map=JointMap(servos)), follower().hierarchy
        stance = plant(robot, robot.profile.postures.stand)
        reader = RobotReader(robot, stance)
        reached = reader.read(stance.q)
        chase = Chase(robot, hierarchy, still=STILL, trunk_at_stance=reader.trunk_at_stance)
        there: list[Vector] = [(x + 0.1, y, z) for x, y, z in reached.landmarks]
        targets = hierarchy.blank()
        chase.aim(targets, AskedLandmarks(there, reached.trunk, reached.gaze), reached, DT, haste=1.0)
        for name in ("l_hand", "r_hand", "pelvis"):
            row = list(robot.profile.landmarks).index(name)
            steps[weak, name] = float(goal(hierarchy, targets, name)[1]) - reached.landmarks[row][0]
    assert steps["l_el", "l_hand"] == pytest.approx(0.1 * steps["none", "l_hand"])
    assert steps["l_ank_roll", "pelvis"] == pytest.approx(0.1 * steps["none", "pelvis"])
    for weak, name in (("l_el", "r_hand"), ("l_el", "pelvis"), ("l_ank_roll", "l_hand")):
        assert steps[weak, name] == steps["none", name] > 0.0


def test_who_is_held_goes_after_what_is_asked_with_more_of_its_servos() -> None:
    steps = []
    for root in ("free", "suspended"):
        robot = load_robot("op3", root=root)
        stance = plant(robot, robot.profile.postures.stand)
        reader, hierarchy = RobotReader(robot, stance), follower().hierarchy
        reached = reader.read(stance.q)
        chase = Chase(robot, hierarchy, still=STILL, trunk_at_stance=reader.trunk_at_stance)
        targets, there = hierarchy.blank(), [(x + 0.1, y, z) for x, y, z in reached.landmarks]
        chase.aim(targets, AskedLandmarks(there, reached.trunk, reached.gaze), reached, DT, haste=1.0)
        row = list(robot.profile.landmarks).index("l_hand")
        steps.append(float(goal(hierarchy, targets, "l_hand")[1]) - reached.landmarks[row][0])
    assert steps[1] == pytest.approx(HELD[1] / STANDING[1] * steps[0])
