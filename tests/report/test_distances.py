"""The search over postures finds what a look at all of them finds, with fewer looks."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from retarget.model.body_file import compile_body_text
from retarget.model.scene_state import SceneState
from retarget.report.clearance import (
    MovingGeoms,
    among_obstacles,
    closest_pairs,
    moving_geoms,
    scene_model,
)
from retarget.rotations import normalise, to_matrix
from retarget.schema.scene import load_scene
from retarget.types import FloatArray, IntArray


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("offset", [0.5, 0.0, -0.3])
def test_all_is_found(seed: int, offset: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("retarget.report.clearance.BLOCK", 64)
    rng = np.random.default_rng(seed)
    table = offset + np.abs(0.3 + np.cumsum(rng.normal(0.0, 0.01, (400, 12)), axis=0)) - 0.05
    bound = table - rng.uniform(0.0, 0.05, table.shape)
    looked = 0

    def distances(rows: IntArray, pairs: IntArray) -> FloatArray:
        nonlocal looked
        looked += len(rows)
        assert (np.diff(rows) >= 0).all()
        return np.asarray(table[rows, pairs])

    found = closest_pairs(distances, lambda rows: bound[rows], len(table), tolerances=(1e-6, 1e-3))
    assert found.smallest == table.min()
    assert table[found.row, found.pair] == table.min()
    nearest = table.min(axis=1)
    assert found.deeper == tuple(int(np.count_nonzero(nearest < -depth)) for depth in (1e-6, 1e-3))
    assert looked < (table.size // 2 if offset == 0.5 else table.size)


def test_the_first_of_equals_is_named() -> None:
    table = np.array([[0.2, 0.1, 0.1], [0.1, 0.3, 0.1]])
    found = closest_pairs(lambda rows, pairs: table[rows, pairs], lambda rows: table[rows] - 1.0, 2, tolerances=(0.0,))
    assert (found.smallest, found.row, found.pair, found.deeper) == (0.1, 0, 1, (0,))


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
    geoms = MovingGeoms(model, np.array([0, 1]), position, turn.reshape(rows, 2, 9))
    found = geoms.distances(np.array([[0, 1]]))(np.arange(rows), np.zeros(rows, dtype=np.int64))
    wanted = np.array([box_distance(p, t) for p, t in zip(position, turn, strict=True)])
    assert 200 < np.count_nonzero(wanted < 0.0) < rows - 200
    assert np.abs(found - wanted).max() < 1e-6


@pytest.mark.parametrize("second", ['"box" size=".1 .2 .3"', '"plane" size="1 1 1"', '"sphere" size=".1"'])
def test_no_pair_is_nearer_than_its_bound(second: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><mesh name="m" vertex="0 0 0 .3 0 0 0 .1 0 0 0 .2"/></asset><worldbody>'
        f'<geom type="mesh" mesh="m"/><geom type={second}/></worldbody></mujoco>'
    )
    rng, rows = np.random.default_rng(1), 300
    position, turn = rng.uniform(-0.5, 0.5, (rows, 2, 3)), to_matrix(normalise(rng.normal(size=(rows, 2, 4))))
    geoms, one = MovingGeoms(model, np.array([0, 1]), position, turn.reshape(rows, 2, 9)), np.array([[0, 1]])
    found = geoms.distances(one)(np.arange(rows), np.zeros(rows, dtype=np.int64))
    bound = geoms.bounds(one)(np.arange(rows))[:, 0]
    assert (bound <= found + 1e-9).all() and (bound > 0.0).any()


def test_a_body_and_its_scene_share_a_model() -> None:
    body = compile_body_text(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body><freejoint/><geom type="box" size="1 2 3" mass="1"/>'
        '<geom type="ellipsoid" size="1 2 3"/></body></worldbody></mujoco>',
        source="test",
    )
    scene = SceneState(load_scene("table"))
    model, obstacles = scene_model(body, scene.shapes)
    assert model.ngeom == 1 + 5 + 2
    np.testing.assert_allclose(model.geom_size[np.array([1, 2]) + 5], [[1, 2, 3], [1, 2, 3]])
    top = scene.shapes.names.index("top")
    np.testing.assert_allclose(model.geom_size[obstacles[top]], [0.15, 0.3, 0.008])


def test_obstacles_are_followed_over_time() -> None:
    body = compile_body_text(
        '<mujoco><worldbody><body><joint/><geom size="1"/></body></worldbody></mujoco>', source="t"
    )
    scene, times = SceneState(load_scene("crossing_ball")), np.array([-1.0, 1.0, 2.5, 4.0])
    geoms = among_obstacles(body, moving_geoms(body.model, np.zeros((4, 1))), scene, times)
    np.testing.assert_allclose(geoms.position[:, 0, 1], [0.6, 0.6, 0.0, -0.6], atol=1e-12)
    np.testing.assert_allclose(geoms.matrix[:, 0], np.tile(np.eye(3).ravel(), (4, 1)), atol=1e-12)
    np.testing.assert_allclose(geoms.model.geom_rbound[geoms.geoms], [0.05, 1.0])
