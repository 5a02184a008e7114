"""The tasks of a priority file: what each kind asks, and its keys. What `of` names depends on the stage: sensors for
`reconstruct`, landmarks or frames of the robot for `retarget`.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from retarget.schema import Name, NotNegative, Number, Positive, Schema, Share, Switch, Vector3

__all__ = [
    "AxisTask",
    "CentreOfMassTask",
    "HeadingTask",
    "LookAtTask",
    "OrientationTask",
    "PositionTask",
    "PostureTask",
    "PreventiveTask",
    "ReactiveTask",
    "StrengthTask",
    "Task",
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
    """Keys of every task that has rows of its own."""

    gain: Share = 1.0
    """Share of the error that is corrected per iteration."""
    max_error: Positive | None = None
    """[m or rad] Cap of the error asked per iteration; absent: the solver's own."""
    optional: Switch = False
    """What `of` names may be missing on the body or among the worn sensors."""


class PositionTask(_Weighed):
    """Points of the body go to the positions asked of them. Rows are the world's x, y, z."""

    type: Literal["position"]
    """Of the task."""
    of: Names
    """Sensors (of a human); landmarks or frames (of a robot). One name or a list."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row x, y, z; a row of weight 0 is not there."""


class OrientationTask(_Weighed):
    """Frames of the body take the orientations asked of them. Rows are rotations about the world's x, y, z."""

    type: Literal["orientation"]
    """Of the task."""
    of: Names
    """As of position."""
    weight: RowWeights = (1.0, 1.0, 1.0)
    """One number, or one per row."""


class AxisTask(_Weighed):
    """`axis` of each frame points along `direction` in the heading frame (z up): soles flat, trunk upright."""

    type: Literal["axis"]
    """Of the task."""
    of: Names
    """As of position."""
    axis: Direction
    """In the frame of what `of` names; its length does not matter."""
    direction: Direction
    """In the heading frame, z up."""
    weight: Positive = 1.0
    """Of both rows."""


class HeadingTask(_Weighed):
    """The left axis of each frame points to the left of the heading estimate; bending forward stays free."""

    type: Literal["heading"]
    """Of the task."""
    of: Names
    """As of position."""
    weight: Positive = 1.0
    """Of its rows."""


class LookAtTask(_Weighed):
    """`axis` of each frame aims at the point asked of it."""

    type: Literal["look_at"]
    """Of the task."""
    of: Names
    """As of position."""
    axis: Direction = (1.0, 0.0, 0.0)
    """In the frame of what `of` names."""
    weight: Positive = 1.0
    """Of both rows."""


class CentreOfMassTask(_Weighed):
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
    """Of support: share of the polygon, about its middle, in which capture point and zero-moment point stay; absent: as
    at rest."""
    fade_speed: Positive | None = None
    """[m/s] The weight falls as 1 / (1 + (v / fade_speed)^4) with the speed v of the body; absent: never."""


class StrengthTask(Schema):
    """Joints of the legs carry no more than their servos can for long, of a robot that stands on two soles (see
    `retarget.standing_strength`)."""

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
    """Name of what it becomes as the head comes down; absent: it stays."""
    stiffness: Annotated[dict[Name, NotNegative], Field(max_length=300, default_factory=_uniform)]
    """Weight by joint or group of joints; `default` is that of all others, and of a free root 0."""
    settle: NotNegative = 0.0
    """[s] Time constant with which free joints approach it; 0: at once."""


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
    | OrientationTask
    | AxisTask
    | HeadingTask
    | LookAtTask
    | CentreOfMassTask
    | StrengthTask
    | PostureTask
    | ReactiveTask
    | PreventiveTask,
    Field(discriminator="type"),
]
