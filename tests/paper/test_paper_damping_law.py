"""Figure 4: what the compiled solver leaves of four displacements beside a sphere, against the law written out."""

import numpy as np
import pytest

from benchmarks.paper.damping_law import BALL, DampedPoint, damped_points


@pytest.fixture(scope="module")
def points() -> dict[str, DampedPoint]:
    return {point.name: point for point in damped_points()}


def test_outside_and_moving_away_nothing_is_altered(points: dict[str, DampedPoint]) -> None:
    for name in ("e1", "e4"):
        assert not points[name].acted
        np.testing.assert_allclose(points[name].got, points[name].asked, atol=1e-9)


def test_only_the_normal_motion_is_damped_by_alpha(points: dict[str, DampedPoint]) -> None:
    for name in ("e2", "e3"):
        point = points[name]
        asked, got = point.asked @ point.normal, point.got @ point.normal
        assert point.acted and asked < 0.0
        assert got == pytest.approx(point.share * asked, abs=1e-9)
        np.testing.assert_allclose(point.got - got * point.normal, point.asked - asked * point.normal, atol=1e-9)


def test_the_nearer_is_damped_more(points: dict[str, DampedPoint]) -> None:
    far, near = points["e2"], points["e3"]
    assert np.linalg.norm(near.position) < np.linalg.norm(far.position)
    assert 0.0 < near.share < far.share < 1.0


def test_the_four_are_where_the_figure_has_them(points: dict[str, DampedPoint]) -> None:
    distance = {name: float(np.linalg.norm(point.position)) - BALL.radius for name, point in points.items()}
    assert distance["e1"] > BALL.influence
    assert all(0.0 < distance[name] < BALL.influence for name in ("e2", "e3", "e4"))
    assert points["e4"].asked @ points["e4"].normal > 0.0
