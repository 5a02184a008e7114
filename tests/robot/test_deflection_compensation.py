"""Goals offset from postures by the deflection of servos, always within the gate's limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import DT, ROBOTS, op3, shipped, stance
from gates import DrivenGate, PathCheck, admit, as_clearance, held, sent
from hardware.arrays import FloatArray
from hardware.bus import ServoGoals
from hardware.servo import integral_rate, loop_lag
from physics_rig import PhysicsRig, ticks
from retarget.ik.gravity_torque import GravityTorque, joint_compliance
from retarget.ik.support_polygon import plant
from retarget.model.robot import RobotBody, robot_of
from retarget.robot.deflection_compensation import MOST_RAD, STILL_RAD, DeflectionCompensation
from retarget.safety.gate import Gate
from retarget.schema.profile_parts import Stiffness
from sim.physics.perturbation import Perturbation

JOINTS = op3().joint_map
STAND = stance().q[op3().servo_columns]
KNEES = [JOINTS.joints.index(name) for name in ("l_knee", "r_knee")]
TINY = 1e-8


def make(
    path_is_clear: PathCheck | None = None, *, start: FloatArray = STAND, robot: RobotBody | None = None
) -> DrivenGate:
    compensation = DeflectionCompensation(robot or op3(), stance(), dt=DT, settle=0.02)
    return DrivenGate(Gate(JOINTS, dt=DT, clearance=as_clearance(path_is_clear), compensation=compensation), start)


def offset(gate: DrivenGate) -> FloatArray:
    """The offset of the goal sent last from the posture that it holds, rad (n,)."""
    return np.asarray(gate.goal.compensated.compensated + gate.goal.compensated.behind)


def load_of(angles: dict[str, float]) -> FloatArray:
    """Deflection of servos (n,) rad in a posture on both soles."""
    planted = plant(op3(), angles)
    torque = GravityTorque(op3(), planted).torques(planted.q, np.zeros(3))
    return np.asarray(joint_compliance(op3()) @ torque[[op3().body.dof_index(joint) for joint in JOINTS.joints]])


def check_motion(goals: FloatArray, start: FloatArray) -> None:
    """Assert that what is sent (T, n), from rest at `start` on, keeps every limit of the servos."""
    steps = np.diff(goals, axis=0, prepend=start[None])
    assert np.all((goals >= JOINTS.lower - TINY) & (goals <= JOINTS.upper + TINY))
    assert np.all(np.abs(steps) <= JOINTS.max_velocity * DT + TINY)
    assert np.all(np.abs(np.diff(steps, axis=0, prepend=0.0)) <= JOINTS.max_acceleration * DT**2 + TINY)


def test_the_offset_of_a_standing_robot_is_the_deflection_of_its_servos() -> None:
    gate = make()
    goals = np.array([admit(gate, STAND) for _ in range(100)])
    np.testing.assert_allclose(goals[-1] - STAND, load_of(op3().profile.postures.stand), atol=STILL_RAD)
    np.testing.assert_array_equal(held(gate), STAND)
    np.testing.assert_array_equal(sent(gate), goals[-1])
    check_motion(goals, STAND)
    knee, last = goals[:, KNEES[0]], goals[-1, KNEES[0]]
    assert np.all(np.diff(knee) * (last - STAND[KNEES[0]]) >= 0.0), "it comes to it from one side"


@pytest.mark.parametrize("known", [True, False])
def test_half_as_stiff_a_robot_is_where_it_was_planned_if_the_plan_knows(known: bool) -> None:
    """Its knees, in physics, after a second of standing: within the friction of the servos, or off by the deflection
    that was not planned for."""
    half = Stiffness.model_validate({"nominal": 9.4378, "range": [5.0, 20.0]})
    soft = robot_of(op3().profile.model_copy(update={"stiffness": {"XM430-W350": half}}), None)
    gate = make(robot=soft if known else op3())
    goals = [admit(gate, STAND) for _ in range(150)]
    rig = PhysicsRig(perturbation=Perturbation(stiffness_scale=0.5))
    rig.arm()
    off = (STAND - JOINTS.to_radians(rig.run(2.5, JOINTS.to_ticks(goals[-1])).position))[KNEES]
    deflection = load_of(op3().profile.postures.stand)[KNEES]
    np.testing.assert_allclose(off, 0.0 if known else deflection, atol=0.01)
    assert np.abs(deflection).min() > 0.02


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31))
def test_for_any_goal_it_keeps_the_limits_and_position_plus_offset_is_the_goal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gate, path, asked = make(), list[FloatArray](), STAND.copy()
    for _ in range(120):
        match rng.integers(8):
            case 0:
                goal = rng.uniform(-4.0, 4.0, len(JOINTS))
            case 1:
                goal = np.full(len(JOINTS), rng.choice([np.nan, np.inf]))
            case 2:
                path.append(gate.brake().joints)
                asked = held(gate)
                continue
            case _:
                goal = asked + rng.normal(0.0, 0.002, len(JOINTS))
        path.append(admit(gate, goal))
        assert gate.goal.passed == bool(np.array_equal(held(gate), goal))
        np.testing.assert_allclose(held(gate) + offset(gate), path[-1], atol=1e-12)
        assert np.abs(offset(gate)).max() <= MOST_RAD
        asked = held(gate)
    check_motion(np.array(path), STAND)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_that_brakes_goes_through_the_postures_that_were_checked(name: str) -> None:
    """Its offsets go on to hold it there: no posture jumps where a goal is refused, and goals keep every limit."""
    robot, paths, dt = shipped(name), list[FloatArray](), 1.0 / shipped(name).profile.safety.rate_hz

    def look(path: FloatArray, instead: FloatArray) -> bool:
        paths.append(path.copy())
        return True

    compensation = DeflectionCompensation(robot, stance(name), dt=dt, settle=0.02)
    posture = stance(name).q[robot.servo_columns]
    gate = Gate(robot.joint_map, dt=dt, clearance=as_clearance(look), compensation=compensation)
    driven = DrivenGate(gate, posture)
    ahead = np.sign(robot.posture(robot.profile.postures.rest)[robot.servo_columns] - posture)
    for tick in range(12):  # ever faster, so that fast servos wait for slow ones
        posture = posture + 0.4 * tick * robot.joint_map.max_acceleration.min() * dt * dt * ahead
        assert driven.check(posture) is not None
    path, before, goals, at_rest = paths[-1], driven.goal, list[FloatArray](), list[bool]()
    assert np.abs(np.diff(path, axis=0)[0]).max() > 1e-3
    for row in [*path[2:], *[path[-1]] * round(1.0 / dt)]:
        np.testing.assert_array_equal(driven.brake().posture, row)
        goals.append(driven.goal.joints)
        at_rest.append(gate.at_rest(driven.goal))
    assert all(at_rest[round(0.35 / dt) :]) and not any(at_rest[: len(path) - 3])
    steps = np.diff(goals, axis=0, prepend=before.joints[None])
    changes = np.diff(steps, axis=0, prepend=before.displacement[None])
    assert (np.abs(changes) <= robot.joint_map.max_acceleration * dt**2 + TINY).all()
    assert (np.abs(steps) <= robot.joint_map.max_velocity * dt + TINY).all()
    assert np.abs(offset(driven) - before.joints + before.posture).max() > 1e-5


def test_what_i_gains_add_in_time_is_left_out() -> None:
    """A shaft with both gains: a spring between goal and shaft, whose goal moves on by the integral of the error."""
    robot, stands, dt = shipped("poppy"), stance("poppy"), 0.02
    posture = stands.q[robot.servo_columns]
    compensation = DeflectionCompensation(robot, stands, dt=dt, settle=0.02)
    state = compensation.begin(posture)
    torque = GravityTorque(robot, stands).torques(stands.q, np.zeros(3))
    deflection = joint_compliance(robot) @ torque[[robot.body.dof_index(joint) for joint in robot.joint_map.joints]]
    rate = np.array([integral_rate(servo) for servo in robot.joint_map.servos])
    added, off = np.zeros_like(posture), list[float]()
    for _ in range(round(20.0 / dt)):
        goal, state = compensation.propose(state, posture, lambda near: near)
        shaft = goal + added - deflection
        added = added + rate * dt * (goal - shaft)
        off.append(float(np.abs(shaft - posture).max()))
    assert np.abs(deflection).max() > 0.01 and rate.max() > 0.2
    assert max(off[150:]) < 0.05 * np.abs(deflection).max()
    assert np.abs((state.compensated + state.behind)[rate > 0.2]).max() < 0.1 * np.abs(deflection).max()


def test_with_a_constant_posture_it_is_soon_at_rest() -> None:
    """The load settles for ever; goals do not: a stop must end."""
    gate = make()
    for tick in range(40):
        admit(gate, STAND + 0.002 * np.sin(0.1 * tick))
    for _ in range(8):  # its own velocity is braked first
        gate.brake()
    posture = held(gate)
    for _ in range(40):
        admit(gate, posture)
        if not gate.goal.displacement.any():
            return
    pytest.fail("it goes on")


def test_collisions_are_looked_for_where_the_robot_is_held() -> None:
    """A refusal changes no offset."""
    paths, alternatives, is_clear = list[FloatArray](), list[FloatArray](), [True]

    def look(path: FloatArray, instead: FloatArray) -> bool:
        paths.append(path.copy())
        alternatives.append(instead.copy())
        return is_clear[-1]

    gate = make(look)
    for tick in range(149):
        if tick == 20:
            before = offset(gate).copy()
            is_clear.append(False)
            assert gate.check(STAND) is None
            np.testing.assert_array_equal(offset(gate), before)
            is_clear.append(True)
        admit(gate, STAND)
        assert tick != 20 or (offset(gate) != before).any()
        np.testing.assert_allclose(paths[-1][:2], np.array([STAND, STAND]), atol=1e-12)
        np.testing.assert_allclose(alternatives[-1][0], STAND, atol=1e-12)
    assert np.abs(offset(gate)).max() > 0.01
    is_clear.append(False)
    admit(gate, STAND + 1e-4)  # refused
    np.testing.assert_allclose(paths[-1][1], STAND + 1e-4, atol=1e-12)
    np.testing.assert_allclose(held(gate), STAND, atol=1e-3)


def test_a_squatting_robot_with_mass_stands_in_its_posture() -> None:
    """In physics: knees under load stand in their posture with compensation, and off it without."""
    rest = op3().profile.postures.rest
    plan = op3().posture(rest)[op3().servo_columns]
    gate, off = make(start=plan), list[float]()
    for _ in range(100):
        goal = admit(gate, plan)
    for goals in (plan, goal):
        rig = PhysicsRig(start=ticks(rest))
        rig.arm()
        states = rig.run(2.0, JOINTS.to_ticks(goals))
        off.append(float(np.abs(JOINTS.to_radians(states.position) - plan)[KNEES].max()))
        rig.bus.write(ServoGoals(states.position))
    assert off[0] > 0.04 > 0.012 > off[1]


def test_legs_wait_for_their_slowest_servo() -> None:
    """Wolfgang's stiff knees, at an even speed, are sent as far behind as its ankles lag more; arms do not wait."""
    robot, stands, joints = shipped("wolfgang"), stance("wolfgang"), shipped("wolfgang").joint_map
    lag = {servo.joint: loop_lag(servo) for servo in joints.servos}
    compensation = DeflectionCompensation(robot, stands, dt=DT, settle=0.02)
    posture, speed = stands.q[robot.servo_columns].copy(), np.zeros(len(joints))
    gate = DrivenGate(Gate(joints, dt=DT, compensation=compensation), posture)
    knee, ankle, elbow = (joints.joints.index(name) for name in ("LKnee", "LAnklePitch", "LElbow"))
    for _ in range(40):
        speed[[knee, ankle, elbow]] = np.minimum(speed[[knee, ankle, elbow]] + 20.0 * DT, 0.5)
        posture = posture + speed * DT
        admit(gate, posture)
        np.testing.assert_array_equal(held(gate), posture)
    assert lag["LAnklePitch"] > 2.0 * lag["LKnee"]
    behind = gate.goal.compensated.behind[[knee, ankle, elbow]]
    np.testing.assert_allclose(behind, [-0.5 * (lag["LAnklePitch"] - lag["LKnee"]), 0.0, 0.0], atol=1e-4)
