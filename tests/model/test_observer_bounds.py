"""What bounds of distances must not miss: slides behind a hinge, slides that stand drawn out, obstacles with a time
of their own."""

import numpy as np
import pytest

from observed import aim, ball, binding, rig
from retarget import _solver
from retarget.model.body import load_body_text
from retarget.types import FloatArray

UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])
ON_ONE_LINK = """<mujoco><worldbody><body name="arm"><joint name="h" type="hinge" axis="0 0 1"/>
<joint name="s" type="slide" axis="1 0 0"/><geom size="0.01" mass="1"/></body></worldbody></mujoco>"""
TWO_SLIDES = """<mujoco><worldbody><body name="h"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.01"
mass="1"/>
</body><body name="o" pos="0 5 0"><joint name="y" type="slide" axis="0 1 0"/><geom size="0.01" mass="1"/></body>
</worldbody></mujoco>"""


def checker(xml: str, columns: list[int], obstacles: int = 1, count: int = 1, at: float = 0.0) -> _solver.PathChecker:
    """The gate's check of `count` balls of 1 cm on the first link and as many obstacles."""
    body = load_body_text(xml, source="test").solver_body()
    observers = [ball(1, 0.01, at=(at, 0.0, 0.0), influence=0.02)] * count
    watched = binding(body, observers, (), [ball(radius=0.01, influence=0.02)] * obstacles)
    return _solver.PathChecker(body, watched, columns=np.array(columns), sole_links=[], sole_points=np.zeros((0, 3)))


def put(made: _solver.PathChecker, position: FloatArray, linear: FloatArray) -> None:
    made.set_obstacles(position, np.repeat(UPRIGHT, len(position), 0), linear, np.zeros_like(position))


def test_an_observer_that_slides_behind_its_own_hinge_is_looked_at_in_time() -> None:
    """It is 1 m out on a slide, on a link whose joints are hinge and slide: no length of the body says how far it
    swings."""
    made = rig(ON_ONE_LINK, [ball(1, 0.01, influence=0.05)], [ball(at=(0.0, 1.0, 0.0), radius=0.01, influence=0.05)])
    levels = [[_solver.Task.preventive(speed=0.5)], [_solver.Task.position(1)]]
    solver = made.solver(levels, activation="all", n_ik=5, speed=3.0)
    made.show(solver)
    solver.reset(np.array([0.0, 1.0]))
    least, acted = np.inf, False
    for turn in np.minimum(0.02 * np.arange(200), 3.0):
        solver.frame(aim(solver, l1_0=np.array([np.cos(turn), np.sin(turn), 0.0])), 0.01)
        angle, out = solver.q
        acted |= bool(solver.observer_modes[0])
        least = min(least, np.hypot(np.cos(angle) * out, np.sin(angle) * out - 1.0) - 0.02)
    assert least > 0.0 and acted


def test_a_slide_that_no_path_moves_counts_as_far_as_it_stands_out() -> None:
    made = checker(ON_ONE_LINK, [0])
    put(made, np.array([[np.cos(0.7), np.sin(0.7), 0.0]]), np.zeros((1, 3)))
    path = np.linspace(0.0, 1.57, 8)[:, None]
    assert not made.is_clear(np.array([0.0, 1.0]), path, dt=0.01, share=0.0)
    assert made.is_clear(np.array([0.0, 0.5]), path, dt=0.01, share=0.0)


@pytest.mark.parametrize("rows", [1, 2, 4])
@pytest.mark.parametrize("share", [0.55, 0.7, 0.85])
def test_an_obstacle_that_recedes_while_the_robot_has_arrived_long_ago_is_met(rows: int, share: float) -> None:
    """The robot goes 0.2 m in a few rows and rests; the obstacle goes as far in forty, from less than 0.2 m away."""
    made, count, way = checker(TWO_SLIDES, [0, 1]), 40, 0.2
    path = np.zeros((count + 1, 2))
    path[:, 0] = way * np.minimum(np.arange(count + 1) / rows, 1.0)
    path[:, 1] = np.linspace(0.0, 0.01, count + 1)
    speed = way / (count * 0.01)
    put(made, np.array([[share * way + 0.02, 0.0, 0.0]]), np.array([[speed, 0.0, 0.0]]))
    row = np.linspace(0.0, count, 4001)
    gap = share * way + speed * 0.01 * row - np.interp(row, np.arange(count + 1), path[:, 0])
    assert gap.min() < 0.0
    assert not made.is_clear(np.zeros(2), path, dt=0.01, share=0.0)


@pytest.mark.parametrize("count", [1, 4, 5, 8])
def test_however_many_observers_flee_they_may(count: int) -> None:
    hinge = ON_ONE_LINK.replace('<joint name="s" type="slide" axis="1 0 0"/>', "")
    made = checker(hinge, [0], obstacles=2, count=count, at=1.0)
    along, out = 0.05, 1.0204
    places = np.array([[out * np.cos(along), out * np.sin(along), 0.0], [1.0, -0.1, 0.0]])
    put(made, places, np.array([[0.0, 0.0, 0.0], [0.0, 1.2, 0.0]]))
    path = np.linspace(0.0, 0.1, 19)[:, None]
    assert made.is_clear(np.zeros(1), path, dt=0.01, share=0.0, instead=np.zeros((19, 1)))
