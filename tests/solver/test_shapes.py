"""Signed distance of solids: certificates, brute force over features, hulls of Minkowski differences, and MuJoCo.

A pair that is apart is proved by itself: the points lie on the solids (so the distance is not larger), and along the
normal the solids are that far apart (so it is not smaller). Of a pair that overlaps the normal proves a way out; that
there is no shorter one is searched for.
"""

from itertools import product

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from messages import Facts, refuses
from oracles.problem import Array
from oracles.solids import (
    BOX,
    CAPSULE,
    CYLINDER,
    HALF_SPACE,
    NAMES,
    Solids,
    cores_apart,
    corners,
    depth,
    nearest,
    one,
    random_pairs,
    random_solids,
    support,
    together,
    widest_gap,
)
from retarget import _solver

EXACT = 1e-9
MANNERS = ("free", "aligned", "tilted", "touching")
KINDS = [(k, m) for k, m in product(range(4), repeat=2) if (k, m) != (HALF_SPACE, HALF_SPACE)]
POLYTOPES = [(CAPSULE, CAPSULE), (CAPSULE, BOX), (BOX, CAPSULE), (BOX, BOX)]
PER_KIND = 1700  # times 4 manners, times 15 pairs of kinds: 102,000
each_pair = pytest.mark.parametrize("kinds", KINDS, ids=lambda kinds: f"{NAMES[kinds[0]]}-{NAMES[kinds[1]]}")


def pairs(kinds: tuple[int, int], manner: str, n: int, seed: int = 0) -> tuple[Solids, Solids]:
    rng = np.random.default_rng([seed, *kinds, MANNERS.index(manner)])
    if manner != "touching":
        return random_pairs(kinds, manner, n, rng)
    a, b = random_pairs(kinds, "free", n, rng)
    distance, _, _, normal = nearest(a, b)
    gap = rng.choice([-1.0, 0.0, 1.0], n) * 10.0 ** rng.uniform(-14.0, -3.0, n)
    return a.moved((gap - distance)[:, None] * normal), b


@pytest.mark.parametrize("manner", MANNERS)
@each_pair
def test_points_lie_on_the_solids_and_the_normal_keeps_them_apart(kinds: tuple[int, int], manner: str) -> None:
    a, b = pairs(kinds, manner, PER_KIND)
    distance, point_a, point_b, normal = nearest(a, b)
    assert all(np.isfinite(values).all() for values in (distance, point_a, point_b, normal))
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-14)
    assert np.abs(point_a - point_b - distance[:, None] * normal).max() < 1e-14
    on_surface = 1e-7 if CYLINDER in kinds else 4 * EXACT
    if kinds == (CYLINDER, CYLINDER) and manner == "tilted":
        on_surface = (
            2e-5  # overlapping caps that are parallel but for 1e-5 rad: the depth is sharp, its points are less so
        )
    assert depth(a, point_a).max() < on_surface
    assert depth(b, point_b).max() < on_surface
    # A difference of points that are 1e-10 apart gives its direction to 1e-6.
    along = -support(a, -normal) - support(b, normal)
    assert np.all(np.abs(along - distance) < EXACT + 1e-16 / np.maximum(np.abs(distance), 1e-10))


@pytest.mark.parametrize("manner", MANNERS)
@pytest.mark.parametrize("kinds", POLYTOPES)
def test_distance_is_the_smallest_over_all_features(kinds: tuple[int, int], manner: str) -> None:
    a, b = pairs(kinds, manner, 400, seed=1)
    distance = (
        nearest(a, b)[0] + np.where(a.kind == CAPSULE, a.size[:, 0], 0) + np.where(b.kind == CAPSULE, b.size[:, 0], 0)
    )
    expected = cores_apart(a, b)
    apart = (distance > 0.0) & (expected > 0.0)
    assert np.sum(apart) > 50
    assert np.abs(distance - expected)[apart].max() < EXACT
    if kinds == (CAPSULE, CAPSULE):
        assert np.abs(distance - expected).max() < EXACT


@pytest.mark.parametrize("kinds", POLYTOPES[1:])
def test_depth_of_polytopes_is_that_of_the_hull_of_their_difference(kinds: tuple[int, int]) -> None:
    a, b = pairs(kinds, "free", 400, seed=2)
    keep = np.minimum(a.size + (kinds[0] == CAPSULE), b.size + (kinds[1] == CAPSULE)).min(axis=1) > 0.0
    for x, kind in ((a, kinds[0]), (b, kinds[1])):
        keep &= (kind != CAPSULE) | (x.size[:, 1] > 0.0)
        x.size[:, 0] *= kind != CAPSULE  # the core
    a, b = a[keep], b[keep]
    distance = nearest(a, b)[0]
    inside = np.flatnonzero(distance < -1e-4)[:60]
    assert len(inside) > 20
    points_a, points_b = corners(a), corners(b)
    for i in inside:
        hull = ConvexHull((points_a[i][:, None] - points_b[i][None]).reshape(-1, 3))
        assert distance[i] == pytest.approx(hull.equations[:, 3].max(), abs=EXACT)


@each_pair
def test_no_direction_leads_out_sooner(kinds: tuple[int, int]) -> None:
    if HALF_SPACE in kinds:
        pytest.skip("one direction only")
    a, b = together_of([pairs(kinds, manner, 60, seed=3) for manner in MANNERS])
    distance, *_ = nearest(a, b)
    overlap = np.flatnonzero(distance < 0.0)[:60]
    seeds = np.random.default_rng(4).normal(size=(len(overlap), 24, 3))
    found = widest_gap(a[overlap], b[overlap], seeds)
    assert np.all(found < distance[overlap] + EXACT)
    # The search is worth something: it comes near what it tries to beat.
    assert np.median(distance[overlap] - found) < 1e-3


def together_of(parts: list[tuple[Solids, Solids]]) -> tuple[Solids, Solids]:
    return together([a for a, _ in parts]), together([b for _, b in parts])


MUJOCO = {CAPSULE: "capsule", CYLINDER: "cylinder", BOX: "box", HALF_SPACE: "plane"}


def mujoco_distances(a: Solids, b: Solids) -> Array:
    """`mj_geomDistance` (N,) with a tight tolerance; sizes must be positive."""
    size = {HALF_SPACE: "1 1 1"}
    geoms = "".join(
        f'<body><geom type="{MUJOCO[k]}" size="{size.get(k, ".1 .1 .1")}"/></body>' for k in (a.kind[0], b.kind[0])
    )
    geoms = geoms.replace('<body><geom type="plane" size="1 1 1"/></body>', '<geom type="plane" size="1 1 1"/>')
    option = '<option ccd_tolerance="1e-12" ccd_iterations="1000"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    first, second = (
        (0, 1) if model.geom_type[0] == getattr(mujoco.mjtGeom, f"mjGEOM_{MUJOCO[a.kind[0]].upper()}") else (1, 0)
    )
    found = np.zeros(len(a.kind))
    for i in range(len(found)):
        for solids, geom in ((a, first), (b, second)):
            model.geom_size[geom] = solids.size[i]
            model.geom_rbound[geom] = 0.0 if solids.kind[i] == HALF_SPACE else np.linalg.norm(solids.size[i]) * 2.0
            data.geom_xpos[geom], data.geom_xmat[geom] = solids.pos[i], solids.matrix[i].ravel()
        found[i] = mujoco.mj_geomDistance(model, data, first, second, 10.0, None)
    return found


@each_pair
def test_mujoco_measures_the_same(kinds: tuple[int, int]) -> None:
    a, b = pairs(kinds, "free", 200, seed=5)
    for x, kind in ((a, kinds[0]), (b, kinds[1])):
        x.size[:, : {CAPSULE: 2, CYLINDER: 2, BOX: 3, HALF_SPACE: 0}[kind]] += 0.02
    distance = nearest(a, b)[0]
    if set(kinds) == {CAPSULE, BOX}:
        # MuJoCo stops looking for the way out of a capsule whose segment is in the box; the hull test covers those.
        radius = np.where(a.kind == CAPSULE, a.size[:, 0], b.size[:, 0])
        near = distance > -radius
        a, b, distance = a[near], b[near], distance[near]
    assert len(distance) > 100
    assert np.abs(distance - mujoco_distances(a, b)).max() < 1e-9


@each_pair
def test_normal_is_the_gradient(kinds: tuple[int, int]) -> None:
    """d distance = normal . (velocity of a - velocity of b), for rigid motions of A about its centre."""
    a, b = pairs(kinds, "free", 400, seed=11)
    distance, point, _, normal = nearest(a, b)
    rng, step = np.random.default_rng(12), 1e-6
    linear, angular = rng.normal(size=(2, len(distance), 3))
    at = []
    for side in (-step, step):
        turn = Rotation.from_rotvec(side * angular) * Rotation.from_quat(a.quat, scalar_first=True)
        quat = np.ascontiguousarray(turn.as_quat(scalar_first=True))
        at.append(nearest(Solids(a.kind, a.size, a.pos + side * linear, quat), b))
    expected = np.sum(normal * (linear + np.cross(angular, point - a.pos)), axis=1)
    slope = (at[1][0] - at[0][0]) / (2 * step)
    # Where the normal jumps (an overlap with two ways out) or the point does (parallel sides) there is no gradient.
    smooth = np.linalg.norm(at[1][3] - at[0][3], axis=1) + np.linalg.norm(at[1][1] - at[0][1], axis=1) < 1e-3
    smooth &= np.abs(distance) > 1e-3
    assert np.mean(smooth) > 0.75
    assert np.abs(slope - expected)[smooth].max() < 1e-5


def test_lower_bound_is_one() -> None:
    a, b = together_of([pairs(kinds, manner, 300, seed=13) for kinds in KINDS for manner in MANNERS])
    least = _solver.shape_gaps_at_least(*a.arguments, *b.arguments)
    distance = nearest(a, b)[0]
    assert np.all(least <= distance + EXACT)
    flat = (a.kind == HALF_SPACE) | (b.kind == HALF_SPACE)
    assert least[flat] == pytest.approx(distance[flat], abs=1e-12)


# Solids by hand: touching, crossing, parallel, concentric; nothing and plates; what the binding refuses.


@pytest.mark.parametrize("kinds", KINDS, ids=lambda kinds: f"{NAMES[kinds[0]]}-{NAMES[kinds[1]]}")
def test_points_lines_and_plates_have_finite_distances(kinds: tuple[int, int]) -> None:
    a, b = (random_solids(kind, 500, np.random.default_rng([14, kind])) for kind in kinds)
    nothing = [
        Solids(x.kind, x.size * np.random.default_rng(15).choice([0.0, 1.0, 1e-300, 1e6], x.size.shape), x.pos, x.quat)
        for x in (a, b)
    ]
    for far in (0.0, 1e-300, 1e-20, 1e-9, 1e6):
        found = nearest(nothing[0].moved(np.full(3, far)), nothing[1])
        assert all(np.isfinite(values).all() for values in found)
        assert np.linalg.norm(found[3], axis=1) == pytest.approx(1.0, abs=1e-12)


BAD = [
    (0, np.array([4]), 4),
    (1, np.array([[0.1, -0.1, 0.0]]), ()),
    (1, np.array([[np.nan, 0.1, 0.0]]), ()),
    (2, np.array([[0.0, np.inf, 0.0]]), ()),
    (2, np.zeros((1, 2)), ()),
    (3, np.zeros((1, 4)), ()),
    (0, np.array([0, 0]), ()),
]


@pytest.mark.parametrize("side", [0, 4])
@pytest.mark.parametrize(("field", "value", "facts"), BAD)
@pytest.mark.parametrize("function", [_solver.shape_distances, _solver.shape_gaps_at_least])
def test_bad_solids_are_refused(function, side: int, field: int, value: Array, facts: Facts) -> None:  # type: ignore[no-untyped-def]
    ball = one(CAPSULE, (0.1, 0.1))
    arguments = [*ball.arguments, *ball.arguments]
    arguments[side + field] = value
    with refuses(ValueError, facts):
        function(*arguments)


def test_column_major_arrays_are_refused() -> None:
    balls = together([one(CAPSULE, (0.1, 0.1))] * 2)
    with refuses(ValueError, "pos_a"):
        nearest(Solids(balls.kind, balls.size, np.asfortranarray(balls.pos), balls.quat), balls)


def test_two_half_spaces_and_unequal_numbers_are_refused() -> None:
    plane, ball = one(HALF_SPACE, ()), one(CAPSULE, (0.1, 0.1))
    with refuses(ValueError):
        nearest(plane, plane)
    with refuses(ValueError, "kinds_b", 1):
        nearest(together([ball, ball]), ball)
