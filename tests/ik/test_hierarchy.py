"""Priority files compiled for a body: names become targets, what is not set is absent."""

from dataclasses import replace
from functools import cache, partial
from typing import Any, cast

import numpy as np
import pytest

from followers import op3
from messages import refuses
from retarget.errors import ConfigError
from retarget.ik.hierarchy import Hierarchy, SceneObstacles, body_frames
from retarget.ik.support_polygon import half_spaces, plant
from retarget.ik.tasks import Limb, SlotKind, compile_task
from retarget.model.body import JointType
from retarget.model.human import Human, build_human, human_limits
from retarget.model.human_dimensions import proportional_dimensions
from retarget.model.robot import load_robot, plant_root
from retarget.model.scene_state import ObstaclePoses, SceneState
from retarget.schema.priorities import (
    AxisTask,
    CarriedTask,
    HeadingTask,
    LimbTask,
    LookAtTask,
    OrientationTask,
    PositionTask,
    PostureTask,
    Priorities,
    ReactiveTask,
    Task,
)
from retarget.schema.scene import Scene
from retarget.types import FloatArray

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


ON_LEFT: tuple[dict[str, Any], ...] = (
    {"name": "held", "tasks": ({"type": "position", "of": ("l_ankle", "r_ankle", "chest")},)},
    {
        "name": "posture",
        "tasks": (
            {"type": "position", "of": ("l_wrist",), "weight": 10, "when": ("left", "flight")},
            {"type": "posture", "towards": "stand", "settle": 0.2},
        ),
    },
)


def test_a_task_of_a_phase_weighs_as_much_as_the_phase_is_there() -> None:
    hierarchy = compiled(ON_LEFT, phased=True)
    body, stand = human().body.solver_body(), human().posture("stand")
    place = {name: human().body.frame(name).body for name in ("l_ankle", "r_ankle", "chest", "l_wrist")}
    at_rest = body.forward(stand)[0]
    goal, away = at_rest[place["l_wrist"]] + [0.0, 0.1, 0.2], []
    for left in (0.0, 0.05, 0.5, 1.0):
        targets = hierarchy.blank()
        for name, link in place.items():
            hierarchy.set_position(targets, name, goal if name == "l_wrist" else at_rest[link])
        hierarchy.set_phases(targets, {"double": 1.0 - left, "left": 0.5 * left, "right": 0.0, "flight": 0.5 * left})
        away.append(float(np.linalg.norm(body.forward(settled(hierarchy, targets))[0][place["l_wrist"]] - goal)))
    assert away[0] == pytest.approx(np.hypot(0.1, 0.2), abs=1e-4)
    assert away[0] > away[1] > away[2] > away[3]


def test_a_body_whose_phases_nobody_knows_takes_no_task_of_one() -> None:
    with refuses(ConfigError, "position of l_wrist", "left", "for a human"):
        compiled(ON_LEFT)


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


@pytest.mark.parametrize("optional", [True, False])
def test_a_weight_per_length_of_what_has_none_is_refused(optional: bool) -> None:
    """It was taken as one per metre, or as a frame that the body does not have."""
    task = {"type": "position", "of": ("l_wrist",), "per": "length", "optional": optional}
    with refuses(ConfigError, "l_wrist", "per length"):
        compiled(({"name": "hands", "tasks": (task,)},))


def test_a_root_that_is_not_free_or_sensors_that_a_body_does_not_have_carry_nothing() -> None:
    carried = CarriedTask(type="carried", by={"head": 1.0, "l_ankle": 1.0}, settle=0.1)
    body = human().body
    compile_carried = partial(compile_task, carried, fed=(), is_soft=True, limbs={}, lengths={})
    assert [slot.kind for slot in compile_carried(body, body_frames(body))] == [SlotKind.CARRIED]
    with refuses(ConfigError, "l_ankle", "a carried task names what the body does not have"):
        compile_carried(body, {"head": body.frame("head")})
    fixed = replace(body, joint_type=np.full_like(body.joint_type, JointType.HINGE))
    with refuses(ConfigError, "a carried task is for a free root"):
        compile_carried(fixed, body_frames(body))


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


# One task of a priority file becomes tasks of the solver.

BODY = build_human(proportional_dimensions(1.7)).body
FRAMES = body_frames(BODY)
LIMBS = {"l_arm": Limb(FRAMES["chest"], FRAMES["l_wrist"], 0.5)}


@pytest.mark.parametrize(
    ("task", "kinds"),
    [
        (PositionTask(type="position", of=("head", "l_wrist")), [SlotKind.POSITION] * 2),
        (LimbTask(type="limb", of=("l_arm",), weight=0.1), [SlotKind.LIMB]),
        (OrientationTask(type="orientation", of=("chest",), weight=(1.0, 0.0, 2.0)), [SlotKind.ORIENTATION]),
        (AxisTask(type="axis", of=("pelvis",), axis=(0, 0, 2), direction=(0, 0, 3)), [SlotKind.AXIS]),
        (HeadingTask(type="heading", of=("pelvis",)), [SlotKind.HEADING]),
        (LookAtTask(type="look_at", of=("head",)), [SlotKind.LOOK_AT]),
        (PostureTask(type="posture", stiffness={"default": 1.0}), [SlotKind.POSTURE]),
        (PostureTask(type="posture", stiffness={"spine": 9.0}, settle=0.1), [SlotKind.POSTURE, SlotKind.PREVIOUS]),
        (ReactiveTask(type="reactive"), []),
    ],
)
def test_kinds(task: Task, kinds: list[SlotKind]) -> None:
    for is_soft in (False, True):
        slots = compile_task(task, BODY, FRAMES, fed=FRAMES, is_soft=is_soft, limbs=LIMBS, lengths={})
        assert [slot.kind for slot in slots] == kinds


def test_tasks_that_nothing_feeds_are_left_out_but_axes_are_not() -> None:
    position = PositionTask(type="position", of=("head", "l_wrist"))
    assert [
        slot.name for slot in compile_task(position, BODY, FRAMES, fed={"head"}, is_soft=False, limbs=LIMBS, lengths={})
    ] == ["head"]
    axis = AxisTask(type="axis", of=("pelvis",), axis=(0, 0, 1), direction=(0, 0, 1))
    assert len(compile_task(axis, BODY, FRAMES, fed=(), is_soft=False, limbs=LIMBS, lengths={})) == 1


def test_weights_per_length_count_errors_in_lengths_of_the_landmark() -> None:
    """Two hands that cannot both be reached: the one with half of the length counts twice as much."""

    def reached(tasks: tuple[dict[str, Any], ...], **more: Any) -> FloatArray:
        hierarchy = compiled(({"name": "hands", "tasks": tasks}, LEVELS[-1]), **more)
        targets = hierarchy.blank()
        for name, y in (("l_wrist", 1.5), ("head", -0.5)):
            hierarchy.set_position(targets, name, np.array([0.3, y, 1.4]))
        return settled(hierarchy, targets, frames=5)

    task = {"type": "position", "of": ("l_wrist", "head"), "weight": 1.0, "per": "length"}
    per_metre = (
        {"type": "position", "of": "l_wrist", "weight": 4.0},
        {"type": "position", "of": "head", "weight": 2.0},
    )
    lengths = {"l_wrist": 0.25, "head": 0.5}
    assert (reached((task,), lengths=lengths) == reached(per_metre)).all()
    with pytest.raises(ConfigError):
        reached((task,), lengths={"l_wrist": 0.25})


# The base pose from the lower sole.

STANCE = plant(op3(), op3().profile.postures.stand)


def bent(side: str, knee: float) -> FloatArray:
    """The standing posture with one leg drawn up, its root somewhere else."""
    sign = 1.0 if side == "l" else -1.0
    angles = dict(op3().profile.postures.stand)
    angles[f"{side}_knee"] += sign * knee
    angles[f"{side}_hip_pitch"] -= sign * 0.5 * knee
    angles[f"{side}_ank_pitch"] += sign * 0.5 * knee
    q = op3().posture(angles)
    q[:3] += [0.3, -0.2, 0.1]
    return q


def test_the_sole_stays_when_the_joints_move() -> None:
    robot = load_robot("op3")
    before = plant(robot, robot.profile.postures.stand).q
    q = before.copy()
    q[robot.servo_columns] += np.random.default_rng(0).uniform(-0.2, 0.2, 20)
    q[:7] = np.nan
    plant_root(robot, before, q)
    both = np.stack([before, q])
    soles = robot.points(both, ("l_sole", "r_sole"))
    turns = robot.orientations(both, ("l_sole", "r_sole"))
    foot = int(np.argmin(soles[0, :, 2]))
    np.testing.assert_allclose(soles[1, foot], soles[0, foot], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(turns[1, foot] * turns[0, foot])), 1.0, atol=1e-12)
