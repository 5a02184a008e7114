"""Priority files compiled for a body: names become targets, what is not set is absent."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from followers import op3, stance
from messages import refuses
from retarget.errors import ConfigError
from retarget.ik.hierarchy import Hierarchy, body_frames
from retarget.ik.support_polygon import half_spaces
from retarget.ik.tasks import Limb, Slot, SlotKind, compile_task
from retarget.model.body import BodyModel, JointType
from retarget.model.human import Human, build_human, human_limits
from retarget.model.human_dimensions import proportional_dimensions
from retarget.model.robot import plant_root
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


def test_named_targets_are_reached_and_what_is_not_set_is_absent() -> None:
    """Labels follow the levels, of which an empty one keeps its place."""
    hierarchy = compiled()
    assert hierarchy.labels == (
        *("over_root over_root", "position l_ankle", "position r_ankle", "position l_wrist", "position head"),
        *("posture stand", "previous previous"),
    )
    assert len(hierarchy.solver.task_errors) == len(hierarchy.labels)
    targets, hand = hierarchy.blank(), np.array([0.35, 0.25, 1.2])
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
    # Many at once are the same as one by one.
    names, block = ("head", "pelvis", "l_wrist", "l_ankle"), np.arange(16.0).reshape(4, 4) + 1.0
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
    with refuses(ConfigError, "position of l_wrist", "left", "for a human"):
        compiled(ON_LEFT)  # a body whose phases are unknown
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


def test_support_edges_fill_their_slots() -> None:
    support = {"type": "centre_of_mass", "mode": "support"}
    hierarchy = compiled(({"name": "balance", "tasks": (support,)}, LEVELS[-1]))
    targets = hierarchy.blank()
    edges = np.array([[1.0, 0.0, 0.2], [-1.0, 0.0, -0.1], [0.0, 1.0, 0.05], [0.0, -1.0, 0.05]])
    hierarchy.set_support(targets, half_spaces(edges))
    q = settled(hierarchy, targets)
    com = human().body.solver_body().centre_of_mass(q[None])[0]
    assert 0.1 - 1e-6 <= com[0] <= 0.2 + 1e-6 and abs(com[1]) <= 0.05 + 1e-6


def test_what_a_body_or_a_landmark_does_not_have_is_refused() -> None:
    """A weight per length was taken as one per metre, or as a frame that the body does not have."""
    task: dict[str, Any] = {"type": "position", "of": ("l_wirst",)}
    with refuses(ConfigError, next_step="l_wrist"):
        compiled(({"name": "hands", "tasks": (task,)},))
    assert compiled(({"name": "hands", "tasks": ({**task, "optional": True},)},)).labels == ()
    with refuses(ConfigError, next_step="stand"):
        compiled(({"name": "posture", "tasks": ({"type": "posture", "towards": "stnad"},)},))
    with refuses(ConfigError, next_step="spine"):
        compiled(({"name": "posture", "tasks": ({"type": "posture", "stiffness": {"spnie": 1.0}},)},))
    for optional in (True, False):
        task = {"type": "position", "of": ("l_wrist",), "per": "length", "optional": optional}
        with refuses(ConfigError, "l_wrist", "per length"):
            compiled(({"name": "hands", "tasks": (task,)},))


def compile_for(body: BodyModel, task: Task, **more: Any) -> list[Slot]:
    """The tasks of the solver for one of a priority file."""
    frames = body_frames(body)
    limbs = {"l_arm": Limb(frames["chest"], frames["l_wrist"], 0.5)}
    usual: dict[str, Any] = {"frames": frames, "fed": (), "is_soft": True, "limbs": limbs, "lengths": {}}
    return list(compile_task(task, body, **(usual | more)))


def test_a_root_that_is_not_free_or_sensors_that_a_body_does_not_have_carry_nothing() -> None:
    carried, body = CarriedTask(type="carried", by={"head": 1.0, "l_ankle": 1.0}, settle=0.1), human().body
    assert [slot.kind for slot in compile_for(body, carried)] == [SlotKind.CARRIED]
    with refuses(ConfigError, "l_ankle", "a carried task names what the body does not have"):
        compile_for(body, carried, frames={"head": body.frame("head")})
    fixed = replace(body, joint_type=np.full_like(body.joint_type, JointType.HINGE))
    with refuses(ConfigError, "a carried task is for a free root"):
        compile_for(fixed, carried)


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
def test_one_task_of_a_priority_file_becomes_tasks_of_the_solver(task: Task, kinds: list[SlotKind]) -> None:
    """Those that nothing feeds are left out, but for axes."""
    body = human().body
    for is_soft in (False, True):
        slots = compile_for(body, task, fed=body_frames(body), is_soft=is_soft)
        assert [slot.kind for slot in slots] == kinds
    if isinstance(task, PositionTask):
        assert [slot.name for slot in compile_for(body, task, fed={"head"}, is_soft=False)] == ["head"]
    if isinstance(task, AxisTask):
        assert len(compile_for(body, task, is_soft=False)) == 1


def test_weights_per_length_count_errors_in_lengths_of_the_landmark() -> None:
    """Two hands that cannot both be reached: the one with half of the length counts twice as much."""

    def reached(tasks: tuple[dict[str, Any], ...], **more: Any) -> FloatArray:
        hierarchy = compiled(({"name": "hands", "tasks": tasks}, LEVELS[-1]), **more)
        targets = hierarchy.blank()
        for name, y in (("l_wrist", 1.5), ("head", -0.5)):
            hierarchy.set_position(targets, name, np.array([0.3, y, 1.4]))
        return settled(hierarchy, targets, frames=5)

    task = {"type": "position", "of": ("l_wrist", "head"), "weight": 1.0, "per": "length"}
    weights = {"l_wrist": 4.0, "head": 2.0}
    per_metre = tuple({"type": "position", "of": of, "weight": weight} for of, weight in weights.items())
    lengths = {"l_wrist": 0.25, "head": 0.5}
    assert (reached((task,), lengths=lengths) == reached(per_metre)).all()
    with pytest.raises(ConfigError):
        reached((task,), lengths={"l_wrist": 0.25})


def test_the_sole_stays_when_the_joints_move() -> None:
    before = stance().q
    q = before.copy()
    q[op3().servo_columns] += np.random.default_rng(0).uniform(-0.2, 0.2, 20)
    q[:7] = np.nan
    plant_root(op3(), before, q)
    both = np.stack([before, q])
    soles, turns = op3().points(both, ("l_sole", "r_sole")), op3().orientations(both, ("l_sole", "r_sole"))
    foot = int(np.argmin(soles[0, :, 2]))
    np.testing.assert_allclose(soles[1, foot], soles[0, foot], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(turns[1, foot] * turns[0, foot])), 1.0, atol=1e-12)
