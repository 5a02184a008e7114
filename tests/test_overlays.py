"""Observers and obstacles over a robot: on its links, in the colour of what they do, zones around shapes."""

from typing import Any

import numpy as np
import pytest

from followers import op3
from retarget.observers import robot_observers
from retarget.rotations import rotate
from retarget.viewer.moment import Obstacle
from retarget.viewer.overlays import Around, Observing
from retarget.viewer.palette import MODES
from retarget.viewer.solids import shape_mesh
from viewed import moment


@pytest.fixture
def observing(server: Any) -> Observing:
    return Observing(server.scene, op3())


def test_they_are_on_their_links(observing: Observing) -> None:
    q = op3().body.qpos0.copy()
    q[op3().servo_columns] = np.linspace(-0.3, 0.3, 20)
    observing.show(moment(goal=q))
    known = robot_observers(op3())
    positions, turns = op3().body.solver_body().forward(q)
    expected = positions[known.links] + rotate(turns[known.links], known.positions)
    for shape, zone, place in zip(observing._shapes, observing._zones, expected, strict=True):
        np.testing.assert_allclose(shape.position, place, atol=1e-4)
        np.testing.assert_allclose(zone.position, place, atol=1e-4)


def test_a_zone_is_as_far_around_as_the_influence(observing: Observing) -> None:
    known = robot_observers(op3())
    for shape, zone, influence in zip(observing._shapes, observing._zones, known.influence, strict=True):
        wider = np.ptp(zone.vertices, axis=0) - np.ptp(shape.vertices, axis=0)
        np.testing.assert_allclose(wider, 2.0 * influence, atol=0.02 * influence + 1e-6)


def test_colours_are_what_they_do(observing: Observing) -> None:
    modes = np.zeros(len(observing._shapes), dtype=np.uint8)
    modes[1], modes[2] = 1, 2
    observing.show(moment(modes=modes))
    for kept in (observing._shapes, observing._zones):
        assert [tuple(handle.color) for handle in kept[:4]] == [MODES[0], MODES[1], MODES[2], MODES[0]]
    observing.show(moment(modes=np.zeros_like(modes)))
    assert {tuple(handle.color) for handle in observing._shapes} == {MODES[0]}
    observing.show(moment(modes=None))
    observing.show(moment(modes=modes[:3]))
    assert {tuple(handle.color) for handle in observing._shapes} == {MODES[0]}, "of another robot"


def test_hidden_ones_do_not_move(observing: Observing) -> None:
    observing.see(visible=False)
    observing.show(moment(goal=op3().body.qpos0 + 0.1, modes=np.full(len(observing._shapes), 2, dtype=np.uint8)))
    assert not any(handle.visible for handle in (*observing._shapes, *observing._zones))
    assert tuple(observing._shapes[0].color) == MODES[0]


def test_obstacles_move_where_it_is_known_where_they_are(server: Any) -> None:
    mesh = shape_mesh(0, (0.05, 0.0, 0.0))
    around = Around(server.scene, [Obstacle("a/b", mesh), Obstacle("c", mesh)])
    poses = np.array([[0.1, 0.2, 0.3, 0.0, 1.0, 0.0, 0.0], [0.4, 0.5, 0.6, 1.0, 0.0, 0.0, 0.0]])
    around.show(moment(around=poses))
    for other in (None, poses[:1] + 1.0):
        around.show(moment(around=other))
    for handle, pose in zip(around._handles, poses, strict=True):
        np.testing.assert_allclose((*handle.position, *handle.wxyz), pose)
    around.see(visible=False)
    assert not any(handle.visible for handle in around._handles)
