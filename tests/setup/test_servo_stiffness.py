"""The fit of a stiffness from held goals, the goals themselves, and what is refused before anything moves."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hardware.servo import find_model
from messages import refuses
from retarget.errors import UsageError
from retarget.model.robot import RobotBody, load_robot
from retarget.setup.servo_stiffness import HeldGoals, Hung, fit, held_goals, load_torques, measured

DT = 0.008
TICK = find_model("XM430-W350").tick_rad


@cache
def hanging(name: str = "op3") -> RobotBody:
    return load_robot(name, root="fixed")


@cache
def knee() -> HeldGoals:
    return held_goals(hanging(), "l_knee", Hung(0.5, "l_sole"), dt=DT)


def readings(stiffness: float, *, friction: float, zero: float, gear: float = 1.0) -> tuple[HeldGoals, np.ndarray]:
    """Goals, and what the encoder of a shaft of this stiffness reads of them."""
    held = knee()
    held = replace(held, servo=replace(held.servo, gear=gear))
    goals, column = held.goals, held.column
    moved = np.sign(np.diff(goals[:, column], prepend=goals[0, column] - 1.0))
    for row in np.flatnonzero(moved == 0.0):
        moved[row] = moved[row - 1]
    rest = np.diff(goals[:, column], prepend=np.nan) == 0.0
    present = goals.copy()
    for _ in range(6):  # the load is that of where the joint gets
        torque = np.zeros(len(goals))
        torque[rest] = load_torques(hanging(), column, present[rest], Hung(0.5, "l_sole"))
        present[:, column] = goals[:, column] - (torque / gear + friction * moved) / stiffness / gear - zero
    present[:, column] = np.rint(gear * present[:, column] / TICK) * TICK / gear
    return held, present


@pytest.mark.parametrize("gear", [1.0, 1.5])
@pytest.mark.parametrize("stiffness", [5.3, 9.45, 18.9, 40.0])
def test_the_stiffness_that_went_in_comes_out_within_its_uncertainty(stiffness: float, gear: float) -> None:
    held, present = readings(stiffness, friction=0.1, zero=0.004, gear=gear)
    found = measured(hanging(), held, held.goals, present, Hung(0.5, "l_sole"), dt=DT)
    assert found is not None and found.lowest <= stiffness <= found.highest
    assert found.highest - found.lowest < 0.25 * stiffness and found.value == pytest.approx(stiffness, rel=0.1)
    assert found.friction == pytest.approx(0.1, abs=0.03)
    without = measured(hanging(), held, held.goals, present, None, dt=DT)
    assert without is None or without.value < 0.5 * stiffness, "a load that is not known of is not measured"


def test_the_uncertainty_holds_as_often_as_it_says() -> None:
    torque, side = np.tile(np.linspace(-0.4, 1.2, 6), 2), np.repeat([1, -1], 6)
    within, seeds = 0, 400
    for seed in range(seeds):
        noise = np.random.default_rng(seed).normal(0.0, TICK, len(torque))
        found = fit(torque, torque / 18.9 + 0.002 + 0.005 * side + noise, side, resolution=TICK)
        within += found is not None and found.lowest <= 18.9 <= found.highest
    assert within >= 0.9 * seeds, within
    exact = fit(torque, torque / 18.9 + 0.002 + 0.005 * side, side, resolution=1e-9)
    assert exact is not None and exact.value == pytest.approx(18.9) and exact.friction == pytest.approx(0.0945)
    assert fit(torque, 0.005 * side + 0.0 * torque, side, resolution=TICK) is None


def test_the_load_is_the_slope_of_the_potential_energy() -> None:
    robot, held = hanging(), knee()
    rows, eps = held.goals[::500], 1e-5
    solver, frame = robot.body.solver_body(), ("l_sole",)

    def energy(joints: np.ndarray) -> np.ndarray:
        q = np.tile(robot.body.qpos0, (len(joints), 1))
        q[:, robot.servo_columns] = joints
        own = robot.body.total_mass * solver.centre_of_mass(q)[:, 2]
        return np.asarray(9.81 * (own + 0.5 * robot.points(q, frame)[:, 0, 2]))

    step = np.zeros(rows.shape[1])
    step[held.column] = eps
    slope = (energy(rows + step) - energy(rows - step)) / (2.0 * eps)
    np.testing.assert_allclose(load_torques(robot, held.column, rows, Hung(0.5, "l_sole")), slope, atol=1e-6)
    assert np.ptp(slope) > 0.5


def test_goals_are_slow_within_limits_and_held_from_both_sides() -> None:
    robot, held = hanging(), knee()
    track, servo = held.goals[:, held.column], held.servo
    stand = robot.posture(robot.profile.postures.stand)[robot.servo_columns]
    others = np.delete(np.arange(len(stand)), held.column)
    np.testing.assert_array_equal(held.goals[:, others], np.tile(stand[others], (len(track), 1)))
    assert servo.lower < track.min() < stand[held.column] < track.max() < servo.upper
    assert np.abs(np.diff(track)).max() / DT <= robot.profile.safety.speed_caps.approach * servo.max_velocity
    assert np.abs(np.diff(track, n=2)).max() / DT**2 <= servo.max_acceleration


@pytest.mark.parametrize(
    ("name", "joint", "says"),
    [
        ("op3", "l_kneee", "no such joint"),
        ("op3", "head_pan", "too little load"),
        ("toddlerbot", "left_knee", "too little load"),  # at its own gain; at the usual one it were enough
        ("poppy", "l_hip_y", "an I gain"),
        ("toddlerbot", "waist_roll", "two servos"),
    ],
)
def test_a_joint_that_cannot_be_measured_is_refused(name: str, joint: str, says: str) -> None:
    with refuses(UsageError, "--joint", says):
        held_goals(hanging(name), joint, None, dt=DT)
