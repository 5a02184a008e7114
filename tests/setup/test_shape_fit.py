"""The shape around a link: it encloses, it is no larger than the box around it, and what is written still encloses."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from retarget.errors import InputError, UsageError
from retarget.model.body_file import compile_body_text
from retarget.model.scene_shapes import ShapeKind
from retarget.rotations import normalise, rotate, to_matrix
from retarget.setup.fit_observers import Zones
from retarget.setup.shape_fit import (
    MIN_RADIUS,
    MOST_AXES,
    LinkGeometry,
    LinkShape,
    distances_to_segment,
    fitted_shape,
    fitted_shapes,
    link_geometries,
)
from retarget.types import FloatArray

CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T


def sticks_out(shape: LinkShape, centres: FloatArray, radii: FloatArray) -> float:
    """m; at most zero where every ball is inside."""
    if shape.kind is ShapeKind.CAPSULE:
        return float(np.max(distances_to_segment(centres, *shape.ends) + radii) - shape.size[0])
    local = (centres - shape.pos) @ to_matrix(normalise(shape.quat))
    return float(np.max(np.abs(local) + radii[:, None] - shape.size))


@given(
    seed=st.integers(0, 10_000),
    kind=st.sampled_from(["box", "points", "rod", "ball"]),
    size=st.sampled_from([0.005, 0.05, 1.0]),
)
def test_the_shape_of_balls_encloses_them_and_is_no_larger_than_the_box_around_them(
    seed: int, kind: str, size: float
) -> None:
    rng = np.random.default_rng(seed)
    points, radii = CORNERS * rng.uniform(0.1, 1.0, size=3), np.zeros(8)
    if kind != "box":
        points, radii = rng.normal(size=(40, 3)) * rng.uniform(0.1, 1.0, size=3), rng.uniform(0.0, 0.2, 40)
    if kind in ("rod", "ball"):
        points, radii = points[: 2 if kind == "rod" else 1], np.full(2 if kind == "rod" else 1, 0.3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    centres, radii = size * points @ turn.T + rng.normal(size=3), size * radii
    shape = fitted_shape(LinkGeometry(1, "link", centres, radii, turn[None]))
    assert sticks_out(shape, centres, radii) <= 1e-9
    boxed = float(np.prod(np.ptp(np.concatenate([centres - radii[:, None], centres + radii[:, None]]), axis=0)))
    assert volume(shape) <= boxed * 1.01 + 1e-7
    if kind in ("rod", "ball"):
        assert shape.kind is ShapeKind.CAPSULE and shape.size[0] == pytest.approx(0.3 * size, abs=3e-5)


def volume(shape: LinkShape) -> float:
    radius, half, third = shape.size.tolist()
    if shape.kind is ShapeKind.BOX:
        return float(8.0 * radius * half * third)
    return float(np.pi * radius**2 * (2.0 * half + 4.0 / 3.0 * radius))


@pytest.mark.parametrize("points", [[[0, 0, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
def test_points_without_volume_still_get_a_radius(points: list[list[float]]) -> None:
    centres = np.array(points, dtype=np.float64)
    shape = fitted_shape(LinkGeometry(1, "link", centres, np.zeros(len(centres)), np.eye(3)[None]))
    assert shape.size[0] >= MIN_RADIUS and sticks_out(shape, centres, np.zeros(len(centres))) <= 1e-9


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
    return link_geometries(model(geoms, extra))[1]


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
def test_the_shape_of_a_geom_holds_its_surface(kind: str) -> None:
    size, exact = KINDS[kind]
    compiled = model(f'<geom name="g" type="{kind}" size="{size}" {PLACE}/>')
    shape = fitted_shapes(compiled, source="t")[1]
    points = rotate(compiled.geom_quat[1], surface(kind, compiled.geom_size[1])) + compiled.geom_pos[1]
    assert sticks_out(shape, points, np.zeros(len(points))) <= 1e-9
    assert shape.ratio is not None and volume(shape) / shape.ratio == pytest.approx(exact, rel=0.02)
    assert shape.ratio == pytest.approx(1.0, rel=0.02) or kind in ("cylinder", "ellipsoid")


def test_a_mesh_counts_with_its_vertices_wherever_the_compiler_moved_it() -> None:
    corners = "0 0 0  0.2 0 0  0 0.1 0  0 0 0.05  0.01 0.01 0.01"
    geometry = arm('<geom type="mesh" mesh="m"/>', f'<asset><mesh name="m" vertex="{corners}"/></asset>')
    expected = np.array([[0, 0, 0], [0, 0, 0.05], [0, 0.1, 0], [0.2, 0, 0]])
    found = geometry.centres[np.lexsort(np.round(geometry.centres, 6).T[::-1])]
    assert np.allclose(found, expected, atol=1e-6)  # the inner one is not on the hull


def test_a_link_of_many_shapes_is_tried_along_few_axes_and_shapes_that_collide_count_first() -> None:
    boxes = "".join(f'<geom type="box" size="0.01 0.01 0.01" euler="0 0 {n % 70}"/>' for n in range(140))
    assert len(arm(boxes).axes) == MOST_AXES
    assert len(arm('<geom size="0.1" euler="0 0 9"/>' + 3 * '<geom type="box" size="1 1 1"/>').axes) == 1
    seen, solid = '<geom size="0.2" contype="0" conaffinity="0"/>', '<geom size="0.1"/>'
    assert arm(seen + solid).radii.tolist() == [0.1] and arm(seen).radii.tolist() == [0.2]


def test_a_body_without_geometry_is_refused() -> None:
    text = """<mujoco><worldbody><body name="a"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </worldbody></mujoco>"""
    with refuses(InputError):
        fitted_shapes(compile_body_text(text, source="test").model, source="a.xml")


@pytest.mark.parametrize("zones", [(0.0, 0.0), (np.nan, 0.0), (np.inf, 0.0), (0.1, 0.1), (0.1, -0.1), (0.1, np.nan)])
def test_zones_that_no_profile_may_have_are_refused(zones: tuple[float, float]) -> None:
    with pytest.raises(UsageError):
        Zones(*zones)
