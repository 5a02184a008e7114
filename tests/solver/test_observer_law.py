"""The law of the paper, one iteration at a time: what is left of an approach, whose row is put up, who is pushed."""

import numpy as np
import pytest

from observed import BOX, CAPSULE, CARTS, CYLINDER, POINT, Rig, Shape, aim, ball, chain, rig, rod, wall
from retarget._solver import Solver, Task

DT = 0.02
AWAY = (1.0, 0.0, 0.0)


def share(distance: float, influence: float, margin: float = 0.0) -> float:
    return float(np.clip((distance - margin) / (influence - margin), 0.0, 1.0))


def step(solver: Solver, **asked: object) -> np.ndarray:
    """Displacement (nq,) of one frame from rest."""
    q = solver.q
    return np.asarray(solver.frame(aim(solver, **asked), DT) - q)


def point_before_ball(distance: float, *, margin: float = 0.0) -> tuple[Rig, Solver]:
    """A ball of 5 cm at the origin; another one in its way along x, so far off."""
    made = rig(POINT, [ball(1)], [ball(at=(0.1 + distance, 0.0, 0.0), margin=margin)])
    return made, made.solver([[Task.preventive()], [Task.position(1)]])


@pytest.mark.parametrize("margin", [0.0, 0.03])
@pytest.mark.parametrize("distance", [0.09, 0.065, 0.03, 0.01, 1e-4, 0.0])
def test_what_is_left_of_an_approach_falls_with_the_distance(distance: float, margin: float) -> None:
    """At the margin nothing, and the tangent plane stays free."""
    _, solver = point_before_ball(distance, margin=margin)
    moved = step(solver, l1_0=(0.03, 0.02, -0.01))
    assert moved == pytest.approx([share(distance, 0.1, margin) * 0.03, 0.02, -0.01], abs=1e-12)
    assert solver.observer_modes.tolist() == [1]


def test_an_approaching_obstacle_pushes_a_still_part_by_what_is_not_left_of_its_approach() -> None:
    """Figure 5: n . J dq = (1 - alpha) n . Do."""
    for distance in (0.08, 0.05, 0.01, 0.0):
        made, solver = point_before_ball(distance)
        made.velocity[:] = (-0.5, 0.3, 0.0)
        made.show(solver)
        pushed = -(1.0 - share(distance, 0.1)) * 0.5 * DT
        assert step(solver) == pytest.approx([pushed, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("n_ik", [1, 2, 5, 10])
def test_an_obstacle_comes_nearer_iteration_by_iteration(n_ik: int) -> None:
    """No iteration ends early while it does."""
    made = rig(POINT, [ball(1)], [ball(at=(0.16, 0.0, 0.0))])
    solver = made.solver([[Task.preventive()], [Task.position(1)]], n_ik=n_ik, early_stop=True)
    made.velocity[:] = (-1.0, 0.0, 0.0)
    made.show(solver)
    x, obstacle = 0.0, 0.16
    for _ in range(n_ik):
        x -= (1.0 - share(obstacle - x - 0.1, 0.1)) * DT / n_ik
        obstacle -= DT / n_ik
    assert step(solver) == pytest.approx([x, 0.0, 0.0], abs=1e-12)


def test_a_turning_obstacle_moves_where_it_is_near() -> None:
    """A bar that turns about its own middle at 2 rad/s comes with 2 rad/s times its arm."""
    made = rig(POINT, [ball(1)], [Shape(BOX, (0.5, 0.01, 0.5), at=(0.3, 0.08, 0.0))])
    solver = made.solver([[Task.preventive()]])
    solver.set_obstacles(made.at, made.quat, made.velocity, np.array([[0.0, 0.0, 2.0]]))
    speed, distance = 2.0 * 0.3, 0.02
    assert step(solver) == pytest.approx([0.0, -(1.0 - share(distance, 0.1)) * speed * DT, 0.0], abs=1e-12)


def test_different_obstacles_each_get_theirs() -> None:
    """Figure 6 (b): two walls that meet in a corner."""
    up, side = (0.5**0.5, 0.0, -(0.5**0.5), 0.0), (0.5**0.5, 0.5**0.5, 0.0, 0.0)
    made = rig(POINT, [ball(1)], [wall(quat=up, at=(0.07, 0.0, 0.0)), wall(quat=side, at=(0.0, 0.11, 0.0))])
    near = made.near(np.zeros(3))
    assert near.distance == pytest.approx([0.02, 0.06]) and near.normal == pytest.approx(-np.eye(3)[:2], abs=1e-12)
    solver = made.solver([[Task.preventive()], [Task.position(1)]])
    moved = step(solver, l1_0=(0.03, 0.02, 0.01))
    assert moved == pytest.approx([0.2 * 0.03, 0.6 * 0.02, 0.01], abs=1e-12)


def two_before_a_wall() -> Solver:
    """Two carts, 2 cm and 6 cm before a wall along x."""
    made = rig(CARTS, [ball(1), ball(2, at=(-0.04, 0.3, 0.0))], [wall(quat=(0.5**0.5, 0.0, -(0.5**0.5), 0.0))])
    made.at[:] = (0.07, 0.0, 0.0)
    return made.solver([[Task.preventive()], [Task.position(1), Task.position(2)]])


def test_only_the_closest_of_one_obstacle_acts() -> None:
    solver = two_before_a_wall()
    asked = {"l1_0": (0.03, 0.01, 0.0), "l1_1": (0.03, 0.01, 0.0)}
    assert step(solver, **asked) == pytest.approx([0.2 * 0.03, 0.01, 0.03, 0.01], abs=1e-12)
    assert solver.observer_modes.tolist() == [1, 0]


@pytest.mark.parametrize("seed", range(25))
def test_chains_among_random_obstacles_keep_the_law(seed: int) -> None:
    """n . (J dq - Do) >= alpha n . (J dq_trial - Do) for the closest that approaches each obstacle (alpha is 0 inside),
    and equal to the trial where nothing approaches."""
    rng = np.random.default_rng(seed)
    shapes = [
        Shape(
            int(rng.choice([CAPSULE, CYLINDER, BOX])),
            (0.03, *rng.uniform(0.02, 0.1, 2).tolist()),
            at=(*rng.uniform(-0.4, 0.8, 2).tolist(), 0.0),
            quat=(1.0, *rng.normal(0.0, 0.5, 3).tolist()),
            influence=0.15,
        )
        for _ in range(3)
    ]
    made = rig(chain(6), [rod(k + 1) for k in range(6)], shapes)
    made.velocity[:, :2] = rng.normal(0.0, 0.1, (3, 2)) * (seed % 2)
    q = rng.uniform(-0.6, 0.6, 6)
    tip = made.body.points(q[None], [6], np.array([[0.2, 0.0, 0.0]]))[0, 0]
    goal = tip + 0.004 * np.array([*rng.normal(size=2), 0.0])
    trial = made.solver([[Task.position(6, (0.2, 0.0, 0.0), weight=(1.0, 1.0, 0.0))]], observed=False)
    solver = made.solver([[Task.preventive()], [Task.position(6, (0.2, 0.0, 0.0), weight=(1.0, 1.0, 0.0))]])
    for each in (trial, solver):
        each.reset(q)
    without = trial.frame(np.array([1.0, *goal]), DT) - q
    made.show(solver)
    done = solver.frame(np.array([1.0, 1.0, *goal]), DT) - q
    near = made.near(q)
    rows = made.rows(q, near)
    drift = DT * np.repeat(made.velocity, 6, axis=0)
    relative, relative_trial = (rows @ dq - (near.normal * drift).sum(axis=1) for dq in (done, without))
    acting = []
    for pairs in np.arange(18).reshape(3, 6):
        approaching = [k for k in pairs if near.distance[k] < 0.15 and relative_trial[k] < 0.0]
        acting += [min(approaching, key=lambda k: near.distance[k])] if approaching else []
    for k in acting:
        if np.abs(rows[k]).max() < 1e-9:
            continue  # nearest at the first hinge, which nothing moves
        assert relative[k] >= share(near.distance[k], 0.15) * relative_trial[k] - 1e-9
    if not acting:
        assert done == pytest.approx(without, abs=1e-12)
