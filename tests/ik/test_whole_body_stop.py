"""A robot on its soles that can always stop: what is refused, and that the way to a stop keeps everything."""

import numpy as np
import pytest

from followers import DT, follow, follower, op3, performer, postures
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance, plant
from retarget.ik.whole_body_stop import BRAKING, SOLE_M, Stopping
from retarget.robot.following_limits import following_limits, servo_limits
from retarget.robot.landmarks import standing_dofs
from retarget.types import FloatArray


def stance() -> Stance:
    return plant(op3(), op3().profile.postures.stand)


def stopping() -> Stopping:
    where = stance()
    return Stopping(op3().body, following_limits(op3(), where), servo_limits(op3()), where, standing_dofs(op3()))


def upward(speed: float) -> FloatArray:
    """Velocity (nv,) of a robot that rises straight at `speed` m/s on planted soles, from its standing posture."""
    return moving(stance().q, np.array([0.0, 0.0, speed, 0.0, 0.0, 0.0]))


def moving(q: FloatArray, root: FloatArray) -> FloatArray:
    """Velocity (nv,) of a robot on planted soles in posture q (nq,) whose root moves at `root` (6,)."""
    body, rows = op3().body.solver_body(), []
    for sole in stance().soles:
        x, y, z = sole.frame.position.tolist()
        rows.append(body.frame_jacobian(q, sole.frame.body, (x, y, z)))
    rows.append(np.eye(6, op3().body.nv))
    return np.asarray(np.linalg.lstsq(np.concatenate(rows), np.concatenate([np.zeros(12), root]), rcond=None)[0])


def step(guard: Stopping) -> tuple[FloatArray, FloatArray]:
    """The next posture on a way that is known, and its velocity."""
    found = guard.follow(DT)
    assert found is not None
    return found


def test_a_slow_rise_is_admitted_and_one_into_straight_knees_is_not() -> None:
    assert stopping().admits(stance().q, upward(0.05), DT)
    assert not stopping().admits(stance().q, upward(0.6), DT)


def test_a_centre_of_mass_over_the_edge_is_not_admitted() -> None:
    q = stance().q.copy()
    q[0] += 0.2
    assert not stopping().admits(q, np.zeros(op3().body.nv), DT)


def test_the_way_to_a_stop_keeps_soles_and_accelerations_and_ends_at_rest() -> None:
    guard, velocity = stopping(), upward(0.1)
    arm = op3().body.dof_index("l_sho_pitch")
    velocity[arm] = 3.0
    where = stance()
    assert guard.admits(where.q, velocity, DT)
    before = velocity
    for _ in range(30):
        q, now = step(guard)
        limits = servo_limits(op3()).max_acceleration
        assert (np.abs(now - before) <= limits * DT * (1.0 + 1e-6)).all()
        for sole in where.soles:
            corners = op3().body.solver_body().points(q[None], [sole.frame.body] * len(sole.corners), sole.corners)[0]
            assert np.linalg.norm(corners[:, :2] - sole.outline, axis=1).max() < SOLE_M
        before = now
    assert np.abs(before).max() < 1e-9


def test_arms_brake_within_their_limits_where_the_legs_stand_already() -> None:
    guard, where = stopping(), stance()
    arm, limits = op3().body.dof_index("l_sho_pitch"), servo_limits(op3())
    before = np.zeros(op3().body.nv)
    before[arm] = 3.0
    assert guard.admits(where.q, before, DT)
    ticks = 0
    while np.abs(before).max() > 1e-9:
        _, now = step(guard)
        assert (np.abs(now - before) <= limits.max_acceleration * DT * (1.0 + 1e-6)).all()
        before, ticks = now, ticks + 1
    assert ticks > 5


def test_a_fast_crouch_is_stopped_whatever_arms_do() -> None:
    """Joints that made up for what soles had cost them went to and fro at their full acceleration, and did not rest."""
    guard, where, random = stopping(), stance(), np.random.default_rng(0)
    arms = [op3().body.dof_index(joint) for joint in op3().joint_map.joints if "sho" in joint or "el" in joint]
    for _ in range(20):
        velocity = upward(-0.15)
        velocity[arms] = random.uniform(-4.0, 4.0, len(arms))
        guard.begin(where.q)
        assert guard.admits(where.q, velocity, DT)


@pytest.mark.long
def test_the_mass_brakes_evenly_and_softly_whatever_the_limbs_do() -> None:
    """Joints that stopped one after the other would throw it."""
    human, random = postures(performer()), np.random.default_rng(1)
    done = follow(follower(), human[: len(human) // 2]).q
    guard, body, stopped = stopping(), op3().body.solver_body(), 0
    for q in done[:: len(done) // 60]:
        velocity = moving(q, random.normal(size=6) * (0.05, 0.05, 0.05, 0.2, 0.2, 0.2))
        velocity[op3().body.dof_index("l_sho_pitch")] = 3.0
        guard.begin(stance().q)
        if not guard.admits(q, velocity, DT):
            continue
        way = np.array([q, *(step(guard)[0] for _ in range(60))])
        speeds = np.diff(body.centre_of_mass(way), axis=0) / DT
        first = body.centre_of_mass_jacobian(q) @ velocity
        changes = np.diff(speeds, axis=0, prepend=first[None])
        height = float(body.centre_of_mass(q[None])[0, 2])
        soft = max(BRAKING, float(np.linalg.norm(first)) / np.sqrt(height / GRAVITY)) * DT
        assert np.linalg.norm(changes, axis=1).max() < 1.05 * soft + 1e-4
        across = speeds - np.outer(speeds @ first, first) / (first @ first)
        assert np.linalg.norm(across, axis=1).max() < 0.005
        stopped += 1
    assert stopped > 30


def test_without_a_way_every_joint_brakes_within_its_limits() -> None:
    guard, where, before = stopping(), stance(), upward(0.6)
    limits, q = servo_limits(op3()).max_acceleration, where.q
    guard.begin(q, before)
    ticks = 0
    while np.abs(before[6:]).max() > 1e-9:
        after = guard.brake(DT)
        now = op3().body.solver_body().difference(q, after) / DT
        assert (np.abs(now - before)[6:] <= limits[6:] * DT * (1.0 + 1e-6)).all()
        guard.begin(after, now)
        q, before, ticks = after, now, ticks + 1
    assert ticks > 5


def test_what_is_already_lost_may_go_on_as_long_as_it_does_not_get_worse() -> None:
    guard, q = stopping(), stance().q.copy()
    q[2] += 0.01
    guard.begin(q)
    still = np.zeros(op3().body.nv)
    assert guard.admits(q, still, DT)
    worse = q.copy()
    worse[2] += 0.001
    assert not guard.admits(worse, still, DT)


def test_many_small_steps_off_the_ground_do_not_add_up() -> None:
    guard, q = stopping(), stance().q.copy()
    guard.begin(q)
    q[2] += SOLE_M
    rises = 0
    while rises < 50 and guard.admits(q, np.zeros(op3().body.nv), DT):
        q[2] += 9e-6
        rises += 1
    assert rises < 5


def test_a_follower_without_a_way_asks_no_servo_for_more_than_it_can() -> None:
    """Its posture is a goal like any other: the gate is to let it pass."""
    human, robot = postures(performer())[0], follower()
    limits, dofs = op3().limits, [op3().body.dof_index(joint) for joint in op3().joint_map.joints]
    before = upward(0.6)
    stands, q = robot.start(human), stance().q
    robot.reseed(q, before)
    assert robot.halt(DT) is None
    last, speed, height = stands.joint_positions, before[dofs], []
    for _ in range(70):
        posture = robot.step(human, DT)
        now = (posture.joint_positions - last) / DT
        assert (np.abs(now - speed) <= limits.max_acceleration * DT * (1.0 + 1e-6)).all()
        last, speed = posture.joint_positions, now
        height.append(float(posture.q[2]))
    assert max(height) > stance().q[2] + 0.005  # the root goes on with the legs
    assert robot.halt(DT) is not None
