"""`_solver.Braking`: bounds that leave a way to stop, and the way to a stop itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import op3
from messages import refuses
from oracles.frame_bounds import frame_bounds
from retarget._solver import Braking, Solver, Task, braking_displacement
from retarget.types import FloatArray

DT = 0.01
LOWER, UPPER = np.array([-1.0, -0.2, 0.0]), np.array([1.0, 0.3, 2.0])
SPEED, ACCELERATION = np.array([4.0, 1.0, 0.5]), np.array([40.0, 20.0, 3.0])
CHANGE = ACCELERATION * DT**2
MIDDLE = 0.5 * (LOWER + UPPER)
BRAKING = Braking(LOWER, UPPER, SPEED, ACCELERATION, dt=DT)
vectors = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(np.array)
steps = st.lists(st.floats(-0.04, 0.04), min_size=3, max_size=3).map(np.array)


def braked(position: FloatArray, step: FloatArray) -> FloatArray:
    """The next displacement of joints that brake: none once their stop is over."""
    rows = BRAKING.stop(position, step)
    return np.asarray(rows[0] - position if len(rows) else np.zeros(3))


def alone(step: FloatArray) -> FloatArray:
    """Joints that each brake as hard as they can."""
    return np.asarray(np.copysign(np.maximum(np.abs(step) - CHANGE, 0.0), step))


@given(steps)
def test_joints_brake_in_proportion_as_hard_as_the_slowest_can(step: FloatArray) -> None:
    few = 0.1 * step  # ends of ranges are far
    ticks = max(1.0, float((np.abs(few) / CHANGE).max()))
    np.testing.assert_allclose(BRAKING.ticks(few), ticks)
    np.testing.assert_allclose(braked(MIDDLE, few), (1.0 - 1.0 / ticks) * few, atol=1e-12)


@given(vectors, steps)
def test_a_joint_at_an_end_of_its_range_brakes_earlier(position: FloatArray, step: FloatArray) -> None:
    low, high = BRAKING.bounds(position, step)
    even = (1.0 - 1.0 / BRAKING.ticks(step)) * step
    np.testing.assert_allclose(braked(position, step), np.minimum(np.maximum(even, low), high), atol=1e-12)


@given(vectors, steps)
def test_bounds_are_the_oracles_and_to_go_on_braking(position: FloatArray, step: FloatArray) -> None:
    low, high = frame_bounds(position, step, LOWER, UPPER, SPEED, ACCELERATION, DT)
    found = BRAKING.bounds(position, step)
    np.testing.assert_allclose(found[0], np.minimum(low, alone(step)), atol=1e-12)
    np.testing.assert_allclose(found[1], np.maximum(high, alone(step)), atol=1e-12)
    assert (found[0] <= found[1]).all()


@given(vectors, steps, steps, st.sampled_from([0.0, 1e-9, 1e-3]))
def test_a_goal_passes_where_every_joint_is_within_its_bounds(
    position: FloatArray, before: FloatArray, step: FloatArray, tolerance: float
) -> None:
    low, high = BRAKING.bounds(position, before)
    goal = position + step
    asked = goal - position
    admitted = BRAKING.accepted(position, before, goal, tolerance=tolerance)
    assert (admitted is not None) == bool((np.maximum(low - asked, asked - high) <= tolerance).all())
    if admitted is not None:
        np.testing.assert_array_equal(admitted, np.minimum(np.maximum(asked, low), high))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_never_passes(bad: float) -> None:
    rest = np.zeros(3)
    assert BRAKING.accepted(rest, rest, np.array([0.0, bad, 0.0]), tolerance=1.0) is None
    assert BRAKING.accepted(rest, rest, np.zeros(2), tolerance=1.0) is None


@settings(max_examples=50)
@given(vectors, steps)
def test_a_stop_is_what_braking_does_and_ends_at_rest(position: FloatArray, seed: FloatArray) -> None:
    step = np.clip(seed, -SPEED * DT, SPEED * DT)
    at, moved, rows = position, step, BRAKING.stop(position, step)
    for row in rows:
        np.testing.assert_allclose(row - at, braked(at, moved), atol=1e-12)
        at, moved = row, row - at
    assert (np.abs(moved) <= CHANGE + 1e-12).all()
    assert not len(BRAKING.stop(at, np.zeros(3))) or (position < LOWER).any() or (position > UPPER).any()


ranges = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).map(
    lambda share: LOWER + np.array(share) * (UPPER - LOWER)
)


@given(ranges, steps)
def test_a_stop_keeps_every_limit_and_one_that_breaks_a_limit_does_not(position: FloatArray, seed: FloatArray) -> None:
    low, high = BRAKING.bounds(position, np.zeros(3))
    step = np.clip(seed, low, high)
    rows = BRAKING.stop(position + step, step)
    assert BRAKING.keeps(position + step, step, rows, tolerance=1e-9)
    fast = np.vstack([position + step, rows, rows[-1] if len(rows) else position + step])
    fast[-1, 0] += 2.1 * CHANGE[0]
    assert not BRAKING.keeps(position, np.zeros(3), fast, tolerance=1e-9), "it is not at rest at its end"
    assert not BRAKING.keeps(position, step, np.full((1, 3), np.nan), tolerance=1e-9)
    beyond = np.vstack([position + step, rows])
    beyond[-1, 1] = UPPER[1] + 1e-3
    assert not BRAKING.keeps(position, np.zeros(3), beyond, tolerance=1e-9)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).map(np.array),
    st.lists(st.floats(-1.0, 1.0), min_size=40, max_size=40),
)
def test_no_joint_leaves_its_range_however_it_is_led_and_stopped(start: FloatArray, way: list[float]) -> None:
    position, moved = LOWER + start * (UPPER - LOWER), np.zeros(3)
    for tick, pull in enumerate(way):
        low, high = BRAKING.bounds(position, moved)
        now = braked(position, moved) if tick % 7 == 6 else low + (0.5 + 0.5 * pull) * (high - low)
        assert (np.abs(now - moved) <= CHANGE + 1e-12).all() and (np.abs(now) <= SPEED * DT + 1e-12).all()
        position, moved = position + now, now
        path = BRAKING.stop(position, moved)
        assert (path >= LOWER - 1e-9).all() and (path <= UPPER + 1e-9).all()


@pytest.mark.parametrize(
    ("speed", "dt"),
    [(0.0, DT), (np.inf, DT), (1.0, 0.0), (np.nan, DT)],
)
def test_limits_must_be_limits(speed: float, dt: float) -> None:
    with refuses(ValueError):
        Braking(LOWER[:1], UPPER[:1], np.array([speed]), ACCELERATION[:1], dt=dt)


@given(st.floats(1e-6, 1.0), st.floats(1e-5, 1e-2))
def test_braking_ends_just_at_the_goal(gap: float, change: float) -> None:
    step = braking_displacement(gap, change)
    way, here = 0.0, step
    while here > 0.0:
        way, here = way + here, here - change
    assert way <= gap * (1.0 + 1e-9) + 1e-12
    assert step <= gap


# A share of all speeds, as of a robot whose servos are warm.

SHARES = st.lists(st.sampled_from([0.05, 0.2, 0.5, 0.9, 1.0]), min_size=40, max_size=40)
FAR = st.lists(st.sampled_from([-1.0, 0.0, 1.0]), min_size=40, max_size=40)


@settings(max_examples=40)
@given(SHARES, FAR)
def test_a_slower_robot_speeds_up_less_and_still_brakes_before_its_limits(
    shares: list[float], goals: list[float]
) -> None:
    """Whatever the share does from tick to tick: it never takes away what a joint needs to stop in its range."""
    body, columns = op3().body, slice(7, None)
    free = np.full(body.nv, np.inf)
    fastest, hardest, most = np.full(body.nv, 4.0), np.full(body.nv, 40.0), 0.3
    locked = np.arange(body.nv) < 6
    lower, upper = -free, free.copy()
    lower[6:], upper[6:] = -most, most
    solver = Solver(
        body.solver_body(),
        [[Task.posture(np.ones(body.nv))]],
        lower=lower,
        upper=upper,
        max_velocity=fastest,
        max_acceleration=hardest,
        locked=locked,
        max_step=1e9,
        damping=0.0,
    )
    solver.reset(body.qpos0)
    step = np.zeros(body.nv - 6)
    for share, goal in zip(shares, np.repeat(goals, 4)[: len(shares)], strict=True):
        q, before = solver.q, step
        asked = body.qpos0.copy()
        asked[columns] = goal
        after = solver.frame(np.concatenate([[1.0], asked]), DT, share)
        step = after[columns] - q[columns]
        gained = np.abs(step) - np.where(step * before > 0.0, np.abs(before), 0.0)
        assert (gained <= share**2 * 40.0 * DT**2 + 1e-9).all()
        assert (np.abs(step - before) <= 40.0 * DT**2 + 1e-9).all()
        assert (np.abs(step) <= np.maximum(share * 4.0 * DT, np.abs(before) - 40.0 * DT**2) + 1e-9).all()
        assert (np.abs(after[columns]) <= most + 1e-9).all()


def test_a_share_that_is_none_is_refused() -> None:
    body = op3().body
    limits = np.ones(body.nv)
    solver = Solver(
        body.solver_body(),
        [[Task.posture(limits)]],
        lower=-limits,
        upper=limits,
        max_velocity=limits,
        max_acceleration=limits,
        locked=limits < 0.0,
    )
    for share in (0.0, 1.5, np.nan):
        with refuses(ValueError, "speed_override"):
            solver.frame(np.zeros(solver.target_size), DT, share)
