"""A priority file: the ordered levels of one stage, each a list of tasks. `configs/priorities/*.yaml`.

Levels are data: level 1 is never traded for a lower one. What a task's `of` names depends on the stage: sensors for
`reconstruct`, landmarks or frames of the robot for `retarget`. What is absent this frame takes no part; what the body
does not have is refused when the hierarchy is built, unless the task is `optional`.

A file that `extends` another is an overlay: it says only what differs from its base.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from math import sqrt
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from retarget.errors import ConfigError, Problem, UsageError
from retarget.frames import SENSORS
from retarget.schema.catalogue import Kind, find, is_file, read_as
from retarget.schema.strict_models import (
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
    ascending,
    listed,
    one_or_more,
    unknown_name,
    validated,
)
from retarget.schema.strict_yaml import Document, KeyPath, read_text, scan

# The tasks of a priority file: what each kind asks, and its keys. What `of` names depends on the stage: sensors for
# `reconstruct`, landmarks or frames of the robot for `retarget`.


def _per_row(value: Any) -> Any:
    """One number weighs all rows alike."""
    return (value,) * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


def _not_all_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise PydanticCustomError("zero", "all three are zero")
    return value


RowWeights = Annotated[
    tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(_per_row), AfterValidator(_not_all_zero)
]
"""Weights of the x, y and z rows, or one number for all three; a row of weight 0 is not there."""
Direction = Annotated[Vector3, AfterValidator(_not_all_zero)]
"""A direction; its length does not matter."""
Against = Literal["self", "scene", "all"]
Names = Annotated[tuple[Name, ...], BeforeValidator(one_or_more), Field(min_length=1, max_length=64)]


class _Weighed(Schema):
    """Keys of every task that has rows of its own."""

    gain: Share = 1.0
    """Share of the error that is corrected per iteration."""
    max_error: Positive | None = None
    """[m or rad] Cap of the error asked per iteration; absent: the solver's own."""
    optional: Switch = False
    """Names in `of` may be missing on the body or among the performer's sensors."""


Phase = Literal["double", "left", "right", "flight"]
"""Phase of support: on both feet, on the left or the right one alone, or on none."""


class Phased(_Weighed):
    """Keys of tasks that may act in some phases of support only."""

    when: Annotated[tuple[Phase, ...], BeforeValidator(one_or_more), Field(min_length=1)] | None = None
    """Phases of a human's support in which it acts, one or a list; absent: always. In the last level, beside a posture:
    there weights come and go smoothly, as a strict level cannot."""


class PositionTask(Phased):
    """Points of the body go to the positions asked of them. Rows are the world's x, y, z."""

    type: Literal["position"]
    """Of the task."""
    of: Names
    """Sensors (of a human); landmarks or frames (of a robot). One name or a list."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row x, y, z; a row of weight 0 is not there."""
    per: Literal["metre", "length"] = "metre"
    """`length`: the weight is [m], of an error as long as the `robot_length` of the landmark, so that it means the same
    on a small robot."""


class LimbTask(Phased):
    """Lines from anchors of the robot's profile to its landmarks take the length and direction asked, in the world,
    wherever the anchors are: arms do not pull the trunk along. Rows are the world's x, y, z."""

    type: Literal["limb"]
    """Of the task."""
    of: Names
    """Landmarks with one anchor; or `neck`, the line of the trunk from the pelvis to it."""
    weight: Positive = 1.0
    """[m/rad] A limb that is off by a radian counts as much as a point that is off by so much."""


class OrientationTask(Phased):
    """Frames of the body take the orientations asked of them. Rows are rotations about the world's x, y, z."""

    type: Literal["orientation"]
    """Of the task."""
    of: Names
    """As of position."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row."""


class AxisTask(Phased):
    """`axis` of each frame points along `direction` in the heading frame (z up): soles flat, trunk upright."""

    type: Literal["axis"]
    """Of the task."""
    of: Names
    """As of position."""
    axis: Direction
    """In the frame of what `of` names; its length does not matter."""
    direction: Direction
    """In the heading frame, z up."""
    lowered: Direction | None = None
    """What `direction` becomes as the head of a human comes down, like `lowered` of a posture; absent: it stays."""
    bent: Direction | None = None
    """What it becomes as a human who gets down bends over: with the head ahead of the feet, not above them."""
    weight: Positive = 1.0
    """Of both rows."""


class HeadingTask(Phased):
    """The left axis of each frame points to the left of the heading estimate; bending forward stays free."""

    type: Literal["heading"]
    """Of the task."""
    of: Names
    """As of position."""
    weight: Positive = 1.0
    """Of its rows."""


class LookAtTask(Phased):
    """`axis` of each frame aims at the point asked of it."""

    type: Literal["look_at"]
    """Of the task."""
    of: Names
    """As of position."""
    axis: Direction = (1.0, 0.0, 0.0)
    """In the frame of what `of` names."""
    weight: Positive = 1.0
    """Of both rows."""


class CentreOfMassTask(Phased):
    """The centre of mass is kept over the root, over the feet, or inside their support polygon."""

    type: Literal["centre_of_mass"]
    """Of the task."""
    mode: Literal["over_root", "over_feet", "support"]
    """Over the root as in the paper; over the middle of the feet; or inside the support polygon, as inequalities."""
    weight: RowWeights = (1.0, 1.0, 0.0)
    """Of x, y, z."""
    forward: Number = 0.0
    """[m] Of over_feet: so far along the heading."""
    margin: NotNegative = 0.0
    """[m] Of support: so far inside the edge."""
    moving: Annotated[Positive, Field(le=1.0)] | None = None
    """Of support: share of the polygon, about its middle, in which the capture point stays, and the zero-moment point
    in a little more; absent: as at rest."""
    fade_speed: Positive | None = None
    """[m/s] The weight falls as 1 / (1 + (v / fade_speed)^4) with the speed v of the body; absent: never."""


class StrengthTask(Schema):
    """Joints of the legs carry no more than their servos can for long, of a robot that stands on two soles (see
    `retarget.robot.balance`)."""

    type: Literal["strength"]
    """Of the task."""
    share: Annotated[Positive, Field(le=1.0)]
    """Of the stall torque of each servo, what it may carry for long; more only where `stand` alone needs it."""


class PostureTask(_Weighed):
    """Joints are drawn to a posture of the body."""

    type: Literal["posture"]
    """Of the task."""
    towards: Name = "attractor"
    """Name of the posture."""
    lowered: Name | None = None
    """Name of the posture that replaces it as the head comes down; absent: it stays."""
    stiffness: Annotated[dict[Name, NotNegative], Field(max_length=300, default_factory=lambda: {"default": 1.0})]
    """Weight by joint or group of joints; `default` is that of all others, and of a free root 0."""
    settle: NotNegative = 0.0
    """[s] Time constant with which free joints approach it; 0: at once."""


class CarriedTask(Phased):
    """The root of a human goes the way of the sensors that carry it, and leaves that way only slowly. It is what
    `settle` of a posture is for joints: without it, what pulls at the whole body moves it at once, as balance does."""

    type: Literal["carried"]
    """Of the task."""
    by: Annotated[dict[Name, Positive], Field(max_length=32)]
    """Share of each sensor. The head always carries, the others together less while they fly past it. Only proportions
    matter; those that are not there take no part."""
    settle: Positive
    """[s] Time constant with which the root leaves that way for a goal of the same weight."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row x, y, z."""


class ReactiveTask(Schema):
    """Observers that touch push their part out."""

    type: Literal["reactive"]
    """Of the task."""
    of: Names | None = None
    """Observers; absent: all."""
    against: Against = "all"
    """Each other, what the scene holds, or both."""
    speed: Positive = 0.1
    """[m/s] Of the way out, at most."""


class PreventiveTask(Schema):
    """Observers inside influence damp the approach of their part."""

    type: Literal["preventive"]
    """Of the task."""
    of: Names | None = None
    """Observers; absent: all."""
    against: Against = "all"
    """Each other, what the scene holds, or both."""
    speed: Positive = 0.5
    """[m/s] With `activation: all`: approach permitted where influence begins; it falls to nothing at the margin."""


Task = Annotated[
    PositionTask
    | LimbTask
    | OrientationTask
    | AxisTask
    | HeadingTask
    | LookAtTask
    | CentreOfMassTask
    | StrengthTask
    | PostureTask
    | CarriedTask
    | ReactiveTask
    | PreventiveTask,
    Field(discriminator="type"),
]


# The `heading` section of a priority file: weights of the hints by which the heading is found from the sensors.


class HeadingSettings(Schema):
    """Each hint is a vector on the ground; their weighted sum points forward. The defaults are those of files without
    this section, as `paper`: lines between left and right, hands ahead of the feet, and the velocity of the head."""

    pairs: dict[Name, NotNegative] = Field(default_factory=lambda: {"ankle": 0.5, "wrist": 1.0}, max_length=16)
    """[1/m] By part with a left and a right sensor: weight of the line between the two."""
    hands: NotNegative = 1.0
    """[1/m] Weight of how far forward of the ankles the hands are."""
    learned: NotNegative = 0.0
    """Weight of what recorded people's hands and heads say of their heading (`retarget/human/heading.yaml`)."""
    stance: Annotated[NotNegative, Field(le=1.0)] = 0.0
    """Share of the hints of hands, head and feet that is averaged for as long as both feet are planted."""
    velocity: NotNegative = 0.5
    """[s/m] Weight of the velocity of the head."""
    walking: Annotated[tuple[NotNegative, NotNegative], AfterValidator(ascending)] = (0.5, 1.0)
    """[m/s] Speeds of the head at which its velocity begins to count, and counts wholly."""
    facing: dict[Name, NotNegative] = Field(
        default_factory=lambda: {"head": 1.0, "chest": 2.0, "pelvis": 2.0}, max_length=16
    )
    """By sensor with an orientation: weight of its forward axis."""
    settle: Positive = 0.2
    """[s] Time constant of the low-pass."""
    velocity_settle: Positive = 0.05
    """[s] Time constant of the low-pass of the head's velocity."""


Steps = Literal["planted", "walk", "follow"]
"""What the feet of a robot do when its performer walks: stay; walk as well; or, where something else carries the robot,
whatever the performer's do."""
Legs = Literal["free"]
"""That nothing carries a robot, so that pelvis and feet are where the performer's are; else its profile says what."""


class ObserverSettings(Schema):
    """Observers of the human, and margins of all observers."""

    human: Literal["none", "lines", "lines_and_head", "capsules"] = "none"
    """Observers of a human: none, lines along the limbs, those and a ball for the head, or its own capsules. The
    profile of a robot has its own."""
    influence: Positive = 0.08
    """[m] Influence distance of the human's observers."""
    margin: NotNegative | None = None
    """[m] Margin of all observers; absent: each its own."""
    obstacle_margin: NotNegative | None = None
    """[m] Margin of all obstacles; absent: each its own."""


class DeflectionCompensationSettings(Schema):
    """Goals that hold a robot on its soles in its posture although its servos deflect (see
    `retarget.robot.deflection_compensation`)."""

    settle: Annotated[Positive, Field(le=1.0)] = 0.02
    """[s] Time constant with which goals follow the load."""
    speed_margin: NotNegative = 0.25
    """Share by which the load in motion exceeds that of a crouch at rest; joints that carry the robot are planned no
    faster than their motors turn under it."""
    soft_limits: Annotated[NotNegative, Field(le=0.5)] = 0.05
    """[rad] Distance that joints that carry the robot keep from the ends of their range, as their servos overshoot."""
    tracking_delay: Annotated[NotNegative, Field(le=1.0)] = 0.03
    """[s] Delay of the bus that is allowed: at the speed of the plan the guard does not stop a servo that lags by so
    much more."""


class Level(Schema):
    """Tasks of equal rank. A level without tasks keeps its place and has no effect."""

    name: Text
    """For messages and reports."""
    tasks: Annotated[tuple[Task, ...], Field(max_length=32)]
    """Tasks of equal rank; none: the level keeps its place and has no effect."""


class Priorities(Schema):
    """The levels of a stage, as a priority file has them."""

    name: Name
    """By which it is chosen."""
    description: Text
    """One line for lists."""
    extends: Text | None = None
    """The base of an overlay: its name (a file beside this one comes first), or its path relative to this file. Keys of
    the overlay replace those of its base whole. Of priorities that are loaded: None."""
    iterations: Annotated[Integer, Field(ge=1, le=100)] = 2
    """Per frame, at most (the paper's N_IK)."""
    activation: Literal["closest", "all"] = "closest"
    """Which preventive observers add their row: the closest per obstacle (paper), or all."""
    observers: ObserverSettings = ObserverSettings()
    """Observers and margins."""
    heading: HeadingSettings = HeadingSettings()
    """How the heading of a performer is found from the sensors."""
    deflection_compensation: DeflectionCompensationSettings | None = None
    """Goals for a robot with mass on its own soles; absent: goals are postures."""
    steps: Steps | None = None
    """What the feet do when the performer walks: stay; walk as well; or, of a robot that hangs, whatever the
    performer's do. Absent: they stay, and those of a robot that hangs follow."""
    strategies: Annotated[tuple[Literal["trunk", "crouch"], ...], Field(max_length=2)] = ()
    """How a robot on its soles gets its hands to places that its arms alone do not reach (see
    `retarget.robot.strategies`); absent: not at all."""
    servo_lead: Annotated[NotNegative, Field(le=2.0)] = 0.0
    """What carries nothing (arms and head, all of a robot that hangs) aims ahead of the asked motion by this share of
    the lag of its servos."""
    levels: Annotated[tuple[Level, ...], Field(min_length=1, max_length=32)]
    """Highest first: a level is never traded for a lower one. In an overlay an entry that is only a name is that level
    of its base, an entry with tasks replaces the level of its name or adds one, and what is left out is dropped."""

    def tasks(self) -> Iterator[tuple[int, int, Task]]:
        """All tasks with their places: (level, index in the level, task), from 0."""
        for level, entry in enumerate(self.levels):
            for index, task in enumerate(entry.tasks):
                yield level, index, task


def load_priorities(path_or_name: str | Path) -> Priorities:
    """A priority file by shipped or user's name, or by path. Raises UsageError, ConfigError with all its problems."""
    return validated(Priorities, _merged(find(Kind.PRIORITIES, path_or_name)), check=_check)


def self_contained(path: Path) -> bytes:
    """What is in a priority file; an overlay is written out with its bases. Raises ConfigError, OSError."""
    if scan(read_text(path), path).data.get("extends") is None:
        return path.read_bytes()
    return json.dumps(_merged(path).data, indent=1, ensure_ascii=False).encode()


# Overlays. The levels of an overlay stand at the same places before and after the merge, and a base is valid by
# itself: so every problem has its place in the overlay's own file.

MAX_BASES = 8
"""Most overlays on each other."""


def _merged(path: Path, overlays: tuple[Path, ...] = ()) -> Document:
    """A priority file, with what it takes from its base where it is an overlay. overlays: those that led here."""
    document = read_as(Kind.PRIORITIES, path)
    if document.data.get("extends") is None:
        return document
    base = _merged(_base(document, overlays), (*overlays, path))
    validated(Priorities, base, check=_check)
    own = {key: value for key, value in document.data.items() if key != "extends"}
    taken = {key: value for key, value in base.data.items() if key not in ("name", "description")}
    problems = list(document.problems)
    entries, theirs = own.get("levels"), base.data["levels"]
    if isinstance(entries, list) and isinstance(theirs, list):
        # Levels that are only a name are those of the base.
        by_name = {str(level["name"]): level for level in theirs if isinstance(level, dict)}
        for index, entry in enumerate(entries):
            if isinstance(entry, str) and entry not in by_name:
                kind = f"level of {base.data['name']}"
                problems.append(unknown_name(document, ("levels", index), kind, entry, by_name))
        own["levels"] = [by_name.get(entry) if isinstance(entry, str) else entry for entry in entries]
    return replace(document, data=taken | own, problems=tuple(problems))


def _base(document: Document, overlays: tuple[Path, ...]) -> Path:
    """The file that an overlay extends. Raises ConfigError: there is none, or it leads back, or through too many."""
    named, here = str(document.data["extends"]), ("extends",)
    is_path = named.endswith((".yaml", ".yml"))
    beside = document.path.parent / (named if is_path else f"{named}.yaml")
    try:
        base = find(Kind.PRIORITIES, beside if is_path or is_file(beside) else named)
    except UsageError as error:
        (problem,) = error.problems
        place = document.problem(here, problem.what)
        found = problem.found or problem.where
        raise ConfigError.from_problems([replace(problem, where=place.where, found=found, line=place.line)]) from None
    way = (*overlays, document.path, base)
    names, step = " -> ".join(path.stem for path in way), "Extend another file, or give this one a name of its own"
    if base.resolve() in (path.resolve() for path in way[:-1]):
        problem = document.problem(here, "a priority file that extends itself", found=names, next_step=step)
        raise ConfigError.from_problems([problem])
    if len(way) > MAX_BASES + 1:
        problem = document.problem(here, "too many overlays on each other", found=names, allowed=f"{MAX_BASES}")
        raise ConfigError.from_problems([problem])
    return base


def _check(priorities: Priorities, document: Document) -> list[Problem]:
    problems = []
    first: dict[str, int] = {}
    for index, level in enumerate(priorities.levels):
        earlier = first.setdefault(level.name, index)
        if earlier != index:
            here: KeyPath = ("levels", index, "name")
            found = f"{level.name!r}, also of level {earlier + 1}"
            problems.append(document.problem(here, "duplicate level name", found=found))
        is_soft = index == len(priorities.levels) - 1 and any(isinstance(task, PostureTask) for task in level.tasks)
        for place, task in enumerate(level.tasks):
            if isinstance(task, Phased) and task.when is not None:
                here = ("levels", index, "tasks", place, "when")
                if not is_soft:
                    allowed = "in the last level, beside a posture: what a strict level takes comes and goes at once"
                    problems.append(document.problem(here, "a phase of support in a strict level", allowed=allowed))
                if isinstance(task, CentreOfMassTask) and task.mode == "support":
                    step = "Leave it out: an inequality has no weight that could change smoothly"
                    problems.append(document.problem(here, "a phase of support of a support task", next_step=step))
            if isinstance(task, AxisTask):
                for key, other in (("lowered", task.lowered), ("bent", task.bent)):
                    if other is not None and _opposite(task.direction, other):
                        at, allowed = ("levels", index, "tasks", place, key), "less than half a turn away"
                        problems.append(document.problem(at, "the opposite of direction", allowed=allowed))
                if task.lowered is not None and task.bent is not None:
                    at = ("levels", index, "tasks", place, "bent")
                    problems.append(document.problem(at, "two ways of one axis", allowed="lowered or bent"))
            if isinstance(task, CarriedTask):
                here = ("levels", index, "tasks", place, "by")
                unknown = [name for name in task.by if name not in SENSORS]
                problems += [unknown_name(document, (*here, name), "sensor", name, SENSORS) for name in unknown]
                if not unknown and "head" not in task.by:
                    found, step = listed(task.by), "Add head"
                    problems.append(document.problem(here, "the head has no share", found=found, next_step=step))
    by_place = {name for *_, task in priorities.tasks() if isinstance(task, PositionTask) for name in task.of}
    if priorities.strategies and (missing := {"l_hand", "r_hand", "pelvis"} - by_place):
        found, step = f"no position task of {listed(sorted(missing))}", "Add it, as hands_first has it"
        problems.append(document.problem(("strategies",), "strategies need tasks", found=found, next_step=step))
    if priorities.levels and not any(level.tasks for level in priorities.levels):
        problems.append(document.problem(("levels",), "no level has a task", allowed="at least one task"))
    return problems


def _opposite(one: Direction, other: Direction) -> bool:
    """Whether two directions, of any length, point apart so that there is no shortest way from one to the other."""
    (a, b, c), (x, y, z) = one, other
    lengths = sqrt(a * a + b * b + c * c) * sqrt(x * x + y * y + z * z)
    return a * x + b * y + c * z < -(1.0 - 1e-6) * lengths


# Whether a priority file is for the body that it was given to: a robot's file moves no human, nor the other way.

FOR_HUMANS = "human, human_clear, paper"
"""The shipped priority files of the human's stage."""


def check_for_human(priorities: Priorities, name: str) -> None:
    """Raise ConfigError for tasks that name no sensor of any performer, and would have no effect.

    name: of the priority file, or its path.
    """
    wrong = [
        (priorities.levels[level].name, task.of)
        for level, _, task in priorities.tasks()
        if isinstance(task, PositionTask | LimbTask | OrientationTask | LookAtTask)
        and not task.optional
        and not set(task.of) & set(SENSORS)
    ]
    if wrong:
        raise ConfigError(
            f"tasks name no sensor of a performer, in {listed(dict.fromkeys(level for level, _ in wrong))}",
            where=str(find(Kind.PRIORITIES, name)),
            found=listed(dict.fromkeys(chain.from_iterable(of for _, of in wrong))),
            allowed=listed(SENSORS),
            next_step=f"Name sensors, or take a file for the human ({FOR_HUMANS})",
        )


@contextmanager
def naming_file(name: str, *, robot: str) -> Iterator[None]:
    """What a robot refuses in a priority file is said with the file, and with what to do. name: of it, or its path."""
    try:
        yield
    except ConfigError as error:
        where = str(find(Kind.PRIORITIES, name))
        own = f"{robot} brings its own (those of the human are {FOR_HUMANS})"
        step = f"Name frames of {robot}, or leave its priorities out: {own}"
        problems = [
            problem if problem.where else replace(problem, where=where, next_step=f"{problem.next_step} {step}".strip())
            for problem in error.problems
        ]
        raise ConfigError.from_problems(problems) from error
