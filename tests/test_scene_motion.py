"""The obstacles of a scene over time: frames, motion by file, live updates by name."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from retarget import rotations
from retarget.errors import UsageError
from retarget.scalar_rotations import turn
from retarget.scene import Scene, load_scene
from retarget.scene_motion import ObstaclePoses, SceneState
from retarget.scene_poses import Pose
from support.messages import refuses

STAND = Pose((1.0, 2.0, 0.0), turn((0.0, 0.0, 0.5 * math.pi)))
ROD = {"capsule": {"from": [0, 0, 0], "to": [0, 0.4, 0], "radius": 0.1}}


def scene(**obstacles: Any) -> Scene:
    return Scene.model_validate({"name": "a", "description": "b", "obstacles": obstacles})


def test_a_shipped_scene() -> None:
    state = SceneState(load_scene("crossing_ball"))
    now = state.at(2.5)
    assert state.shapes.names == ("ball",)
    assert_allclose(now.position, [[0.2, 0.0, 0.34]], atol=1e-12)
    assert_allclose(now.linear_velocity, [[0.0, -0.4, 0.0]], atol=1e-12)
    assert_allclose(state.at(6.5).linear_velocity, [[0.0, 0.4, 0.0]], atol=1e-12)


def test_arrays() -> None:
    state = SceneState(load_scene("table"))
    now = state.at(0.0)
    shapes = [part.shape for part in (now.position, now.quat, now.linear_velocity, now.angular_velocity)]
    assert shapes == [(5, 3), (5, 4), (5, 3), (5, 3)]
    assert all(part.flags.c_contiguous for part in (now.position, now.quat, now.linear_velocity))
    now.position[:] = 9.0
    assert_array_equal(state.at(0.0).position[0], [0.31, 0, 0.212])


def test_the_pose_is_that_of_the_canonical_frame() -> None:
    now = SceneState(scene(rod={"shape": ROD, "at": {"pos": [1, 0, 0]}})).at(0.0)
    assert_allclose(now.position, [[1, 0.2, 0]], atol=1e-15)
    assert_allclose(rotations.rotate(now.quat[0], [0, 0, 1]), [0, 1, 0], atol=1e-15)


def test_the_stand_carries_its_obstacles() -> None:
    keys = {"shape": ROD, "at": {"pos": [1, 0, 0]}, "velocity": [1, 0, 0]}
    state = SceneState(scene(here=keys, there=keys | {"frame": "stand"}), stand=STAND)
    now = state.at(1.0)
    assert_allclose(now.position, [[2, 0.2, 0], [0.8, 4, 0]], atol=1e-12)
    assert_allclose(now.linear_velocity, [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    assert state.update("there", (0, 0, 0), (1, 0, 0, 0), time=1.0, velocity=(0, 1, 0))
    now = state.at(1.0)
    assert_allclose(now.position[1], [0.8, 2, 0], atol=1e-12)
    assert_allclose(now.linear_velocity[1], [-1, 0, 0], atol=1e-12)


def differences(state: SceneState, time: float, step: float = 1e-6) -> tuple[ObstaclePoses, Any, Any]:
    before, now, after = (state.at(moment) for moment in (time - step, time, time + step))
    turned = rotations.log(rotations.multiply(after.quat, rotations.conjugate(before.quat)))
    return now, (after.position - before.position) / (2 * step), turned / (2 * step)


def test_velocities_of_shape_frames_are_derivatives() -> None:
    path = [{"time": 0, "pos": [0, 0, 0]}, {"time": 1, "pos": [1, 2, 3], "quat": [0.5, 0.5, 0.5, 0.5]}]
    spin = {"shape": ROD, "angular_velocity": [1, -2, 3], "velocity": [0.5, 0, 0], "frame": "stand"}
    now, linear, angular = differences(SceneState(scene(rod={"shape": ROD, "path": path}, spin=spin), stand=STAND), 0.4)
    assert_allclose(now.linear_velocity, linear, atol=1e-8)
    assert_allclose(now.angular_velocity, angular, atol=1e-8)
    assert np.abs(linear).min(axis=0).max() > 0.1


@pytest.mark.parametrize("keys", [{}, {"velocity": [1, 0, 0]}], ids=["still", "moving"])
def test_a_live_update_overrides_the_file(keys: dict[str, Any]) -> None:
    state = SceneState(scene(other={"shape": ROD}, ball={"shape": {"sphere": {"radius": 0.1}}} | keys))
    assert state.age("ball", 3.0) == math.inf
    assert not state.update("ball", (math.nan, 0, 0), (1, 0, 0, 0), time=1.0)
    assert state.at(1.0).position[1, 0] == pytest.approx(1.0 if keys else 0.0)
    assert state.update("ball", (5, 6, 7), (1, 0, 0, 0), time=2.0)
    assert not state.update("ball", (9, 9, 9), (1, 0, 0, 0), time=1.0)
    assert_allclose(state.at(3.0).position, [[0.0, 0.2, 0.0], [5.0, 6.0, 7.0]])
    assert_array_equal(state.at(3.0).linear_velocity, np.zeros((2, 3)))
    assert (state.age("ball", 3.0), state.dropped("ball"), state.dropped("other")) == (1.0, 2, 0)


def test_an_unknown_obstacle_is_told_the_nearest() -> None:
    state = SceneState(load_scene("table"))
    for ask in (
        lambda: state.update("tpo", (0, 0, 0), (1, 0, 0, 0), time=0.0),
        lambda: state.dropped("tpo"),
        lambda: state.age("tpo", 0.0),
    ):
        with refuses(UsageError, found="'tpo'", allowed="l_front_leg", next_step="top"):
            ask()
