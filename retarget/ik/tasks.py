"""Compiles a task of a priority file into tasks of the solver, each with the name under which its target is set."""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

import numpy as np

from retarget import rotations
from retarget._solver import Task as SolverTask
from retarget.arithmetic import norm
from retarget.errors import ConfigError, suggest
from retarget.model.body import BodyModel, Frame, JointType, joint_weights, low_inertia_joints
from retarget.rotations import as_quat, as_vector
from retarget.schema.priorities import (
    AxisTask,
    CarriedTask,
    CentreOfMassTask,
    HeadingTask,
    LimbTask,
    LookAtTask,
    OrientationTask,
    Phase,
    PositionTask,
    PostureTask,
    PreventiveTask,
    ReactiveTask,
    StrengthTask,
    Task,
)
from retarget.types import FloatArray

SUPPORT_EDGES = 34
"""Most half-spaces of a support task: two for each edge of the hull of two feet of eight corners each, two for
height."""

CARRIES = "carried by "  # prefix of the names of frames at joints that carry a robot on its soles

_LEFT = np.array([0.0, 1.0, 0.0])  # axis that a heading turns, which bending forward leaves alone


class SlotKind(Enum):
    """Kind of target in a slot of the target vector."""

    POSITION = "position"
    LIMB = "limb"
    ORIENTATION = "orientation"
    AXIS = "axis"
    HEADING = "heading"
    LOOK_AT = "look_at"
    OVER_ROOT = "over_root"
    OVER_FEET = "over_feet"
    SUPPORT = "support"
    STRENGTH = "strength"
    POSTURE = "posture"
    PREVIOUS = "previous"
    CARRIED = "carried"
    REACTIVE = "reactive"
    PREVENTIVE = "preventive"


@dataclass(frozen=True, eq=False)
class Slot:
    """A solver task and its target. name: as in `of`, or the posture's.

    direction: unit x, y, z in the heading frame, for an axis or a heading. lowered, bent: the same when the head is
    lowered or the body bends over. settle: time constant of a PREVIOUS or a CARRIED, s. when: phases of support; none:
    always.
    """

    kind: SlotKind
    name: str
    task: SolverTask
    direction: tuple[float, float, float] | None = None
    lowered: tuple[float, float, float] | None = None
    bent: tuple[float, float, float] | None = None
    settle: float = 0.0
    when: tuple[Phase, ...] = ()


@dataclass(frozen=True, eq=False)
class Limb:
    """A line of a body between two points that are at most `length` m apart."""

    begin: Frame
    end: Frame
    length: float


def compile_task(
    task: Task,
    body: BodyModel,
    frames: Mapping[str, Frame],
    *,
    fed: Container[str],
    is_soft: bool,
    limbs: Mapping[str, Limb],
    lengths: Mapping[str, float],
    observers: Sequence[str] = (),
) -> list[Slot]:
    """Slots of one task; none for observers on a body without any.

    lengths: m, of landmarks, for weights per length. fed: names whose targets will ever be set; tasks on others are
    left out. is_soft: True in a last level with a posture, where `weight` is a stiffness.

    Raises ConfigError: a task that is not optional names what the body lacks, or observers are in a soft level.
    """
    if isinstance(task, PostureTask):
        return _posture(task, body)
    if isinstance(task, CentreOfMassTask):
        return [_centre_of_mass(task, body, frames, is_soft=is_soft)]
    if isinstance(task, StrengthTask):
        joints = [(name.removeprefix(CARRIES), frame) for name, frame in frames.items() if name.startswith(CARRIES)]
        return [
            Slot(SlotKind.STRENGTH, joint, SolverTask.lever(frame.body, as_vector(frame.position), max_edges=1))
            for joint, frame in joints
        ]
    if isinstance(task, CarriedTask):
        _named(task, task.by, frames)
        if body.joint_type[0] != JointType.FREE:
            step = "Leave the task out: it is for a human"
            raise ConfigError("a carried task is for a free root", found=body.joint_names[0], next_step=step)
        rows = _row_weights(task.weight, is_soft=is_soft)
        made = SolverTask.position(
            int(body.joint_body[0]), (0.0, 0.0, 0.0), weight=rows, gain=task.gain, max_error=task.max_error or 0.05
        )
        return [Slot(SlotKind.CARRIED, "root", made, settle=task.settle)]
    if isinstance(task, ReactiveTask | PreventiveTask):
        return _observing(task, observers, is_soft=is_soft)
    if isinstance(task, LimbTask):
        return [_limb(task, name, limb) for name, limb in _named(task, task.of, limbs)]
    # An axis or a heading has its direction from the file. Other rows without a target would hold the frame at the
    # origin.
    needs_target = isinstance(task, PositionTask | OrientationTask | LookAtTask)
    named = [(name, frame) for name, frame in _named(task, task.of, frames) if name in fed or not needs_target]
    by_length = isinstance(task, PositionTask) and task.per == "length"
    if by_length and task.optional and lengths:  # as of a robot that hangs, whose pelvis follows nothing
        named = [(name, frame) for name, frame in named if name in lengths]
    if by_length and (unknown := [name for name, _ in named if name not in lengths]):
        raise ConfigError(
            "a position task weighs per length what has no known length",
            found=", ".join(unknown),
            allowed=", ".join(lengths) or "landmarks of a robot, with their robot_length",
            next_step="Leave out per: length, or name a landmark",
        )
    return [
        _placed(task, name, frame, is_soft=is_soft, unit=lengths[name] if by_length else 1.0) for name, frame in named
    ]


T = TypeVar("T")


def _named(
    task: PositionTask | LimbTask | OrientationTask | AxisTask | HeadingTask | LookAtTask | CarriedTask,
    names: Iterable[str],
    frames: Mapping[str, T],
) -> list[tuple[str, T]]:
    missing = [name for name in names if name not in frames]
    if missing and not task.optional:
        raise ConfigError(
            f"a {task.type} task names what the body does not have",
            found=", ".join(missing),
            next_step=suggest(missing[0], list(frames)),
        )
    return [(name, frames[name]) for name in names if name in frames]


def _limb(task: LimbTask, name: str, limb: Limb) -> Slot:
    """A task on one limb. Its rows are shares of the limb's length, which are radians if small."""
    made = SolverTask.position(
        limb.end.body,
        as_vector(limb.end.position),
        base=(limb.begin.body, as_vector(limb.begin.position)),
        weight=(task.weight / limb.length,) * 3,
        gain=task.gain,
        max_error=limb.length * (task.max_error or 0.2),
    )
    return Slot(SlotKind.LIMB, name, made)


def _placed(
    task: PositionTask | OrientationTask | AxisTask | HeadingTask | LookAtTask,
    name: str,
    frame: Frame,
    *,
    is_soft: bool,
    unit: float,
) -> Slot:
    """A task on one frame. unit: length (m) of a position's error that has the weight of the task."""
    gain, point = task.gain, as_vector(frame.position)
    if isinstance(task, PositionTask):
        cap = task.max_error or 0.05
        x, y, z = _row_weights(task.weight, is_soft=is_soft)
        rows = (x / unit, y / unit, z / unit)
        made = SolverTask.position(frame.body, point, weight=rows, gain=gain, max_error=cap)
        return Slot(SlotKind.POSITION, name, made)
    cap = task.max_error or 0.2
    if isinstance(task, OrientationTask):
        rows = _row_weights(task.weight, is_soft=is_soft)
        made = SolverTask.orientation(frame.body, as_quat(frame.quat), weight=rows, gain=gain, max_error=cap)
        return Slot(SlotKind.ORIENTATION, name, made)
    weight = float(np.sqrt(task.weight)) if is_soft else task.weight
    # The solver takes the axis in the frame of the link.
    local = _LEFT if isinstance(task, HeadingTask) else _unit(task.axis)
    axis = as_vector(rotations.rotate(frame.quat, local))
    if isinstance(task, LookAtTask):
        made = SolverTask.look_at(frame.body, point, axis, weight=weight, gain=gain, max_error=cap)
        return Slot(SlotKind.LOOK_AT, name, made)
    made = SolverTask.axis(frame.body, axis, weight=weight, gain=gain, max_error=cap)
    if isinstance(task, HeadingTask):
        return Slot(SlotKind.HEADING, name, made, direction=as_vector(_LEFT))
    lowered, bent = (None if axis is None else as_vector(_unit(axis)) for axis in (task.lowered, task.bent))
    return Slot(SlotKind.AXIS, name, made, direction=as_vector(_unit(task.direction)), lowered=lowered, bent=bent)


def _centre_of_mass(task: CentreOfMassTask, body: BodyModel, frames: Mapping[str, Frame], *, is_soft: bool) -> Slot:
    cap = task.max_error or 0.05
    if task.mode == "support":
        # Light joints take no part: a balance that moves by arms would swing them as a counterweight.
        without = [] if task.moving is None else low_inertia_joints(body, frames)
        return Slot(SlotKind.SUPPORT, task.mode, SolverTask.support(SUPPORT_EDGES, without=without, max_error=cap))
    rows = _row_weights(task.weight, is_soft=is_soft)
    over_root = task.mode == "over_root"
    root = int(body.joint_body[0]) if over_root else None
    made = SolverTask.centre_of_mass(weight=rows, over=root, gain=task.gain, max_error=cap)
    return Slot(SlotKind.OVER_ROOT if over_root else SlotKind.OVER_FEET, task.mode, made)


def _observing(task: ReactiveTask | PreventiveTask, observers: Sequence[str], *, is_soft: bool) -> list[Slot]:
    if not observers:
        return []
    if is_soft:
        raise ConfigError(
            f"a {task.type} task is in the last level, which has a posture",
            allowed="a level of its own above it, where it is a limit",
        )
    kind, make = SlotKind.REACTIVE, SolverTask.reactive
    if isinstance(task, PreventiveTask):
        kind, make = SlotKind.PREVENTIVE, SolverTask.preventive
    missing = [name for name in task.of or () if name not in observers]
    if missing:
        raise ConfigError(
            f"a {task.type} task names an observer that the body does not have",
            found=", ".join(missing),
            next_step=suggest(missing[0], list(observers)),
        )
    of = None if task.of is None else [observers.index(name) for name in task.of]
    return [Slot(kind, task.against, make(of=of, against=task.against, speed=task.speed))]


def _posture(task: PostureTask, body: BodyModel) -> list[Slot]:
    named = [(name, value) for name, value in task.stiffness.items() if name != "default"]
    weight = joint_weights(body, named, default=task.stiffness.get("default", 1.0))
    cap = task.max_error or 0.3
    slots = [Slot(SlotKind.POSTURE, task.towards, SolverTask.posture(weight, gain=task.gain, max_error=cap))]
    if task.settle > 0.0:
        drag = SolverTask.posture(weight, max_error=cap)
        slots.append(Slot(SlotKind.PREVIOUS, "previous", drag, settle=task.settle))
    return slots


def _row_weights(weight: tuple[float, float, float], *, is_soft: bool) -> tuple[float, float, float]:
    """Weights of rows. A stiffness multiplies the square of an error, so its root multiplies the row."""
    return as_vector(np.sqrt(weight)) if is_soft else weight


def _unit(vector: tuple[float, float, float]) -> FloatArray:
    array = np.array(vector, dtype=np.float64)
    return array / norm(array)
