"""The targets of a robot: scaled limb by limb, in the performer's heading, within what the robot can do."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import DT, ROBOTS, dimensions, op3, performer, stance
from retarget import rotations
from retarget.arithmetic import soft_cap
from retarget.ik.support_polygon import plant
from retarget.model.human_dimensions import POINTS
from retarget.model.robot import load_robot
from retarget.robot.crouch_envelope import Envelope
from retarget.robot.landmarks import (
    SETTLE_S,
    SOFT_ZONE,
    Facing,
    FootSeparation,
    LandmarkMap,
    PelvisOverFeet,
    RobotReader,
    foot_separation,
)
from retarget.rotations import Vector, axis_turn
from retarget.types import Carrying, FloatArray, HumanPosture

AHEAD, UP = (0.1, 0.0, -0.02), np.array([0.0, 0.0, 1.0])
ROBOT = op3().profile


def test_a_quick_twist_hardly_turns_the_facing_and_a_new_stance_does() -> None:
    """Directions that disagree hold it."""
    facing, straight, twist = Facing(), axis_turn((0.0, 0.0, 1.0), 0.0), axis_turn((0.0, 0.0, 1.0), 0.8)
    facing.update(straight, AHEAD, AHEAD, DT)
    for _ in range(int(0.2 / DT)):
        x, y = facing.update(twist, AHEAD, AHEAD, DT)
    assert 0.0 < np.arctan2(y, x) < 0.1
    turned = (0.1 * np.cos(0.8), 0.1 * np.sin(0.8), 0.0)
    for _ in range(int(8.0 * SETTLE_S / DT)):
        x, y = facing.update(twist, turned, turned, DT)
    assert abs(np.arctan2(y, x) - 0.8) < 0.01
    held, back = Facing(), (-0.1, 0.0, 0.0)
    held.update(straight, AHEAD, AHEAD, DT)
    for _ in range(1000):
        heading = held.update(straight, back, back, DT)
    assert heading == (1.0, 0.0)


LEAST = 0.1
reach = st.floats(-0.5, 0.5)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_keeps_its_left_foot_to_the_left_by_as_much_as_it_stands(name: str) -> None:
    robot = load_robot(name, root="suspended")
    rows = tuple(robot.profile.landmarks)
    feet = foot_separation(robot.profile, plant(robot, robot.profile.postures.stand), rows)
    assert feet is not None and (rows[feet.left], rows[feet.right]) == ("l_sole", "r_sole")
    assert 0.03 < feet.least < 0.3


def separated(left: Vector, right: Vector) -> tuple[Vector, Vector]:
    landmarks = [right, (1.0, 2.0, 3.0), left]
    FootSeparation(left=2, right=0, least=LEAST).apply(landmarks)
    assert landmarks[1] == (1.0, 2.0, 3.0)
    return landmarks[2], landmarks[0]


@given(reach, reach, st.floats(LEAST * (1.0 + SOFT_ZONE), 0.5))
def test_feet_far_from_each_other_stay(x: float, y: float, distance: float) -> None:
    left, right = (x, y + distance, 0.1), (0.0, y, 0.0)
    now = separated(left, right)
    assert now[0] == pytest.approx(left, abs=1e-12) and now[1] == pytest.approx(right, abs=1e-12)


@given(reach, reach)
def test_feet_that_meet_or_cross_pass_side_by_side(left: float, right: float) -> None:
    first, second = separated((0.1, left, 0.2), (-0.1, right, 0.0))
    assert first[1] - second[1] >= LEAST - 1e-12
    assert first[1] + second[1] == pytest.approx(left + right, abs=1e-12)
    assert (first[0], first[2], second[0], second[2]) == (0.1, 0.2, -0.1, 0.0)


@given(st.floats(-0.3, 0.3), st.floats(1e-6, 1e-3))
def test_no_jump_and_no_reversal(distance: float, more: float) -> None:
    """As feet come closer, their targets come closer as well, and never faster."""
    here, there = (separated((0.0, y, 0.0), (0.0, 0.0, 0.0)) for y in (distance, distance + more))
    grown = (there[0][1] - there[1][1]) - (here[0][1] - here[1][1])
    assert -1e-12 <= grown <= more + 1e-12


WIDE = Envelope(np.array([0.1, 0.25]), np.full((2, 4), 1.2))


@cache
def size() -> FloatArray:
    return dimensions(performer()).standing()


def landmark_map(envelope: Envelope | None = WIDE) -> LandmarkMap:
    return LandmarkMap(ROBOT, dimensions(performer()), stance(), envelope)


def human(joints: FloatArray | None = None, orientations: FloatArray | None = None) -> HumanPosture:
    """A performer with these joint centres (23, 3); absent: standing upright, facing x."""
    joints = size() if joints is None else joints
    orientations = np.tile(rotations.IDENTITY, (3, 1)) if orientations is None else orientations
    return HumanPosture(np.zeros(0), POINTS, joints, orientations, np.zeros(3), np.zeros(0), 0.0, (1.0, 0.0))


def changed(change: Callable[[str, FloatArray], FloatArray]) -> FloatArray:
    return np.array([change(name, point) for name, point in zip(POINTS, size(), strict=True)])


def bent(turn: FloatArray) -> HumanPosture:
    """A performer whose trunk is turned about the middle of the hips, legs as they were."""
    hips = 0.5 * (size()[POINTS.index("l_hip")] + size()[POINTS.index("r_hip")])
    legs = ("hip", "knee", "ankle", "toe")
    joints = changed(lambda n, p: p if n.endswith(legs) else rotations.rotate(turn, p - hips) + hips)
    return human(joints, np.array([rotations.IDENTITY, turn, turn]))


def desired(posture: HumanPosture, where: LandmarkMap | None = None) -> dict[str, FloatArray]:
    """The target (3,) of every landmark."""
    where = where or landmark_map()
    return dict(zip(where.names, map(np.array, where.desired(posture, DT).landmarks), strict=True))


def test_a_standing_performer_is_a_standing_robot_wherever_they_stand_and_face() -> None:
    here = desired(human())
    assert np.allclose(here["l_sole"], stance().points["l_sole"])
    assert abs(here["pelvis"][2] - stance().points["pelvis"][2]) < 0.01
    assert np.linalg.norm(here["head"] - stance().points["head"]) < 0.03
    # Arms hang: a hand is an arm's length under the shoulder.
    assert here["l_hand"][2] < here["pelvis"][2]
    assert abs(np.linalg.norm(here["l_hand"] - here["r_hand"]) - 0.177) < 0.03
    turn = rotations.from_axis_angle(UP, 2.0)
    there = desired(human(rotations.rotate(turn, size()) + np.array([3.0, -1.0, 0.0]), np.tile(turn, (3, 1))))
    assert all(np.allclose(here[name], there[name], atol=1e-9) for name in here)


def test_a_crouch_is_a_crouch_and_stops_where_the_robot_does() -> None:
    def crouched(share: float) -> FloatArray:
        """Feet nearer to the hips: their height under the pelvis times `share`."""
        return changed(lambda n, p: p * np.array([1.0, 1.0, share]) if "ankle" in n or "toe" in n else p)

    heights = [desired(human(crouched(share)))["pelvis"][2] for share in np.linspace(1.0, 0.1, 10)]
    assert (np.diff(heights) < 0.0).all()
    assert heights[0] - heights[2] > 0.03
    assert heights[-1] > WIDE.lowest


def test_arms_are_scaled_from_the_robots_own_shoulders() -> None:
    shoulder, elbow, wrist = (size()[POINTS.index(f"l_{joint}")] for joint in ("shoulder", "elbow", "wrist"))
    arm = np.linalg.norm(elbow - shoulder) + np.linalg.norm(wrist - elbow)
    forward = changed(lambda n, p: shoulder + np.array([arm, 0.0, 0.0]) if n == "l_wrist" else p)
    at = desired(human())["pelvis"] + stance().points["l_shoulder"] - stance().points["pelvis"]
    assert np.allclose(desired(human(forward))["l_hand"] - at, [0.23, 0.0, 0.0], atol=1e-9)


@given(st.floats(-0.9, 0.9), st.floats(-0.5, 0.5))
def test_the_trunk_leans_and_twists_with_the_performer(lean: float, twist: float) -> None:
    leans = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), lean)
    turn = rotations.multiply(leans, rotations.from_axis_angle(UP, twist))
    target = landmark_map().desired(bent(turn), DT)
    if lean < 0.8:
        assert rotations.angle_between(np.array(target.trunk), turn) < 0.02
    assert np.allclose(target.gaze, rotations.rotate(turn, np.array([1.0, 0.0, 0.0])), atol=1e-9)


def test_a_lean_beyond_the_robots_is_drawn_in() -> None:
    stiff = landmark_map(Envelope(np.array([0.1, 0.25]), np.full((2, 4), 0.5)))
    target = stiff.desired(bent(rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), 1.2)), DT)
    assert 0.35 < float(rotations.angle_between(np.array(target.trunk), rotations.IDENTITY)) < 0.5


@given(st.floats(0.0, 3.0), st.floats(0.1, 2.0), st.floats(0.05, 0.9))
def test_drawing_in_is_smooth_and_never_reaches_the_most(value: float, most: float, knee: float) -> None:
    inside = soft_cap(value, most, knee)
    assert inside <= most + 1e-12 and inside <= value + 1e-12
    assert inside == value or value > (1.0 - knee) * most
    assert soft_cap(value + 1e-3, most, knee) - inside <= 1e-3 + 1e-9
    assert soft_cap(value + 1e-3, most, knee) >= inside


@pytest.mark.parametrize(("foot", "carrying"), [("l_ankle", Carrying.RIGHT), ("r_ankle", Carrying.LEFT)])
def test_a_lifted_foot_is_no_crouch(foot: str, carrying: Carrying) -> None:
    lifted = replace(human(changed(lambda n, p: p + 0.3 * UP if n == foot else p)), carrying=carrying)
    where = landmark_map()
    upright = desired(human(), where)["pelvis"][2]
    assert abs(desired(lifted, where)["pelvis"][2] - upright) < 1e-3


def test_a_robot_that_hangs_keeps_its_feet_from_each_other_and_its_head_on_its_trunk() -> None:
    robot = load_robot("op3", root="suspended")
    hangs = plant(robot, robot.profile.postures.stand)
    moved = {"l_ankle": np.array([0.0, -0.2, 0.0]), "head": np.array([0.1, 0.0, -0.1])}  # a foot across, a bent neck
    joints = changed(lambda name, point: point + moved.get(name, 0.0))
    target = desired(human(joints), LandmarkMap(robot.profile, dimensions(performer()), hangs, None))
    usual = hangs.points["l_sole"][1] - hangs.points["r_sole"][1]
    assert usual <= target["l_sole"][1] - target["r_sole"][1] < 1.1 * usual
    assert np.allclose(target["head"], hangs.points["head"]) and np.allclose(target["pelvis"], hangs.points["pelvis"])


LEG = 0.21


def settled(hips: Vector, higher: float, legs: tuple[Vector, Vector]) -> float:
    """The height of the pelvis over feet that stay, in lengths of a leg."""
    over = PelvisOverFeet(LEG)
    for _ in range(1000):
        target = over.step(hips, legs, higher, 0.008)
    return target[2] / LEG


def test_a_stride_on_straight_legs_is_no_crouch() -> None:
    """Feet 0.6 of a leg from each other: the hips of the performer are low, and those of the robot are not."""
    stride = ((0.3 * LEG, 0.0, -0.954 * LEG), (-0.3 * LEG, 0.0, -0.954 * LEG))
    assert 0.99 < settled((0.0, 0.0, 0.954 * LEG), 0.0, stride) <= 1.0


@given(st.floats(0.3, 0.95))
def test_a_squat_is_as_deep_as_the_performers(share: float) -> None:
    leg = (0.0, 0.0, -share * LEG)
    assert 0.999 * share <= settled((0.0, 0.0, share * LEG), 0.0, (leg, leg)) <= 1.032 * share


@pytest.mark.parametrize("lift", [30.0, 60.0, 80.0])
@pytest.mark.parametrize("to", [(1.0, 0.0), (0.0, 1.0)])
def test_a_straight_leg_that_is_lifted_bends_no_knee(lift: float, to: tuple[float, float]) -> None:
    """The right leg is straight and vertical, the left one is lifted forward or aside."""
    across, down = LEG * float(np.sin(np.radians(lift))), LEG * float(np.cos(np.radians(lift)))
    lifted = (across * to[0], across * to[1], -down)
    hips = (-0.5 * lifted[0], -0.5 * lifted[1], 0.5 * (LEG + down))
    assert settled(hips, LEG - down, (lifted, (0.0, 0.0, -LEG))) > 0.99


def test_an_invisible_bob_moves_no_knee() -> None:
    """A leg goes up and down by a hundredth of itself twice a second, then bends by half: only that is followed."""
    over, heights = PelvisOverFeet(LEG), []
    for tick in range(750):
        bob = 0.005 * np.sin(4.0 * np.pi * 0.008 * tick)
        share = 0.93 + bob if tick < 500 else 0.5
        leg = (0.0, 0.0, -float(share) * LEG)
        heights.append(over.step((0.0, 0.0, 0.9 * LEG), (leg, leg), 0.0, 0.008)[2] / LEG)
    assert np.ptp(heights[250:500]) < 0.003
    assert heights[530] < 0.55


def test_the_pelvis_is_no_higher_than_the_robot_leans_from() -> None:
    """Straight legs do not tilt hips sideways: a robot that cannot lean at its full height goes down as far as it has
    to, and leans."""
    robot = Envelope(np.array([0.15, 0.2, 0.25]), np.array([[0.9] * 4, [0.9, 0.6, 0.9, 0.6], [0.9, 1e-3, 0.5, 1e-3]]))
    assert robot.highest_for(0.3, 0.0, 1.0) == pytest.approx(0.225, abs=1e-3)
    assert robot.highest_for(0.3, 1.0, 0.0) == robot.highest_for(0.0, 0.0, 1.0) == 0.25
    assert robot.highest_for(2.0, 0.0, -1.0) == 0.15
    for lean in np.linspace(0.0, 0.9, 50):
        height = robot.highest_for(float(lean), 0.6, 0.8)
        assert robot.most_lean(height, 0.6, 0.8) >= lean - 0.02


def test_the_stance_is_upright_and_looks_ahead_and_turns_with_head_and_root() -> None:
    actual = RobotReader(op3(), stance()).read(stance().q)
    assert np.allclose(actual.trunk, rotations.IDENTITY) and np.allclose(actual.gaze, (1.0, 0.0, 0.0))
    assert np.allclose(actual.points, [stance().points[entry.frame] for entry in ROBOT.landmarks.values()])
    assert np.allclose(actual.points, actual.landmarks)
    assert np.allclose(actual.centre_of_mass, op3().kinematics.centre_of_mass(stance().q[None])[0])
    q = stance().q.copy()
    q[op3().body.joint_qpos[op3().body.joint_index("head_pan")]] = 0.5
    turn = rotations.from_axis_angle(UP, 0.3)
    q[3:7] = rotations.multiply(turn, q[3:7])
    actual = RobotReader(op3(), stance()).read(q)
    assert np.allclose(actual.trunk, turn) and np.allclose(actual.gaze, (np.cos(0.8), np.sin(0.8), 0.0))
