"""Goals of one tick: near to where the robot is, towards what is asked, and none for what was not asked."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import DT, follower, op3, performer, postures
from hardware.joint_map import JointMap
from hardware.servo import loop_lag
from retarget._solver import braking_displacement
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import plant
from retarget.ik.tasks import SlotKind
from retarget.model.body import JointLimits
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.following_limits import (
    BENT,
    SLOWEST,
    followed_speed,
    following_limits,
    loaded_speed,
    soft_limits,
)
from retarget.robot.landmarks import AskedLandmarks, RobotReader, limb_names, standing_dofs
from retarget.robot.reference_governor import (
    HELD,
    STANDING,
    ChannelLimits,
    Glide,
    OnlineTrajectory,
    ReferenceGovernor,
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


@pytest.mark.parametrize("dt", [0.008, 0.02])
def test_noise_is_smoothed_and_an_even_motion_is_on_time(dt: float) -> None:
    """A channel through one low pass alone lets through more than that."""
    noise = np.random.default_rng(3).normal(0.0, 1e-3, 4000)

    def follow(asked: FloatArray) -> FloatArray:
        trajectory, rows, last = OnlineTrajectory(CHANNEL), [0.0], 0.0
        for there in asked.tolist():
            step = trajectory.step((there - last, 0.0, 0.0), (there - rows[-1], 0.0, 0.0), dt)
            rows.append(rows[-1] + step[0])
            last = there
        return np.array(rows[1:])

    def jerk(path: FloatArray) -> float:
        return float(np.sqrt((np.diff(path, n=3) ** 2).mean()))

    assert jerk(follow(noise)) < (0.12 if dt < 0.01 else 0.4) * jerk(noise)
    even = 0.1 * dt * np.arange(1000.0)
    assert follow(even)[-1] == pytest.approx(even[-1], abs=1e-5)


# The limits within which a robot follows.


def limits(robot: RobotBody | None = None) -> JointLimits:
    """OP3's, or of another robot that stands."""
    robot = robot or op3()
    return following_limits(robot, plant(robot, robot.profile.postures.stand))


@pytest.mark.parametrize("tracking_delay", [0.0, 0.03, 0.1])
def test_a_servo_at_this_speed_stays_within_the_sustained_error(tracking_delay: float) -> None:
    robot, dt = op3(), 1e-4
    safety = robot.profile.safety
    assert safety.planned_lag is not None
    speeds = followed_speed(robot, limits(robot), tracking_delay=tracking_delay).max_velocity
    for servo in robot.joint_map.servos:
        speed = float(speeds[robot.body.dof_index(servo.joint)])
        delay, share = round((1.0 / safety.rate_hz + tracking_delay) / dt), dt / loop_lag(servo)
        shaft, worst = 0.0, 0.0
        for tick in range(round(0.8 / dt)):
            shaft += share * (speed * max(tick - delay, 0) * dt - shaft)
            worst = max(worst, speed * tick * dt - shaft)
        assert worst == pytest.approx(safety.planned_lag, rel=0.02)


def with_safety(robot: RobotBody, **keys: float | None) -> RobotBody:
    """The robot with other bounds in `safety`."""
    profile = robot.profile
    safety = profile.safety.model_copy(update=keys)
    return replace(robot, profile=profile.model_copy(update={"safety": safety}))


def speeds(robot: RobotBody) -> FloatArray:
    return followed_speed(robot, limits(robot), tracking_delay=0.03).max_velocity


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot", "poppy"])
def test_the_threshold_of_the_fault_changes_no_planned_speed(name: str) -> None:
    robot = load_robot(name)
    for threshold in (None, 0.21, 0.34):
        np.testing.assert_array_equal(speeds(with_safety(robot, following_error_sustained=threshold)), speeds(robot))
    slower = with_safety(robot, planned_lag=0.1)
    assert (speeds(slower) <= speeds(robot)).all() and (speeds(slower) < speeds(robot)).any()


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot", "poppy"])
def test_a_profile_without_planned_lag_keeps_the_speeds_that_it_had(name: str) -> None:
    robot = load_robot(name)
    older = with_safety(robot, planned_lag=None)
    np.testing.assert_array_equal(speeds(older), speeds(robot))
    neither = with_safety(older, following_error_sustained=None)
    np.testing.assert_array_equal(speeds(neither), limits(robot).max_velocity)


def test_no_joint_gets_faster_and_nothing_else_changes() -> None:
    for name in ("op3", "wolfgang", "toddlerbot", "poppy"):
        robot = load_robot(name)
        free = limits(robot)
        slow, slower = (followed_speed(robot, free, tracking_delay=tracking_delay) for tracking_delay in (0.0, 0.03))
        assert (slow.max_velocity <= free.max_velocity).all()
        assert (slower.max_velocity <= slow.max_velocity).all() and (slower.max_velocity[6:] > 0.0).all()
        for part in ("lower", "upper", "max_acceleration"):
            np.testing.assert_array_equal(getattr(slower, part), getattr(free, part))


def test_they_are_those_of_the_servos_but_for_limbs_that_stay_bent() -> None:
    body, servos = op3().body, op3().limits
    kept, drawn_in = limits(), {}
    for index, joint in enumerate(op3().joint_map.joints):
        dof = body.dof_index(joint)
        assert kept.max_velocity[dof] == servos.max_velocity[index]
        assert kept.max_acceleration[dof] == servos.max_acceleration[index]
        if (kept.lower[dof], kept.upper[dof]) != (servos.lower[index], servos.upper[index]):
            drawn_in[joint] = (kept.lower[dof], kept.upper[dof])
    assert set(drawn_in) == {"l_knee", "r_knee", "l_el", "r_el"}
    assert abs(drawn_in["l_knee"][0] - BENT) < 0.06 and abs(drawn_in["r_knee"][1] + BENT) < 0.06
    assert drawn_in["l_el"][1] < -BENT / 2 and drawn_in["r_el"][0] > BENT / 2


def test_a_knee_that_carries_is_slower_and_a_head_is_not() -> None:
    free, loaded = limits(), loaded_speed(op3(), limits(), speed_margin=0.25)
    for joint, expected in (("l_knee", 3.06), ("r_knee", 3.06), ("head_pan", 4.5), ("l_el", 4.5)):
        assert loaded.max_velocity[op3().body.dof_index(joint)] == pytest.approx(expected, abs=0.03)
    assert (loaded.max_velocity <= free.max_velocity).all()
    for name in ("lower", "upper", "max_acceleration"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(free, name))


@pytest.mark.parametrize("name", ["wolfgang", "toddlerbot"])
def test_every_robot_keeps_some_speed(name: str) -> None:
    robot = load_robot(name)
    free = limits(robot)
    loaded = loaded_speed(robot, free, speed_margin=0.25)
    ratio = loaded.max_velocity[6:] / free.max_velocity[6:]
    assert SLOWEST <= ratio.min() < 1.0 or np.isclose(ratio, 1.0).all()
    assert ratio.max() == 1.0


def test_legs_keep_off_and_arms_do_not() -> None:
    free = limits()
    kept = soft_limits(op3(), free, margin=0.05)
    body = op3().body
    for joint, low, high in (("l_hip_pitch", -2.306194, 0.438692), ("l_ank_roll", -1.346263, 1.346263)):
        dof = body.dof_index(joint)
        assert (kept.lower[dof], kept.upper[dof]) == pytest.approx((low, high))
    knee = body.dof_index("l_knee")
    assert kept.upper[knee] == pytest.approx(2.533087)
    assert kept.lower[knee] == free.lower[knee]  # it is kept bent by more than that already
    arm = body.dof_index("l_el")
    assert (kept.lower[arm], kept.upper[arm]) == (free.lower[arm], free.upper[arm])
    for name in ("max_velocity", "max_acceleration"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(free, name))


@pytest.mark.parametrize("name", ["op3", "wolfgang", "toddlerbot", "poppy"])
@pytest.mark.parametrize("margin", [0.02, 0.05, 0.5])
def test_no_robot_loses_how_it_stands(name: str, margin: float) -> None:
    robot = load_robot(name)
    free = limits(robot)
    kept = soft_limits(robot, free, margin=margin)
    assert (kept.lower >= free.lower).all() and (kept.upper <= free.upper).all()
    assert (kept.lower < kept.upper)[6:].all()
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    posture = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    inside = (posture >= kept.lower[dofs] - 1e-12) & (posture <= kept.upper[dofs] + 1e-12)
    was = (posture >= free.lower[dofs] - 1e-12) & (posture <= free.upper[dofs] + 1e-12)
    assert inside[was].all()
    changed = (kept.lower != free.lower) | (kept.upper != free.upper)
    assert not (changed & ~standing_dofs(robot)).any()
