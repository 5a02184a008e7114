"""What legs carry in `stand`, in `rest` and on one leg, against the static balance of the body."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.optimize import linprog

from followers import DT, ROBOTS, dimensions, follower, performer, postures, shipped, stance
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import plant, support_distance
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


@pytest.mark.parametrize("name", ROBOTS)
def test_loads_are_shown_with_the_strength(name: str) -> None:
    robot = shipped(name)
    stand, rest, alone = heaviest_loads(robot)
    assert [load.posture for load in (stand, rest, alone)] == ["in stand", "in rest", "on one leg"]
    assert 0.0 < stand.torque < 0.3 * stand.stall and stand.joint in leg_joints(robot)
    assert 0.0 < rest.torque < 0.6 * rest.stall
    assert alone.share > stand.share
    assert str(rest).endswith(f"N m, {100.0 * rest.torque / rest.stall:.0f}% of its stall torque")
    if name != "poppy":  # the hip's roll joint carries all that it holds up, beside itself
        load, _ = on_one_leg(robot)
        assert "hip_roll" in load.joint.lower() or "HipRoll" in load.joint
        body, local = robot.body, np.zeros((1, 3))
        place = robot.kinematics.points(body.qpos0[None], [body.joint_body[body.joint_index(load.joint)]], local)
        moment = GRAVITY * body.total_mass * abs(float(place[0, 0, 1]))
        assert 0.6 * moment < load.torque < 1.5 * moment


HEIGHT = 0.25


@cache
def balance() -> tuple[StandingBalance, Room]:
    """What `balanced` keeps to."""
    made = StandingBalance(load_priorities("balanced"), stance())
    assert made._room is not None
    return made, made._room


def middle() -> FloatArray:
    """The middle of the soles, HEIGHT above them."""
    return np.array([*np.concatenate([sole.outline for sole in stance().soles]).mean(axis=0), HEIGHT])


def farthest(spaces: FloatArray, direction: FloatArray, com: FloatArray) -> FloatArray:
    """The point at height HEIGHT that is farthest in a direction (2,) from com (3,), inside all half-spaces."""
    low, high = -np.inf, np.inf
    for nx, ny, nz, offset in spaces.tolist():
        along, room = nx * direction[0] + ny * direction[1], offset - nx * com[0] - ny * com[1] - nz * HEIGHT
        if along > 1e-12:
            high = min(high, room / along)
        elif along < -1e-12:
            low = max(low, room / along)
        else:
            assert room > -1e-9
    assert low <= high + 1e-9, "there is always somewhere to go"
    return com + max(low, high) * np.array([*direction, 0.0])


@settings(max_examples=12)
@given(st.floats(0.0, 2.0 * np.pi), st.lists(st.sampled_from([-1.0, 1.0]), min_size=15, max_size=30))
def test_a_mass_that_goes_as_far_as_it_may_stays_over_the_soles(angle: float, turns: list[float]) -> None:
    """To and fro along any line: there is always a next point, and the zero-moment point never leaves."""
    (keeps, room), direction = balance(), np.array([np.cos(angle), np.sin(angle)])
    before = com = middle()
    for turn in np.repeat(turns, 5):
        after = farthest(keeps.spaces(com, (com - before) / DT, DT), turn * direction, com)
        zmp = com - HEIGHT / GRAVITY * (after - 2.0 * com + before) / DT**2
        assert support_distance(zmp, np.array(room.zero_moment_point)) > -1e-6
        before, com = com, after


@pytest.mark.parametrize("name", ["balanced", "balanced_sustained"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_mass_at_rest_at_an_edge_of_its_room_gets_away_from_there(robot: str, name: str) -> None:
    """The zero-moment point has to go beyond that edge for it: a mass that could not press there would never leave."""
    keeps = StandingBalance(load_priorities(name), stance(robot))
    assert keeps._room is not None
    edges = np.array(keeps._room.capture_point)
    for angle in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
        direction = -np.array([np.cos(angle), np.sin(angle)])
        outward = np.maximum(edges[:, :2] @ -direction, 1e-9)
        before = com = np.array([*(-direction * (edges[:, 2] / outward).min()), HEIGHT])
        for _ in range(round(1.0 / DT)):
            after = farthest(keeps.spaces(com, (com - before) / DT, DT), direction, com)
            before, com = com, after
        assert direction @ com[:2] > 0.0, "in a second it is past the middle"


@pytest.mark.parametrize("away", [0.002, 0.01])
@pytest.mark.parametrize("edge", range(8))
def test_from_outside_there_is_a_path_back_in(away: float, edge: int) -> None:
    """A mass that a stop left beyond the room, at rest, gets back there, and never presses beyond the soles for it."""
    keeps, room = balance()
    edges = np.array(room.capture_point)
    direction = edges[edge, :2]
    before = com = np.array([*((edges[edge, 2] + away) * direction), HEIGHT])
    for _ in range(round(2.0 / DT)):
        spaces = keeps.spaces(com, (com - before) / DT, DT)
        room_left = 1e6 * (spaces[:, 3] - spaces[:, :3] @ com)  # [um]
        found = linprog(direction, spaces[:, :2], room_left, bounds=(None, None))
        assert found.success, "there is always somewhere to go"
        after = com + 1e-6 * np.array([*found.x, 0.0])
        zmp = com - HEIGHT / GRAVITY * (after - 2.0 * com + before) / DT**2
        assert support_distance(zmp, keeps.edges) > -1e-6
        capture = after + (after - com) / DT * np.sqrt(HEIGHT / GRAVITY)
        before, com = com, after
        if support_distance(capture, edges) > -3e-4:
            return
    pytest.fail("it stays outside")


@pytest.mark.long
def test_a_robot_that_follows_with_it_keeps_its_zero_moment_point_on_its_soles() -> None:
    """In a hurry: the share of ticks in which the zero-moment point is not where `balanced` keeps it."""
    human, outside = postures(performer(), speed=2.5)[:400], list[float]()
    for robot in (follower(priorities="balanced"), follower()):
        robot.start(human[0])
        com = np.array([robot.step(posture, DT).centre_of_mass for posture in human])
        push = (com[2:] - 2.0 * com[1:-1] + com[:-2]) / DT**2
        zmp = com[1:-1] - com[1:-1, 2:] / (GRAVITY + push[:, 2:]) * push
        distance = support_distance(zmp, np.array(balance()[1].zero_moment_point))
        outside.append(float((distance < -5e-3).mean()))
    assert outside[0] < 0.01 < 0.3 < outside[1]


def strength(name: str) -> StandingStrength:
    return StandingStrength(shipped(name), stance(name), share=0.3)


@pytest.mark.parametrize("name", ROBOTS)
def test_torques_change_as_the_half_spaces_say(name: str) -> None:
    """By finite differences over postures with planted soles: but for the leg's own weight, which is left out."""
    robot, keeps = shipped(name), strength(name)
    body, q = robot.kinematics, plant(robot, robot.profile.postures.attractor).q
    com, before = body.centre_of_mass(q[None])[0], keeps.torques(q)
    by_com, by_joint, places = keeps._gradients(q, com)
    planted = [body.frame_jacobian(q, sole.body, tuple(sole.position.tolist())) for sole in robot.soles]
    free = null_space(np.concatenate(planted))
    errors, sizes = [], []
    for move in 1e-5 * np.random.default_rng(5).normal(size=(20, free.shape[1])) @ free.T:
        there = body.integrate(q, move)
        moved = body.centre_of_mass(there[None])[0] - com
        places_moved = keeps._probe.read(there)[0] - places
        predicted = by_com @ moved[:2] + np.einsum("ki,ki->k", by_joint, places_moved[:, :2])
        sizes.append(keeps.torques(there) - before)
        errors.append(predicted - sizes[-1])
    pitch = [k for k, joint in enumerate(keeps.names) if "knee" in joint.lower() or "ank" in joint.lower()]
    assert np.linalg.norm(np.array(errors)[:, pitch]) < 0.05 * np.linalg.norm(np.array(sizes)[:, pitch])
    assert np.linalg.norm(errors) < 0.25 * np.linalg.norm(sizes)


@pytest.mark.parametrize("speed", [0.0, 0.1, -0.3])
def test_the_mass_is_thrown_neither_up_nor_down(speed: float) -> None:
    spaces = balance()[0].spaces(middle(), np.array([0.0, 0.0, speed]), DT)
    up, down = spaces[np.abs(spaces[:, 2]) == 1.0]
    assert (up[2], down[2]) == (1.0, -1.0)
    np.testing.assert_allclose((up[3] - HEIGHT - speed * DT) / DT**2, HEAVE)
    np.testing.assert_allclose((-down[3] - HEIGHT - speed * DT) / DT**2, -HEAVE)


def test_legs_carry_no_more_than_they_can_for_long() -> None:
    """The greatest share of what ToddlerBot's legs may carry for long, while a performer reaches and crouches."""
    keeps, humans, most = strength("toddlerbot"), postures(performer(), speed=2.0)[:450], list[float]()
    for priorities in ("balanced", "balanced_sustained"):
        follower = Follower(shipped("toddlerbot"), load_priorities(priorities), dimensions(performer()))
        follower.start(humans[0])
        most.append(max(float((np.abs(keeps.torques(follower.step(one, DT).q)) / keeps.most).max()) for one in humans))
    assert most[0] > 1.4
    assert most[1] < 1.3  # for a moment, as a fast crouch is braked
