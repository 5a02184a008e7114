"""The solver's kinematics against MuJoCo, on random trees with joints of every kind."""

import mujoco
import numpy as np
import pytest

from followers import op3
from oracles.problem import Array
from oracles.trees import Tree, random_tree
from retarget import _solver
from retarget._solver import Solver, Task
from retarget.types import FloatArray

SEEDS = range(20)
EXACT = 1e-12


@pytest.fixture(params=SEEDS)
def tree(request: pytest.FixtureRequest) -> Tree:
    """A random tree at a random posture."""
    tree = random_tree(request.param)
    return tree.at(tree.q)


def body_of(tree: Tree) -> _solver.Body:
    return _solver.Body(*tree.body_arguments())


def same_rotation(a: Array, b: Array) -> bool:
    """Unit quaternions (k, 4) turn the same way, whatever their sign."""
    return bool(np.allclose(np.abs(np.sum(a * b, axis=-1)), 1.0, atol=EXACT))


def points_on(tree: Tree) -> tuple[list[int], Array]:
    """One point on every link: links (k,) and local positions (k, 3)."""
    links = list(range(tree.model.nbody))
    return links, np.random.default_rng(1).normal(size=(len(links), 3))


def test_forward(tree: Tree) -> None:
    position, orientation = body_of(tree).forward(tree.q)
    assert position == pytest.approx(tree.data.xpos, abs=EXACT)
    assert same_rotation(orientation, tree.data.xquat)


def test_points_and_orientations_of_many_postures(tree: Tree) -> None:
    body = body_of(tree)
    links, local = points_on(tree)
    postures = np.array([tree.model.qpos0, tree.q])
    points, orientations = body.points(postures, links, local), body.orientations(postures, links)
    centres = body.centre_of_mass(postures)
    for k, q in enumerate(postures):
        data = tree.at(q).data
        expected = data.xpos + np.einsum("kij,kj->ki", data.xmat.reshape(-1, 3, 3), local)
        assert points[k] == pytest.approx(expected, abs=EXACT)
        assert same_rotation(orientations[k], data.xquat)
        assert centres[k] == pytest.approx(data.subtree_com[0], abs=EXACT)


def test_frame_jacobian_is_mujocos(tree: Tree) -> None:
    body = body_of(tree)
    links, local = points_on(tree)
    points = body.points(tree.q[None], links, local)[0]
    for link in links[1:]:
        linear, angular = np.zeros((3, body.nv)), np.zeros((3, body.nv))
        mujoco.mj_jac(tree.model, tree.data, linear, angular, points[link], link)
        ours = body.frame_jacobian(tree.q, link, tuple(local[link]))
        assert ours == pytest.approx(np.vstack([linear, angular]), abs=EXACT)


def test_centre_of_mass_jacobian(tree: Tree) -> None:
    body = body_of(tree)
    expected = np.zeros((3, body.nv))
    mujoco.mj_jacSubtreeCom(tree.model, tree.data, expected, 0)
    ours = body.centre_of_mass_jacobian(tree.q)
    assert ours == pytest.approx(expected, abs=EXACT)


@pytest.mark.parametrize("size", [1e-9, 0.1, 3.0])
def test_integrate(tree: Tree, size: float) -> None:
    dq = size * np.random.default_rng(2).normal(size=tree.model.nv)
    expected = tree.q.copy()
    mujoco.mj_integratePos(tree.model, expected, dq, 1.0)
    assert body_of(tree).integrate(tree.q, dq) == pytest.approx(expected, abs=EXACT)


@pytest.mark.parametrize("size", [1e-9, 0.1, 0.8])
def test_difference_undoes_integrate(tree: Tree, size: float) -> None:
    body = body_of(tree)
    dq = size * np.random.default_rng(3).uniform(-1.0, 1.0, tree.model.nv)
    there = body.integrate(tree.q, dq)
    expected = np.zeros(tree.model.nv)
    mujoco.mj_differentiatePos(tree.model, expected, 1.0, tree.q, there)
    ours = body.difference(tree.q, there)
    assert ours == pytest.approx(expected, abs=1e-9)
    assert ours == pytest.approx(dq, abs=1e-9)


@pytest.mark.parametrize("field", range(10))
def test_arrays_of_wrong_shape_are_refused(field: int) -> None:
    arguments = list(random_tree(1).body_arguments())
    arguments[field] = arguments[field][:-1].copy()
    with pytest.raises(ValueError):
        _solver.Body(*arguments)


# A position that is asked from a point of another link: of the difference of both points, not of either.


def relative(base: int) -> Solver:
    robot = op3()
    body, hand = robot.body, robot.frame("l_hand")
    x, y, z = hand.position.tolist()
    free = np.full(body.nv, np.inf)
    task = Task.position(hand.body, (x, y, z), base=(base, (0.0, 0.0, 0.0)))
    return Solver(
        body.solver_body(),
        [[task]],
        lower=-free,
        upper=free,
        max_velocity=free,
        max_acceleration=free,
        locked=np.zeros(body.nv, dtype=np.bool_),
        n_ik=60,
    )


def test_the_difference_of_two_points_is_led() -> None:
    """Asked from the origin of the torso, which is free to move as well."""
    robot, shoulder = op3(), op3().frame("l_shoulder")
    solver, q = relative(shoulder.body), robot.posture(robot.profile.postures.stand)
    solver.reset(q)

    def apart(posture: FloatArray) -> FloatArray:
        """From the origin of the torso to the hand (3,), m."""
        origin = robot.body.solver_body().points(posture[None], [shoulder.body], np.zeros((1, 3)))[0, 0]
        return np.asarray(robot.points(posture[None], ("l_hand",))[0, 0] - origin)

    wanted = apart(q) + np.array([0.02, 0.01, 0.03])
    after = solver.frame(np.concatenate([[1.0], wanted]), 1.0)
    np.testing.assert_allclose(apart(after), wanted, atol=1e-4)


def test_a_base_that_the_body_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match="link"):
        relative(10_000)
