"""The law of the paper, one iteration at a time: what is left of an approach, whose row is put up, who is pushed."""

from typing import Any

import numpy as np
import pytest

from messages import Facts, refuses
from observed import (
    BOX,
    CAPSULE,
    CARTS,
    CYLINDER,
    HALF_SPACE,
    POINT,
    Rig,
    Shape,
    aim,
    ball,
    binding,
    chain,
    rig,
    rod,
    wall,
)
from retarget import _solver
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
    assert moved == pytest.approx([share(distance, 0.1, margin) * 0.03, 0.02, -0.01], abs=1e-7)
    assert solver.observer_modes.tolist() == [1]


def test_an_approaching_obstacle_pushes_a_still_part_by_what_is_not_left_of_its_approach() -> None:
    """Figure 5: n . J dq = (1 - alpha) n . Do."""
    for distance in (0.08, 0.05, 0.01, 0.0):
        made, solver = point_before_ball(distance)
        made.velocity[:] = (-0.5, 0.3, 0.0)
        made.show(solver)
        pushed = -(1.0 - share(distance, 0.1)) * 0.5 * DT
        assert step(solver) == pytest.approx([pushed, 0.0, 0.0], abs=1e-7)


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
    assert step(solver) == pytest.approx([x, 0.0, 0.0], abs=1e-7)


def test_a_turning_obstacle_moves_where_it_is_near() -> None:
    """A bar that turns about its own middle at 2 rad/s comes with 2 rad/s times its arm."""
    made = rig(POINT, [ball(1)], [Shape(BOX, (0.5, 0.01, 0.5), at=(0.3, 0.08, 0.0))])
    solver = made.solver([[Task.preventive()]])
    solver.set_obstacles(made.at, made.quat, made.velocity, np.array([[0.0, 0.0, 2.0]]))
    speed, distance = 2.0 * 0.3, 0.02
    assert step(solver) == pytest.approx([0.0, -(1.0 - share(distance, 0.1)) * speed * DT, 0.0], abs=1e-7)


def test_different_obstacles_each_get_theirs() -> None:
    """Figure 6 (b): two walls that meet in a corner."""
    up, side = (0.5**0.5, 0.0, -(0.5**0.5), 0.0), (0.5**0.5, 0.5**0.5, 0.0, 0.0)
    made = rig(POINT, [ball(1)], [wall(quat=up, at=(0.07, 0.0, 0.0)), wall(quat=side, at=(0.0, 0.11, 0.0))])
    near = made.near(np.zeros(3))
    assert near.distance == pytest.approx([0.02, 0.06]) and near.normal == pytest.approx(-np.eye(3)[:2], abs=1e-7)
    solver = made.solver([[Task.preventive()], [Task.position(1)]])
    moved = step(solver, l1_0=(0.03, 0.02, 0.01))
    assert moved == pytest.approx([0.2 * 0.03, 0.6 * 0.02, 0.01], abs=1e-7)


def two_before_a_wall() -> Solver:
    """Two carts, 2 cm and 6 cm before a wall along x."""
    made = rig(CARTS, [ball(1), ball(2, at=(-0.04, 0.3, 0.0))], [wall(quat=(0.5**0.5, 0.0, -(0.5**0.5), 0.0))])
    made.at[:] = (0.07, 0.0, 0.0)
    return made.solver([[Task.preventive()], [Task.position(1), Task.position(2)]])


def test_only_the_closest_of_one_obstacle_acts() -> None:
    solver = two_before_a_wall()
    asked = {"l1_0": (0.03, 0.01, 0.0), "l1_1": (0.03, 0.01, 0.0)}
    assert step(solver, **asked) == pytest.approx([0.2 * 0.03, 0.01, 0.03, 0.01], abs=1e-7)
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
        assert relative[k] >= share(near.distance[k], 0.15) * relative_trial[k] - 1e-7
    if not acting:
        assert done == pytest.approx(without, abs=1e-7)


# What the compiled observers refuse and return; determinism.

NAN = float("nan")


def carts(**instead: Any) -> _solver.Observers:
    """Two observers and an obstacle, with other arguments."""
    body = rig(CARTS, []).body
    return binding(body, [ball(1), ball(2)], [(0, 1)], [ball()], **instead)


@pytest.mark.parametrize(
    ("instead", "part"),
    [
        ({"kinds": np.array([0])}, "kinds"),
        ({"kinds": np.array([0, 0, 0])}, "kinds"),
        ({"sizes": np.zeros((2, 2))}, ("sizes", 2)),
        ({"sizes": np.full((2, 3), NAN)}, ()),
        ({"sizes": np.full((2, 3), -0.1)}, ()),
        ({"sizes": np.full((2, 3), np.inf)}, ()),
        ({"positions": np.zeros((1, 3))}, "positions"),
        ({"positions": np.full((2, 3), NAN)}, "positions"),
        ({"quats": np.zeros((2, 3))}, "quats"),
        ({"quats": np.full((2, 4), NAN)}, "quats"),
        ({"influence": np.array([0.1])}, ("influence", 1, 2)),
        ({"influence": np.array([0.1, NAN])}, ("influence", "NaN", "margin")),
        ({"influence": np.array([0.1, np.inf])}, "influence"),
        ({"margin": np.array([0.1, 0.1])}, ("influence", "0.1", "margin")),
        ({"margin": np.array([0.0, -0.1])}, ()),
        ({"margin": np.array([0.0, NAN])}, ("margin", "NaN")),
        ({"margin": np.zeros(3)}, ("margin", 3)),
        ({"kinds": np.array([0, HALF_SPACE])}, ()),
        ({"kinds": np.array([0, 4])}, (4, 0)),
        ({"kinds": np.array([0, -1])}, -1),
        ({"links": np.array([1, 7])}, 7),
        ({"links": np.array([1, -1])}, ()),
        ({"pairs": np.array([[0, 2]])}, (0, 2)),
        ({"pairs": np.array([[-1, 1]])}, ()),
        ({"pairs": np.array([[1, 1]])}, 1),
        ({"pairs": np.zeros((1, 3), dtype=np.int64)}, 3),
        ({"pairs": np.asfortranarray(np.array([[0, 1], [1, 0]]))}, ()),
        ({"obstacle_pairs": np.array([[0, 1]])}, (0, 1, 2)),
        ({"obstacle_pairs": np.array([[2, 0]])}, (2, 0)),
        ({"obstacle_pairs": np.array([[0, 0]]), "obstacle_pair_margin": np.zeros(2)}, ("obstacle_pair_margin", 1)),
        ({"obstacle_kinds": np.array([9])}, 9),
        ({"obstacle_sizes": np.zeros((2, 3))}, ()),
        ({"obstacle_sizes": np.full((1, 3), NAN)}, ()),
        (
            {"obstacle_influence": np.array([0.01]), "obstacle_margin": np.array([0.02])},
            ("influence", "0.01", "margin", "0.02"),
        ),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else None,
)
def test_bad_observers_are_refused(instead: dict[str, Any], part: Facts) -> None:
    with refuses(ValueError, part):
        carts(**instead)


def with_observers(levels: list[list[Task]], **more: Any) -> Solver:
    return rig(POINT, [ball(1)], [ball(at=(0.3, 0.0, 0.0))]).solver(levels, **more)


def test_solvers_refuse_what_does_not_fit_together() -> None:
    with refuses(ValueError, "activation", '"some"', "closest"):
        with_observers([[Task.preventive()]], activation="some")
    with refuses(ValueError, 1):
        with_observers([[Task.preventive(of=[1])]])
    posture = Task.posture(np.ones(3))
    for task in (Task.preventive(), Task.reactive()):
        with refuses(ValueError):
            with_observers([[posture, task]])
    with_observers([[Task.preventive()], [posture]])


@pytest.mark.parametrize(
    ("instead", "part"),
    [
        ({"position": np.zeros((2, 3))}, "position"),
        ({"position": np.full((1, 3), NAN)}, "position"),
        ({"quat": np.zeros((1, 3))}, "quat"),
        ({"quat": np.full((1, 4), NAN)}, "quat"),
        ({"linear": np.zeros((1, 2))}, "linear"),
        ({"linear": np.full((1, 3), np.inf)}, "linear"),
        ({"angular": np.zeros((2, 3))}, "angular"),
        ({"angular": np.full((1, 3), NAN)}, "angular"),
        ({"present": np.array([True, True])}, (2, 1)),
    ],
    ids=str,
)
def test_bad_obstacle_poses_are_refused_and_change_nothing(instead: dict[str, Any], part: Facts) -> None:
    solver = with_observers([[Task.preventive()], [Task.position(1)]])
    good = {"position": np.array([[0.11, 0.0, 0.0]]), "quat": np.array([[1.0, 0.0, 0.0, 0.0]])}
    solver.set_obstacles(**good)
    with refuses(ValueError, part):
        solver.set_obstacles(**(good | instead))
    assert solver.frame(aim(solver, l1_0=(0.03, 0.0, 0.0)), DT)[0] == pytest.approx(0.003, abs=1e-7)


def test_obstacles_that_were_not_placed_or_are_absent_are_not_there() -> None:
    made = rig(POINT, [ball(1)], [ball(at=(0.11, 0.0, 0.0))])
    solver = made.solver([[Task.preventive()], [Task.position(1)]])
    other = _solver.Solver(
        *(made.body, [[Task.preventive()], [Task.position(1)]]),
        lower=np.full(3, -np.inf), upper=np.full(3, np.inf), max_velocity=np.full(3, 100.0),
        max_acceleration=np.full(3, np.inf), locked=np.zeros(3, dtype=bool), n_ik=1, damping=0.0,
        observers=binding(made.body, made.shapes, (), made.obstacles),
    )  # fmt: skip
    targets = aim(solver, l1_0=(0.03, 0.0, 0.0))
    assert solver.frame(targets, DT)[0] == pytest.approx(0.003, abs=1e-7)
    assert other.frame(targets, DT)[0] == pytest.approx(0.03, abs=1e-7)
    solver.reset(np.zeros(3))
    solver.set_obstacles(made.at, made.quat, present=np.array([False]))
    assert solver.frame(targets, DT)[0] == pytest.approx(0.03, abs=1e-7)


@pytest.mark.parametrize("appears", [False, True], ids=["moved", "present again"])
def test_an_obstacle_that_is_put_elsewhere_is_seen(appears: bool) -> None:
    """Though its pair was so far apart that it was not looked at."""
    made = rig(POINT, [ball(1)], [ball(at=(0.08 if appears else 5.0, 0.0, 0.0))])
    levels = [[Task.reactive(speed=0.1)], [Task.preventive()], [Task.position(1)]]
    solver = made.solver(levels, activation="all", n_ik=3, speed=1.0, acceleration=100.0)
    targets = aim(solver, l2_0=(0.0, 0.0, 0.0))
    solver.set_obstacles(made.at, made.quat, present=np.array([not appears]))
    for _ in range(5):
        solver.frame(targets, 0.01)
    made.at[:] = (0.08, 0.0, 0.0)
    made.show(solver)
    q = solver.frame(targets, 0.01)
    assert solver.observer_modes.tolist() == [2]
    assert q[0] == pytest.approx(-1e-3, abs=1e-7)


def among_obstacles() -> tuple[Rig, Solver, list[np.ndarray]]:
    """A chain whose tip goes to and fro among moving obstacles, observing itself too."""
    rng = np.random.default_rng(4)
    made = rig(chain(6), [rod(k + 1) for k in range(6)], [ball(at=(0.5, 0.4 - 0.2 * k, 0.0)) for k in range(5)])
    made.pairs = [(a, b) for a in range(6) for b in range(a + 2, 6)]
    made.velocity[:, :2] = rng.normal(0.0, 0.05, (5, 2))
    levels = [[Task.reactive()], [Task.preventive()], [Task.position(6, (0.2, 0.0, 0.0))], [Task.posture(np.ones(6))]]
    solver = made.solver(levels, activation="all", n_ik=5, damping=1.0, speed=5.0)
    goals = [np.array([0.6 * np.cos(0.05 * t), 0.8 * np.sin(0.03 * t), 0.0]) for t in range(200)]
    return made, solver, [aim(solver, l2_0=goal, l3_0=np.zeros(6)) for goal in goals]


def test_the_same_bits_every_time() -> None:
    runs = []
    for _ in range(2):
        _, solver, targets = among_obstacles()
        runs.append(np.array([solver.frame(row, DT) for row in targets]))
    assert (runs[0] == runs[1]).all()
    assert solver.observer_modes.any()


def test_obstacles_go_on_at_their_velocities() -> None:
    """Set once or set every frame is the same."""
    runs = []
    for every_frame in (False, True):
        made, solver, targets = among_obstacles()
        q = []
        for row in targets:
            if every_frame:
                made.show(solver)
            q.append(solver.frame(row, DT))
            made.at += DT * made.velocity
        runs.append(np.array(q))
    assert runs[0] == pytest.approx(runs[1], abs=1e-7)


def test_modes_are_reported() -> None:
    made = rig(POINT, [ball(1)], [ball(at=(0.35, 0.0, 0.0))])
    solver = made.solver([[Task.reactive()], [Task.preventive()]], activation="all")
    seen = []
    for x in (0.35, 0.35, 0.15, 0.15, 0.05, 0.35):
        solver.reset(np.zeros(3)) if x == 0.05 else None
        made.at[0, 0] = x + solver.q[0]
        made.show(solver)
        solver.frame(aim(solver), DT)
        seen.append(int(solver.observer_modes[0]))
    assert seen == [0, 0, 1, 1, 2, 0]


@pytest.mark.parametrize("seconds", [-3.0, np.nan, np.inf])
def test_no_stop_takes_such_a_time(seconds: float) -> None:
    _, solver, _ = among_obstacles()
    with pytest.raises(ValueError, match="seconds"):
        solver.foresee(solver.q[None], seconds)
    with pytest.raises(ValueError, match="pendulum"):
        solver.brake(DT, 5, pendulum=seconds)
