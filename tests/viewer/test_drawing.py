"""The scene of a page: what moves is sent, what stands still is not, and what is hidden costs nothing."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from followers import op3
from retarget.model.meshes import shape_mesh
from retarget.model.observers import robot_observers
from retarget.rotations import rotate
from retarget.viewer.colours import COLD, HOT, LEGEND, MODES, OUTSIDE, ROBOT, ZMP, heat_keys
from retarget.viewer.drawing import Drawing, Shapes
from viewed import cast_of_a_human, cast_of_op3, person, snapshot

AWAY = np.array([[0.0, 2.0, 0.3, 1.0, 0.0, 0.0, 0.0]])


def sent(server: Any) -> int:
    """How many messages browsers were sent until now."""
    return int(server._websock_server._broadcast_buffer.message_counter)


def node(server: Any, part: str, number: int = 0) -> Any:
    """A shape of a part of the scene, by its number."""
    nodes = server.scene._handle_from_node_name
    return nodes[[name for name in nodes if name.startswith(f"/{part}/")][number]]


def limb(server: Any, joint: str) -> Any:
    """The link that a joint of OP3 turns."""
    body, shown = op3().body, cast_of_op3().robot
    assert shown is not None
    return node(server, "robot", shown.links.tolist().index(int(body.joint_body[body.joint_index(joint)])))


def test_everything_has_a_box_and_a_meaning(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    assert {"robot", "goal", "performer", "asked", "balance", "obstacles"} <= set(drawing.parts)
    assert drawing.parts == tuple(part for part in (*LEGEND,) if part in drawing.parts)
    drawing.show(snapshot(obstacles=AWAY))
    for part in drawing.parts:
        drawing.see(part, visible=False)
    before = sent(server)
    q = op3().body.qpos0 + 0.1
    drawing.show(snapshot(obstacles=AWAY, robot=q, q=q))
    assert sent(server) - before < 20, "of what is hidden hardly anything is sent"


def test_only_what_moves_is_sent(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    drawing.show(snapshot())
    before = sent(server)
    drawing.show(snapshot())
    assert sent(server) == before
    q = op3().body.qpos0.copy()
    q[op3().servo_columns[0]] += 0.1
    drawing.show(snapshot(robot=q))
    assert sent(server) <= before + 6, "the three links of an arm, each moved and turned"


def test_the_zero_moment_point_is_red_outside_of_the_soles(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    drawing.show(snapshot(zmp=np.array([0.0, 0.0])))
    disc = server.scene._handle_from_node_name["/balance/zmp"]
    assert tuple(disc.color) == ZMP and disc.visible
    drawing.show(snapshot(zmp=np.array([0.5, 0.0])))
    assert tuple(disc.color) == OUTSIDE
    drawing.show(snapshot(zmp=np.full(2, np.nan)))
    assert not disc.visible, "it is not known"


def test_sensors_are_on_the_performer_and_can_be_hidden(server: Any) -> None:
    """Beside the robot, as small as the performer there."""
    drawing = Drawing(server, cast_of_op3())
    start = person().body.qpos0.copy()
    worn = np.array([start[:3] + 0.1, [np.nan] * 3])
    drawing.show(snapshot(human_q=start, sensors=worn))
    wrist, performer = node(server, "performer/sensors"), server.scene._handle_from_node_name["/performer"]
    scale = node(server, "performer/body").scale
    np.testing.assert_allclose(wrist.position, scale * worn[0], atol=1e-6)
    assert performer.position[1] + wrist.position[1] > 0.3 and wrist.visible
    for visible in (False, True):
        drawing.see("sensors", visible=visible)
        assert server.scene._handle_from_node_name["/performer/sensors"].visible is visible
    drawing.show(snapshot(human_q=start, sensors=worn + np.nan))
    assert not wrist.visible, "it is not valid"


def test_a_human_alone_stands_where_one_looks(server: Any) -> None:
    cast = cast_of_a_human()
    drawing = Drawing(server, cast)
    start = cast.human.body.qpos0.copy()
    start[:2] = (3.0, -4.0)
    com, none = np.array([3.0, -4.0, 0.9]), np.zeros((0, 3))
    worn = np.array([[3.0, -4.0, 1.2], [np.nan] * 3])
    drawing.show(snapshot(human_q=start, com=com, landmarks_asked=none, landmarks_reached=none, sensors=worn))
    wrist, head = (node(server, "performer/sensors", at) for at in (0, 1))
    place = server.scene._handle_from_node_name["/performer"].position + wrist.position
    assert tuple(place) == pytest.approx((0.0, 0.0, 1.2), abs=1e-6)
    assert wrist.visible and not head.visible, "the head's is not valid"
    assert drawing.parts == ("performer", "sensors", "balance")
    assert heat_keys(op3().profile.safety.temperature_c)[1] not in drawing.keys


def test_limbs_are_red_at_the_temperature_that_stops_the_robot(server: Any) -> None:
    drawing, hot = Drawing(server, cast_of_op3()), np.full(20, 20.0)
    hot[0], hot[1] = 200.0, np.nan
    drawing.show(snapshot(temperature=hot))
    limbs = [limb(server, joint) for joint in op3().joint_map.joints[:2]]
    assert [tuple(limb.color) for limb in limbs] == [HOT, COLD]
    drawing.show(snapshot(temperature=None))
    assert tuple(limbs[0].color) == HOT, "what is not known changes nothing"


@pytest.mark.parametrize("measure", [True, False])
def test_the_legend_names_heat_where_servos_measure_it(server: Any, measure: bool) -> None:
    heated = heat_keys(op3().profile.safety.temperature_c)
    keys = Drawing(server, replace(cast_of_op3(), servos_measure=measure)).keys
    assert [key in keys for key in heated] == [measure, measure]


def test_observers_are_seen_while_they_act(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    known = robot_observers(op3())
    modes = np.zeros(len(known.names), dtype=np.uint8)
    modes[1], modes[2] = 1, 2
    q = op3().body.qpos0.copy()
    q[op3().servo_columns] = np.linspace(-0.3, 0.3, 20)
    drawing.show(snapshot(q=q, observer_modes=modes))
    shapes = [node(server, "observers", at) for at in range(len(modes))]
    assert [shape.visible for shape in shapes[:4]] == [False, True, True, False]
    assert [tuple(shape.color) for shape in shapes[1:3]] == [*MODES]
    positions, turns = op3().body.solver_body().forward(q)
    expected = positions[known.links] + rotate(turns[known.links], known.positions)
    for at in (1, 2):
        np.testing.assert_allclose(shapes[at].position, expected[at], atol=1e-4)
    for other in (None, modes[:3], np.zeros_like(modes)):
        drawing.show(snapshot(observer_modes=other))
        assert not any(shape.visible for shape in shapes)


def test_shapes_move_where_it_is_known_where_they_are(server: Any) -> None:
    mesh = shape_mesh(0, (0.05, 0.0, 0.0))
    shapes = Shapes(server.scene, "/shapes", [mesh, mesh], color=ROBOT)
    assert not any(handle.visible for handle in shapes.handles)
    poses = np.array([[0.1, 0.2, 0.3, 0.0, 1.0, 0.0, 0.0], [0.4, 0.5, 0.6, 1.0, 0.0, 0.0, 0.0]])
    shapes.show(poses[:, :3], poses[:, 3:])
    for other in (None, poses[:1, :3] + 1.0):
        shapes.show(other)
    for handle, pose in zip(shapes.handles, poses, strict=True):
        np.testing.assert_allclose((*handle.position, *handle.wxyz), pose)
