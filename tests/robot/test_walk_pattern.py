"""The step pattern of a walk: equations of motion, changes of support, feet, and its end."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.robot.walking.gait import clipped, fastest, ramped
from retarget.robot.walking.pattern import (
    RIGHT,
    Foothold,
    Gait,
    PatternState,
    Request,
    displacement,
    next_step,
    rotated,
    stepped,
    sway,
    way_to_stand,
)

GAIT = Gait(ticks=72, double_ticks=8, dt=0.008, height=0.23, width=0.095, lift=0.01, narrowest=0.082, longest=0.13)
REQUESTS = pytest.mark.parametrize(
    "asked",
    [
        Request(),
        Request(forward=0.12),
        Request(forward=-0.08, turn=0.2),
        Request(left=-0.04),
        Request(forward=0.08, left=0.03, turn=-0.3),
    ],
    ids=str,
)
MOST = fastest(GAIT)


def walk(*asked: Request, feet: tuple[Foothold, Foothold] | None = None) -> list[PatternState]:
    """A walk of these requests, a step each, and its end."""
    half = np.array([0.0, 0.5 * GAIT.width])
    stand = (Foothold(half, 0.0), Foothold(-half, 0.0)) if feet is None else feet
    moments, step = sway(GAIT, stand, RIGHT)
    moments, now = list(moments), Request()
    for one in asked:
        moments += stepped(GAIT, step)
        now = ramped(GAIT, now, one)
        step = next_step(GAIT, step, now)
    return [*moments, *stepped(GAIT, step), *way_to_stand(GAIT, step)]


@REQUESTS
def test_the_mass_moves_as_a_pendulum_over_its_zero_moment_point(asked: Request) -> None:
    """c'' = w^2 (c - z) by central differences, across all changes of support, until the walk is caught."""
    walked = walk(*[asked] * 10)
    count = len(walked) - round(4.0 / GAIT.omega / GAIT.dt)
    mass = np.array([one.pendulum.mass for one in walked])[:count]
    zmp = np.array([one.zmp for one in walked])[:count]
    acceleration = (mass[2:] - 2.0 * mass[1:-1] + mass[:-2]) / GAIT.dt**2
    # The zero-moment point goes 0.1 m in 64 ms: differences over 16 ms miss its curvature.
    off = np.abs(acceleration / GAIT.omega**2 - (mass - zmp)[1:-1])
    assert np.percentile(off, 99) < 0.002 and off.max() < 0.02


@REQUESTS
def test_nothing_jumps_where_the_support_changes(asked: Request) -> None:
    """Mass, zero-moment point, yaw and both soles go on where they were."""
    for before, after in pairwise(walk(*[asked] * 10)):
        assert np.abs(after.pendulum.mass - before.pendulum.mass).max() < 0.004
        assert np.abs(after.zmp - before.zmp).max() < 0.04
        assert abs(after.yaw - before.yaw) < 0.01
        for old, new in zip(before.soles, after.soles, strict=True):
            assert np.abs(new.place - old.place).max() < 0.008


@REQUESTS
def test_a_foot_leaves_the_floor_and_comes_down_at_rest(asked: Request) -> None:
    """A sole lifts and lands at less than a hundredth of its greatest speed, is never below the floor, and stays while
    it carries."""
    walked = walk(*[asked] * 6)
    places = np.array([[sole.place for sole in one.soles] for one in walked])
    carries = np.array([one.carries for one in walked])
    assert places[..., 2].min() >= 0.0
    speed = np.linalg.norm(np.diff(places, axis=0), axis=-1) / GAIT.dt
    for foot in range(2):
        raised = (places[:, foot, 2] > 0.0).astype(int)
        lifts, landings = (np.flatnonzero(np.diff(raised) == change) for change in (1, -1))
        assert len(landings) > 2
        # A path whose speed and acceleration vanish at its ends moves by its jerk alone in the first and last tick.
        assert speed[[*lifts, *landings], foot].max() < 0.01 * speed[:, foot].max()
        assert speed[carries[1:, foot] & carries[:-1, foot], foot].max() == 0.0
    assert carries.any(axis=1).all()


@REQUESTS
def test_steps_become_what_is_asked(asked: Request) -> None:
    """Once the request stays, each landing is where it puts the foot."""
    asked = clipped(GAIT, asked)
    walked = walk(*[asked] * 24)[: -3 * GAIT.ticks - 120]
    pairs = pairwise(walked)
    landings = [(before.carries.index(False), at) for before, at in pairs if all(at.carries) > all(before.carries)]
    for landed, one in landings[-4:]:
        support, other = one.soles[1 - landed], one.soles[landed]
        way = rotated((other.place - support.place)[:2], -support.yaw)
        wanted, turn = displacement(GAIT, asked, landed)
        np.testing.assert_allclose(way, wanted, atol=0.004)
        assert other.yaw - support.yaw == pytest.approx(turn, abs=1e-9)


some = st.floats(-1.5, 1.5)
requests = st.builds(lambda x, y, z: Request(x * MOST.forward, y * MOST.left, z * MOST.turn), some, some, some)


@given(st.lists(requests, min_size=1, max_size=6), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_a_walk_ends_on_both_feet_side_by_side_wherever_it_began(asked: list[Request], yaw: float, x: float) -> None:
    """Whatever is asked from step to step; feet never come nearer to each other than the gait allows."""
    middle = Foothold(np.array([x, 1.0]), yaw)
    half = np.array([0.0, 0.5 * GAIT.width])
    walked = walk(*asked, feet=(middle.moved(half), middle.moved(-half)))
    end = walked[-1]
    left, right = (rotated(sole.place[:2], -end.yaw) for sole in end.soles)
    np.testing.assert_allclose(left - right, [0.0, GAIT.width], atol=1e-6)
    assert end.soles[0].yaw == pytest.approx(end.soles[1].yaw, abs=1e-9) and all(end.carries)
    np.testing.assert_allclose(end.pendulum.mass, 0.5 * (end.soles[0].place + end.soles[1].place)[:2], atol=1e-9)
    np.testing.assert_allclose(walked[-2].pendulum.mass, end.pendulum.mass, atol=1e-4)
    apart = [rotated((one.soles[0].place - one.soles[1].place)[:2], -one.yaw)[1] for one in walked]
    assert min(apart) > GAIT.narrowest - 0.004


@given(requests, requests)
def test_a_velocity_changes_by_little_from_step_to_step(now: Request, asked: Request) -> None:
    after = ramped(GAIT, now, asked)
    for axis in ("forward", "left", "turn"):
        at, to, most = (getattr(one, axis) for one in (now, after, MOST))
        assert abs(to - at) <= 0.2 * most + 1e-12


@given(requests)
def test_what_is_asked_at_once_is_no_more_than_all_that_legs_can(asked: Request) -> None:
    made = clipped(GAIT, asked)
    assert np.hypot(made.forward / MOST.forward, made.left / MOST.left) <= 1.0 + 1e-12 and abs(made.turn) <= MOST.turn
    assert made.forward * asked.left == pytest.approx(made.left * asked.forward, abs=1e-9), (
        "it goes the way that is asked"
    )
    assert made.turn * asked.turn >= 0.0
