"""The scene of a page: what moves is sent, what stands still is not, and what is hidden costs nothing."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from followers import op3
from retarget.viewer.colours import COLD, HOT, LEGEND, LOAD, OUTSIDE, PLAIN, TEMPERATURE, ZMP
from retarget.viewer.drawing import Drawing
from viewed import cast_of_a_human, cast_of_op3, person, snapshot

AWAY = np.array([[0.0, 2.0, 0.3, 1.0, 0.0, 0.0, 0.0]])


def sent(server: Any) -> int:
    """How many messages browsers were sent until now."""
    return int(server._websock_server._broadcast_buffer.message_counter)


def test_everything_has_a_box_and_a_meaning(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3(simulated=True))
    assert {"body", "goal", "performer", "asked", "balance", "pressure", "soles", "obstacles"} <= set(drawing.parts)
    assert set(drawing.parts) <= set(LEGEND)
    drawing.show(snapshot(obstacle_poses=AWAY))
    for part in drawing.parts:
        drawing.see(part, visible=False)
    before = sent(server)
    q = op3().body.qpos0 + 0.1
    drawing.show(snapshot(obstacle_poses=AWAY, robot=q, goal=q))
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
    assert sent(server) == before + 1, "one joint: one link, in the frame of the one before it"


def test_obstacles_are_where_they_are_and_the_performer_is_beyond_them(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    near = AWAY * [1.0, 0.3, 1.0, 1.0, 1.0, 1.0, 1.0]
    drawing.show(snapshot(obstacle_poses=near))
    ball: Any = drawing._overlays["obstacles"]
    assert tuple(ball._handles[0].position) == pytest.approx((0.0, 0.6, 0.3))
    assert drawing._place is not None and drawing._place.to[1] > 0.65
    drawing.show(snapshot(obstacle_poses=near + 0.1))
    assert tuple(ball._handles[0].position) == pytest.approx((0.1, 0.7, 0.4))


def test_the_zero_moment_point_is_red_outside_of_the_soles(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    drawing.show(snapshot(zmp=np.array([0.0, 0.0])))
    assert tuple(drawing._balance._disc.color) == ZMP and drawing._balance._disc.visible
    drawing.show(snapshot(zmp=np.array([0.5, 0.0])))
    assert tuple(drawing._balance._disc.color) == OUTSIDE
    drawing.show(snapshot(zmp=np.full(2, np.nan)))
    assert not drawing._balance._disc.visible, "it is not known"


def test_limbs_have_the_colour_that_was_chosen(server: Any) -> None:
    drawing = Drawing(server, cast_of_op3())
    assert drawing.colourings == (TEMPERATURE, LOAD, PLAIN)
    hot, much = np.full(20, 20.0), np.full(20, 0.0)
    hot[0], much[1] = 200.0, 9.0
    drawing.show(snapshot(temperature=hot, current=much))
    limbs = drawing._limbs
    assert limbs is not None and limbs._handles[0] is not None and limbs._handles[1] is not None
    assert [tuple(limbs._handles[i].color) for i in (0, 1)] == [HOT, COLD]  # type: ignore[union-attr]
    drawing.colour_by(LOAD)
    assert [tuple(limbs._handles[i].color) for i in (0, 1)] == [COLD, HOT]  # type: ignore[union-attr]
    assert drawing.scale is not None and drawing.scale.high == 1.5
    drawing.colour_by(PLAIN)
    assert [tuple(limbs._handles[i].color) for i in (0, 1)] == [COLD, COLD]  # type: ignore[union-attr]
    assert drawing.scale is None


def test_sensors_are_on_the_performer_and_can_be_hidden(server: Any) -> None:
    """Beside the robot, as small as the performer there."""
    drawing = Drawing(server, cast_of_op3())
    start = person().body.qpos0.copy()
    worn = np.array([start[:3] + 0.1, [np.nan] * 3])
    drawing.show(snapshot(human=start, sensors=worn))
    wrist: Any = drawing._balls["sensors"]._balls[0].handle
    assert drawing._place is not None
    np.testing.assert_allclose(wrist.position, drawing._place.of(worn[0]), atol=1e-6)
    assert wrist.position[1] > 0.3
    for visible in (False, True):
        drawing.see("sensors", visible=visible)
        assert wrist.visible is visible
    drawing.show(snapshot(human=start, sensors=worn + np.nan))
    assert not wrist.visible, "it is not valid"


def test_landmarks_that_are_named_later_can_be_hidden_from_the_beginning(server: Any) -> None:
    """A run names them with its first row; the boxes of the page are made before."""
    drawing = Drawing(server, replace(cast_of_op3(), landmarks=()))
    assert {"asked", "reached"} <= set(drawing.parts)


def test_a_human_alone_stands_where_one_looks(server: Any) -> None:
    cast = cast_of_a_human()
    drawing = Drawing(server, cast)
    start = cast.human.body.qpos0.copy()
    start[:2] = (3.0, -4.0)
    com, none = np.array([3.0, -4.0, 0.9]), np.zeros((0, 3))
    worn = np.array([[3.0, -4.0, 1.2], [np.nan] * 3])
    drawing.show(snapshot(human=start, com=com, asked=none, reached=none, sensors=worn))
    wrist, head = (ball.handle for ball in drawing._balls["sensors"]._balls)
    assert tuple(wrist.position) == pytest.approx((0.0, 0.0, 1.2), abs=1e-6)
    assert wrist.visible and not head.visible, "the head's is not valid"
    assert {"human", "sensors"} < set(drawing.parts) and not {"asked", "reached"} & set(drawing.parts)
    assert "human" in drawing.parts and "robot" not in drawing.parts and drawing.colourings == ()


def test_what_servos_never_reported_is_no_colour(server: Any) -> None:
    """Limbs in the colour of a cold servo would say that it is cold."""
    assert len(Drawing(server, cast_of_op3()).colourings) > 1
    drawing = Drawing(server, replace(cast_of_op3(), servos_commanded=False))
    assert drawing.colourings == () and drawing.scale is None
