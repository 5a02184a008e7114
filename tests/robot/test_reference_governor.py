"""Goals of one tick: near to where the robot is, towards what is asked, and none for what was not asked."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import DT, follower, op3, performer, postures
from hardware.joint_map import JointMap
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import plant
from retarget.ik.tasks import SlotKind
from retarget.model.robot import load_robot
from retarget.robot.landmarks import AskedLandmarks, RobotReader, limb_names
from retarget.robot.reference_governor import (
    HELD,
    STANDING,
    ChannelLimits,
    Glide,
    OnlineTrajectory,
    ReferenceGovernor,
    braking_displacement,
)
from retarget.rotations import Vector
from retarget.types import FloatArray

STILL = frozenset({"l_sole", "r_sole"})


def goal(hierarchy: Hierarchy, targets: np.ndarray, name: str) -> np.ndarray:
    """Weight and goal of a landmark, or of a limb."""
    kind = SlotKind.POSITION if hierarchy.uses(SlotKind.POSITION, name) else SlotKind.LIMB
    _, slots = hierarchy.position_slots([name], kind)
    return np.asarray(targets[slots[0]])


LIMBS = limb_names(op3().profile)


def ahead(limbs: list[Vector]) -> list[Vector]:
    """All limbs asked 0.1 m ahead of where they are."""
    return [(x + 0.1, y, z) for x, y, z in limbs]


def test_a_goal_is_a_step_from_where_the_robot_is_towards_what_is_asked() -> None:
    robot = follower()
    robot.start(postures(performer())[0])
    hierarchy = robot.hierarchy
    stance = plant(op3(), op3().profile.postures.stand)
    reader = RobotReader(op3(), stance)
    reached = reader.read(stance.q)
    governor = ReferenceGovernor(op3(), hierarchy, still=STILL, trunk_at_stance=reader.trunk_at_stance)
    x, y, z = reached.limbs[LIMBS.index("l_hand")]
    asked = AskedLandmarks(reached.landmarks, ahead(reached.limbs), reached.trunk, reached.gaze)
    targets = hierarchy.blank()
    steps = []
    for _ in range(5):
        governor.aim(targets, asked, reached, DT)
        weight, *place = goal(hierarchy, targets, "l_hand")
        steps.append(np.array(place) - np.array((x, y, z)))
        assert weight == 1.0
    assert np.allclose(steps, [[step[0], 0.0, 0.0] for step in steps], atol=1e-12)
    assert (np.diff([step[0] for step in steps]) > 0.0).all() and steps[-1][0] < 0.002
    pelvis = list(op3().profile.landmarks).index("pelvis")
    assert np.allclose(goal(hierarchy, targets, "pelvis")[1:], reached.landmarks[pelvis], atol=1e-12)


def test_planted_landmarks_get_no_goals() -> None:
    robot = follower()
    governor = ReferenceGovernor(op3(), robot.hierarchy, still=STILL, trunk_at_stance=(1.0, 0.0, 0.0, 0.0))
    targets = robot.hierarchy.blank()
    stance = plant(op3(), op3().profile.postures.stand)
    reached = RobotReader(op3(), stance).read(stance.q)
    governor.aim(
        targets,
        AskedLandmarks(reached.landmarks, reached.limbs, reached.trunk, reached.gaze),
        reached,
        DT,
    )
    assert goal(robot.hierarchy, targets, "l_sole")[0] == 0.0
    assert robot.hierarchy.uses(SlotKind.POSITION, "l_sole")


def test_the_limits_of_a_limb_are_those_of_its_own_joints() -> None:
    """A weak joint elsewhere, such as a waist's, slows no hand."""
    steps = {}
    for weak in ("none", "l_el", "l_ank_roll"):
        servos = [
            replace(servo, max_acceleration=4.0 if servo.joint == weak else 40.0) for servo in op3().joint_map.servos
        ]
        robot, hierarchy = replace(op3(), joint_map=JointMap(servos)), follower().hierarchy
        stance = plant(robot, robot.profile.postures.stand)
        reader = RobotReader(robot, stance)
        reached = reader.read(stance.q)
        governor = ReferenceGovernor(robot, hierarchy, still=STILL, trunk_at_stance=reader.trunk_at_stance)
        there: list[Vector] = [(x + 0.1, y, z) for x, y, z in reached.landmarks]
        targets = hierarchy.blank()
        asked = AskedLandmarks(there, ahead(reached.limbs), reached.trunk, reached.gaze)
        governor.aim(targets, asked, reached, DT)
        pelvis = reached.landmarks[list(robot.profile.landmarks).index("pelvis")]
        begins = {name: reached.limbs[LIMBS.index(name)] for name in ("l_hand", "r_hand")} | {"pelvis": pelvis}
        for name, begin in begins.items():
            steps[weak, name] = float(goal(hierarchy, targets, name)[1]) - begin[0]
    assert steps["l_el", "l_hand"] == pytest.approx(0.1 * steps["none", "l_hand"])
    assert steps["l_ank_roll", "pelvis"] == pytest.approx(0.1 * steps["none", "pelvis"])
    for weak, name in (("l_el", "r_hand"), ("l_el", "pelvis"), ("l_ank_roll", "l_hand")):
        assert steps[weak, name] == steps["none", name] > 0.0


def test_a_robot_that_is_held_uses_more_of_its_servos() -> None:
    steps = []
    for root in ("free", "suspended"):
        robot = load_robot("op3", root=root)
        stance = plant(robot, robot.profile.postures.stand)
        reader, hierarchy = RobotReader(robot, stance), follower().hierarchy
        reached = reader.read(stance.q)
        governor = ReferenceGovernor(robot, hierarchy, still=STILL, trunk_at_stance=reader.trunk_at_stance)
        targets = hierarchy.blank()
        asked = AskedLandmarks(reached.landmarks, ahead(reached.limbs), reached.trunk, reached.gaze)
        governor.aim(targets, asked, reached, DT)
        begin = reached.limbs[LIMBS.index("l_hand")]
        steps.append(float(goal(hierarchy, targets, "l_hand")[1]) - begin[0])
    assert steps[1] == pytest.approx(HELD[1] / STANDING[1] * steps[0])


ACCELERATION, SPEED = 0.5, 0.1


@settings(max_examples=30)
@given(goals=st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), min_size=1, max_size=8))
def test_whatever_is_asked_it_keeps_its_speed_and_acceleration(goals: list[tuple[float, float]]) -> None:
    glide, way = Glide((0.0, 0.0), acceleration=ACCELERATION, speed=SPEED), [[0.0, 0.0]]
    for goal in goals:
        way += [glide.step(goal, DT).copy() for _ in range(40)]
    velocity = np.diff(np.array(way), axis=0) / DT
    assert np.abs(velocity).max() <= SPEED + 1e-9
    assert np.abs(np.diff(velocity, axis=0, prepend=0.0)).max() <= ACCELERATION * DT + 1e-9


@given(goal=st.floats(-0.2, 0.2))
def test_from_rest_it_settles_without_overshoot(goal: float) -> None:
    glide = Glide((0.0,), acceleration=ACCELERATION, speed=SPEED)
    way = np.array([glide.step((goal,), DT)[0] for _ in range(500)])
    assert (np.abs(way) <= abs(goal) + 1e-12).all()
    assert abs(way[-1] - goal) < 1e-9 and abs(glide.moved[0]) < 1e-9


CHANNEL = ChannelLimits(own=4.0, catch_up=2.0, speed=0.5)


def governor(asked: FloatArray, start: float | None = None) -> FloatArray:
    """Where a point gets that follows asked (T,) m along x and reaches every goal."""
    trajectory = OnlineTrajectory(CHANNEL)
    here, last = asked[0] if start is None else start, asked[0]
    track = []
    for there in asked:
        here += trajectory.step((there - last, 0.0, 0.0), (there - here, 0.0, 0.0), DT)[0]
        last = there
        track.append(here)
    return np.array(track)


@given(st.floats(1e-6, 1.0), st.floats(1e-5, 1e-2))
def test_braking_ends_just_at_the_goal(gap: float, change: float) -> None:
    step = braking_displacement(gap, change)
    way, here = 0.0, step
    while here > 0.0:
        way, here = way + here, here - change
    assert way <= gap * (1.0 + 1e-9) + 1e-12
    assert step <= gap


def test_ahead_of_an_even_motion_by_just_so_much_time() -> None:
    """A jump does not count as motion at once, so it is not ahead of one for long."""
    lead_time, speed = 0.05, 0.3
    asked = speed * DT * np.arange(150)
    trajectory, here, last = OnlineTrajectory(CHANNEL, lead_time=lead_time), 0.0, 0.0
    for there in asked:
        here += trajectory.step((there - last, 0.0, 0.0), (there - here, 0.0, 0.0), DT)[0]
        last = there
    assert here - asked[-1] == pytest.approx(speed * lead_time, rel=0.05)
    for _ in range(200):
        here += trajectory.step((0.0, 0.0, 0.0), (last - here, 0.0, 0.0), DT)[0]
    assert here == pytest.approx(last, abs=1e-6)
