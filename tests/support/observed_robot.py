"""OP3 among obstacles, judged on its observers and on its body's own geoms."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import followers
from followers import DT, op3, performer, settled
from retarget import _solver
from retarget.model.body import BodyModel
from retarget.model.observers import Observers, placed, robot_observers
from retarget.model.scene_state import SceneState
from retarget.report.clearance import place_body
from retarget.robot.follower import Follower
from retarget.schema.priorities import Priorities, load_priorities
from retarget.schema.scene import Scene
from retarget.types import FloatArray, HumanPosture, RobotPosture

SOON = 0.2
"""Moving obstacles set out at this time, s."""
ZONE = {"influence": 0.06, "margin": 0.004}


@cache
def human() -> list[HumanPosture]:
    return followers.postures(performer())


def raised() -> list[HumanPosture]:
    """From a crouch up to the reach of the right hand, half as fast as performed, which is then held."""
    slow = followers.postures(performer(), speed=0.5)
    return slow[250:600] + [slow[600]] * 150


def robot(scene: SceneState | None, priorities: Priorities | None = None) -> Follower:
    size = followers.dimensions(performer())
    return Follower(op3(), priorities or load_priorities("servo"), size, scene=scene)


@dataclass(frozen=True, eq=False)
class Done:
    """What it did after it had arrived: postures, and how near its observers came to each obstacle (T, k) m."""

    postures: list[RobotPosture]
    distance: FloatArray
    state: SceneState | None
    times: FloatArray

    @property
    def q(self) -> FloatArray:
        return np.array([posture.q for posture in self.postures])

    @property
    def joints(self) -> FloatArray:
        return np.array([posture.joint_positions for posture in self.postures])

    def error(self, name: str) -> FloatArray:
        """Distance (T,) m of a landmark from where it was asked to be."""
        column = self.postures[0].landmark_names.index(name)
        off = [posture.landmarks_reached[column] - posture.landmarks_asked[column] for posture in self.postures]
        return np.asarray(np.linalg.norm(off, axis=1))

    def geoms_apart(self) -> float:
        """Smallest distance (m) of the body's own geoms to the scene, by MuJoCo."""
        assert self.state is not None
        path = op3().profile.body_path
        found = place_body(path, self.q, root="free").to_scene(self.state, self.times).smallest
        assert found is not None
        return found

    def reached(self, name: str) -> FloatArray:
        """Where a landmark was (T, 3) m."""
        column = self.postures[0].landmark_names.index(name)
        return np.array([posture.landmarks_reached[column] for posture in self.postures])

    def self_apart(self) -> float:
        """Smallest distance (m) of the body's own geoms to each other, by MuJoCo."""
        neutral = op3().posture(op3().profile.postures.neutral)
        found = place_body(op3().profile.body_path, self.q, root="free").to_itself(neutral=neutral).smallest
        assert found is not None
        return found

    def swing(self, ticks: int = 125) -> float:
        """Most that a joint went to and fro in the last second, rad: its path beyond the way that it made."""
        last = self.joints[-ticks:]
        return float((np.abs(np.diff(last, axis=0)).sum(axis=0) - np.abs(last[-1] - last[0])).max())


def scene_of(**obstacles: Any) -> SceneState:
    return SceneState(Scene.model_validate({"name": "a", "description": "b", "obstacles": obstacles}))


def sphere(at: FloatArray | Sequence[float], radius: float = 0.03, **more: Any) -> dict[str, Any]:
    return {"shape": {"sphere": {"radius": radius}}, "at": {"pos": tuple(at)}, **ZONE, **more}


@cache
def own() -> Observers:
    return robot_observers(op3())


def nearest(body: BodyModel, observers: Observers, q: FloatArray, state: SceneState, time: float) -> FloatArray:
    """Smallest distance (k,) m of the observers of a body to each obstacle at a time."""
    position, quat = placed(body, observers, q)
    poses, shapes = state.at(time), state.shapes
    n, k = len(observers.names), len(shapes.names)
    mine, theirs = np.tile(np.arange(n), k), np.repeat(np.arange(k), n)
    found = _solver.shape_distances(
        *(observers.kinds[mine], observers.sizes[mine], position[mine], quat[mine]),
        *(shapes.kinds[theirs], shapes.sizes[theirs], poses.position[theirs], poses.quat[theirs]),
    )[0]
    return np.asarray(found.reshape(k, n).min(axis=1))


def observed(q: FloatArray, state: SceneState, time: float) -> FloatArray:
    """Smallest distance (k,) m of the robot's observers to each obstacle at a time."""
    return nearest(op3().body, own(), q, state, time)


def act(follower: Follower, state: SceneState | None, motion: Sequence[HumanPosture]) -> Done:
    """Arrive, then follow; time 0 of the scene is the arrival."""
    follower.start(motion[0])
    arrived = settled(follower, motion[0])
    done, near, times = [arrived[-1]], [], [0.0]
    for tick, posture in enumerate(motion):
        done.append(follower.step(posture, DT))
        times.append((tick + 1) * DT)
    if state is not None:
        near = [observed(posture.q, state, time) for posture, time in zip(done, times, strict=True)]
    return Done(done, np.array(near), state, np.array(times))


def without_observers(priorities: Priorities) -> Priorities:
    """The same levels, empty where observers were."""
    levels = tuple(
        level.model_copy(update={"tasks": tuple(t for t in level.tasks if t.type not in ("reactive", "preventive"))})
        for level in priorities.levels
    )
    return priorities.model_copy(update={"levels": levels})
