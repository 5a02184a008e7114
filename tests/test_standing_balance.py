"""A centre of mass that goes as far as it may keeps its zero-moment point inside, and can always be stopped."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from followers import DT, follower, op3, performer, postures
from retarget.follow import Follower
from retarget.priorities import Priorities, load_priorities
from retarget.rotations import FloatArray
from retarget.stance import plant
from retarget.standing_balance import BEYOND_M, GRAVITY, StandingBalance
from retarget.support import support_distance
from support.messages import refuses

HEIGHT = 0.25


def balance(name: str = "steady") -> StandingBalance:
    return StandingBalance(load_priorities(name), plant(op3(), op3().profile.postures.stand))


def shrunk() -> FloatArray:
    """Edges (e, 3) that `steady` keeps to."""
    return np.array(balance()._room)


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
def test_whoever_goes_as_far_as_it_may_stays_on_its_soles(angle: float, turns: list[float]) -> None:
    """To and fro along any line: there is always a next point, and the zero-moment point never leaves."""
    keeps, way = balance(), np.array([np.cos(angle), np.sin(angle)])
    middle = np.concatenate([sole.outline for sole in plant(op3(), op3().profile.postures.stand).soles]).mean(axis=0)
    before = com = np.array([*middle, HEIGHT])
    for turn in np.repeat(turns, 5):
        after = farthest(keeps.spaces(com, (com - before) / DT, DT), turn * way, com)
        zmp = com - HEIGHT / GRAVITY * (after - 2.0 * com + before) / DT**2
        assert support_distance(zmp, shrunk()) > -1e-6
        before, com = com, after


def test_at_the_edge_of_its_room_a_robot_that_lands_may_be_pushed_in() -> None:
    """The zero-moment point has to go beyond that edge for it."""
    keeps, still, (nx, ny, offset) = balance(), np.zeros(3), balance()._room[0]
    com = np.array([nx * offset, ny * offset, HEIGHT])
    inward = com - np.array([nx, ny, 0.0]) * GRAVITY / HEIGHT * 0.005 * DT**2  # as from 5 mm farther out
    follows, lands = keeps.spaces(com, still, DT), keeps.spaces(com, still, DT, lands=True)
    assert (follows[:, :3] @ inward > follows[:, 3]).any()
    assert (lands[:, :3] @ inward <= lands[:, 3]).all()


def test_at_rest_inside_it_may_stay_and_outside_it_must_come_back() -> None:
    keeps, still = balance(), np.zeros(3)
    spaces = keeps.spaces(np.array([0.0, 0.0, HEIGHT]), still, DT)
    assert (spaces[:, :3] @ [0.0, 0.0, HEIGHT] <= spaces[:, 3]).all()
    out = np.array([0.05, 0.0, HEIGHT])
    spaces = keeps.spaces(out, still, DT)
    assert (spaces[:, :3] @ out > spaces[:, 3]).any()


@pytest.mark.parametrize("away", [0.002, 0.01])
@pytest.mark.parametrize("edge", range(8))
def test_from_outside_there_is_a_way_back_in(away: float, edge: int) -> None:
    """Whom a stop left beyond the room, at rest, gets back there, and never presses beyond the soles for it."""
    keeps, room = balance(), shrunk()
    way = room[edge, :2]
    before = com = np.array([*((room[edge, 2] + away) * way), HEIGHT])
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
        if support_distance(capture, room) > -BEYOND_M:
            return
    pytest.fail("it stays outside")


def test_without_motion_the_margin_alone_counts() -> None:
    keeps = balance("servo")
    assert not keeps.looks_at_motion
    spaces = keeps.spaces(np.array([0.0, 0.0, HEIGHT]), np.array([9.0, 0.0, 0.0]), DT)
    assert len(spaces) == len(keeps.edges) and (spaces[:, 2] == 0.0).all()


@pytest.mark.parametrize("share", [0.0, 1.5])
def test_an_impossible_share_is_refused(share: float) -> None:
    with refuses(ValueError, "moving"):
        task = {"type": "centre_of_mass", "mode": "support", "moving": share}
        Priorities.model_validate({"name": "t", "description": "t", "levels": [{"name": "b", "tasks": [task]}]})


def zmp_outside(robot: Follower) -> float:
    """Share of ticks in which a hurried follower's zero-moment point is not where `steady` keeps it."""
    human = postures(performer(), speed=2.5)[:600]
    robot.start(human[0])
    com = np.array([robot.step(posture, DT).centre_of_mass for posture in human])
    push = (com[2:] - 2.0 * com[1:-1] + com[:-2]) / DT**2
    zmp = com[1:-1] - com[1:-1, 2:] / (GRAVITY + push[:, 2:]) * push
    return float((support_distance(zmp, shrunk()) < -5e-3).mean())


def test_a_robot_that_follows_with_it_keeps_its_zero_moment_point_on_its_soles() -> None:
    assert zmp_outside(follower(priorities="steady")) < 0.01 < 0.3 < zmp_outside(follower())
