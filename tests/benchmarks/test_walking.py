"""The step pattern of `benchmarks.walking`: equations of motion, changes of support, feet, legs and limits."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.walking import Case, run_case, servo_accelerations
from benchmarks.walking_body import WalkingBody
from benchmarks.walking_feedback import Gains, GoalLimits, ankle_torques, turns_against, zmp_shift
from benchmarks.walking_fit import needs
from benchmarks.walking_legs import CHAIN, leg_angles, leg_of
from benchmarks.walking_pattern import LEFT, Gait, Moment, Request, Walk, displacement, rotated
from retarget import rotations
from retarget._solver import Braking
from retarget.ik.gravity_torque import GravityTorque
from retarget.ik.support_polygon import plant
from retarget.model.robot import load_robot
from sim.physics.mount import mount_of
from sim.physics.perturbation import NOMINAL
from sim.physics.world import build_world

GAIT = Gait()
REQUESTS = pytest.mark.parametrize(
    "asked",
    [
        Request(),
        Request(forward=0.15),
        Request(forward=-0.08, turn=0.2),
        Request(left=-0.04),
        Request(forward=0.08, left=0.03, turn=-0.3),
    ],
    ids=str,
)


def moments(asked: Request, *, ticks: int, stop: int | None = None, gait: Gait = GAIT) -> Iterator[Moment]:
    """The moments of a walk whose request grows linearly within 3 s."""
    walk = Walk(gait)
    for tick in range(ticks):
        share = min(tick * gait.dt / 3.0, 1.0)
        now = Request(share * asked.forward, share * asked.left, share * asked.turn)
        yield walk.advance(now if stop is None or tick < stop else None)


@REQUESTS
def test_the_mass_moves_as_a_pendulum_over_its_zero_moment_point(asked: Request) -> None:
    """xi' = w (xi - z) and eta' = -w (eta - z) hold by central differences, across all changes of support."""
    walked = list(moments(asked, ticks=1200))
    far = np.array([one.pendulum.divergent for one in walked])
    near = np.array([one.pendulum.convergent for one in walked])
    zmp = np.array([one.zmp for one in walked])
    for state, rate in ((far, GAIT.omega), (near, -GAIT.omega)):
        speed = (state[2:] - state[:-2]) / (2.0 * GAIT.dt)
        # The zero-moment point goes 0.1 m in 64 ms: differences over 16 ms miss its curvature by some mm/s.
        np.testing.assert_allclose(speed, rate * (state - zmp)[1:-1], atol=0.02)


@REQUESTS
def test_nothing_jumps_where_the_support_changes(asked: Request) -> None:
    """Divergent component, zero-moment point, shares, yaw and both soles go on where they were."""
    walked = list(moments(asked, ticks=1500, stop=1000))
    for before, after in pairwise(walked):
        assert np.abs(after.pendulum.divergent - before.pendulum.divergent).max() < 0.006
        assert np.abs(after.zmp - before.zmp).max() < 0.04
        assert abs(after.shares[LEFT] - before.shares[LEFT]) < 0.25
        assert abs(after.yaw - before.yaw) < 0.01
        for old, new in zip(before.soles, after.soles, strict=True):
            assert np.abs(new.place - old.place).max() < 0.008


@REQUESTS
def test_a_foot_leaves_the_floor_and_comes_down_at_rest(asked: Request) -> None:
    """A sole lifts and lands at less than a hundredth of its greatest speed, and is never below the floor."""
    places = np.array([[sole.place for sole in one.soles] for one in moments(asked, ticks=700)])
    assert places[..., 2].min() >= 0.0
    speed = np.linalg.norm(np.diff(places, axis=0), axis=-1) / GAIT.dt
    for foot in range(2):
        raised = (places[:, foot, 2] > 0.0).astype(int)
        lifts, landings = (np.flatnonzero(np.diff(raised) == change) for change in (1, -1))
        assert len(landings) > 2
        # A path whose speed and acceleration vanish at its ends moves by its jerk alone in the first and last tick.
        assert speed[[*lifts, *landings], foot].max() < 0.01 * speed[:, foot].max()


@REQUESTS
def test_steps_become_what_is_asked(asked: Request) -> None:
    """Once the request stays, each landing is where the request puts it, and soles are never nearer than the gait's
    narrowest."""
    walked = list(moments(asked, ticks=2200))
    landings = list[Moment]()
    for before, after in pairwise(walked):
        if before.carrying != after.carrying and len(landings) < 40:
            landings.append(after)
    for one in landings[-4:]:
        support, other = one.soles[1 - one.carrying], one.soles[one.carrying]
        way = rotated((other.place - support.place)[:2], -support.yaw)
        wanted, turn = displacement(GAIT, asked, one.carrying)
        np.testing.assert_allclose(way, wanted, atol=0.004)
        assert other.yaw - support.yaw == pytest.approx(turn, abs=1e-9)
    apart = [rotated((one.soles[0].place - one.soles[1].place)[:2], -one.yaw)[1] for one in walked]
    assert min(apart) > GAIT.narrowest - 0.004


@pytest.mark.parametrize("stop", [610, 660])
@REQUESTS
def test_a_walk_ends_on_both_feet(asked: Request, stop: int) -> None:
    """Within three steps after the request to stop feet stand side by side, and the mass rests mid-way."""
    *walked, end = moments(asked, ticks=stop + 3 * GAIT.ticks + 250, stop=stop)
    left, right = (rotated(sole.place[:2], -end.yaw) for sole in end.soles)
    np.testing.assert_allclose(left - right, [0.0, GAIT.width], atol=0.02)
    middle = 0.5 * (end.soles[0].place + end.soles[1].place)[:2]
    np.testing.assert_allclose(end.pendulum.mass, middle, atol=1e-3)
    np.testing.assert_allclose(end.zmp, middle, atol=1e-9)
    assert end.shares == pytest.approx((0.5, 0.5))
    assert all(np.array_equal(one.soles[0].place, end.soles[0].place) for one in walked[-200:])


def test_legs_reach_what_their_angles_span() -> None:
    """Angles in closed form are those from which forward kinematics made the sole's pose."""
    robot, chance = load_robot("op3"), np.random.default_rng(0)
    for side in ("l", "r"):
        leg = leg_of(robot, side)
        for _ in range(30):
            angles = leg.signs * chance.uniform([-0.3, -0.3, -0.9, 0.2, -0.9, -0.3], [0.3, 0.3, 0.2, 1.5, 0.2, 0.3])
            q = robot.posture({f"{side}_{name}": angle for name, angle in zip(CHAIN, angles, strict=True)})
            place, turn = (of(q[None], (f"{side}_sole",))[0, 0] for of in (robot.points, robot.orientations))
            found = leg_angles(leg, np.eye(3), q[:3], rotations.to_matrix(turn), place)
            np.testing.assert_allclose(found, angles, atol=5e-4)


def test_torques_of_a_stand_are_those_of_its_weight() -> None:
    """Inverse dynamics with the ground's force split by load agrees with the torques of gravity."""
    robot = load_robot("op3")
    joints = np.zeros(len(robot.joint_map.joints))
    model = build_world(robot, joints, mount=mount_of(robot), perturbation=NOMINAL).model
    body, moment = WalkingBody(robot, model, height=GAIT.height), Walk(GAIT).stand()
    for _ in range(20):
        q = body.posture(moment, GAIT.height, joints)
    torque, speed, acceleration = body.torques((q, q, q), GAIT.dt, moment)
    stance = plant(robot, dict(zip(robot.joint_map.joints, body.joints(q).tolist(), strict=True)))
    dofs = [robot.body.dof_index(joint) for joint in robot.joint_map.joints]
    np.testing.assert_allclose(torque, GravityTorque(robot, stance).torques(stance.q, np.zeros(3))[dofs], atol=0.02)
    assert not speed.any() and not acceleration.any()


def test_an_ankle_presses_where_the_mass_falls() -> None:
    """A mass that falls forward is met by more pressure before the ankle: the torque turns the toes down."""
    shift = zmp_shift(Gains(), np.array([0.01, 0.2]))
    assert shift.tolist() == [0.01, Gains().most_shift[1]]
    # About y a positive turn of the foot lowers its toes; about x it lowers its right side.
    pitch, roll = ankle_torques(np.eye(3)[[1, 0]], np.array([0.01, 0.02]), 30.0)
    assert pitch == pytest.approx(0.3) and roll == pytest.approx(-0.6)


def test_a_hip_turns_the_trunk_back() -> None:
    """The trunk beyond a hip whose leg stands turns against the hip's own sense."""
    (turn,) = turns_against(np.array([[0.0, 1.0, 0.0]]), np.array([0.0, 0.1, 0.0]))
    assert turn == pytest.approx(0.1)


@pytest.mark.parametrize("seed", range(10))
def test_goals_keep_their_limits_and_catch_up(seed: int) -> None:
    """Whatever is asked, speed and acceleration stay within limits; what is asked steadily is reached."""
    chance, dt, n = np.random.default_rng(seed), 0.008, 3
    fastest, most = np.full(n, 4.5), np.full(n, 40.0)
    limits = GoalLimits(Braking(np.full(n, -2.0), np.full(n, 2.0), fastest, most, dt=dt), most * dt**2, np.zeros(n))
    asked = np.cumsum(chance.normal(0.0, 0.03, (150, n)), axis=0)
    asked = np.vstack([asked, np.tile(np.clip(asked[-1], -1.9, 1.9), (150, 1))])
    goals = np.array([np.zeros(n), np.zeros(n), *(limits.limit(np.clip(one, -2.0, 2.0)) for one in asked)])
    assert np.abs(np.diff(goals, axis=0)).max() <= 4.5 * dt + 1e-9
    assert np.abs(np.diff(goals, 2, axis=0)).max() <= 40.0 * dt**2 + 1e-9
    np.testing.assert_allclose(goals[-1], asked[-1], atol=1e-6)


def test_slow_low_steps_fit_the_limits_of_the_profile() -> None:
    """The usual gait keeps the profile's speed and acceleration and its servos' torque at 0.1 m/s; high and quick steps
    do not, and 0.2 m/s is beyond the servos' speed."""
    robot = load_robot("op3")
    world = build_world(robot, np.zeros(len(robot.joint_map.joints)), mount=mount_of(robot), perturbation=NOMINAL)
    most, fastest = robot.limits.max_acceleration.min(), robot.limits.max_velocity.min()
    assert (servo_accelerations(robot, world.model) > most).all()
    usual = needs(robot, world, Case(forward=0.1))
    assert usual.acceleration < most and usual.speed < fastest and usual.torque < 1.0
    assert needs(robot, world, Case(ticks=41, double=6, lift=0.03)).acceleration > most
    assert needs(robot, world, Case(forward=0.2)).speed > fastest


def test_it_walks_in_place() -> None:
    """A robot with mass, noise and play steps in place within its limits, stops, and still stands."""
    (found,) = run_case(Case(seconds=8.0, seed=7))
    assert found.stood > 7.9
    assert found.steps > 6
    assert found.slip < 0.002
    assert not found.touches
