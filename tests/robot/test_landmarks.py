"""What is asked of a robot: scaled limb by limb, in the performer's heading, within what the robot can do."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followers import DT, dimensions, op3, performer
from retarget import rotations
from retarget.arithmetic import soft_cap
from retarget.ik.support_polygon import plant
from retarget.model.human_dimensions import POINTS
from retarget.model.robot import load_robot
from retarget.robot.crouch_envelope import Envelope
from retarget.robot.landmarks import (
    KNEE,
    SETTLE_S,
    Facing,
    FootSeparation,
    LandmarkMap,
    PelvisOverFeet,
    RobotReader,
    foot_separation,
)
from retarget.rotations import Vector, axis_turn
from retarget.types import Carrying, FloatArray, HumanPosture

AHEAD = (0.1, 0.0, -0.02)


def turned(angle: float) -> tuple[float, float, float]:
    return (0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.0)


def yaw(heading: tuple[float, float]) -> float:
    return float(np.arctan2(heading[1], heading[0]))


def test_a_quick_twist_hardly_turns_it_and_a_new_stance_does() -> None:
    facing, straight = Facing(), axis_turn((0.0, 0.0, 1.0), 0.0)
    facing.update(straight, AHEAD, AHEAD, DT)
    twist = axis_turn((0.0, 0.0, 1.0), 0.8)
    for _ in range(int(0.2 / DT)):
        heading = facing.update(twist, AHEAD, AHEAD, DT)
    assert 0.0 < yaw(heading) < 0.1
    for _ in range(int(8.0 * SETTLE_S / DT)):
        heading = facing.update(twist, turned(0.8), turned(0.8), DT)
    assert abs(yaw(heading) - 0.8) < 0.01


def test_directions_that_disagree_hold_it() -> None:
    facing, straight = Facing(), axis_turn((0.0, 0.0, 1.0), 0.0)
    facing.update(straight, AHEAD, AHEAD, DT)
    back = (-0.1, 0.0, 0.0)
    for _ in range(1000):
        heading = facing.update(straight, back, back, DT)
    assert heading == (1.0, 0.0)


ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
LEAST = 0.1
reach = st.floats(-0.5, 0.5)


@cache
def of(name: str) -> FootSeparation | None:
    robot = load_robot(name, root="suspended")
    stance = plant(robot, robot.profile.postures.stand)
    return foot_separation(robot.profile, stance, tuple(robot.profile.landmarks))


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_keeps_its_left_foot_to_the_left_by_as_much_as_it_stands(name: str) -> None:
    feet = of(name)
    assert feet is not None
    rows = tuple(load_robot(name).profile.landmarks)
    assert (rows[feet.left], rows[feet.right]) == ("l_sole", "r_sole")
    assert 0.03 < feet.least < 0.3


def ask(left: Vector, right: Vector) -> tuple[Vector, Vector]:
    landmarks = [right, (1.0, 2.0, 3.0), left]
    FootSeparation(left=2, right=0, least=LEAST).apply(landmarks)
    assert landmarks[1] == (1.0, 2.0, 3.0)
    return landmarks[2], landmarks[0]


@given(reach, reach, st.floats(LEAST * (1.0 + KNEE), 0.5))
def test_what_is_asked_far_apart_stays(x: float, y: float, apart: float) -> None:
    left, right = (x, y + apart, 0.1), (0.0, y, 0.0)
    now = ask(left, right)
    assert now[0] == pytest.approx(left, abs=1e-12) and now[1] == pytest.approx(right, abs=1e-12)


@given(reach, reach)
def test_feet_that_meet_or_cross_pass_side_by_side(left: float, right: float) -> None:
    first, second = ask((0.1, left, 0.2), (-0.1, right, 0.0))
    assert first[1] - second[1] >= LEAST - 1e-12
    assert first[1] + second[1] == pytest.approx(left + right, abs=1e-12)
    assert (first[0], first[2], second[0], second[2]) == (0.1, 0.2, -0.1, 0.0)


@given(st.floats(-0.3, 0.3), st.floats(1e-6, 1e-3))
def test_no_jump_and_no_reversal(apart: float, more: float) -> None:
    """As feet come closer, what is asked comes closer as well, and never faster."""
    here, there = (ask((0.0, way, 0.0), (0.0, 0.0, 0.0)) for way in (apart, apart + more))
    grown = (there[0][1] - there[1][1]) - (here[0][1] - here[1][1])
    assert -1e-12 <= grown <= more + 1e-12


IDENTITIES = np.tile(rotations.IDENTITY, (3, 1))
WIDE = Envelope(np.array([0.1, 0.25]), np.full((2, 4), 1.2))


@cache
def size() -> FloatArray:
    return dimensions(performer()).standing()


def landmark_map(envelope: Envelope | None = WIDE) -> LandmarkMap:
    return LandmarkMap(op3().profile, dimensions(performer()), plant(op3(), op3().profile.postures.stand), envelope)


def human(joints: FloatArray | None = None, orientations: FloatArray = IDENTITIES) -> HumanPosture:
    """A performer with these joint centres (23, 3); absent: standing upright, facing x."""
    joints = size() if joints is None else joints
    return HumanPosture(np.zeros(0), POINTS, joints, orientations, np.zeros(3), np.zeros(0), 0.0, (1.0, 0.0))


def changed(change: Callable[[str, FloatArray], FloatArray]) -> FloatArray:
    return np.array([change(name, point) for name, point in zip(POINTS, size(), strict=True)])


def crouched(share: float) -> FloatArray:
    """Feet nearer to the hips: their height under the pelvis times `share`."""
    return changed(lambda n, p: p * np.array([1.0, 1.0, share]) if "ankle" in n or "toe" in n else p)


def landmarks_ask(posture: HumanPosture, envelope: Envelope | None = WIDE) -> dict[str, FloatArray]:
    where = landmark_map(envelope)
    return dict(zip(where.names, map(np.array, where.desired(posture, DT).landmarks), strict=True))


def test_a_standing_performer_is_a_standing_robot() -> None:
    asked = landmarks_ask(human())
    stance = plant(op3(), op3().profile.postures.stand)
    assert np.allclose(asked["l_sole"], stance.points["l_sole"])
    assert abs(asked["pelvis"][2] - stance.points["pelvis"][2]) < 0.01
    assert np.linalg.norm(asked["head"] - stance.points["head"]) < 0.03
    # Arms hang: a hand is an arm's length under the shoulder.
    assert asked["l_hand"][2] < asked["pelvis"][2]
    assert abs(np.linalg.norm(asked["l_hand"] - asked["r_hand"]) - 0.177) < 0.03


def test_where_the_performer_stands_and_faces_does_not_matter() -> None:
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), 2.0)
    moved = human(rotations.rotate(turn, size()) + np.array([3.0, -1.0, 0.0]), np.tile(turn, (3, 1)))
    here, there = landmarks_ask(human()), landmarks_ask(moved)
    assert all(np.allclose(here[name], there[name], atol=1e-9) for name in here)


def test_a_crouch_is_a_crouch_and_stops_where_the_robot_does() -> None:
    heights = [landmarks_ask(human(crouched(share)))["pelvis"][2] for share in np.linspace(1.0, 0.1, 10)]
    assert (np.diff(heights) < 0.0).all()
    assert heights[0] - heights[2] > 0.03
    assert heights[-1] > WIDE.lowest


def test_arms_are_scaled_from_the_robots_own_shoulders() -> None:
    arm = np.linalg.norm(size()[POINTS.index("l_elbow")] - size()[POINTS.index("l_shoulder")])
    arm += np.linalg.norm(size()[POINTS.index("l_wrist")] - size()[POINTS.index("l_elbow")])
    shoulder = size()[POINTS.index("l_shoulder")]
    forward = changed(lambda n, p: shoulder + np.array([arm, 0.0, 0.0]) if n == "l_wrist" else p)
    asked = landmarks_ask(human(forward))["l_hand"]
    stance = plant(op3(), op3().profile.postures.stand)
    at = landmarks_ask(human())["pelvis"] + stance.points["l_shoulder"] - stance.points["pelvis"]
    assert np.allclose(asked - at, [0.23, 0.0, 0.0], atol=1e-9)


@given(st.floats(-0.9, 0.9), st.floats(-0.5, 0.5))
def test_the_trunk_leans_and_twists_with_the_performer(lean: float, twist: float) -> None:
    turn = rotations.multiply(
        rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), lean),
        rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), twist),
    )
    legs = ("hip", "knee", "ankle", "toe")
    bent = changed(lambda n, p: p if n.endswith(legs) else rotations.rotate(turn, p - hips()) + hips())
    asked = landmark_map().desired(human(bent, np.array([rotations.IDENTITY, turn, turn])), DT)
    if lean < 0.8:
        assert rotations.angle_between(np.array(asked.trunk), turn) < 0.02
    assert np.allclose(asked.gaze, rotations.rotate(turn, np.array([1.0, 0.0, 0.0])), atol=1e-9)


def test_a_lean_beyond_the_robots_is_drawn_in() -> None:
    turn = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), 1.2)
    legs = ("hip", "knee", "ankle", "toe")
    bent = changed(lambda n, p: p if n.endswith(legs) else rotations.rotate(turn, p - hips()) + hips())
    stiff = Envelope(np.array([0.1, 0.25]), np.full((2, 4), 0.5))
    trunk = np.array(landmark_map(stiff).desired(human(bent, np.array([rotations.IDENTITY, turn, turn])), DT).trunk)
    lean = float(rotations.angle_between(trunk, rotations.IDENTITY))
    assert 0.35 < lean < 0.5


@given(st.floats(0.0, 3.0), st.floats(0.1, 2.0), st.floats(0.05, 0.9))
def test_drawing_in_is_smooth_and_never_reaches_the_most(value: float, most: float, knee: float) -> None:
    inside = soft_cap(value, most, knee)
    assert inside <= most + 1e-12 and inside <= value + 1e-12
    assert inside == value or value > (1.0 - knee) * most
    assert soft_cap(value + 1e-3, most, knee) - inside <= 1e-3 + 1e-9
    assert soft_cap(value + 1e-3, most, knee) >= inside


def hips() -> FloatArray:
    return np.asarray(0.5 * (size()[POINTS.index("l_hip")] + size()[POINTS.index("r_hip")]))


@pytest.mark.parametrize(("foot", "carrying"), [("l_ankle", Carrying.RIGHT), ("r_ankle", Carrying.LEFT)])
def test_a_lifted_foot_is_no_crouch(foot: str, carrying: Carrying) -> None:
    lifted = replace(human(changed(lambda n, p: p + np.array([0.0, 0.0, 0.3]) if n == foot else p)), carrying=carrying)
    where = landmark_map()
    row = where.names.index("pelvis")
    upright = where.desired(human(), DT).landmarks[row][2]
    assert abs(where.desired(lifted, DT).landmarks[row][2] - upright) < 1e-3


def test_a_robot_that_hangs_keeps_its_feet_apart_and_its_head_on_its_trunk() -> None:
    robot = load_robot("op3", root="suspended")
    stance = plant(robot, robot.profile.postures.stand)
    where = LandmarkMap(robot.profile, dimensions(performer()), stance, None)
    moved = {"l_ankle": np.array([0.0, -0.2, 0.0]), "head": np.array([0.1, 0.0, -0.1])}  # a foot across, a bent neck
    joints = changed(lambda name, point: point + moved.get(name, 0.0))
    asked = dict(zip(where.names, map(np.array, where.desired(human(joints), DT).landmarks), strict=True))
    apart = stance.points["l_sole"][1] - stance.points["r_sole"][1]
    assert apart <= asked["l_sole"][1] - asked["r_sole"][1] < 1.1 * apart
    assert np.allclose(asked["head"], stance.points["head"]) and np.allclose(asked["pelvis"], stance.points["pelvis"])


LEG = 0.21
STRAIGHT = ((0.0, 0.0, -LEG), (0.0, 0.0, -LEG))


def settled(hips: Vector, higher: float, legs: tuple[Vector, Vector] = STRAIGHT) -> Vector:
    over = PelvisOverFeet(LEG)
    for _ in range(1000):
        asked = over.step(hips, legs, higher, 0.008)
    return asked


def test_a_stride_on_straight_legs_is_no_crouch() -> None:
    """Feet 0.6 of a leg apart: the hips of the performer are low, and those of the robot are not."""
    stride = ((0.3 * LEG, 0.0, -0.954 * LEG), (-0.3 * LEG, 0.0, -0.954 * LEG))
    hips = settled((0.0, 0.0, 0.954 * LEG), 0.0, stride)
    assert 0.99 * LEG < hips[2] <= LEG


@given(st.floats(0.3, 0.95))
def test_a_squat_is_as_deep_as_the_performers(share: float) -> None:
    legs = ((0.0, 0.0, -share * LEG), (0.0, 0.0, -share * LEG))
    height = settled((0.0, 0.0, share * LEG), 0.0, legs)[2]
    assert 0.999 * share * LEG <= height <= 1.032 * share * LEG


@pytest.mark.parametrize("lift", [30.0, 60.0, 80.0])
@pytest.mark.parametrize("to", [(1.0, 0.0), (0.0, 1.0)])
def test_a_straight_leg_that_is_lifted_bends_no_knee(lift: float, to: tuple[float, float]) -> None:
    """The right leg is straight and vertical, the left one is lifted forward or aside."""
    across, down = LEG * float(np.sin(np.radians(lift))), LEG * float(np.cos(np.radians(lift)))
    lifted = (across * to[0], across * to[1], -down)
    hips = (-0.5 * lifted[0], -0.5 * lifted[1], 0.5 * (LEG + down))
    assert settled(hips, LEG - down, (lifted, STRAIGHT[1]))[2] > 0.99 * LEG


def test_a_bob_that_nobody_sees_moves_no_knee() -> None:
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


# Where a robot's parts are, and their names in priorities.


def test_the_stance_is_upright_and_looks_ahead() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    reached = RobotReader(op3(), stance).read(stance.q)
    assert np.allclose(reached.trunk, rotations.IDENTITY) and np.allclose(reached.gaze, (1.0, 0.0, 0.0))
    frames = [entry.frame for entry in op3().profile.landmarks.values()]
    assert np.allclose(reached.points, [stance.points[name] for name in frames])
    assert np.allclose(reached.points, reached.landmarks)
    assert np.allclose(reached.centre_of_mass, op3().body.solver_body().centre_of_mass(stance.q[None])[0])


def test_turning_head_and_root_turns_gaze_and_trunk() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    q = stance.q.copy()
    q[op3().body.joint_qpos[op3().body.joint_index("head_pan")]] = 0.5
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), 0.3)
    q[3:7] = rotations.multiply(turn, q[3:7])
    reached = RobotReader(op3(), stance).read(q)
    assert np.allclose(reached.trunk, turn) and np.allclose(reached.gaze, (np.cos(0.8), np.sin(0.8), 0.0))
