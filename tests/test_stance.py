"""Where a robot stands."""

import numpy as np

from followers import op3
from retarget import rotations
from retarget.stance import plant


def test_soles_are_on_the_ground_about_the_origin() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    left, right = stance.soles
    assert np.allclose(left.position + right.position, 0.0, atol=1e-12)
    assert np.allclose(left.position * [1.0, -1.0, 1.0], right.position, atol=1e-9)
    assert np.allclose(left.orientation, rotations.IDENTITY)
    reached = op3().points(stance.q[None], ("l_sole", "r_sole"))[0]
    assert np.allclose(reached, [left.position, right.position], atol=1e-9)


def test_a_posture_that_leans_is_put_upright_on_its_soles() -> None:
    angles = dict(op3().profile.postures.stand) | {"l_ank_pitch": 0.6, "r_ank_pitch": -0.6}
    stance = plant(op3(), angles)
    up = rotations.rotate(op3().orientations(stance.q[None], ("l_sole", "r_sole"))[0], np.array([0.0, 0.0, 1.0]))
    assert np.allclose(up, [0.0, 0.0, 1.0], atol=1e-9)
    assert abs(stance.points["l_sole"][2]) < 1e-9


def test_the_corners_of_a_sole_are_its_outline() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    for sole in stance.soles:
        links = [sole.frame.body] * len(sole.corners)
        corners = op3().body.solver_body().points(stance.q[None], links, sole.corners)[0]
        assert np.allclose(corners[:, :2], sole.outline, atol=1e-9) and np.allclose(corners[:, 2], 0.0, atol=1e-9)


def test_the_margin_moves_the_edges_of_support_inward() -> None:
    stance = plant(op3(), op3().profile.postures.stand)
    assert np.allclose(stance.edges(0.0)[:, 2] - stance.edges(0.01)[:, 2], 0.01)
