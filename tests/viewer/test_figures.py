"""A body on a page: links where the solver has them, in a place, and sent only where they move."""

from typing import Any

import numpy as np
import pytest

from followers import op3
from retarget import rotations
from retarget.viewer.colours import ROBOT
from retarget.viewer.figures import STEP_M, Figure, Movable, Place, Shapes
from retarget.viewer.meshes import shape_mesh
from viewed import cast_of_op3


def test_a_place_is_scaled_and_turned_about_its_origin() -> None:
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    place = Place(0.5, np.array([1.0, 2.0, 0.0]), turn, np.array([0.0, 3.0, 0.0]))
    points = np.array([[1.0, 2.0, 0.0], [2.0, 2.0, 4.0]])
    np.testing.assert_allclose(place.of(points), [[0.0, 3.0, 0.0], [0.0, 3.5, 2.0]], atol=1e-12)


def test_what_hardly_moves_is_not_sent_but_never_drifts() -> None:
    """Small steps add up: the node is never further off than one of them."""

    class Node:
        position = (0.0, 0.0, 0.0)
        wxyz = (1.0, 0.0, 0.0, 0.0)
        visible = True

    node = Node()
    there: Any = Movable(node)  # type: ignore[arg-type]
    for step in range(1, 20):
        there.move(np.array([0.4 * STEP_M * step, 0.0, 0.0]))
        assert abs(node.position[0] - 0.4 * STEP_M * step) <= STEP_M
    assert node.position[0] > 0.0


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_links_are_where_the_body_has_them(scale: float, server: Any) -> None:
    shown = cast_of_op3().robot
    assert shown is not None
    figure = Figure(server.scene, "robot", shown, colour=ROBOT, scale=scale)
    q = op3().body.qpos0.copy()
    q[:3], q[op3().servo_columns] = (0.5, -0.25, 0.3), np.linspace(-0.4, 0.4, 20)
    place = Place(scale, to=np.array([0.0, 1.0, 0.0]))
    figure.place(q, place)
    positions, turns = shown.body.solver_body().forward(q)
    for link, handle in figure.handles.items():
        np.testing.assert_allclose(handle.position, place.of(positions[link]), atol=2e-4)
        assert rotations.angle_between(np.array(handle.wxyz), turns[link]) < 2e-3


def test_shapes_move_where_it_is_known_where_they_are(server: Any) -> None:
    mesh = shape_mesh(0, (0.05, 0.0, 0.0))
    shapes = Shapes(server.scene, "shapes", {"a/b": mesh, "c": mesh}, colour=ROBOT)
    assert not any(handle.visible for handle in shapes.handles)
    poses = np.array([[0.1, 0.2, 0.3, 0.0, 1.0, 0.0, 0.0], [0.4, 0.5, 0.6, 1.0, 0.0, 0.0, 0.0]])
    shapes.show(poses[:, :3], poses[:, 3:])
    for other in (None, poses[:1, :3] + 1.0):
        shapes.show(other)
    for handle, pose in zip(shapes.handles, poses, strict=True):
        np.testing.assert_allclose((*handle.position, *handle.wxyz), pose)
