"""The scene over time as a hierarchy sees it: still until it begins, then tick by tick."""

from typing import Any, cast

import numpy as np

from retarget.hierarchy import Hierarchy
from retarget.observers import NO_SCENE
from retarget.scene import Scene
from retarget.scene_motion import ObstaclePoses, SceneState
from retarget.surroundings import Surroundings

BALL: dict[str, Any] = {"shape": {"sphere": {"radius": 0.1}}, "velocity": (1.0, 0.0, 0.0), "at": {"pos": (0, 0, 1)}}


class Listener:
    """In place of a hierarchy: what it was told."""

    def __init__(self) -> None:
        self.told: list[ObstaclePoses] = []

    def set_obstacles(self, poses: ObstaclePoses) -> None:
        self.told.append(poses)

    def tick(self, around: Surroundings, dt: float = 0.5) -> tuple[float, float]:
        """Place and speed along x that one tick tells."""
        around.tick(cast(Hierarchy, self), dt)
        return float(self.told[-1].position[0, 0]), float(self.told[-1].linear_velocity[0, 0])


def ball() -> Surroundings:
    return Surroundings(SceneState(Scene.model_validate({"name": "a", "description": "b", "obstacles": {"b": BALL}})))


def test_time_goes_by_as_ever_for_obstacles_and_they_seem_faster_to_a_slow_robot() -> None:
    around, listener = ball(), Listener()
    around.begin()
    around.tick(cast(Hierarchy, listener), 0.5, pace=0.5)
    around.tick(cast(Hierarchy, listener), 0.5, pace=0.5)
    poses = listener.told[-1]
    assert around.time == 1.0
    assert (float(poses.position[0, 0]), float(poses.linear_velocity[0, 0])) == (0.5, 2.0)
    assert around.now is not None and float(around.now.linear_velocity[0, 0]) == 1.0  # what the gate looks at


def test_until_it_begins_everything_stands_where_it_is_at_first() -> None:
    around, listener = ball(), Listener()
    assert [listener.tick(around) for _ in range(3)] == [(0.0, 0.0)] * 3
    assert around.time == 0.0


def test_then_time_goes_on_tick_by_tick() -> None:
    around, listener = ball(), Listener()
    around.begin()
    assert [listener.tick(around) for _ in range(3)] == [(0.0, 1.0), (0.5, 1.0), (1.0, 1.0)]
    assert around.time == 1.5


def test_time_goes_on_though_nobody_listens() -> None:
    around, listener = ball(), Listener()
    around.begin()
    around.tick(None, 2.0)
    assert listener.tick(around) == (2.0, 1.0)


def test_a_restart_is_a_rest_at_the_beginning() -> None:
    around, listener = ball(), Listener()
    around.begin()
    listener.tick(around)
    around.restart()
    assert listener.tick(around) == (0.0, 0.0) and around.time == 0.0


def test_without_a_scene_nobody_is_told_anything() -> None:
    around, listener = Surroundings(None), Listener()
    around.begin()
    around.tick(cast(Hierarchy, listener), 1.0)
    assert not listener.told and around.shapes is NO_SCENE
    assert ball().shapes.names == ("b",)
    assert NO_SCENE.sizes.shape == (0, 3) and np.size(NO_SCENE.kinds) == 0
