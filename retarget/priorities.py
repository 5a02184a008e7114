"""A priority file: the ordered levels of one stage, each a list of tasks. `configs/priorities/*.yaml`.

Levels are data: level 1 is never traded for a lower one. What a task's `of` names depends on the stage: sensors for
`reconstruct`, landmarks or frames of the robot for `retarget`. What is absent this frame takes no part; what the body
does not have is refused when the hierarchy is built, unless the task is `optional`.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from retarget.catalogue import Kind, find
from retarget.errors import Problem
from retarget.heading_settings import HeadingSettings
from retarget.schema import (
    Integer,
    Name,
    NotNegative,
    Number,
    Positive,
    Schema,
    Share,
    Switch,
    Text,
    Vector3,
    read_model,
)
from retarget.strict_yaml import Document

__all__ = [
    "AxisTask",
    "CentreOfMassTask",
    "HeadingTask",
    "Level",
    "LookAtTask",
    "ObserverSettings",
    "OrientationTask",
    "PositionTask",
    "PostureTask",
    "PreventiveTask",
    "Priorities",
    "ReactiveTask",
    "Task",
    "UpholdSettings",
    "load_priorities",
]


def _per_row(value: Any) -> Any:
    """One number weighs all rows alike."""
    return (value,) * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


def _not_all_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise PydanticCustomError("zero", "all three are zero")
    return value


def _one_or_more(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


def _uniform() -> dict[str, float]:
    return {"default": 1.0}


RowWeights = Annotated[
    tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(_per_row), AfterValidator(_not_all_zero)
]
"""Weights of the x, y and z rows, or one number for all three; a row of weight 0 is not there."""
Direction = Annotated[Vector3, AfterValidator(_not_all_zero)]
"""A direction; its length does not matter."""
Against = Literal["self", "scene", "all"]
Names = Annotated[tuple[Name, ...], BeforeValidator(_one_or_more), Field(min_length=1, max_length=64)]


class _Weighed(Schema):
    """Keys of every task that has rows of its own. gain: share of the error corrected per iteration, (0, 1].

    max_error: cap of the error asked per iteration, m or rad; absent: the solver's own. optional: what `of` names may
    be missing on the body or among the worn sensors.
    """

    gain: Share = 1.0
    max_error: Positive | None = None
    optional: Switch = False


class PositionTask(_Weighed):
    """Points of the body go to the positions asked of them. Rows are the world's x, y, z."""

    type: Literal["position"]
    of: Names
    weight: RowWeights = (1.0, 1.0, 1.0)


class OrientationTask(_Weighed):
    """Frames of the body take the orientations asked of them. Rows are rotations about the world's x, y, z."""

    type: Literal["orientation"]
    of: Names
    weight: RowWeights = (1.0, 1.0, 1.0)


class AxisTask(_Weighed):
    """`axis` of each frame points along `direction` in the heading frame (z up): soles flat, trunk upright."""

    type: Literal["axis"]
    of: Names
    axis: Direction
    direction: Direction
    weight: Positive = 1.0


class HeadingTask(_Weighed):
    """The left axis of each frame points to the left of the heading estimate; bending forward stays free."""

    type: Literal["heading"]
    of: Names
    weight: Positive = 1.0


class LookAtTask(_Weighed):
    """`axis` of each frame aims at the point asked of it."""

    type: Literal["look_at"]
    of: Names
    axis: Direction = (1.0, 0.0, 0.0)
    weight: Positive = 1.0


class CentreOfMassTask(_Weighed):
    """The centre of mass.

    over_root: horizontally at a fixed offset from the root, as in the paper; over_feet: over the middle of the feet,
    `forward` m along the heading; support: inside the support polygon shrunk by `margin` m, as inequality rows.
    moving: share of that polygon, about its middle, in which capture point and zero-moment point stay: for a robot
    with mass; absent: the centre of mass alone counts, as at rest.
    fade_speed, m/s: the weight falls as 1 / (1 + (v / fade_speed)^4) with the speed v of the body; absent: never.
    """

    type: Literal["centre_of_mass"]
    mode: Literal["over_root", "over_feet", "support"]
    weight: RowWeights = (1.0, 1.0, 0.0)
    forward: Number = 0.0
    margin: NotNegative = 0.0
    moving: Annotated[Positive, Field(le=1.0)] | None = None
    fade_speed: Positive | None = None


class PostureTask(_Weighed):
    """Joints are drawn to a posture of the body.

    towards: its name. lowered: name of what it becomes as the head comes down; absent: it stays. stiffness: weight by
    joint or by group of joints; `default` is that of all others, and of a free root 0. settle: s, time constant
    with which free joints approach it; absent or 0: at once.
    """

    type: Literal["posture"]
    towards: Name = "attractor"
    lowered: Name | None = None
    stiffness: Annotated[dict[Name, NotNegative], Field(max_length=300, default_factory=_uniform)]
    settle: NotNegative = 0.0


class ReactiveTask(Schema):
    """Observers that touch push their part out, at `speed` m/s at most. of: names of observers; absent: all.

    against: each other, what the scene holds, or both.
    """

    type: Literal["reactive"]
    of: Names | None = None
    against: Against = "all"
    speed: Positive = 0.1


class PreventiveTask(Schema):
    """Observers inside influence damp the approach of their part. of: names of observers; absent: all.

    against: each other, what the scene holds, or both. speed: where all of them act, the approach in m/s permitted
    where influence begins; it falls to nothing at the margin.
    """

    type: Literal["preventive"]
    of: Names | None = None
    against: Against = "all"
    speed: Positive = 0.5


Task = Annotated[
    PositionTask
    | OrientationTask
    | AxisTask
    | HeadingTask
    | LookAtTask
    | CentreOfMassTask
    | PostureTask
    | ReactiveTask
    | PreventiveTask,
    Field(discriminator="type"),
]


class ObserverSettings(Schema):
    """What this file asks of observers. human: which a human wears: lines along the limbs, those and a ball for the
    head, or its own capsules on every segment; a robot brings its own. influence: of those of the human, m. margin:
    of all observers, m, obstacle_margin: of all obstacles; absent: each its own.
    """

    human: Literal["none", "lines", "lines_and_head", "capsules"] = "none"
    influence: Positive = 0.08
    margin: NotNegative | None = None
    obstacle_margin: NotNegative | None = None


class UpholdSettings(Schema):
    """Goals that hold a robot on its soles up where its servos give way (see `retarget.upheld_goals`).

    settle: s, time constant with which goals follow the load. reserve: share by which the load of a crouch is exceeded
    in motion; what carries it is planned no faster than its motors turn under that.
    """

    settle: Annotated[Positive, Field(le=1.0)] = 0.02
    reserve: NotNegative = 0.25


class Level(Schema):
    """Tasks of equal rank. A level without tasks keeps its place and asks nothing."""

    name: Text
    tasks: Annotated[tuple[Task, ...], Field(max_length=32)]


class Priorities(Schema):
    """Levels, highest first. iterations: most per frame (the paper's N_IK).

    activation: which preventive observers put up their row: the closest per obstacle (paper), one after the other by
    distance, or all (a damper throughout influence). observers: which they are. heading: how the heading of a
    performer is told from the sensors. uphold: for a robot with mass on its own soles; absent: its goals are its
    postures.
    """

    name: Name
    description: Text
    iterations: Annotated[Integer, Field(ge=1, le=100)] = 5
    activation: Literal["closest", "ranked", "all"] = "closest"
    observers: ObserverSettings = ObserverSettings()
    heading: HeadingSettings = HeadingSettings()
    uphold: UpholdSettings | None = None
    levels: Annotated[tuple[Level, ...], Field(min_length=1, max_length=32)]

    def tasks(self) -> Iterator[tuple[int, int, Task]]:
        """All tasks with their places: (level, index in the level, task), from 0."""
        for level, entry in enumerate(self.levels):
            for index, task in enumerate(entry.tasks):
                yield level, index, task


def load_priorities(path_or_name: str | Path) -> Priorities:
    """A priority file by shipped or user's name, or by path. Raises UsageError, ConfigError with all its problems."""
    priorities, _ = read_model(Priorities, find(Kind.PRIORITIES, path_or_name), check=_check)
    return priorities


def _check(priorities: Priorities, document: Document) -> list[Problem]:
    problems = []
    first: dict[str, int] = {}
    for index, level in enumerate(priorities.levels):
        earlier = first.setdefault(level.name, index)
        if earlier != index:
            here = ("levels", index, "name")
            found = f"{level.name!r}, also of level {earlier + 1}"
            problems.append(document.problem(here, "duplicate level name", found=found))
    if priorities.levels and not any(level.tasks for level in priorities.levels):
        problems.append(document.problem(("levels",), "no level has a task", allowed="at least one task"))
    return problems
