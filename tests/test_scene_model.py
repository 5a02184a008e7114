"""Obstacles beside a body's geoms: the right shapes, in the right places."""

import mujoco
import numpy as np

from retarget.metrics.scene_model import obstacle_tracks, scene_model
from retarget.scene import load_scene
from retarget.scene_motion import SceneState


def test_a_body_and_its_scene_share_a_model() -> None:
    body = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body><freejoint/><geom type="box" size="1 2 3"/>'
        '<geom type="ellipsoid" size="1 2 3"/></body></worldbody></mujoco>'
    )
    scene = SceneState(load_scene("table"))
    found = scene_model(body, np.array([1, 2]), scene.shapes)
    assert found.model.ngeom == 2 + 5
    np.testing.assert_allclose(found.model.geom_size[found.body], [[1, 2, 3], [1, 2, 3]])
    top = scene.shapes.names.index("top")
    np.testing.assert_allclose(found.model.geom_size[found.obstacles[top]], [0.15, 0.3, 0.008])


def test_obstacles_are_followed_over_time() -> None:
    scene, times = SceneState(load_scene("crossing_ball")), np.array([-1.0, 1.0, 2.5, 4.0])
    tracks = obstacle_tracks(scene, times)
    np.testing.assert_allclose(tracks.position[:, 0, 1], [0.6, 0.6, 0.0, -0.6], atol=1e-12)
    np.testing.assert_allclose(tracks.matrix[:, 0], np.tile(np.eye(3).ravel(), (4, 1)), atol=1e-12)
    np.testing.assert_allclose(tracks.radius, [0.05])
