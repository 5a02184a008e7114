"""The smallest shape around a link: it encloses, nothing smaller is found, and what is written still encloses."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from messages import refuses, shows
from retarget.errors import InputError, UsageError
from retarget.model.body_file import compile_body_text
from retarget.rotations import normalise, rotate, to_matrix
from retarget.setup.shape_fit import (
    MIN_RADIUS,
    Capsule,
    LinkGeometry,
    Proposal,
    Solid,
    Zones,
    distances_to_segment,
    enclosing_capsule,
    link_geometries,
    propose,
)
from retarget.types import FloatArray

CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
SEEDS = range(4)
ZONES = Zones(0.03, 0.005)


def geometry(centres: FloatArray, radii: FloatArray, turn: FloatArray) -> LinkGeometry:
    return LinkGeometry(1, "link", centres, radii, turn[None], (), None)


def sticks_out(capsule: Capsule, centres: FloatArray, radii: FloatArray) -> float:
    """m; at most zero where every ball is inside."""
    distances = distances_to_segment(centres, capsule.start, capsule.end)
    return float(np.max(distances + radii) - capsule.radius)


def cloud(seed: int) -> FloatArray:
    """Boxes for even seeds, points for odd ones; any size, turned and moved."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 1.0, size=3)
    points = CORNERS * half if seed % 2 == 0 else rng.normal(size=(40, 3)) * half
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return np.asarray(10.0 ** rng.uniform(-2, 1) * points @ turn.T + rng.normal(size=3))


def brute_force(points: FloatArray, seed: int) -> float:
    """Smallest volume of the best radius for 2,000 random segments, the best of them improved without derivatives."""

    def volume(ends: FloatArray) -> float:
        start, end = ends[:3], ends[3:]
        return Capsule(start, end, float(distances_to_segment(points, start, end).max())).volume

    rng = np.random.default_rng(seed)
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    tries = np.tile(middle, 2) + rng.uniform(-0.6, 0.6, size=(2000, 6)) * size
    best = sorted(tries, key=volume)[:4]
    options = {"maxiter": 3000, "xatol": 1e-9 * size, "fatol": 1e-12 * size**3, "adaptive": True}
    return min(float(minimize(volume, start, method="Nelder-Mead", options=options).fun) for start in best)


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_it_encloses_and_no_brute_force_finds_a_smaller_one(seed: int) -> None:
    points = cloud(seed)
    found = enclosing_capsule(points, np.zeros(len(points)))
    assert sticks_out(found, points, np.zeros(len(points))) <= 1e-9
    assert found.volume <= brute_force(points, seed) * (1.0 + 1e-6)
    larger = enclosing_capsule(50.0 * points + 7.0, np.zeros(len(points)))
    assert larger.volume == pytest.approx(50.0**3 * found.volume, rel=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_capsules_own_balls_give_the_capsule(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end, radius = rng.normal(size=3), rng.normal(size=3), 0.3
    found = enclosing_capsule(np.array([start, end]), np.full(2, radius))
    ends = sorted([tuple(found.start), tuple(found.end)])
    assert np.allclose(ends, sorted([tuple(start), tuple(end)]), atol=1e-6)
    assert found.radius == pytest.approx(radius, abs=1e-6)


@pytest.mark.parametrize("points", [[[0, 0, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
def test_points_without_volume_still_get_a_radius(points: list[list[float]]) -> None:
    centres = np.array(points, dtype=np.float64)
    found = enclosing_capsule(centres, np.zeros(len(centres)))
    assert found.radius >= MIN_RADIUS
    assert sticks_out(found, centres, np.zeros(len(centres))) <= 1e-9


PLACE = 'pos="0.1 -0.2 0.3" quat="0.5 0.1 -0.7 0.3"'
KINDS = {
    "sphere": ("0.03", 4 / 3 * np.pi * 0.03**3),
    "capsule": ("0.02 0.1", np.pi * 0.02**2 * (0.2 + 4 / 3 * 0.02)),
    "cylinder": ("0.05 0.08", np.pi * 0.05**2 * 0.16),
    "box": ("0.03 0.05 0.1", 8 * 0.03 * 0.05 * 0.1),
    "ellipsoid": ("0.03 0.06 0.12", 4 / 3 * np.pi * 0.03 * 0.06 * 0.12),
}
"""Size and volume, m^3."""


def model(geoms: str, extra: str = "", *, name: str = "arm") -> Any:
    text = f"""<mujoco>{extra}<worldbody><body name="base"><geom name="b" type="sphere" size="0.01" mass="1"/>
      <body name="{name}"><joint name="j"/>{geoms}<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body></worldbody></mujoco>"""
    return compile_body_text(text, source="test").model


def arm(geoms: str, extra: str = "") -> LinkGeometry:
    return link_geometries(model(geoms, extra))[0][1]


def surface(kind: str, size: FloatArray, count: int = 4000) -> FloatArray:
    """Points on a geom, in its own frame."""
    rng = np.random.default_rng(0)
    n = rng.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    if kind in ("sphere", "ellipsoid"):
        return np.asarray(n * (size if kind == "ellipsoid" else size[0]))
    if kind == "capsule":
        return np.asarray(n * size[0] + np.sign(n[:, 2:]) * [0.0, 0.0, size[1]])
    if kind == "box":
        return np.asarray(np.sign(n) * size)
    flat = n[:, :2] / np.linalg.norm(n[:, :2], axis=1)[:, None]
    return np.hstack([flat * size[0], np.sign(n[:, 2:]) * size[1]])


@pytest.mark.parametrize("kind", KINDS)
def test_the_capsule_of_a_geom_holds_its_surface(kind: str) -> None:
    size, volume = KINDS[kind]
    compiled = model(f'<geom name="g" type="{kind}" size="{size}" {PLACE}/>')
    geometry = link_geometries(compiled)[0][1]
    capsule = enclosing_capsule(geometry.centres, geometry.radii)
    points = rotate(compiled.geom_quat[1], surface(kind, compiled.geom_size[1])) + compiled.geom_pos[1]
    assert distances_to_segment(points, capsule.start, capsule.end).max() <= capsule.radius + 1e-9
    assert geometry.hull_volume() == pytest.approx(volume, rel=0.02)


def test_a_mesh_counts_with_its_vertices_wherever_the_compiler_moved_it() -> None:
    corners = "0 0 0  0.2 0 0  0 0.1 0  0 0 0.05  0.01 0.01 0.01"
    geometry = arm('<geom type="mesh" mesh="m"/>', f'<asset><mesh name="m" vertex="{corners}"/></asset>')
    expected = np.array([[0, 0, 0], [0, 0, 0.05], [0, 0.1, 0], [0.2, 0, 0]])
    found = geometry.centres[np.lexsort(np.round(geometry.centres, 6).T[::-1])]
    assert np.allclose(found, expected, atol=1e-6)  # the inner one is not on the hull


def test_a_body_without_geometry_is_refused() -> None:
    text = """<mujoco><worldbody><body name="a"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </worldbody></mujoco>"""
    with refuses(InputError):
        link_geometries(compile_body_text(text, source="test").model)


FOOT = '<geom name="sole" type="box" size="0.0635 0.028 0.004"/>'
WIDE = '<geom type="box" size="0.057 0.039 0.004" quat="1 0.1 0.2 0.3"/>'


def proposal(geoms: str, *, name: str = "arm") -> Proposal:
    return propose(link_geometries(model(geoms, name=name))[0], ZONES)[1]


@pytest.mark.parametrize(
    ("geoms", "kind", "geom"),
    [
        (FOOT, "box", "sole"),
        (FOOT.replace('name="sole"', ""), "box", ""),
        ('<geom name="disc" type="cylinder" size="0.1 0.005"/>', "cylinder", "disc"),
    ],
)
def test_what_is_flat_gets_its_own_named_geom(geoms: str, kind: str, geom: str) -> None:
    found = proposal(geoms)
    assert isinstance(found.shape, Solid) and (found.shape.kind, found.shape.geom) == (kind, geom)
    shows(found.why)


def test_a_chunky_body_gets_a_box_if_a_capsule_would_reach_out_farther_than_it_acts() -> None:
    chunky = '<geom name="g" type="box" size="{} {} {}"/>'
    assert isinstance(proposal(chunky.format(0.09, 0.07, 0.08)).shape, Solid)
    assert isinstance(proposal(chunky.format(0.009, 0.007, 0.008)).shape, Capsule)


@pytest.mark.parametrize("geoms", [FOOT + WIDE, WIDE, '<geom type="ellipsoid" size="0.031 0.032 0.2" pos="1 2 3"/>'])
def test_what_is_rounded_still_encloses(geoms: str) -> None:
    geometry = arm(geoms)
    shape = propose((geometry,), ZONES)[0].shape
    if isinstance(shape, Capsule):
        assert np.array_equal(np.round(shape.start, 5), shape.start)
        assert (distances_to_segment(geometry.centres, shape.start, shape.end) <= shape.radius + 1e-9).all()
    else:
        local = (geometry.centres - shape.pos) @ to_matrix(normalise(shape.quat))
        assert (np.abs(local) <= shape.size + 1e-9).all()


@pytest.mark.parametrize("zones", [(0.0, 0.0), (np.nan, 0.0), (np.inf, 0.0), (0.1, 0.1), (0.1, -0.1), (0.1, np.nan)])
def test_zones_that_no_profile_may_have_are_refused(zones: tuple[float, float]) -> None:
    with pytest.raises(UsageError):
        Zones(*zones)
