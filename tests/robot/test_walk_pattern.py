"""The step pattern of a walk: equations of motion, changes of support, feet, and its end."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.arithmetic import exp
from retarget.robot.walking.gait import clipped, fastest, walking_heights
from retarget.robot.walking.pattern import (
    CATCH,
    LEFT,
    RIGHT,
    ROLL,
    Foothold,
    Gait,
    Pattern,
    Request,
    Step,
    next_foothold,
    rotated,
    standing,
    walk,
)
from retarget.types import FloatArray

GAIT = Gait(72, 65, 122, 6, dt=0.008, height=0.23, width=0.095, lift=0.01, longest=0.1)
REQUESTS = pytest.mark.parametrize(
    "command",
    [
        Request(),
        Request(forward=0.14),
        Request(forward=-0.08, turn=0.2),
        Request(left=-0.04),
        Request(forward=0.08, left=0.03, turn=-0.3),
    ],
    ids=str,
)
MOST = fastest(GAIT)


def stand(x: float = 0.0, yaw: float = 0.0) -> Pattern:
    """Both feet side by side."""
    middle, half = Foothold(np.array([x, 1.0]), yaw), np.array([0.0, 0.5 * GAIT.width])
    return standing((middle.moved(half), middle.moved(-half)), np.array([x, 1.0, GAIT.height]), 1)


def walked(requests: list[tuple[Request, int]], begun: Pattern | None = None) -> tuple[Pattern, list[Pattern]]:
    """A walk of these requests, a step of so many ticks each, and its end; and all paths that were planned for it."""
    whole = stand() if begun is None else begun
    paths, path, row, at, swinging, double = list[Pattern](), whole, 0, 0, RIGHT, GAIT.natural(CATCH)
    single = GAIT.ticks - GAIT.double_ticks
    for command, ticks in requests:
        time = ticks * GAIT.dt
        target = next_foothold(GAIT, path.feet(row)[1 - swinging], clipped(GAIT, command, time), swinging, time)
        beside = next_foothold(GAIT, target, Request(), 1 - swinging, GAIT.period)  # brings the feet together
        first = Step(1 - swinging, target, double, ticks - GAIT.double_ticks)
        steps = (first, Step(swinging, beside, GAIT.double_ticks, single))
        path = walk(GAIT, path, row, steps, walking_heights(GAIT, 0.05))
        parts = {name: np.concatenate([getattr(whole, name)[:at], getattr(path, name)]) for name in vars(path)}
        whole, paths, row = Pattern(**parts), [*paths, path], first.double + first.single
        at, swinging, double = at + row, 1 - swinging, GAIT.double_ticks
    return whole, paths


def accelerations(path: FloatArray) -> FloatArray:
    """Second differences (k - 2, n) of a path (k, n), m/s^2."""
    return np.diff(path, n=2, axis=0) / (GAIT.dt * GAIT.dt)


@REQUESTS
@pytest.mark.parametrize("ticks", [66, 72, 120])
def test_the_mass_moves_as_a_pendulum_over_its_zero_moment_point(command: Request, ticks: int) -> None:
    """c'' = w^2 (c - z) by differences, across all changes of support, from rest to rest."""
    whole, _ = walked([(command, ticks)] * 8)
    mass, between = whole.mass[:, :2], 0.5 * (whole.zmp[1:] + whole.zmp[:-1])
    pressed = 0.5 * (between[1:] + between[:-1])
    # Within two ticks the mass is bent as much as between them: 2 (cosh(w dt) - 1) in place of (w dt)^2.
    far = GAIT.omega * GAIT.dt
    bent = (exp(far) + exp(-far) - 2.0) / (GAIT.dt * GAIT.dt)
    off = np.abs(accelerations(mass) / bent - (mass[1:-1] - pressed))
    assert off.max() < 1e-3 and np.percentile(off, 95) < 1e-6
    assert np.abs(mass[-1] - mass[-2]).max() < 1e-5, "it rests"


@REQUESTS
def test_the_zero_moment_point_is_under_the_soles_that_carry_and_the_other_foot_comes_down_at_rest(
    command: Request,
) -> None:
    """Along its own way, and hardly beyond the middle of a sole that carries alone: by what a foot rolls, and what a
    new command takes."""
    whole, _ = walked([(command, 72)] * 8)
    for row in range(len(whole.zmp)):
        carries = whole.carries[row]
        if carries.all():
            continue
        sole = whole.soles[row, int(carries[1])]
        x, y = rotated(whole.zmp[row] - sole[:2], -float(sole[3])).tolist()
        assert abs(x) < ROLL * 0.14 * 72 * GAIT.dt + 0.01 and abs(y) < 0.02
    # A sole lifts and touches down at less than a hundredth of its greatest speed, and stays while it carries.
    places, carries = whole.soles[..., :3], whole.carries
    assert places[..., 2].min() >= 0.0
    speed = np.linalg.norm(np.diff(places, axis=0), axis=-1) / GAIT.dt
    for foot in range(2):
        raised = (places[:, foot, 2] > 0.0).astype(int)
        lifts, touchdowns = (np.flatnonzero(np.diff(raised) == change) for change in (1, -1))
        assert len(touchdowns) > 2
        # A path whose speed and acceleration vanish at its ends moves by its jerk alone in the first and last tick.
        assert speed[[*lifts, *touchdowns], foot].max() < 0.01 * speed[:, foot].max()
        assert speed[carries[1:, foot] & carries[:-1, foot], foot].max() == 0.0
    assert carries.any(axis=1).all()


@REQUESTS
def test_nothing_jumps_where_the_support_changes_or_a_path_goes_on_from_another(command: Request) -> None:
    """Mass, zero-moment point, yaw and both soles go on where they were."""
    whole, _ = walked([(command, 72), (command, 66), (Request(), 90), (command, 72), (command, 120), (command, 72)])
    assert np.abs(accelerations(whole.mass[:, :2])).max() < 8.0
    # The zero-moment point goes 0.1 m in six ticks, 1.5 times as fast in the middle of those.
    assert np.abs(np.diff(whole.zmp, axis=0)).max() < 1.5 * 0.14 / 6 + 0.005
    assert np.abs(np.diff(whole.zmp, 2, axis=0)).max() < 0.02
    assert np.abs(np.diff(whole.yaws)).max() < 0.01
    assert np.abs(np.diff(whole.soles, axis=0)).max() < 0.014


@REQUESTS
@pytest.mark.parametrize("ticks", [72, 100])
def test_steps_become_the_request(command: Request, ticks: int) -> None:
    """Over two steps the feet have gone and turned as far as the command says."""
    whole, _ = walked([(command, ticks)] * 9)
    both = np.asarray(whole.carries.all(axis=1))
    landed = np.flatnonzero(both[1:] & ~both[:-1]) + 1
    first, last = landed[4], landed[6]
    went = 0.5 * (whole.soles[last, :, :2] - whole.soles[first, :, :2]).sum(axis=0)
    yaw, turned = float(whole.yaws[first]), float(whole.yaws[last] - whole.yaws[first])
    time = 2 * ticks * GAIT.dt
    made = clipped(GAIT, command, ticks * GAIT.dt)
    assert turned == pytest.approx(made.turn * time, abs=1e-9)
    ahead = rotated(went, -yaw - 0.25 * turned)  # the feet between both touchdowns
    np.testing.assert_allclose(ahead, [made.forward * time, made.left * time], atol=0.004)


some, ticked = st.floats(-1.5, 1.5), st.integers(65, 130)
requests = st.builds(lambda x, y, z: Request(x * MOST.forward, y * MOST.left, z * MOST.turn), some, some, some)


@given(st.lists(st.tuples(requests, ticked), min_size=1, max_size=6), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_a_walk_ends_on_both_feet_side_by_side_wherever_it_began(
    command: list[tuple[Request, int]], yaw: float, x: float
) -> None:
    """Every path that was planned, for any commands; feet never come nearer to each other than the gait allows."""
    _, paths = walked(command, stand(x, yaw))
    for path in paths:
        left, right = path.feet(-1)
        np.testing.assert_allclose(rotated(left.place - right.place, -left.yaw), [0.0, GAIT.width], atol=1e-6)
        assert left.yaw == pytest.approx(right.yaw, abs=1e-9) and path.carries[-1].all()
        np.testing.assert_allclose(path.mass[-1, :2], 0.5 * (left.place + right.place), atol=1e-9)
        np.testing.assert_allclose(path.mass[-2], path.mass[-1], atol=1e-5)
        for soles, mid in zip(path.soles, path.yaws, strict=True):
            assert rotated(soles[LEFT, :2] - soles[RIGHT, :2], -float(mid))[1] > 0.8 * GAIT.width


@given(requests, st.floats(0.4, 2.0))
def test_a_request_is_clipped_to_all_that_legs_can(command: Request, time: float) -> None:
    made = clipped(GAIT, command, time)
    assert np.hypot(made.forward / MOST.forward, made.left / MOST.left) <= 1.0 + 1e-12 and abs(made.turn) <= MOST.turn
    assert abs(made.forward) * time <= GAIT.longest + 1e-12
    across = made.forward * command.left - made.left * command.forward
    assert across == pytest.approx(0.0, abs=1e-9), "it goes in the direction of the command"
    assert made.turn * command.turn >= 0.0
