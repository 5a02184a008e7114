"""Models of the sections of a robot profile, one for each kind of entry. SI units; frames as each docstring says."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from hardware.bus_spec import MAX_WATCHDOG
from hardware.servo import MULTI_TURN_REACH
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

MAX_HOMING_OFFSET = 1_044_479
"""Of register 20, ticks either way (e-Manual)."""
ServoId = Annotated[Integer, Field(ge=0, le=252)]
Point2 = tuple[Number, Number]
Register = Annotated[Integer, Field(ge=0, le=16383)]
Tick = Annotated[Integer, Field(ge=-MULTI_TURN_REACH, le=MULTI_TURN_REACH)]
Row = tuple[Number, Number]


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
    """Gains as register values (e-Manual: Position P, I, D Gain, Feedforward 1st and 2nd Gain; Protocol 1.0: P, I, D
    Gain); absent: the servo keeps its own."""

    p: Register | None = None
    i: Register | None = None
    d: Register | None = None
    feedforward_1: Register | None = None
    feedforward_2: Register | None = None


class Servo(Schema):
    """The servo of one joint.

    shaft tick = zero_tick + direction * gear * q / (angle of one tick); gear: shaft turns per joint turn. limits rad,
    max_velocity rad/s and max_acceleration rad/s^2 of the joint. current: most it may draw, A. mode: position (within
    one turn), extended_position (many turns), current_based_position (many turns, with its current bounded).
    homing_offset: what the servo's own register holds, ticks; zero_tick is what it reports, so this is part of it.
    Of a joint in one of the `couplings` the servo is one of the two that turn it; limits and speeds are the joint's.
    """

    id: ServoId
    model: Name
    bus: Name
    direction: Literal[1, -1]
    zero_tick: Tick
    gear: Positive = 1.0
    limits: Interval
    max_velocity: Positive
    max_acceleration: Positive
    gains: Gains = Gains()
    current: Positive | None = None
    mode: Literal["position", "extended_position", "current_based_position"] = "position"
    homing_offset: Annotated[Integer, Field(ge=-MAX_HOMING_OFFSET, le=MAX_HOMING_OFFSET)] = 0


class Coupling(Schema):
    """Two joints that their two servos turn together: angles of `joints` = matrix @ shaft angles, rad.

    The shaft angle of a servo is direction * (tick - zero_tick) * (angle of one tick), and its gear is 1. Rows are the
    two joints, columns their servos, both in the order of `joints`. A waist whose roll is a quarter of the difference
    and whose yaw a quarter of the sum: {joints: [roll, yaw], matrix: [[-0.25, 0.25], [0.25, 0.25]]}.
    """

    joints: tuple[Name, Name]
    matrix: tuple[Row, Row]


class Power(Schema):
    """A switch for the servos' power: device `id` of the bus gets `value` at address `register` (one byte) before
    anything else, and the servos have wait_s, s, to start."""

    id: ServoId
    register_: Annotated[Integer, Field(ge=0, le=65535, alias="register")]
    value: Annotated[Integer, Field(ge=0, le=255)]
    wait_s: Annotated[NotNegative, Field(le=10)] = 0.5


class Bus(Schema):
    """A line of servos. ids: every device expected to answer on it, servos and others.

    watchdog_s: longest silence after which the servos stop by themselves, a multiple of 0.02 s, 0: never; absent: 0.1,
    and 0 with Protocol 1.0, whose servos have none. return_delay_us: pause before an answer, even.
    """

    port: Text
    baud: Integer
    protocol: Literal[1, 2]
    ids: Annotated[tuple[ServoId, ...], Field(min_length=1, max_length=253)]
    watchdog_s: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=MAX_WATCHDOG)] | None = None
    return_delay_us: Annotated[Integer, Field(ge=0, le=508, multiple_of=2)] = 0
    power: Power | None = None


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
    """Shares (0, 1] of each servo's max_velocity: while following, and while approaching a posture (start, rest).
    warm: share of the speed of following that is left while a servo is too warm or draws too much."""

    follow: Share = 1.0
    approach: Share = 0.2
    warm: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.25, le=1)] = 0.5


class Safety(Schema):
    """Bounds of operation; beyond one of them the guard stops the robot. rate_hz: the tick of the robot, Hz.

    freshness: oldest state of a servo that is acted on, and most that a goal may take from the start of its tick, s.
    speed_caps: what the stages and the gate keep. temperature_c: hottest servo, degrees Celsius. voltage: lowest and
    highest supply, V. following_error: largest distance between goal and present position, rad;
    following_error_lasting: a smaller one that stops only if it lasts following_error_s, s. current_a: most that a
    servo may draw for current_s, s. The keys that end in _warn are levels at which somebody is told, each
    within that of its stop; temperature_warn_c, by default 5 degrees less than temperature_c, and current_warn_a slow
    the robot too. What is left out is not watched.
    """

    rate_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=10, le=1000)]
    freshness: Positive
    freshness_warn: Positive | None = None
    speed_caps: SpeedCaps = SpeedCaps()
    temperature_c: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=100)]
    temperature_warn_c: Positive | None = None
    voltage: Interval
    voltage_warn: Interval | None = None
    following_error: Positive
    following_error_lasting: Positive | None = None
    following_error_s: Annotated[Positive, Field(le=10)] = 0.2
    following_error_warn: Positive | None = None
    current_a: Positive | None = None
    current_warn_a: Positive | None = None
    current_s: Annotated[Positive, Field(le=60)] = 1.0
