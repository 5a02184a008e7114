"""A priority file: the ordered levels of one stage, each a list of tasks. `configs/priorities/*.yaml`.

`of` names sensors in `reconstruct`, landmarks or frames of the robot in `retarget`. Names that are absent in a frame
take no part; names that the body lacks are refused unless the task is `optional`.
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


def _per_row(value: Any) -> Any:
    return (value,) * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


def _not_all_zero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise PydanticCustomError("zero", "all three are zero")
    return value


RowWeights = Annotated[
    tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(_per_row), AfterValidator(_not_all_zero)
]
"""Weights of rows x, y and z, or one number for all; a row of weight 0 does not exist."""
Direction = Annotated[Vector3, AfterValidator(_not_all_zero)]  # of any length
Against = Literal["self", "scene", "all"]
Names = Annotated[tuple[Name, ...], BeforeValidator(one_or_more), Field(min_length=1, max_length=64)]


class _Weighed(Schema):
    """Keys of every task with rows of its own."""

    gain: Share = 1.0
    """Share of the error that is corrected per iteration."""
    max_error: Positive | None = None
    """[m or rad] Largest corrected error per iteration; absent: the solver's own."""
    optional: Switch = False
    """Names in `of` may be missing."""


Phase = Literal["double", "left", "right", "flight"]
"""Phase of support: both feet, the left or the right one alone, or none."""


class Phased(_Weighed):
    """Keys of tasks that may act in some phases of support only."""

    when: Annotated[tuple[Phase, ...], BeforeValidator(one_or_more), Field(min_length=1)] | None = None
    """Phases of a human's support in which it acts, one or a list; absent: always. Only in the last level, beside a
    posture."""


class PositionTask(Phased):
    """Points of the body go to their desired positions. Rows are the world's x, y, z."""

    type: Literal["position"]
    """Kind of task."""
    of: Names
    """Sensors (of a human); landmarks or frames (of a robot). One name or a list."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row."""
    per: Literal["metre", "length"] = "metre"
    """`length`: the weight is [m], for an error as long as the landmark's `robot_length`."""


class LimbTask(Phased):
    """Lines from anchors of the robot's profile to its landmarks take the desired length and direction in the world, so
    arms do not pull the trunk along. Rows are the world's x, y, z."""

    type: Literal["limb"]
    """Kind of task."""
    of: Names
    """Landmarks with one anchor; or `neck`, the line to it from the pelvis."""
    weight: Positive = 1.0
    """[m/rad] Position error that counts as much as one radian."""


class OrientationTask(Phased):
    """Frames of the body take their desired orientations. Rows are rotations about the world's x, y, z."""

    type: Literal["orientation"]
    """Kind of task."""
    of: Names
    """As in a position task."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row."""


class AxisTask(Phased):
    """`axis` of each frame points along `direction` in the heading frame (z up): soles flat, trunk upright."""

    type: Literal["axis"]
    """Kind of task."""
    of: Names
    """As in a position task."""
    axis: Direction
    """In the frame named in `of`."""
    direction: Direction
    """In the heading frame."""
    lowered: Direction | None = None
    """Replaces `direction` as the head of a human comes down."""
    bent: Direction | None = None
    """Replaces it as a human bends over on the way down."""
    weight: Positive = 1.0
    """Weight of both rows."""


class HeadingTask(Phased):
    """The left axis of each frame points to the left of the heading estimate."""

    type: Literal["heading"]
    """Kind of task."""
    of: Names
    """As in a position task."""
    weight: Positive = 1.0
    """Weight of its rows."""


class LookAtTask(Phased):
    """`axis` of each frame aims at its desired point."""

    type: Literal["look_at"]
    """Kind of task."""
    of: Names
    """As in a position task."""
    axis: Direction = (1.0, 0.0, 0.0)
    """In the frame named in `of`."""
    weight: Positive = 1.0
    """Weight of both rows."""


class CentreOfMassTask(Phased):
    """The centre of mass is kept over the root, over the feet, or inside their support polygon."""

    type: Literal["centre_of_mass"]
    """Kind of task."""
    mode: Literal["over_root", "over_feet", "support"]
    """Inside the support polygon by inequalities; the paper has over_root."""
    weight: RowWeights = (1.0, 1.0, 0.0)
    """Weights of x, y, z."""
    forward: Number = 0.0
    """[m] Offset along the heading, of over_feet."""
    margin: NotNegative = 0.0
    """[m] Distance inside the edge, of support."""
    moving: Annotated[Positive, Field(le=1.0)] | None = None
    """Share of the polygon for the capture point, and a little more for the zero-moment point, of support; absent: as
    at rest."""
    fade_speed: Positive | None = None
    """[m/s] The weight falls as 1 / (1 + (v / fade_speed)^4) with the speed v of the body; absent: never."""


class StrengthTask(Schema):
    """Joints of the legs carry no more than their servos can for long (see `retarget.robot.balance`)."""

    type: Literal["strength"]
    """Kind of task."""
    share: Annotated[Positive, Field(le=1.0)]
    """Sustained share of each servo's stall torque; more only if `stand` alone needs it."""


class PostureTask(_Weighed):
    """Joints are drawn to a posture of the body."""

    type: Literal["posture"]
    """Kind of task."""
    towards: Name = "attractor"
    """Name of the posture."""
    lowered: Name | None = None
    """Name of the posture that replaces it as the head comes down."""
    stiffness: Annotated[dict[Name, NotNegative], Field(max_length=300, default_factory=lambda: {"default": 1.0})]
    """Weight by joint or group of joints; `default` is that of all others, and of a free root 0."""
    settle: NotNegative = 0.0
    """[s] Time constant with which free joints approach it; 0: at once."""


class CarriedTask(Phased):
    """The root of a human follows the sensors that carry it, and leaves their path only slowly, so that balance does
    not move the whole body at once."""

    type: Literal["carried"]
    """Kind of task."""
    by: Annotated[dict[Name, Positive], Field(max_length=32)]
    """Share of each sensor, in proportion. The head always carries, the others together less while they fly past it."""
    settle: Positive
    """[s] Time constant with which the root leaves that path."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row."""


class ReactiveTask(Schema):
    """Observers in contact push their part out."""

    type: Literal["reactive"]
    """Kind of task."""
    of: Names | None = None
    """Observers; absent: all."""
    against: Against = "all"
    """Each other, the scene, or both."""
    speed: Positive = 0.1
    """[m/s] Largest speed of the push."""


class PreventiveTask(Schema):
    """Observers inside influence damp the approach of their part."""

    type: Literal["preventive"]
    """Kind of task."""
    of: Names | None = None
    """Observers; absent: all."""
    against: Against = "all"
    """Each other, the scene, or both."""
    speed: Positive = 0.5
    """[m/s] With `activation: all`: speed of approach at the influence distance; it falls to 0 at the margin."""


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


class HeadingSettings(Schema):
    """Each hint is a vector on the ground; their weighted sum points forward. The defaults are those of `paper`."""

    pairs: dict[Name, NotNegative] = Field(default_factory=lambda: {"ankle": 0.5, "wrist": 1.0}, max_length=16)
    """[1/m] Weight of the line between a left and a right sensor, by part."""
    hands: NotNegative = 1.0
    """[1/m] Weight of the distance of the hands ahead of the ankles."""
    learned: NotNegative = 0.0
    """Weight of the heading learned from recorded hands and heads (`retarget/human/heading.yaml`)."""
    stance: Annotated[NotNegative, Field(le=1.0)] = 0.0
    """Share of the hints of hands, head and feet that is averaged while both feet are planted."""
    velocity: NotNegative = 0.5
    """[s/m] Weight of the velocity of the head."""
    walking: Annotated[tuple[NotNegative, NotNegative], AfterValidator(ascending)] = (0.5, 1.0)
    """[m/s] Speeds of the head at which its velocity begins to count, and counts wholly."""
    facing: dict[Name, NotNegative] = Field(
        default_factory=lambda: {"head": 1.0, "chest": 2.0, "pelvis": 2.0}, max_length=16
    )
    """Weight of the forward axis of a sensor with an orientation."""
    settle: Positive = 0.2
    """[s] Time constant of the low-pass."""
    velocity_settle: Positive = 0.05
    """[s] Time constant of the low-pass of the head's velocity."""


Steps = Literal["planted", "walk", "follow"]
"""Behaviour of a robot's feet when its performer walks."""
Legs = Literal["free"]
"""Nothing carries the robot, and pelvis and feet are where the performer's are."""


class ObserverSettings(Schema):
    """Observers of the human, and margins of all observers."""

    human: Literal["none", "lines", "lines_and_head", "capsules"] = "none"
    """Observers of a human: none, lines along the limbs, those and a ball for the head, or its own capsules."""
    influence: Positive = 0.08
    """[m] Influence distance of the human's observers."""
    margin: NotNegative | None = None
    """[m] Margin of all observers; absent: each its own."""
    obstacle_margin: NotNegative | None = None
    """[m] Margin of all obstacles; absent: each its own."""


class DeflectionCompensationSettings(Schema):
    """Goals that hold a robot on its soles in its posture although its servos deflect."""

    settle: Annotated[Positive, Field(le=1.0)] = 0.02
    """[s] Time constant with which goals follow the load."""
    speed_margin: NotNegative = 0.25
    """Share by which the load in motion exceeds that of a crouch; it limits planned speeds to those of motors under
    that load."""
    soft_limits: Annotated[NotNegative, Field(le=0.5)] = 0.05
    """[rad] Distance of joints that carry the robot from the ends of their range."""
    tracking_delay: Annotated[NotNegative, Field(le=1.0)] = 0.03
    """[s] Allowed delay of the bus: at planned speed the guard accepts a servo that lags by so much more."""


class Level(Schema):
    """Tasks of equal rank."""

    name: Text
    """For messages and reports."""
    tasks: Annotated[tuple[Task, ...], Field(max_length=32)]
    """Without tasks the level keeps its place and has no effect."""


class Priorities(Schema):
    """The levels of a stage."""

    name: Name
    """Name by which it is chosen."""
    description: Text
    """One line for lists."""
    extends: Text | None = None
    """The base of an overlay: its name (a file beside this one comes first), or its path relative to this file. Keys of
    the overlay replace those of its base whole."""
    iterations: Annotated[Integer, Field(ge=1, le=100)] = 2
    """Most iterations per frame (the paper's N_IK)."""
    activation: Literal["closest", "all"] = "closest"
    """Preventive observers that add their row: the closest per obstacle (paper), or all."""
    observers: ObserverSettings = ObserverSettings()
    """Observers and margins."""
    heading: HeadingSettings = HeadingSettings()
    """Weights of the hints of a performer's heading."""
    deflection_compensation: DeflectionCompensationSettings | None = None
    """Goals for a robot with mass on its own soles."""
    steps: Steps | None = None
    """Behaviour of the feet when the performer walks: stay; walk as well; or, on a robot that hangs, copy the
    performer's. Absent: stay, or copy if the robot hangs."""
    strategies: Annotated[tuple[Literal["trunk", "crouch"], ...], Field(max_length=2)] = ()
    """Means by which a robot on its soles reaches farther than its arms (see `retarget.robot.strategies`)."""
    lag_compensation: Annotated[NotNegative, Field(le=2.0)] = 0.0
    """Share of the lag of their servos by which free limbs (arms and head, all of a robot that hangs) aim ahead."""
    levels: Annotated[tuple[Level, ...], Field(min_length=1, max_length=32)]
    """Highest first: a level is never traded for a lower one. In an overlay an entry that is only a name is that level
    of its base, an entry with tasks replaces or adds a level, and other levels are dropped."""

    def tasks(self) -> Iterator[tuple[int, int, Task]]:
        """All tasks with their places: (level, index in the level, task), from 0."""
        for level, entry in enumerate(self.levels):
            for index, task in enumerate(entry.tasks):
                yield level, index, task


def load_priorities(path_or_name: str | Path) -> Priorities:
    """A priority file by name or path. Raises UsageError, ConfigError with all its problems."""
    return validated(Priorities, _merged(find(Kind.PRIORITIES, path_or_name)), check=_check)


def self_contained(path: Path) -> bytes:
    """The content of a priority file, an overlay written out with its bases. Raises ConfigError, OSError."""
    if scan(read_text(path), path).data.get("extends") is None:
        return path.read_bytes()
    return json.dumps(_merged(path).data, indent=1, ensure_ascii=False).encode()


# Levels of an overlay keep their places in a merge, and a base is valid by itself: every problem has its place in the
# overlay's own file.

MAX_BASES = 8  # most overlays on each other


def _merged(path: Path, overlays: tuple[Path, ...] = ()) -> Document:
    """A priority file, completed from its base. overlays: those that led here."""
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
        by_name = {str(level["name"]): level for level in theirs if isinstance(level, dict)}
        for index, entry in enumerate(entries):
            if isinstance(entry, str) and entry not in by_name:
                kind = f"level of {base.data['name']}"
                problems.append(unknown_name(document, ("levels", index), kind, entry, by_name))
        own["levels"] = [by_name.get(entry) if isinstance(entry, str) else entry for entry in entries]
    return replace(document, data=taken | own, problems=tuple(problems))


def _base(document: Document, overlays: tuple[Path, ...]) -> Path:
    """The file that an overlay extends. Raises ConfigError if there is none, in a circle, or beyond MAX_BASES."""
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
    files = (*overlays, document.path, base)
    names, step = " -> ".join(path.stem for path in files), "Extend another file, or give this one a name of its own"
    if base.resolve() in (path.resolve() for path in files[:-1]):
        problem = document.problem(here, "a priority file that extends itself", found=names, next_step=step)
        raise ConfigError.from_problems([problem])
    if len(files) > MAX_BASES + 1:
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
    """True if two directions have no shortest rotation between them."""
    (a, b, c), (x, y, z) = one, other
    lengths = sqrt(a * a + b * b + c * c) * sqrt(x * x + y * y + z * z)
    return a * x + b * y + c * z < -(1.0 - 1e-6) * lengths


FOR_HUMANS = "human, human_clear, paper"  # the shipped priority files of the human's stage


def check_for_human(priorities: Priorities, name: str) -> None:
    """Raise ConfigError for tasks that name no sensor. name: of the file, or its path."""
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
    """Add the file and the next step to errors of a robot. name: of the file, or its path."""
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
