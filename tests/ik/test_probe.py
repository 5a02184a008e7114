"""`_solver.Probe` and `_solver.Footing`: the same as the kinematics of the body, one by one."""

import numpy as np
import pytest

from messages import refuses
from retarget._solver import Footing, Probe
from retarget.ik.support_polygon import plant, support_distance
from retarget.model.robot import load_robot
from retarget.types import FloatArray

ROBOT = load_robot("op3")
BODY = ROBOT.body.solver_body()
STANCE = plant(ROBOT, ROBOT.profile.postures.stand)
LINKS, ORIENTED = [3, 7, 3], [1, 5]
LOCAL = np.array([[0.1, 0.0, -0.02], [0.0, 0.03, 0.0], [0.0, 0.0, 0.0]])


def postures(count: int, seed: int = 3) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.array([BODY.integrate(STANCE.q, 0.3 * rng.standard_normal(BODY.nv)) for _ in range(count)])


def test_footing_gives_the_worst_of_a_path() -> None:
    sole = STANCE.soles[0]
    links, planted = [sole.frame.body] * len(sole.corners), np.insert(sole.outline, 2, 0.0, axis=1)
    edges = STANCE.edges(0.0)
    footing = Footing(BODY, links, sole.corners, planted, edges)
    off, inside = footing.losses(STANCE.q[None])
    assert off < 1e-6
    assert inside > 0.0
    way = postures(10)
    off, inside = footing.losses(way)
    gone = np.linalg.norm(BODY.points(way, links, sole.corners) - planted, axis=2)
    assert off == pytest.approx(gone.max(), abs=1e-12)
    assert inside == pytest.approx(support_distance(BODY.centre_of_mass(way), edges).min(), abs=1e-12)


def test_nan_in_a_posture_is_never_a_small_loss() -> None:
    sole = STANCE.soles[0]
    links, planted = [sole.frame.body] * len(sole.corners), np.insert(sole.outline, 2, 0.0, axis=1)
    footing = Footing(BODY, links, sole.corners, planted, STANCE.edges(0.0))
    bad = STANCE.q.copy()
    bad[0] = np.nan
    off, inside = footing.losses(np.array([STANCE.q, bad, STANCE.q]))
    assert np.isnan(off)
    assert np.isnan(inside)


def test_what_does_not_fit_is_refused() -> None:
    with refuses(ValueError, 999):
        Probe(BODY, [999], np.zeros((1, 3)), [])
    with refuses(ValueError, 999):
        Probe(BODY, [], np.zeros((0, 3)), [999])
    with refuses(ValueError):
        Probe(BODY, [1], np.zeros((2, 3)), [])
    with refuses(ValueError):
        Probe(BODY, LINKS, LOCAL, ORIENTED).read(np.zeros(3))
