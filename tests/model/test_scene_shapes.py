"""Canonical frames and sizes: the solid is where the file says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from retarget import rotations
from retarget.model.scene_shapes import ShapeKind, canonical, scene_shapes
from retarget.schema.scene import ObstacleShape, Scene

POINTS = st.tuples(*[st.floats(-2, 2)] * 3)


def shape(**measures: object) -> ObstacleShape:
    return ObstacleShape.model_validate(measures)


@given(POINTS, POINTS)
def test_rods_lie_between_their_points(start: tuple[float, ...], end: tuple[float, ...]) -> None:
    length = float(np.linalg.norm(np.subtract(end, start)))
    if length < 1e-3:
        return
    line = {"from": start, "to": end}
    for rod, kind, radius in (
        (shape(segment=line), ShapeKind.CAPSULE, 0.0),
        (shape(capsule=line | {"radius": 0.2}), ShapeKind.CAPSULE, 0.2),
        (shape(cylinder=line | {"radius": 0.2}), ShapeKind.CYLINDER, 0.2),
    ):
        found, sizes, pose = canonical(rod)
        assert found == kind
        assert sizes == pytest.approx((radius, 0.5 * length, 0.0))
        for end_z, point in ((-sizes[1], start), (sizes[1], end)):
            assert_allclose(pose.position + rotations.rotate(pose.quat, [0, 0, end_z]), point, atol=1e-12)


@given(POINTS, POINTS)
def test_half_spaces_are_solid_below_their_own_plane(point: tuple[float, ...], normal: tuple[float, ...]) -> None:
    length = np.linalg.norm(normal)
    if length < 1e-3:
        return
    kind, sizes, pose = canonical(shape(half_space={"point": point, "normal": normal}))
    assert (kind, sizes) == (ShapeKind.HALF_SPACE, (0, 0, 0))
    assert pose.position == pytest.approx(point)
    assert_allclose(rotations.rotate(pose.quat, [0, 0, 1]), np.array(normal) / length, atol=1e-12)


def test_balls_and_boxes() -> None:
    kind, sizes, pose = canonical(shape(sphere={"at": [1, 2, 3], "radius": 0.5}))
    assert (kind, sizes, pose.position) == (ShapeKind.CAPSULE, (0.5, 0, 0), (1, 2, 3))
    kind, sizes, pose = canonical(shape(box={"pos": [1, 0, 0], "quat": [0.7071, 0, 0, 0.7071], "size": [1, 2, 3]}))
    assert (kind, sizes, pose.position) == (ShapeKind.BOX, (1, 2, 3), (1, 0, 0))
    assert np.linalg.norm(pose.quat) == pytest.approx(1.0, abs=1e-15)


def test_arrays_in_the_order_of_the_file() -> None:
    entries = {
        "wall": {"shape": {"half_space": {"normal": [1, 0, 0]}}, "influence": 0.3},
        "ball": {"shape": {"sphere": {"radius": 0.1}}, "margin": 0.0},
    }
    shapes = scene_shapes(Scene.model_validate({"name": "a", "description": "b", "obstacles": entries}))
    assert shapes.names == ("wall", "ball")
    assert_array_equal(shapes.kinds, [3, 0])
    assert_array_equal(shapes.sizes, [[0, 0, 0], [0.1, 0, 0]])
    assert_array_equal(shapes.influence, [0.3, 0.1])
    assert_array_equal(shapes.margin, [0.01, 0.0])
