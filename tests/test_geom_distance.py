"""Distances of MuJoCo's, against a least-squares problem between boxes (apart) and separating axes (inside)."""

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from retarget.metrics.geom_distance import geom_distances
from retarget.rotations import FloatArray, normalise, to_matrix

SIZES = np.array([[0.021, 0.0565, 0.0151], [0.08725, 0.0646, 0.0728]])


def box_distance(position: FloatArray, turn: FloatArray) -> float:
    """Signed distance of the two boxes at (2, 3) m, turned (2, 3, 3)."""
    axes = [*turn[0].T, *turn[1].T, *(np.cross(a, b) for a in turn[0].T for b in turn[1].T)]
    unit = np.array([axis / np.linalg.norm(axis) for axis in axes])
    between = np.abs(unit @ (position[1] - position[0]))
    separation = float((between - np.abs(unit @ turn[0]) @ SIZES[0] - np.abs(unit @ turn[1]) @ SIZES[1]).max())
    if separation <= 0.0:
        return separation
    matrix, ends = np.hstack([turn[0], -turn[1]]), SIZES.ravel()
    found = lsq_linear(matrix, position[1] - position[0], bounds=(-ends, ends), method="bvls")
    return float(np.sqrt(2.0 * found.cost))


def test_boxes_are_exact_apart_and_inside() -> None:
    rng, rows = np.random.default_rng(0), 1000
    turn = to_matrix(normalise(rng.normal(size=(rows, 2, 4))))
    position = rng.uniform(-0.1, 0.1, (rows, 2, 3))
    text = "".join(f'<geom type="box" size="{a} {b} {c}"/>' for a, b, c in SIZES)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    both, one = np.array([0, 1]), np.array([[0, 1]])
    measure = geom_distances(model, one, geoms=both, position=position, matrix=turn.reshape(rows, 2, 9))
    found = measure(np.arange(rows), np.zeros(rows, dtype=np.int64))
    wanted = np.array([box_distance(p, t) for p, t in zip(position, turn, strict=True)])
    assert 200 < np.count_nonzero(wanted < 0.0) < rows - 200
    assert np.abs(found - wanted).max() < 1e-6
