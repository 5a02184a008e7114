"""Priority files compiled for a body: names become targets, what is not set is absent."""

from functools import cache
from typing import Any, cast

import numpy as np
import pytest

from messages import refuses
from retarget.errors import ConfigError
from retarget.ik.hierarchy import Hierarchy, SceneObstacles, body_frames
from retarget.ik.support_polygon import half_spaces
from retarget.model.human import Human, build_human, human_limits
from retarget.model.human_dimensions import proportional_dimensions
from retarget.model.scene_state import ObstaclePoses, SceneState
from retarget.schema.priorities import Priorities
from retarget.schema.scene import Scene

LEVELS: tuple[dict[str, Any], ...] = (
    {"name": "balance", "tasks": ({"type": "centre_of_mass", "mode": "over_root"},)},
    {"name": "feet", "tasks": ({"type": "position", "of": ("l_ankle", "r_ankle")},)},
    {"name": "reactive", "tasks": ({"type": "reactive"},)},
    {"name": "hands", "tasks": ({"type": "position", "of": ("l_wrist", "head")},)},
    {"name": "posture", "tasks": ({"type": "posture", "towards": "stand", "settle": 0.2},)},
)


@cache
def human() -> Human:
    return build_human(proportional_dimensions(1.75))


def compiled(levels: tuple[dict[str, Any], ...] = LEVELS, **more: Any) -> Hierarchy:
    body = human().body
    return Hierarchy(
        Priorities.model_validate({"name": "t", "description": "t", "levels": levels}),
        body,
        frames=body_frames(body),
        postures={name: human().posture(name) for name in ("stand", "attractor")},
        limits=human_limits(body),
        locked=human().locked,
        **more,
    )


def settled(hierarchy: Hierarchy, targets: np.ndarray, frames: int = 200) -> np.ndarray:
    hierarchy.solver.reset(human().posture("stand"))
    q = human().posture("stand")
    for _ in range(frames):
        hierarchy.set_previous(targets, q, 0.05)
        q = hierarchy.solver.frame(targets, 0.05)
    return q


def test_labels_follow_the_levels_and_empty_levels_keep_their_place() -> None:
    hierarchy = compiled()
    assert hierarchy.labels == (
        *("over_root over_root", "position l_ankle", "position r_ankle", "position l_wrist", "position head"),
        *("posture stand", "previous previous"),
    )
    assert len(hierarchy.solver.task_errors) == len(hierarchy.labels)


def test_named_targets_are_reached_and_what_is_not_set_is_absent() -> None:
    hierarchy = compiled()
    targets = hierarchy.blank()
    hand = np.array([0.35, 0.25, 1.2])
    hierarchy.set_position(targets, "l_wrist", hand)
    hierarchy.set_position(targets, "l_ankle", np.array([0.0, 0.1, 0.09]))
    hierarchy.set_position(targets, "unknown", hand)
    q = settled(hierarchy, targets)
    frame = human().body.frame("l_wrist")
    reached = human().body.solver_body().points(q[None], [frame.body], frame.position[None])[0, 0]
    assert np.linalg.norm(reached - hand) < 1e-5
    errors = dict(zip(hierarchy.labels, hierarchy.solver.task_errors, strict=True))
    assert np.isnan(errors["position head"]) and np.isnan(errors["position r_ankle"])
    assert errors["over_root over_root"] < 1e-6


def test_many_positions_at_once_are_the_same_as_one_by_one() -> None:
    hierarchy = compiled()
    names = ("head", "pelvis", "l_wrist", "l_ankle")
    block = np.arange(16.0).reshape(4, 4) + 1.0
    one_by_one, at_once = hierarchy.blank(), hierarchy.blank()
    for name, row in zip(names, block, strict=True):
        hierarchy.set_position(one_by_one, name, row[1:], row[0])
    source, slots = hierarchy.position_slots(names)
    at_once[slots] = block[source]
    assert (at_once == one_by_one).all()


@pytest.mark.parametrize("dt", [1.0 / 120.0, 1.0 / 24.0])
def test_settling_takes_its_time_at_any_rate(dt: float) -> None:
    hierarchy = compiled((LEVELS[-1],))
    start = human().posture("stand")
    elbow = int(human().body.scalar_joints()[1][human().body.dof_index("l_elbow_flexion")])
    start[elbow] = 0.25
    hierarchy.solver.reset(start)
    targets, q = hierarchy.blank(), start
    for _ in range(round(0.5 / dt)):
        hierarchy.set_previous(targets, q, dt)
        q = hierarchy.solver.frame(targets, dt)
    assert q[elbow] == pytest.approx(0.25 * np.exp(-0.5 / 0.2), rel=0.05)


def test_heading_turns_axes_and_leaves_bending_free() -> None:
    posture = {"type": "posture", "towards": "stand", "stiffness": {"default": 1.0}}
    heading = {"type": "heading", "of": "pelvis", "weight": 100.0}
    upright = {"type": "axis", "of": "pelvis", "axis": (0.0, 0.0, 1.0), "direction": (0.0, 0.0, 1.0)}
    hierarchy = compiled(({"name": "last", "tasks": (posture, heading, upright)},))
    targets = hierarchy.blank()
    hierarchy.set_heading(targets, (0.0, 1.0))
    q = settled(hierarchy, targets)
    assert np.abs(q[3:7]) == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], abs=1e-4)


def test_support_edges_fill_their_slots() -> None:
    support = {"type": "centre_of_mass", "mode": "support"}
    hierarchy = compiled(({"name": "balance", "tasks": (support,)}, LEVELS[-1]))
    targets = hierarchy.blank()
    edges = np.array([[1.0, 0.0, 0.2], [-1.0, 0.0, -0.1], [0.0, 1.0, 0.05], [0.0, -1.0, 0.05]])
    hierarchy.set_support(targets, half_spaces(edges))
    q = settled(hierarchy, targets)
    com = human().body.solver_body().centre_of_mass(q[None])[0]
    assert 0.1 - 1e-6 <= com[0] <= 0.2 + 1e-6 and abs(com[1]) <= 0.05 + 1e-6


def test_unknown_names_are_refused_with_the_nearest() -> None:
    task: dict[str, Any] = {"type": "position", "of": ("l_wirst",)}
    with refuses(ConfigError, next_step="l_wrist"):
        compiled(({"name": "hands", "tasks": (task,)},))
    assert compiled(({"name": "hands", "tasks": ({**task, "optional": True},)},)).labels == ()
    with refuses(ConfigError, next_step="stand"):
        compiled(({"name": "posture", "tasks": ({"type": "posture", "towards": "stnad"},)},))
    with refuses(ConfigError, next_step="spine"):
        compiled(({"name": "posture", "tasks": ({"type": "posture", "stiffness": {"spnie": 1.0}},)},))


BALL: dict[str, Any] = {"shape": {"sphere": {"radius": 0.1}}, "velocity": (1.0, 0.0, 0.0), "at": {"pos": (0, 0, 1)}}


class Receiver:
    """In place of a hierarchy: records the obstacle poses that it gets."""

    def __init__(self) -> None:
        self.received: list[ObstaclePoses] = []

    def set_obstacles(self, poses: ObstaclePoses) -> None:
        self.received.append(poses)

    def tick(self, obstacles: SceneObstacles, dt: float = 0.5) -> tuple[float, float]:
        """Place and speed along x that one tick sets."""
        obstacles.tick(cast(Hierarchy, self), dt)
        return float(self.received[-1].position[0, 0]), float(self.received[-1].linear_velocity[0, 0])


def ball() -> SceneObstacles:
    return SceneObstacles(SceneState(Scene.model_validate({"name": "a", "description": "b", "obstacles": {"b": BALL}})))


def test_time_goes_by_as_ever_for_obstacles_and_they_seem_faster_to_a_slow_robot() -> None:
    obstacles, receiver = ball(), Receiver()
    obstacles.begin()
    obstacles.tick(cast(Hierarchy, receiver), 0.5, time_scale=0.5)
    obstacles.tick(cast(Hierarchy, receiver), 0.5, time_scale=0.5)
    poses = receiver.received[-1]
    assert obstacles.time == 1.0
    assert (float(poses.position[0, 0]), float(poses.linear_velocity[0, 0])) == (0.5, 2.0)
    assert obstacles.now is not None and float(obstacles.now.linear_velocity[0, 0]) == 1.0  # what the gate looks at
