"""The smallest enclosing capsule: encloses, gives known answers, and no brute force finds a smaller one."""

import numpy as np
import pytest
from scipy.optimize import minimize

from retarget.fitting.capsule import MIN_RADIUS, Capsule, distances_to_segment, enclosing_capsule
from retarget.rotations import FloatArray

SEEDS = range(6)


def sticks_out(capsule: Capsule, centres: FloatArray, radii: FloatArray) -> float:
    """m; at most zero where every ball is inside."""
    distances = distances_to_segment(centres, capsule.start, capsule.end)
    return float(np.max(distances + radii) - capsule.radius)


def box_corners(half: FloatArray) -> FloatArray:
    return np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T * half


def random_turn(rng: np.random.Generator) -> FloatArray:
    return np.asarray(np.linalg.qr(rng.normal(size=(3, 3)))[0])


def cloud(seed: int) -> FloatArray:
    """Boxes for even seeds, points for odd ones; any size, turned and moved."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 1.0, size=3)
    points = box_corners(half) if seed % 2 == 0 else rng.normal(size=(40, 3)) * half
    return np.asarray(10.0 ** rng.uniform(-2, 1) * points @ random_turn(rng).T + rng.normal(size=3))


def brute_force(points: FloatArray, seed: int) -> float:
    """Smallest volume of the best radius for 4,000 random segments, the best of them improved without derivatives."""

    def volume(ends: FloatArray) -> float:
        start, end = ends[:3], ends[3:]
        radius = float(distances_to_segment(points, start, end).max())
        return Capsule(start, end, radius).volume

    rng = np.random.default_rng(seed)
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    tries = np.tile(middle, 2) + rng.uniform(-0.6, 0.6, size=(4000, 6)) * size
    best = sorted(tries, key=volume)[:6]
    options = {"maxiter": 4000, "xatol": 1e-9 * size, "fatol": 1e-12 * size**3, "adaptive": True}
    return min(float(minimize(volume, start, method="Nelder-Mead", options=options).fun) for start in best)


@pytest.mark.parametrize("seed", SEEDS)
def test_it_encloses_and_no_brute_force_finds_a_smaller_one(seed: int) -> None:
    points = cloud(seed)
    found = enclosing_capsule(points, np.zeros(len(points)))
    assert sticks_out(found, points, np.zeros(len(points))) <= 1e-9
    assert found.volume <= brute_force(points, seed) * (1.0 + 1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_capsules_own_points_give_the_capsule(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end, radius = rng.normal(size=3), rng.normal(size=3), 0.3
    found = enclosing_capsule(np.array([start, end]), np.full(2, radius))
    ends = sorted([tuple(found.start), tuple(found.end)])
    assert np.allclose(ends, sorted([tuple(start), tuple(end)]), atol=1e-6)
    assert found.radius == pytest.approx(radius, abs=1e-6)
    assert sticks_out(found, np.array([start, end]), np.full(2, radius)) <= 1e-9


def test_the_surface_of_a_capsule_gives_it_back() -> None:
    rng = np.random.default_rng(3)
    n = rng.normal(size=(3000, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    points = 0.2 * n + np.where(n[:, 2:] > 0.0, [0.0, 0.0, 0.5], [0.0, 0.0, -0.5])
    found = enclosing_capsule(points, np.zeros(len(points)))
    assert found.radius == pytest.approx(0.2, rel=2e-3)
    assert found.length == pytest.approx(1.0, rel=5e-3)
    assert found.volume <= Capsule(np.array([0, 0, -0.5]), np.array([0, 0, 0.5]), 0.2).volume * (1.0 + 1e-6)


def test_a_ball_is_a_ball() -> None:
    found = enclosing_capsule(np.array([[1.0, 2.0, 3.0]]), np.array([0.25]))
    assert found.is_ball and found.radius == pytest.approx(0.25) and found.start.tolist() == [1.0, 2.0, 3.0]
    one_in_the_other = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]])
    both = enclosing_capsule(one_in_the_other, np.array([0.5, 0.1]))
    assert both.is_ball and both.radius == pytest.approx(0.5)


def test_a_cube_is_no_ball_although_all_its_corners_lie_on_one() -> None:
    found = enclosing_capsule(box_corners(np.ones(3)), np.zeros(8))
    assert found.volume < 4.0 / 3.0 * np.pi * 3.0**1.5 - 0.1


@pytest.mark.parametrize("points", [[[0, 0, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
def test_points_without_volume_still_get_a_radius(points: list[list[float]]) -> None:
    centres = np.array(points, dtype=np.float64)
    found = enclosing_capsule(centres, np.zeros(len(centres)))
    assert found.radius >= MIN_RADIUS
    assert sticks_out(found, centres, np.zeros(len(centres))) <= 1e-9


def test_the_same_points_give_the_same_bits() -> None:
    first, second = (enclosing_capsule(cloud(1), np.zeros(40)) for _ in range(2))
    assert first.start.tolist() == second.start.tolist() and first.radius == second.radius


def test_scale_and_place_do_not_matter() -> None:
    points = cloud(1)
    one = enclosing_capsule(points, np.zeros(40))
    other = enclosing_capsule(50.0 * points + 7.0, np.zeros(40))
    assert other.volume == pytest.approx(50.0**3 * one.volume, rel=1e-6)
