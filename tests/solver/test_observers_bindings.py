"""What the compiled observers refuse and return; determinism."""

from typing import Any

import numpy as np
import pytest

from messages import Facts, refuses
from observed import CARTS, HALF_SPACE, POINT, Rig, aim, ball, binding, chain, rig, rod
from retarget import _solver
from retarget._solver import Solver, Task

DT = 0.02
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
    assert solver.frame(aim(solver, l1_0=(0.03, 0.0, 0.0)), DT)[0] == pytest.approx(0.003, abs=1e-12)


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
    assert solver.frame(targets, DT)[0] == pytest.approx(0.003, abs=1e-12)
    assert other.frame(targets, DT)[0] == pytest.approx(0.03, abs=1e-12)
    solver.reset(np.zeros(3))
    solver.set_obstacles(made.at, made.quat, present=np.array([False]))
    assert solver.frame(targets, DT)[0] == pytest.approx(0.03, abs=1e-12)


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
    assert q[0] == pytest.approx(-1e-3, abs=1e-9)


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
        runs.append(solver.clip(np.array(targets), DT))
    _, solver, targets = among_obstacles()
    one_by_one = np.array([solver.frame(row, DT) for row in targets])
    assert (runs[0] == runs[1]).all() and (runs[0] == one_by_one).all()
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
    assert runs[0] == pytest.approx(runs[1], abs=1e-9)


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
