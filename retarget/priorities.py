"""A priority file: the ordered levels of one stage, each a list of tasks. `configs/priorities/*.yaml`.

Levels are data: level 1 is never traded for a lower one. What a task's `of` names depends on the stage: sensors for
`reconstruct`, landmarks or frames of the robot for `retarget`. What is absent this frame takes no part; what the body
does not have is refused when the hierarchy is built, unless the task is `optional`.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from retarget.catalogue import Kind, find
from retarget.errors import Problem
from retarget.heading_settings import HeadingSettings
from retarget.priority_tasks import (
    AxisTask,
    CentreOfMassTask,
    HeadingTask,
    LookAtTask,
    OrientationTask,
    PositionTask,
    PostureTask,
    PreventiveTask,
    ReactiveTask,
    StrengthTask,
    Task,
)
from retarget.schema import Integer, Name, NotNegative, Positive, Schema, Text, read_model
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
    "Steps",
    "StrengthTask",
    "Task",
    "UpholdSettings",
    "load_priorities",
]

Steps = Literal["planted", "shift", "follow"]
"""What the feet of a robot do when its performer lifts one: stay; lift as well, once the mass is over the other; or,
where something else carries the robot, whatever the performer's do."""


class ObserverSettings(Schema):
    """What this file asks of observers."""

    human: Literal["none", "lines", "lines_and_head", "capsules"] = "none"
    """What a human wears: nothing, lines along the limbs, those and a ball for the head, or its own capsules. A robot
    brings its own."""
    influence: Positive = 0.08
    """[m] Of those of the human."""
    margin: NotNegative | None = None
    """[m] Of all observers; absent: each its own."""
    obstacle_margin: NotNegative | None = None
    """[m] Of all obstacles; absent: each its own."""


class UpholdSettings(Schema):
    """Goals that hold a robot on its soles up where its servos give way (see `retarget.upheld_goals`)."""

    settle: Annotated[Positive, Field(le=1.0)] = 0.02
    """[s] Time constant with which goals follow the load."""
    reserve: NotNegative = 0.25
    """Share by which the load of a crouch is exceeded in motion; what carries it is planned no faster than its motors
    turn under that."""
    off_stops: Annotated[NotNegative, Field(le=0.5)] = 0.05
    """[rad] What carries the robot keeps so far off the ends of its range, for what its servos overshoot."""
    late: Annotated[NotNegative, Field(le=1.0)] = 0.03
    """[s] So late its bus may be before a servo at the speed of the plan is so far behind that the guard stops it."""


class Level(Schema):
    """Tasks of equal rank. A level without tasks keeps its place and asks nothing."""

    name: Text
    """For messages and reports."""
    tasks: Annotated[tuple[Task, ...], Field(max_length=32)]
    """Of equal rank; none: the level keeps its place and asks nothing."""


class Priorities(Schema):
    """A priority file."""

    name: Name
    """By which it is chosen."""
    description: Text
    """For whoever chooses."""
    iterations: Annotated[Integer, Field(ge=1, le=100)] = 5
    """Per frame, at most (the paper's N_IK)."""
    activation: Literal["closest", "ranked", "all"] = "closest"
    """Which preventive observers put up their row: the closest per obstacle (paper), one after the other by distance,
    or all."""
    observers: ObserverSettings = ObserverSettings()
    """Which they are, and what they keep."""
    heading: HeadingSettings = HeadingSettings()
    """How the heading of a performer is told from the sensors."""
    uphold: UpholdSettings | None = None
    """Goals that hold up a robot with mass on its own soles; absent: goals are postures."""
    steps: Steps | None = None
    """What the feet do when the performer lifts one: stay; lift as well, in place, once the mass is over the other; or,
    of a robot that hangs, whatever the performer's do. Absent: they stay, and those of a robot that hangs follow."""
    ahead: Annotated[NotNegative, Field(le=0.2)] = 0.0
    """[s] So far ahead of what is asked a robot aims, by the asked motion's own velocity: its servos are behind it."""
    levels: Annotated[tuple[Level, ...], Field(min_length=1, max_length=32)]
    """Highest first: a level is never traded for a lower one."""

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
