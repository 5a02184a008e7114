"""Models of the sections of a robot profile, one for each kind of entry. SI units; frames as each docstring says."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from retarget.schema import (
    Integer,
    Interval,
    Name,
    NotNegative,
    Number,
    Positive,
    Quaternion,
    Schema,
    Share,
    Text,
    Vector3,
)
from retarget.solid_shapes import SolidShape

ServoId = Annotated[Integer, Field(ge=0, le=252)]
Point2 = tuple[Number, Number]
Register = Annotated[Integer, Field(ge=0, le=16383)]


def _one_or_more(value: Any) -> Any:
    """`name` means the same as `[name]`."""
    return (value,) if isinstance(value, str) else value


def _chain(value: Any) -> Any:
    return (
        [_one_or_more(point) for point in value]
        if isinstance(value, Sequence) and not isinstance(value, str)
        else value
    )


Names = Annotated[tuple[Name, ...], BeforeValidator(_one_or_more), Field(min_length=1, max_length=8)]
"""One name, or several whose mean point is meant."""


class Frame(Schema):
    """A named point on a link. pos (3,) m and quat wxyz in the link's frame; sole frames have z up, x to the toes."""

    link: Name
    pos: Vector3 = (0.0, 0.0, 0.0)
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Gains(Schema):
    """Position gains as register values (e-Manual: Position P, I, D Gain); absent: the servo keeps its own."""

    p: Register | None = None
    i: Register | None = None
    d: Register | None = None


class Servo(Schema):
    """The servo of one joint.

    shaft tick = zero_tick + direction * gear * q / (angle of one tick); gear: shaft turns per joint turn. limits rad,
    max_velocity rad/s and max_acceleration rad/s^2 of the joint. current: most it may draw, A.
    """

    id: ServoId
    model: Name
    bus: Name
    direction: Literal[1, -1]
    zero_tick: Annotated[Integer, Field(ge=0, le=4095)]
    gear: Positive = 1.0
    limits: Interval
    max_velocity: Positive
    max_acceleration: Positive
    gains: Gains = Gains()
    current: Positive | None = None


class Bus(Schema):
    """A line of servos. ids: every device expected to answer on it, servos and others."""

    port: Text
    baud: Annotated[Integer, Field(ge=9600, le=10_000_000)]
    protocol: Literal[1, 2]
    ids: Annotated[tuple[ServoId, ...], Field(min_length=1, max_length=253)]


class Shape(SolidShape):
    """Exactly one of the shapes; `geom` takes over the named geom of the body file."""

    geom: Name | None = None


def _one_shape(shape: Shape) -> Shape:
    if len(shape.model_fields_set) != 1:
        raise PydanticCustomError(
            "shape", "a shape needs exactly one of: segment, capsule, cylinder, sphere, box, geom"
        )
    return shape


AnyShape = Annotated[Shape, AfterValidator(_one_shape)]


class Observer(Schema):
    """A collision observer on a link. influence: distance at which it acts; margin: distance it keeps. Both m."""

    link: Name
    shape: AnyShape
    influence: Positive
    margin: NotNegative


class IgnorePair(Schema):
    """Two links that are never checked against each other, and why."""

    pair: tuple[Name, Name]
    reason: Text


class Foot(Schema):
    """A sole. polygon: its outline in the x-y plane of `frame`, m, convex, counter-clockwise seen from above."""

    frame: Name
    polygon: Annotated[tuple[Point2, ...], Field(min_length=3, max_length=16)]


Posture = dict[Name, Number]
"""Joint -> rad; joints that are not named are 0."""


class Postures(Schema):
    """neutral: pairs touching here are dropped; stand: start; rest: parked; attractor: the paper's predefined pose."""

    neutral: Posture
    stand: Posture
    rest: Posture
    attractor: Posture


class Landmark(Schema):
    """How one robot frame follows the human, limb by limb.

    asked = mean of `anchor` + (mean of `follows` - mean of `from`) * robot_length / (human length) + offset,
    all in the heading frame. `follows` and `from` are human joints, `anchor` robot frames. The human length is the sum
    of the rest-pose distances along the chain `human_length`, whose points are joints or means of joints.
    robot_length, m: how far `frame` gets from `anchor` when the human's limb is stretched. offset, m: from the robot's
    counterpart of the human point to `frame`.
    """

    frame: Name
    follows: Names
    measured_from: Names = Field(alias="from")
    anchor: Names
    robot_length: Positive
    human_length: Annotated[tuple[Names, ...], BeforeValidator(_chain), Field(min_length=2, max_length=10)]
    offset: Vector3 = (0.0, 0.0, 0.0)


class SpeedCaps(Schema):
    """Shares (0, 1] of each servo's max_velocity: while following, and while approaching a posture (start, rest)."""

    follow: Share = 1.0
    approach: Share = 0.2


class Safety(Schema):
    """Bounds of operation; beyond one of them the guard stops the robot. rate_hz: the tick of the robot, Hz.

    freshness: oldest state of a servo that is acted on, and most that a goal may take from the start of its tick, s.
    speed_caps: what the stages and the gate keep. temperature_c: hottest servo, degrees Celsius. voltage: lowest and
    highest supply, V. following_error: largest distance between goal and present position, rad.
    """

    rate_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=10, le=1000)]
    freshness: Positive
    speed_caps: SpeedCaps = SpeedCaps()
    temperature_c: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=100)]
    voltage: Interval
    following_error: Positive
