"""Obstacles on the page: their edges are on their shapes, where the scene has them at that time."""

import numpy as np
import pytest

from retarget.model.scene_shapes import ShapeKind
from retarget.model.scene_state import SceneState
from retarget.report.animation import wires_of
from retarget.rotations import conjugate, rotate
from retarget.schema.scene import load_scene
from retarget.types import FloatArray

TIMES = np.array([0.0, 0.7, 1.4])


@pytest.mark.parametrize("name", ["table", "wall", "gantry", "door_frame", "crossing_ball"])
def test_every_corner_is_on_the_surface_of_an_obstacle(name: str) -> None:
    state = SceneState(load_scene(name))
    wires = wires_of(state, TIMES)
    if wires is None:
        assert set(state.shapes.kinds.tolist()) == {ShapeKind.HALF_SPACE}
        return
    shown = [kind for kind in state.shapes.kinds.tolist() if kind != ShapeKind.HALF_SPACE]
    assert len(wires.edges) == sum(12 if kind == ShapeKind.BOX else 36 for kind in shown)
    for row, time in enumerate(TIMES[: len(wires.points)]):
        poses = state.at_rest(float(time))
        for point in wires.points[row]:
            assert min(_off(state, poses.position, poses.quat, at, point) for at in range(len(poses.position))) < 1e-9


def _off(state: SceneState, position: FloatArray, quat: FloatArray, at: int, point: FloatArray) -> float:
    """Distance, m, of a point from the surface of an obstacle, written out for each shape."""
    local, size = rotate(conjugate(quat[at]), point - position[at]), state.shapes.sizes[at]
    kind = state.shapes.kinds[at]
    if kind == ShapeKind.BOX:
        return float(np.abs(np.abs(local) - size).max())  # a corner
    if kind in (ShapeKind.CAPSULE, ShapeKind.CYLINDER):
        beyond = max(abs(float(local[2])) - float(size[1]), 0.0)
        return abs(float(np.hypot(np.hypot(local[0], local[1]), beyond)) - float(size[0]))
    return np.inf


def test_what_moves_has_a_row_for_each_time_and_what_does_not_has_one() -> None:
    moving = wires_of(SceneState(load_scene("crossing_ball")), TIMES)
    still = wires_of(SceneState(load_scene("table")), TIMES)
    assert moving is not None and still is not None
    assert len(moving.points) == 3 and len(still.points) == 1
    assert np.abs(moving.points[2] - moving.points[0]).max() > 0.01
