"""The search over postures finds what a look at all of them finds, with fewer looks."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from messages import refuses
from retarget.model.body_file import compile_body_text
from retarget.model.scene_state import SceneState
from retarget.report.distances import (
    MovingGeoms,
    closest_pairs,
    geom_distances,
    obstacle_tracks,
    scene_model,
    travelled,
)
from retarget.rotations import normalise, to_matrix
from retarget.schema.scene import load_scene
from retarget.types import FloatArray, IntArray


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("offset", [0.5, 0.0, -0.3])
def test_all_is_found(seed: int, offset: float) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.01, (400, 12))
    table = offset + np.abs(0.3 + np.cumsum(steps, axis=0)) - 0.05
    way = np.vstack([np.zeros(12), np.cumsum(np.abs(steps[1:]), axis=0)])
    looked = 0

    def distances(rows: IntArray, pairs: IntArray) -> FloatArray:
        nonlocal looked
        looked += len(rows)
        assert (np.diff(rows) >= 0).all()
        return np.asarray(table[rows, pairs])

    found = closest_pairs(distances, way, tolerances=(1e-6, 1e-3))
    assert found.smallest == table.min()
    assert table[found.row, found.pair] == table.min()
    nearest = table.min(axis=1)
    assert found.deeper == tuple(int(np.count_nonzero(nearest < -depth)) for depth in (1e-6, 1e-3))
    assert looked < (table.size // 2 if offset == 0.5 else table.size)


def test_one_posture_is_enough() -> None:
    found = closest_pairs(lambda rows, pairs: np.array([0.2, -0.1])[pairs], np.zeros((1, 2)), tolerances=(0.0,))
    assert (found.smallest, found.row, found.pair, found.deeper) == (-0.1, 0, 1, (1,))


def test_nothing_is_no_answer() -> None:
    with refuses(ValueError, 0):
        closest_pairs(lambda rows, pairs: np.zeros(0), np.zeros((3, 0)), tolerances=())


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


def motion(rows: int, seed: int) -> MovingGeoms:
    rng = np.random.default_rng(seed)
    quats = normalise(np.array([1.0, 0, 0, 0]) + np.cumsum(rng.normal(0.0, 0.05, (rows, 3, 4)), axis=0))
    position = np.cumsum(rng.normal(0.0, 0.01, (rows, 3, 3)), axis=0)
    every = np.arange(3)
    return MovingGeoms(every, every, position, to_matrix(quats).reshape(rows, 3, 9), np.array([0.1, 0.2, 0.3]))


def world(geoms: MovingGeoms, points: FloatArray) -> FloatArray:
    """Points (g, n, 3) of the geoms in the world (T, g, n, 3)."""
    turn = geoms.matrix.reshape(*geoms.matrix.shape[:2], 3, 3)
    return np.asarray(geoms.position[:, :, None] + np.einsum("tgij,gnj->tgni", turn, points))


def test_no_point_goes_farther() -> None:
    geoms = motion(60, seed=1)
    way = travelled(geoms.position, geoms.matrix, geoms.radius)
    directions = np.random.default_rng(2).normal(size=(3, 50, 3))
    points = directions / np.linalg.norm(directions, axis=-1, keepdims=True) * geoms.radius[:, None, None]
    placed = world(geoms, points)
    gone = np.linalg.norm(placed[:, None] - placed[None], axis=-1).max(axis=-1)  # (T, T, g)
    assert (gone <= np.abs(way[:, None] - way[None]) + 1e-12).all()
    assert (np.diff(way, axis=0) >= 0.0).all()


def test_seen_from_a_geom_distances_stay_and_it_rests() -> None:
    geoms = motion(10, seed=4)
    seen = geoms.within(1)
    points = np.random.default_rng(5).normal(size=(3, 4, 3))
    before, after = world(geoms, points), world(seen, points)
    np.testing.assert_allclose(
        np.linalg.norm(before[:, 0] - before[:, 2], axis=-1), np.linalg.norm(after[:, 0] - after[:, 2], axis=-1)
    )
    assert travelled(seen.position, seen.matrix, seen.radius)[-1, 1] < 1e-12


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
    scene, times = SceneState(load_scene("crossing_ball")), np.array([-1.0, 1.0, 2.5, 4.0])
    position, matrix, radius = obstacle_tracks(scene, times)
    np.testing.assert_allclose(position[:, 0, 1], [0.6, 0.6, 0.0, -0.6], atol=1e-12)
    np.testing.assert_allclose(matrix[:, 0], np.tile(np.eye(3).ravel(), (4, 1)), atol=1e-12)
    np.testing.assert_allclose(radius, [0.05])
