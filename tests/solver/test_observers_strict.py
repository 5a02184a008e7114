"""Observers in a strict hierarchy: they take nothing from what ranks above them, and nothing below takes from them."""

import numpy as np
import pytest

from observed import POINT, Rig, aim, ball, chain, rig, rod
from retarget._solver import Solver, Task
from retarget.types import FloatArray

DT = 2e-4
"""So short that no step is long enough for its linear model to fail, and none is taken back."""
FRAME = 0.02
TIP, PLANE = (0.2, 0.0, 0.0), (1.0, 1.0, 0.0)


def in_between(seed: int) -> tuple[Rig, FloatArray]:
    """A chain of six links, with obstacles near it: one that it touches, two that it approaches or not."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-0.5, 0.5, 6)
    made = rig(chain(6), [rod(k + 1) for k in range(6)], [ball(radius=0.03) for _ in range(3)])
    middles = made.body.points(q[None], [3, 4, 6], np.full((3, 3), [0.1, 0.0, 0.0]))[0]
    sideways = rng.choice([-1.0, 1.0], 3)[:, None] * np.array([0.0, 1.0, 0.0])
    made.at[:] = middles + sideways * np.array([[0.035], [0.06], [0.08]])
    return made, q


def one_solve(made: Rig, q: FloatArray, levels: list[list[Task]], goals: dict[str, FloatArray]) -> FloatArray:
    """dq of one linear solve."""
    solver = made.solver(levels, activation="all", n_ik=1)
    solver.reset(q)
    return np.asarray(solver.frame(aim(solver, **goals), DT) - q)


def goal(made: Rig, q: FloatArray, link: int, rng: np.random.Generator) -> FloatArray:
    tip = made.body.points(q[None], [link], np.array([TIP]))[0, 0]
    return np.asarray(tip + 4e-5 * np.array([*rng.normal(size=2), 0.0]))


def residual(made: Rig, q: FloatArray, dq: FloatArray, link: int, goal: FloatArray) -> float:
    tip = made.body.points(q[None], [link], np.array([TIP]))[0, 0]
    return float(np.linalg.norm((goal - tip - made.body.frame_jacobian(q, link, TIP)[:3] @ dq)[:2]))


def crossed(made: Rig, q: FloatArray, dq: FloatArray) -> FloatArray:
    """Linear distance of every pair within influence, below its floor, m."""
    near = made.near(q)
    linear = near.distance + made.rows(q, near) @ dq
    floors = np.where(
        near.distance < -1e-4,
        np.minimum(near.distance + 0.1 * DT, np.maximum(0.0, near.distance)),
        near.distance * np.exp(-0.5 * DT / 0.1),
    )
    return np.where(near.distance < 0.1, np.maximum(floors - linear, 0.0), 0.0)


@pytest.mark.parametrize("seed", range(12))
def test_levels_below_take_nothing_from_observers(seed: int) -> None:
    """Reactive, preventive, a point, another point: each as well kept as without those below."""
    rng = np.random.default_rng(seed)
    made, q = in_between(seed)
    far, near = goal(made, q, 6, rng), goal(made, q, 3, rng)
    levels = [[Task.reactive()], [Task.preventive()], *([Task.position(k, TIP, weight=PLANE)] for k in (6, 3))]
    depth = made.near(q).distance < -1e-4
    kept = []
    for count in (1, 2, 3, 4):
        goals = {name: at for name, at in (("l2_0", far), ("l3_0", near)) if int(name[1]) < count}
        dq = one_solve(made, q, levels[:count], goals)
        below = crossed(made, q, dq)
        kept.append((np.linalg.norm(below[depth]), np.linalg.norm(below[~depth]), residual(made, q, dq, 6, far)))
    for count in (1, 2, 3):
        assert kept[count][:count] == pytest.approx(kept[count - 1][:count], abs=1e-7)
    assert kept[3][0] < 1e-9 and depth.any()


@pytest.mark.parametrize("seed", range(12))
def test_observers_take_nothing_from_levels_above(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made, q = in_between(seed)
    tip = goal(made, q, 6, rng)
    levels = [[Task.position(6, TIP, weight=PLANE)], [Task.reactive()], [Task.preventive()]]
    alone, beside = (one_solve(made, q, levels[:count], {"l0_0": tip}) for count in (1, 3))
    assert residual(made, q, beside, 6, tip) == pytest.approx(residual(made, q, alone, 6, tip), abs=1e-7)
    assert np.abs(alone - beside).max() > 1e-6


def pinned(first: Task, second: Task, third: Task) -> tuple[Solver, FloatArray]:
    """A ball 1 cm inside one obstacle and 1 mm from another on its other side, asked to go deeper."""
    made = rig(POINT, [ball(1)], [ball(at=(0.09, 0.0, 0.0)), ball(at=(-0.101, 0.0, 0.0))])
    solver = made.solver([[first], [second], [third]], activation="all")
    targets = np.zeros(solver.target_size)
    targets[[solver.target_slice(k, 0)[0] for k in range(3)]] = 1.0
    level = next(k for k in range(3) if solver.target_slice(k, 0)[1] - solver.target_slice(k, 0)[0] > 1)
    targets[solver.target_slice(level, 0)[0] + 1] = 0.03
    return solver, solver.frame(targets, FRAME)


def test_out_of_contact_comes_before_keeping_off_and_that_before_goals() -> None:
    position, reactive, preventive = Task.position(1), Task.reactive(speed=0.2), Task.preventive()
    solver, q = pinned(reactive, preventive, position)
    assert q[0] == pytest.approx(-0.2 * FRAME, abs=1e-7)
    assert solver.task_errors[0] < 1e-7 < 1e-3 < solver.task_errors[1]
    solver, q = pinned(preventive, reactive, position)
    assert q[0] == pytest.approx(-1e-3 * (1.0 - np.exp(-0.5 * FRAME / 0.1)), abs=1e-7)
    assert solver.task_errors[0] < 1e-7 < 1e-3 < solver.task_errors[1]
    solver, q = pinned(position, reactive, preventive)
    assert q[0] == pytest.approx(0.03, abs=1e-7) and solver.task_errors[0] < 1e-7


@pytest.mark.parametrize("activation", ["closest", "all"])
def test_errors_of_observers_are_returned(activation: str) -> None:
    """By how much contact is not yet left, and that what is off has no error."""
    made = rig(POINT, [ball(1)], [ball(at=(0.08, 0.0, 0.0))])
    levels = [[Task.position(1)], [Task.reactive(speed=0.1)], [Task.preventive()]]
    solver = made.solver(levels, activation=activation)
    targets = aim(solver, l0_0=(0.0, 0.0, 0.0))
    solver.frame(targets, FRAME)
    assert solver.task_errors[1] == pytest.approx(0.1 * FRAME if activation == "all" else 0.02, abs=1e-7)
    targets[solver.target_slice(1, 0)[0]] = 0.0
    solver.frame(targets, FRAME)
    assert np.isnan(solver.task_errors[1])
