"""What legs carry in `stand`, in `rest` and on one leg, against the static balance of the body."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.optimize import linprog

from followers import DT, dimensions, follower, op3, performer, postures
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import plant, support_distance
from retarget.model.robot import RobotBody, load_robot
from retarget.robot.balance import (
    HEAVE,
    Room,
    StandingBalance,
    StandingStrength,
    heaviest_loads,
    leg_joints,
    on_one_leg,
)
from retarget.robot.follower import Follower
from retarget.schema.priorities import load_priorities
from retarget.types import FloatArray

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")


@pytest.mark.parametrize("name", ROBOTS)
def test_loads_are_shown_with_the_strength(name: str) -> None:
    robot = load_robot(name)
    stand, rest, alone = heaviest_loads(robot)
    assert [load.posture for load in (stand, rest, alone)] == ["in stand", "in rest", "on one leg"]
    assert 0.0 < stand.torque < 0.3 * stand.stall and stand.joint in leg_joints(robot)
    assert 0.0 < rest.torque < 0.6 * rest.stall
    assert alone.share > stand.share
    assert str(rest).endswith(f"N m, {100.0 * rest.torque / rest.stall:.0f}% of its stall torque")


@pytest.mark.parametrize("name", ["op3", "toddlerbot", "wolfgang"])
def test_the_hip_carries_all_but_its_leg_beside_itself(name: str) -> None:
    """Its roll joint: the weight of all that it holds up, as far beside it as the middle of the body nearly is."""
    robot = load_robot(name)
    load, _ = on_one_leg(robot)
    assert "hip_roll" in load.joint.lower() or "HipRoll" in load.joint
    body = robot.body
    place = body.solver_body().points(
        body.qpos0[None], [body.joint_body[body.joint_index(load.joint)]], np.zeros((1, 3))
    )
    aside = abs(float(place[0, 0, 1]))
    weight = GRAVITY * body.total_mass
    assert 0.6 * weight * aside < load.torque < 1.5 * weight * aside


HEIGHT = 0.25


@cache
def balance(name: str = "balanced") -> StandingBalance:
    return StandingBalance(load_priorities(name), plant(op3(), op3().profile.postures.stand))


@cache
def room() -> Room:
    """What `balanced` keeps to."""
    found = balance()._room
    assert found is not None
    return found


def farthest(spaces: FloatArray, way: FloatArray, com: FloatArray) -> FloatArray:
    """The point at height HEIGHT that is farthest along a way (2,) from com (3,), inside all half-spaces."""
    low, high = -np.inf, np.inf
    for nx, ny, nz, offset in spaces.tolist():
        along, room = nx * way[0] + ny * way[1], offset - nx * com[0] - ny * com[1] - nz * HEIGHT
        if along > 1e-12:
            high = min(high, room / along)
        elif along < -1e-12:
            low = max(low, room / along)
        else:
            assert room > -1e-9
    assert low <= high + 1e-9, "there is always somewhere to go"
    return com + max(low, high) * np.array([*way, 0.0])


@settings(max_examples=12)
@given(st.floats(0.0, 2.0 * np.pi), st.lists(st.sampled_from([-1.0, 1.0]), min_size=15, max_size=30))
def test_a_mass_that_goes_as_far_as_it_may_stays_over_the_soles(angle: float, turns: list[float]) -> None:
    """To and fro along any line: there is always a next point, and the zero-moment point never leaves."""
    keeps, way = balance(), np.array([np.cos(angle), np.sin(angle)])
    middle = np.concatenate([sole.outline for sole in plant(op3(), op3().profile.postures.stand).soles]).mean(axis=0)
    before = com = np.array([*middle, HEIGHT])
    for turn in np.repeat(turns, 5):
        after = farthest(keeps.spaces(com, (com - before) / DT, DT), turn * way, com)
        zmp = com - HEIGHT / GRAVITY * (after - 2.0 * com + before) / DT**2
        assert support_distance(zmp, np.array(room().zero_moment_point)) > -1e-6
        before, com = com, after


@pytest.mark.parametrize("name", ["balanced", "balanced_sustained"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_mass_at_rest_at_an_edge_of_its_room_gets_away_from_there(robot: str, name: str) -> None:
    """The zero-moment point has to go beyond that edge for it: a mass that could not press there would never leave."""
    stance = plant(load_robot(robot), load_robot(robot).profile.postures.stand)
    keeps = StandingBalance(load_priorities(name), stance)
    assert keeps._room is not None
    edges = np.array(keeps._room.capture_point)
    for angle in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
        way = -np.array([np.cos(angle), np.sin(angle)])
        outward = np.maximum(edges[:, :2] @ -way, 1e-9)
        before = com = np.array([*(-way * (edges[:, 2] / outward).min()), HEIGHT])
        for _ in range(round(1.0 / DT)):
            after = farthest(keeps.spaces(com, (com - before) / DT, DT), way, com)
            before, com = com, after
        assert way @ com[:2] > 0.0, "in a second it is past the middle"


@pytest.mark.parametrize("away", [0.002, 0.01])
@pytest.mark.parametrize("edge", range(8))
def test_from_outside_there_is_a_way_back_in(away: float, edge: int) -> None:
    """A mass that a stop left beyond the room, at rest, gets back there, and never presses beyond the soles for it."""
    keeps, edges = balance(), np.array(room().capture_point)
    way = edges[edge, :2]
    before = com = np.array([*((edges[edge, 2] + away) * way), HEIGHT])
    for _ in range(round(2.0 / DT)):
        spaces = keeps.spaces(com, (com - before) / DT, DT)
        room_left = 1e6 * (spaces[:, 3] - spaces[:, :3] @ com)  # [um]
        found = linprog(way, spaces[:, :2], room_left, bounds=(None, None))
        assert found.success, "there is always somewhere to go"
        after = com + 1e-6 * np.array([*found.x, 0.0])
        zmp = com - HEIGHT / GRAVITY * (after - 2.0 * com + before) / DT**2
        assert support_distance(zmp, keeps.edges) > -1e-6
        capture = after + (after - com) / DT * np.sqrt(HEIGHT / GRAVITY)
        before, com = com, after
        if support_distance(capture, edges) > -3e-4:
            return
    pytest.fail("it stays outside")


def zmp_outside(robot: Follower) -> float:
    """Share of ticks in which a hurried follower's zero-moment point is not where `balanced` keeps it."""
    human = postures(performer(), speed=2.5)[:400]
    robot.start(human[0])
    com = np.array([robot.step(posture, DT).centre_of_mass for posture in human])
    push = (com[2:] - 2.0 * com[1:-1] + com[:-2]) / DT**2
    zmp = com[1:-1] - com[1:-1, 2:] / (GRAVITY + push[:, 2:]) * push
    return float((support_distance(zmp, np.array(room().zero_moment_point)) < -5e-3).mean())


@pytest.mark.long
def test_a_robot_that_follows_with_it_keeps_its_zero_moment_point_on_its_soles() -> None:
    assert zmp_outside(follower(priorities="balanced")) < 0.01 < 0.3 < zmp_outside(follower())


SHARE = 0.3


@cache
def robot(name: str) -> RobotBody:
    return load_robot(name)


def strength(name: str, share: float = SHARE) -> StandingStrength:
    return StandingStrength(robot(name), plant(robot(name), robot(name).profile.postures.stand), share=share)


def planted_moves(name: str, q: FloatArray, count: int) -> FloatArray:
    """Small moves (count, nv) from q (nq,) that leave both soles where they are."""
    body, soles = robot(name).body.solver_body(), robot(name).soles
    rows = [body.frame_jacobian(q, sole.body, tuple(sole.position.tolist())) for sole in soles]
    free = null_space(np.concatenate(rows))
    return np.asarray(1e-5 * np.random.default_rng(5).normal(size=(count, free.shape[1])) @ free.T)


@pytest.mark.parametrize("name", ROBOTS)
def test_torques_change_as_the_half_spaces_say(name: str) -> None:
    """By finite differences over postures with planted soles: but for the leg's own weight, which is left out."""
    keeps, body = strength(name), robot(name).body.solver_body()
    q = plant(robot(name), robot(name).profile.postures.attractor).q
    com, before = body.centre_of_mass(q[None])[0], keeps.torques(q)
    by_com, by_joint, places = keeps._gradients(q, com)
    errors, sizes = [], []
    for move in planted_moves(name, q, 20):
        there = body.integrate(q, move)
        moved = body.centre_of_mass(there[None])[0] - com
        places_moved = keeps._probe.read(there)[0] - places
        said = by_com @ moved[:2] + np.einsum("ki,ki->k", by_joint, places_moved[:, :2])
        errors.append(said - (keeps.torques(there) - before))
        sizes.append(keeps.torques(there) - before)
    pitch = [k for k, joint in enumerate(keeps.names) if "knee" in joint.lower() or "ank" in joint.lower()]
    assert np.linalg.norm(np.array(errors)[:, pitch]) < 0.05 * np.linalg.norm(np.array(sizes)[:, pitch])
    assert np.linalg.norm(errors) < 0.25 * np.linalg.norm(sizes)


@pytest.mark.parametrize("speed", [0.0, 0.1, -0.3])
def test_the_mass_is_thrown_neither_up_nor_down(speed: float) -> None:
    com = np.array(
        [
            *np.concatenate([sole.outline for sole in plant(op3(), op3().profile.postures.stand).soles]).mean(axis=0),
            HEIGHT,
        ]
    )
    spaces = balance().spaces(com, np.array([0.0, 0.0, speed]), DT)
    up, down = spaces[np.abs(spaces[:, 2]) == 1.0]
    assert (up[2], down[2]) == (1.0, -1.0)
    np.testing.assert_allclose((up[3] - HEIGHT - speed * DT) / DT**2, HEAVE)
    np.testing.assert_allclose((-down[3] - HEIGHT - speed * DT) / DT**2, -HEAVE)


def most_used(priorities: str) -> float:
    """Greatest share of what ToddlerBot's legs may carry for long, at rest, while a performer reaches and crouches."""
    follower = Follower(robot("toddlerbot"), load_priorities(priorities), dimensions(performer()))
    keeps, used = strength("toddlerbot"), 0.0
    humans = postures(performer(), speed=2.0)[:450]
    follower.start(humans[0])
    for human in humans:
        used = max(used, float((np.abs(keeps.torques(follower.step(human, DT).q)) / keeps.most).max()))
    return used


def test_legs_carry_no_more_than_they_can_for_long() -> None:
    assert most_used("balanced") > 1.4
    assert most_used("balanced_sustained") < 1.3  # for a moment, as a fast crouch is braked
