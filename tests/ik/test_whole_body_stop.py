"""How a robot on its soles stops: within the limits of its servos, its mass braked evenly, its soles in place."""

from itertools import pairwise

import numpy as np
import pytest

from followers import DT, follow, follower, op3, performer, postures, stance
from retarget._solver import MASS_BRAKING
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import footing
from retarget.ik.whole_body_stop import LONGEST_STOP_TICKS, StopPath, WholeBodyStop
from retarget.robot.following_limits import following_limits, servo_limits
from retarget.robot.landmarks import standing_dofs
from retarget.safety.standing import SOLE_M
from retarget.types import FloatArray

UP = np.eye(6)[2]
"""A root that rises at 1 m/s."""


def planner(*, tips: bool = True) -> WholeBodyStop:
    where, robot = stance(), op3()
    limits = following_limits(robot, where), servo_limits(robot)
    return WholeBodyStop(robot.body, *limits, where, standing_dofs(robot), tips=tips)


def moving(q: FloatArray, root: FloatArray) -> FloatArray:
    """Velocity (nv,) of a robot on planted soles in posture q (nq,) whose root moves at `root` (6,)."""
    body, rows = op3().body.solver_body(), []
    for sole in stance().soles:
        x, y, z = sole.frame.position.tolist()
        rows.append(body.frame_jacobian(q, sole.frame.body, (x, y, z)))
    rows.append(np.eye(6, op3().body.nv))
    return np.asarray(np.linalg.lstsq(np.concatenate(rows), np.concatenate([np.zeros(12), root]), rcond=None)[0])


def velocities(path: StopPath) -> FloatArray:
    """Velocities (k, nv) per s from row to row, and none at the end."""
    body, rows = op3().kinematics, path.postures
    moved = [body.difference(a, b) / DT for a, b in pairwise(rows)]
    return np.array([*moved, np.zeros(op3().body.nv)])


@pytest.mark.parametrize("speed", [0.1, 0.0])
def test_a_stop_keeps_soles_and_accelerations_and_ends_at_rest(speed: float) -> None:
    """An arm brakes also where the legs stand already, and a robot that stands is stopped already."""
    velocity, where = moving(stance().q, speed * UP), stance()
    velocity[op3().body.dof_index("l_sho_pitch")] = 3.0
    path = planner().path(where.q, velocity, DT)
    changes = np.diff(velocities(path), axis=0, prepend=velocity[None])
    assert (np.abs(changes) <= servo_limits(op3()).max_acceleration * DT * (1.0 + 1e-6)).all()
    assert footing(op3().kinematics, where.soles).losses(path.postures)[0] < SOLE_M
    assert 5 < len(path.postures) < 40
    stopped = planner().path(where.q, np.zeros(op3().body.nv), DT)
    assert np.array_equal(stopped.postures, where.q[None])


def test_a_fast_crouch_comes_to_rest_whatever_arms_do() -> None:
    """Joints that made up for what soles had cost them went to and fro at their full acceleration, and did not rest."""
    plans, random = planner(), np.random.default_rng(0)
    arms = [op3().body.dof_index(joint) for joint in op3().joint_map.joints if "sho" in joint or "el" in joint]
    for _ in range(20):
        velocity = moving(stance().q, -0.15 * UP)
        velocity[arms] = random.uniform(-4.0, 4.0, len(arms))
        assert len(plans.path(stance().q, velocity, DT).postures) < LONGEST_STOP_TICKS


def test_a_mass_that_nothing_tips_brakes_with_its_joints() -> None:
    aside = moving(stance().q, np.array([0.0, 0.12, 0.0, 0.0, 0.0, 0.0]))
    rows = [len(planner(tips=tips).path(stance().q, aside, DT).postures) for tips in (True, False)]
    assert rows[1] < 0.7 * rows[0] and (rows[0] - 1) * DT == pytest.approx(0.12 / MASS_BRAKING, abs=4 * DT)


def test_a_joint_beyond_its_range_goes_no_farther_than_it_must() -> None:
    """A posture may stand beyond a soft limit; its stop does not pull it back."""
    q, where = stance().q.copy(), following_limits(op3(), stance())
    dof, column = op3().body.dof_index("l_el"), int(op3().servo_columns[op3().joint_map.joints.index("l_el")])
    q[column] = where.lower[dof] - 0.1
    velocity = np.zeros(op3().body.nv)
    velocity[op3().body.dof_index("r_sho_pitch")] = 3.0
    path = planner().path(q, velocity, DT)
    np.testing.assert_allclose(path.postures[:, column], q[column], atol=1e-5)


@pytest.mark.long
def test_the_mass_brakes_evenly_and_softly_whatever_the_limbs_do() -> None:
    """Joints that stopped one after the other would throw it."""
    human, random = postures(performer()), np.random.default_rng(1)
    done = follow(follower(), human[: len(human) // 2]).q
    plans, body, stopped = planner(), op3().kinematics, 0
    for q in done[:: len(done) // 60]:
        velocity = moving(q, random.normal(size=6) * (0.05, 0.05, 0.05, 0.2, 0.2, 0.2))
        velocity[op3().body.dof_index("l_sho_pitch")] = 3.0
        path = plans.path(q, velocity, DT)
        if footing(body, stance().soles).losses(path.postures)[0] > SOLE_M:
            continue
        speeds = np.diff(body.centre_of_mass(path.postures), axis=0) / DT
        first = body.centre_of_mass_jacobian(q) @ velocity
        changes = np.diff(speeds, axis=0, prepend=first[None])
        pendulum = np.sqrt(body.centre_of_mass(stance().q[None])[0, 2] / GRAVITY)
        soft = max(MASS_BRAKING, float(np.linalg.norm(first)) / pendulum) * DT
        assert np.linalg.norm(changes, axis=1).max() < 1.05 * soft + 1e-4
        across = speeds - np.outer(speeds @ first, first) / (first @ first)
        assert np.linalg.norm(across, axis=1).max() < 0.005
        stopped += 1
    assert stopped > 30
