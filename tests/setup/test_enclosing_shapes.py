"""The enclosing box finds a turned box again and holds balls."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from messages import refuses, shows
from retarget.errors import InputError
from retarget.model.body_file import compile_body_text
from retarget.rotations import from_axis_angle, rotate, to_matrix
from retarget.setup.enclosing_shapes import (
    MIN_HALF,
    MIN_RADIUS,
    Capsule,
    LinkGeometry,
    distances_to_segment,
    enclosing_box,
    enclosing_capsule,
    link_geometries,
)
from retarget.types import FloatArray

CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T


def geometry(centres: FloatArray, radii: FloatArray, turn: FloatArray) -> LinkGeometry:
    return LinkGeometry(1, "link", centres, radii, turn[None], (), None)


def test_a_turned_box_is_found_again() -> None:
    turn = to_matrix(from_axis_angle([0.6, 0.0, 0.8], 0.7))
    half = np.array([0.1, 0.2, 0.3])
    box = enclosing_box(geometry((CORNERS * half) @ turn.T + [1.0, 0.0, 0.0], np.zeros(8), turn))
    assert box.volume == pytest.approx(8.0 * half.prod())
    assert box.pos == pytest.approx([1.0, 0.0, 0.0])
    assert to_matrix(box.quat) == pytest.approx(turn)


def test_balls_count_with_their_radius() -> None:
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    box = enclosing_box(geometry(centres, np.array([0.1, 0.2]), np.eye(3)))
    assert box.size == pytest.approx([0.65, 0.2, 0.2])
    assert box.pos == pytest.approx([0.55, 0.0, 0.0])


def test_flat_geometry_gets_some_thickness() -> None:
    box = enclosing_box(geometry(CORNERS * [1.0, 1.0, 0.0], np.zeros(8), np.eye(3)))
    assert box.size[2] == MIN_HALF


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


PLACE = 'pos="0.1 -0.2 0.3" quat="0.5 0.1 -0.7 0.3"'
KINDS = {
    "sphere": "0.03",
    "capsule": "0.02 0.1",
    "cylinder": "0.05 0.08",
    "box": "0.03 0.05 0.1",
    "ellipsoid": "0.03 0.06 0.12",
}


def model(geoms: str, extra: str = "") -> Any:
    text = f"""<mujoco>{extra}<worldbody><body name="base"><geom name="b" type="sphere" size="0.01" mass="1"/>
      <body name="arm"><joint name="j"/>{geoms}<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body></worldbody></mujoco>"""
    return compile_body_text(text, source="test").model


def surface(kind: str, size: FloatArray, count: int = 4000) -> FloatArray:
    """Points on a geom, in its own frame."""
    rng = np.random.default_rng(0)
    n = rng.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    if kind == "sphere":
        return np.asarray(n * size[0])
    if kind == "ellipsoid":
        return np.asarray(n * size)
    if kind == "capsule":
        return np.asarray(n * size[0] + np.sign(n[:, 2:]) * [0.0, 0.0, size[1]])
    box = np.sign(n) * (size if kind == "box" else 0.0)
    if kind == "cylinder":
        flat = n[:, :2] / np.linalg.norm(n[:, :2], axis=1)[:, None]
        box = np.hstack([flat * size[0], np.sign(n[:, 2:]) * size[1]])
    return np.asarray(box)


def arm(geoms: str, extra: str = "") -> LinkGeometry:
    return link_geometries(model(geoms, extra))[0][1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_capsule_of_a_geom_holds_its_surface(kind: str) -> None:
    compiled = model(f'<geom name="g" type="{kind}" size="{KINDS[kind]}" {PLACE}/>')
    geometry = link_geometries(compiled)[0][1]
    capsule = enclosing_capsule(geometry.centres, geometry.radii)
    points = rotate(compiled.geom_quat[1], surface(kind, compiled.geom_size[1])) + compiled.geom_pos[1]
    assert distances_to_segment(points, capsule.start, capsule.end).max() <= capsule.radius + 1e-9
    assert geometry.name == "arm"


@pytest.mark.parametrize(
    ("kind", "volume"),
    [
        ("sphere", 4 / 3 * np.pi * 0.03**3),
        ("capsule", np.pi * 0.02**2 * (0.2 + 4 / 3 * 0.02)),
        ("cylinder", np.pi * 0.05**2 * 0.16),
        ("box", 8 * 0.03 * 0.05 * 0.1),
        ("ellipsoid", 4 / 3 * np.pi * 0.03 * 0.06 * 0.12),
    ],
)
def test_the_volume_is_that_of_the_geom(kind: str, volume: float) -> None:
    geometry = arm(f'<geom type="{kind}" size="{KINDS[kind]}" {PLACE}/>')
    assert geometry.hull_volume() == pytest.approx(volume, rel=0.02)


def test_a_mesh_counts_with_its_vertices_wherever_the_compiler_moved_it() -> None:
    corners = "0 0 0  0.2 0 0  0 0.1 0  0 0 0.05  0.01 0.01 0.01"
    geometry = arm('<geom type="mesh" mesh="m"/>', f'<asset><mesh name="m" vertex="{corners}"/></asset>')
    expected = np.array([[0, 0, 0], [0, 0, 0.05], [0, 0.1, 0], [0.2, 0, 0]])
    found = geometry.centres[np.lexsort(np.round(geometry.centres, 6).T[::-1])]
    assert np.allclose(found, expected, atol=1e-6)  # the inner one is not on the hull
    assert geometry.hull_volume() == pytest.approx(0.2 * 0.1 * 0.05 / 6.0, rel=1e-4)


def test_only_a_lone_named_box_or_cylinder_can_be_taken_over() -> None:
    box = '<geom name="g" type="box" size="1 1 1"/>'
    lone = arm(box).lone
    assert lone is not None and (lone.geom, lone.kind) == ("g", "box")
    assert arm(box.replace('name="g"', "")).lone is None
    assert arm(box + '<geom type="sphere" size="1"/>').lone is None
    assert arm('<geom name="g" type="ellipsoid" size="1 2 3"/>').lone is None


def test_planes_are_left_out_with_a_note() -> None:
    text = """<mujoco><worldbody><body name="base"><geom type="plane" size="1 1 1"/>
    <body name="arm"><joint/><geom size="0.1"/></body></body></worldbody></mujoco>"""
    found, notes = link_geometries(compile_body_text(text, source="test").model)
    assert [geometry.name for geometry in found] == ["arm"]
    assert notes == ("base: planes and height fields are left out",)


@pytest.mark.parametrize("name", ["", 'name="a b"', 'name="a/b"'])
def test_a_link_without_a_name_for_a_profile_has_a_note(name: str) -> None:
    text = f"""<mujoco><worldbody><body {name}><joint/><geom size="1"/><body name="b"><geom size="1"/></body></body>
    </worldbody></mujoco>"""
    found, notes = link_geometries(compile_body_text(text, source="test").model)
    assert [geometry.name for geometry in found] == ["b"]
    shows(notes[0], 1)


def test_a_body_without_geometry_is_refused() -> None:
    text = """<mujoco><worldbody><body name="a"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </worldbody></mujoco>"""
    with refuses(InputError):
        link_geometries(compile_body_text(text, source="test").model)
