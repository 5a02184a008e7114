"""Where geoms are over postures, and that no point of them goes farther than is said."""

import numpy as np

from retarget.metrics.moving_geoms import MovingGeoms, travelled
from retarget.rotations import FloatArray, normalise, to_matrix


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
