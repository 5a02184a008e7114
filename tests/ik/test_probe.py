"""`_solver.Probe` and `_solver.Footing`: the same as the kinematics of the body, one by one."""

import numpy as np
import pytest

from followers import op3, stance
from messages import refuses
from retarget._solver import Footing, Probe
from retarget.ik.support_polygon import support_distance

BODY = op3().kinematics


def test_footing_gives_the_worst_of_a_path_and_nan_is_never_a_small_loss() -> None:
    sole, stand = stance().soles[0], stance().q
    links, planted = [sole.frame.body] * len(sole.corners), np.insert(sole.outline, 2, 0.0, axis=1)
    edges = stance().edges(0.0)
    footing = Footing(BODY, links, sole.corners, planted, edges)
    off, inside = footing.losses(stand[None])
    assert off < 1e-6 and inside > 0.0
    random = np.random.default_rng(3)
    path = np.array([BODY.integrate(stand, 0.3 * random.standard_normal(BODY.nv)) for _ in range(10)])
    off, inside = footing.losses(path)
    gone = np.linalg.norm(BODY.points(path, links, sole.corners) - planted, axis=2)
    assert off == pytest.approx(gone.max(), abs=1e-12)
    assert inside == pytest.approx(support_distance(BODY.centre_of_mass(path), edges).min(), abs=1e-12)
    bad = stand.copy()
    bad[0] = np.nan
    assert np.isnan(footing.losses(np.array([stand, bad, stand]))).all()


def test_what_does_not_fit_is_refused() -> None:
    with refuses(ValueError, 999):
        Probe(BODY, [999], np.zeros((1, 3)), [])
    with refuses(ValueError, 999):
        Probe(BODY, [], np.zeros((0, 3)), [999])
    with refuses(ValueError):
        Probe(BODY, [1], np.zeros((2, 3)), [])
    with refuses(ValueError):
        Probe(BODY, [3, 7], np.zeros((2, 3)), [1, 5]).read(np.zeros(3))
