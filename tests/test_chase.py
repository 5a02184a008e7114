"""Goals of one tick: near to where the robot is, towards what is asked, and nothing for what nobody asked."""

import numpy as np

from followers import DT, follower, op3, performer, postures
from retarget.chase import Chase
from retarget.hierarchy import Hierarchy
from retarget.landmarks import AskedLandmarks
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
