"""Support polygons: hulls, margins, distances."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from retarget.support import convex_hull, sole_outline, support_distance, support_edges

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
COORDINATES = st.floats(-1.0, 1.0).map(lambda value: round(value, 3))
POINTS = st.lists(st.tuples(COORDINATES, COORDINATES), min_size=6, max_size=20, unique=True).map(np.array)


def area(corners: np.ndarray) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_the_hull_of_two_feet_spans_both() -> None:
    hull = convex_hull(np.concatenate([SQUARE, SQUARE + np.array([2.0, 0.0]), [[1.5, 0.5]]]))
    assert {tuple(corner) for corner in hull} == {(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (0.0, 1.0)}


@given(POINTS)
def test_a_hull_is_counter_clockwise_and_holds_every_point(points: np.ndarray) -> None:
    hull = convex_hull(points)
    if len(hull) > 2 and area(hull) > 1e-3:
        edges = support_edges([points])
        assert np.allclose(np.linalg.norm(edges[:, :2], axis=1), 1.0)
        assert support_distance(points, edges).min() > -1e-9


def test_distance_is_that_to_the_nearest_edge() -> None:
    edges = support_edges([SQUARE])
    points = np.array([[0.5, 0.5, 9.0], [0.9, 0.5, 9.0], [1.2, 0.5, 9.0]])
    assert np.allclose(support_distance(points, edges), [0.5, 0.1, -0.2])
    assert np.allclose(support_distance(points[None], edges), [[0.5, 0.1, -0.2]])


def test_a_margin_moves_every_edge_inward() -> None:
    inner = support_edges([SQUARE], margin=0.2)
    assert np.allclose(support_distance(np.array([0.5, 0.5]), inner), 0.3)
    assert support_distance(np.array([0.1, 0.5]), inner) < 0.0


def test_a_margin_that_is_too_large_leaves_the_middle() -> None:
    inner = support_edges([SQUARE], margin=5.0)
    assert support_distance(np.array([0.5, 0.5]), inner) > 0.0


def test_a_sole_is_laid_on_the_ground() -> None:
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    outline = sole_outline(np.array([1.0, 2.0, 0.0]), quarter, np.array([[0.1, 0.0]]))
    assert np.allclose(outline, [[1.0, 2.1]])
