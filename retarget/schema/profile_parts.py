"""Models of the sections of a robot profile. SI units."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from hardware.bus import MAX_WATCHDOG, BusSpec, PowerSwitch
from hardware.guard_state import GuardLimits
from hardware.imu import BNO08X_BAUD, ImuKind, ImuSpec
from hardware.servo import (
    DEFAULT_P_GAIN,
    MULTI_TURN_REACH,
    Layout,
    ServoCoupling,
    ServoGains,
    ServoMode,
    ServoModel,
    ServoSpec,
    ServoStiffness,
    find_model,
    p_gain,
)
from retarget.schema.shapes import SolidShape
from retarget.schema.strict_models import (
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
    one_or_more,
)

DEFAULT_WATCHDOG = 0.1  # [s]
WARN_BEFORE_C = 5.0
"""[degrees Celsius] Default distance of the warning from the stop."""
MAX_HOMING_OFFSET = 1_044_479
"""[ticks] Largest value of register 20 (e-Manual)."""
ServoId = Annotated[Integer, Field(ge=0, le=252)]
Point2 = tuple[Number, Number]
Register = Annotated[Integer, Field(ge=0, le=16383)]
Tick = Annotated[Integer, Field(ge=-MULTI_TURN_REACH, le=MULTI_TURN_REACH)]
Row = tuple[Number, Number]


Names = Annotated[tuple[Name, ...], BeforeValidator(one_or_more), Field(min_length=1, max_length=8)]
"""One name, or several whose mean point counts."""


class ProfileFrame(Schema):
    """A named point on a link. Sole frames have z up, x to the toes."""

    link: Name
    """Link of the body file that carries it."""
    pos: Vector3 = (0.0, 0.0, 0.0)
    """[m] Position in the link's frame."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation in the link's frame, wxyz."""


class Gains(Schema):
    """Gains as register values (e-Manual: Position P, I, D Gain, Feedforward 1st and 2nd Gain; older layout: P, I, D
    Gain); absent: the servo keeps its own."""

    p: Register | None = None
    """Proportional."""
    i: Register | None = None
    """Integral."""
    d: Register | None = None
    """Derivative."""
    feedforward_1: Register | None = None
    """Velocity feedforward."""
    feedforward_2: Register | None = None
    """Acceleration feedforward."""


class Servo(Schema):
    """The servo of one joint. shaft tick = zero_tick + direction * gear * q / (angle of one tick). In `couplings` two
    servos turn two joints, and limits and speeds are the joint's."""

    id: ServoId
    """Id on its bus."""
    model: Name
    """Model by name (docs/dynamixel.md lists them)."""
    bus: Name
    """Name of its bus."""
    direction: Literal[1, -1]
    """1: ticks rise with the joint's angle, -1: they fall."""
    zero_tick: Tick
    """[tick] Reading at joint angle 0. A calibration replaces it."""
    gear: Positive = 1.0
    """Turns of the shaft per turn of the joint."""
    limits: Interval
    """[rad] Lowest and highest angle of the joint."""
    max_velocity: Positive
    """[rad/s] Greatest speed of the joint."""
    max_acceleration: Positive
    """[rad/s^2] Greatest acceleration of the joint."""
    gains: Gains = Gains()
    """Gains of the position loop."""
    current: Positive | None = None
    """[A] Current limit; absent: the servo's own."""
    mode: Literal["position", "extended_position", "current_based_position"] = "position"
    """Within one turn; many turns; many turns with the current bounded by `current`."""
    homing_offset: Annotated[Integer, Field(ge=-MAX_HOMING_OFFSET, le=MAX_HOMING_OFFSET)] = 0
    """[tick] Value of the servo's own register, a part of zero_tick."""


class Stiffness(Schema):
    """Torque per angle of deflection from the goal, by servo model."""

    nominal: Positive
    """[N m/rad] Value for planning and physics."""
    range_: Annotated[Interval, Field(alias="range")]
    """[N m/rad] Bounds of the true value; `retarget servo stiffness` measures it."""
    p: Annotated[Register, Field(ge=1)] | None = None
    """P gain of this stiffness, which is proportional to it; absent: the common gain of its servos."""


class Coupling(Schema):
    """Two joints that their two servos turn together: angles of `joints` = matrix @ shaft angles, rad.

    The shaft angle of a servo is direction * (tick - zero_tick) * (angle of one tick), and its gear is 1. Example:
    {joints: [roll, yaw], matrix: [[-0.25, 0.25], [0.25, 0.25]]}, where roll is a quarter of the difference and yaw of
    the sum.
    """

    joints: tuple[Name, Name]
    """The two joints; each has an entry in `servos`."""
    matrix: tuple[Row, Row]
    """Rows: the two joints; columns: their servos."""


class Power(Schema):
    """A switch for the servos' power, which gets `value` at `register` before anything else."""

    id: ServoId
    """The device on this bus."""
    register_: Annotated[Integer, Field(ge=0, le=65535, alias="register")]
    """Address of one byte."""
    value: Annotated[Integer, Field(ge=0, le=255)]
    """Value to write."""
    wait_s: Annotated[NotNegative, Field(le=10)] = 0.5
    """[s] Starting time of the servos."""

    def switch(self) -> PowerSwitch:
        """Return the switch as the bus layer takes it."""
        return PowerSwitch(id=self.id, register=self.register_, value=self.value, wait=self.wait_s)


class Bus(Schema):
    """A line of servos."""

    port: Text
    """Path of the serial port."""
    baud: Integer
    """[bit/s] One of those of the protocol."""
    protocol: Literal[1, 2]
    """Dynamixel protocol of all servos on it."""
    ids: Annotated[tuple[ServoId, ...], Field(min_length=1, max_length=253)]
    """Every device that is expected to answer."""
    watchdog_s: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=MAX_WATCHDOG)] | None = None
    """[s] Silence after which servos stop by themselves, a multiple of 0.02, 0: never. Absent: 0.1; 0 for protocol 1
    and XL-320, which have none."""
    return_delay_us: Annotated[Integer, Field(ge=0, le=508, multiple_of=2)] = 0
    """[us] Pause before an answer, even."""
    power: Power | None = None
    """Switch for the servos' power."""

    def layout(self, models: Iterable[ServoModel]) -> Layout:
        """The layout of its control tables."""
        older = self.protocol == 1 or any(model.layout is Layout.OLDER for model in models)
        return Layout.OLDER if older else Layout.X

    def spec(self, name: str, layout: Layout) -> BusSpec:
        """The bus for the hardware side; servos of the older layout have no watchdog."""
        watchdog = self.watchdog_s
        if watchdog is None:
            watchdog = DEFAULT_WATCHDOG if layout is Layout.X else 0.0
        return BusSpec(
            name=name,
            port=self.port,
            baud=self.baud,
            protocol=self.protocol,
            ids=self.ids,
            watchdog=watchdog,
            return_delay=self.return_delay_us * 1e-6,
            power=None if self.power is None else self.power.switch(),
        )


class Imu(Schema):
    """The robot's inertial measurement unit."""

    kind: Literal["opencr", "bno08x"]
    """opencr: the board of an OP3, on one of the buses; bno08x: BNO080, BNO085 or BNO086 in UART-RVC mode, on a serial
    port of its own."""
    bus: Name | None = None
    """Name of its bus, for opencr."""
    id: ServoId | None = None
    """Id on that bus, for opencr."""
    port: Text | None = None
    """Path of its serial port, for bno08x."""
    baud: Annotated[Integer, Field(ge=9600, le=3_000_000)] | None = None
    """[bit/s] Speed of that port; absent: 115200."""
    link: Name
    """Link of the body file that carries it."""
    pos: Vector3 = (0.0, 0.0, 0.0)
    """[m] Position in the link's frame."""
    quat: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation in the link's frame, wxyz; `retarget doctor --robot NAME --tilt` checks it."""

    def spec(self) -> ImuSpec:
        """The sensor for the hardware side."""
        return ImuSpec(
            ImuKind(self.kind),
            self.link,
            self.pos,
            self.quat,
            bus=self.bus or "",
            id=self.id or 0,
            port=self.port or "",
            baud=self.baud or BNO08X_BAUD,
        )


class ObserverShape(SolidShape):
    """Exactly one of the shapes."""

    geom: Name | None = None
    """Uses the geom of this name in the body file."""


class Observer(Schema):
    """A collision observer on a link."""

    link: Name
    """Link that carries it."""
    shape: ObserverShape
    """In the frame of the link."""
    influence: Positive
    """[m] Distance at which it acts."""
    margin: NotNegative
    """[m] Distance that it keeps. The larger margin of two parts counts. The gate requires a quarter."""


class IgnorePair(Schema):
    """Two links that are never checked against each other."""

    pair: tuple[Name, Name]
    """Two links."""
    reason: Text
    """For the reader of the file."""


class Foot(Schema):
    """The sole of a foot."""

    frame: Name
    """Its frame, z up and x to the toes."""
    polygon: Annotated[tuple[Point2, ...], Field(min_length=3, max_length=16)]
    """[m] Outline in the x-y plane of the frame, convex, counter-clockwise seen from above."""


Posture = dict[Name, Number]
"""Joint -> rad; other joints are 0."""


class Postures(Schema):
    """The robot's own postures: angle by joint, rad; other joints are 0."""

    neutral: Posture
    """[rad] For homing; pairs of links that touch here are dropped."""
    stand: Posture
    """[rad] A run begins here."""
    rest: Posture
    """[rad] Torque goes off here at the end of a run."""
    attractor: Posture
    """[rad] Free joints are drawn to it."""
    to_rest: Annotated[
        tuple[Literal["neutral", "stand", "rest", "attractor"], ...], Field(min_length=1, max_length=3)
    ] = ("rest",)
    """Keyframes on the way to rest; the last is `rest`. Each takes up to 2 s, of a warm robot up to 8 s."""
    stays_at_rest: bool = False
    """True if the robot lies, sits or leans by itself in `rest` without torque; `retarget check` tries it in
    simulation. Else a robot on its soles ends a run standing, with torque."""


class Landmark(Schema):
    """A robot frame that follows the human.

    target = mean of `anchor` + (mean of `follows` - mean of `from`) * robot_length / (human length) + offset, all in
    the heading frame; a pelvis from both ankles to both hips is as high as the leg that bears the performer is long.
    """

    frame: Name
    """Robot frame that follows."""
    follows: Names
    """Human joints whose mean is followed."""
    measured_from: Names = Field(alias="from")
    """Human joints at whose mean the human limb begins."""
    anchor: Names
    """Robot frames at whose mean the robot's limb begins, carried by the trunk; if the first is the frame of an earlier
    landmark, the limb begins at its target."""
    robot_length: Positive
    """[m] Distance of `frame` from `anchor` when the human's limb is stretched."""
    human_length: Annotated[
        tuple[Names, ...],
        BeforeValidator(lambda value: [*map(one_or_more, value)] if isinstance(value, list | tuple) else value),
        Field(min_length=2, max_length=10),
    ]
    """Chain of human joints, or of means of joints, whose rest-pose distances add up to the human length."""
    offset: Vector3 = (0.0, 0.0, 0.0)
    """[m] From the robot's counterpart of the human point to `frame`, in the heading frame."""


class SpeedCaps(Schema):
    """Shares (0, 1] of each servo's max_velocity."""

    follow: Share = 1.0
    """While following."""
    approach: Share = 0.2
    """While it moves to a posture or to the performer."""
    warm: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.25, le=1)] = 0.5
    """Share of `follow` while a servo is too warm or draws too much."""


class Safety(Schema):
    """Bounds of operation; beyond one of them the guard stops the robot. An absent bound is not checked."""

    rate_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=10, le=1000)]
    """[Hz] Ticks of the robot."""
    freshness: Positive
    """[s] Greatest age of a servo's state, and of a goal since the start of its tick; beyond it: stop."""
    freshness_warn: Positive | None = None
    """[s] From here on: a warning."""
    holds_when_pressed: bool = True
    """True if the robot holds at contact of an arm or the head; false with a load that the body file lacks."""
    speed_caps: SpeedCaps = SpeedCaps()
    """Shares of each servo's max_velocity, kept by stages and gate."""
    temperature_c: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=100)]
    """[degrees Celsius] Hottest servo; beyond it: stop."""
    temperature_warn_c: Positive | None = None
    """[degrees Celsius] From here on: a warning, and the robot goes slower. Absent: 5 below temperature_c."""
    voltage: Interval
    """[V] Lowest and highest supply; outside: stop."""
    voltage_warn: Interval | None = None
    """[V] Outside: a warning."""
    following_error: Positive
    """[rad] Largest error of a position; beyond it: stop."""
    following_error_sustained: Positive | None = None
    """[rad] A smaller one that stops only after following_error_s."""
    following_error_s: Annotated[Positive, Field(le=10)] = 0.2
    """[s] Time after which a sustained error stops or warns."""
    following_error_warn: Positive | None = None
    """[rad] One that gives a warning after following_error_s."""
    planned_lag: Positive | None = None
    """[rad] Greatest lag of a servo in planned motion of a robot with mass; it caps joint speeds. Absent: 0.95 of
    following_error_sustained, or no cap without that."""
    current_a: Positive | None = None
    """[A] Greatest current of a servo for current_s; beyond it: stop."""
    current_warn_a: Positive | None = None
    """[A] From here on: a warning, and the robot goes slower."""
    current_s: Annotated[Positive, Field(le=60)] = 1.0
    """[s] Time after which a current stops or warns."""

    @property
    def warm_c(self) -> float:
        """Temperature of the warning, degrees Celsius."""
        given = self.temperature_warn_c
        return self.temperature_c - WARN_BEFORE_C if given is None else given

    def guard_limits(self) -> GuardLimits:
        """The limits of the guard."""
        return GuardLimits(
            max_age=self.freshness,
            max_pause=self.freshness,
            max_temperature=self.temperature_c,
            voltage=self.voltage,
            following_error=self.following_error,
            sustained_error=_or_any(self.following_error_sustained),
            sustained_time=self.following_error_s,
            max_current=_or_any(self.current_a),
            current_time=self.current_s,
            warn_age=_or_any(self.freshness_warn),
            warn_temperature=self.warm_c,
            warn_voltage=self.voltage_warn or (-inf, inf),
            warn_current=_or_any(self.current_warn_a),
            warn_following_error=_or_any(self.following_error_warn),
            slow_share=self.speed_caps.warm,
        )


def servo_specs(servos: Mapping[str, Servo], couplings: Sequence[Coupling]) -> tuple[ServoSpec, ...]:
    """The servos in the profile's order. Raises HardwareError for an unknown model."""
    coupled = {
        joint: ServoCoupling(coupling.joints, coupling.matrix) for coupling in couplings for joint in coupling.joints
    }
    return tuple(
        ServoSpec(
            joint=joint,
            id=servo.id,
            model=find_model(servo.model),
            bus=servo.bus,
            direction=servo.direction,
            zero_tick=servo.zero_tick,
            lower=servo.limits[0],
            upper=servo.limits[1],
            max_velocity=servo.max_velocity,
            max_acceleration=servo.max_acceleration,
            gear=servo.gear,
            gains=ServoGains(*servo.gains.model_dump().values()),
            current_limit=servo.current,
            mode=ServoMode(servo.mode),
            homing_offset=servo.homing_offset,
            coupling=coupled.get(joint),
        )
        for joint, servo in servos.items()
    )


def with_stiffness(spec: ServoSpec, stiffness: Stiffness | None) -> ServoSpec:
    """The servo with the stiffness of its model in the profile, if any."""
    if stiffness is None:
        return spec
    of = spec if stiffness.p is None else replace(spec, gains=ServoGains(stiffness.p))
    usual = ServoStiffness(stiffness.nominal, *stiffness.range_).scaled(DEFAULT_P_GAIN / p_gain(of))
    return replace(spec, model=replace(spec.model, stiffness=usual))


def safety_facts(safety: Safety) -> dict[str, str]:
    """Conditions of slowing, warnings and stops, in words for the operator."""
    low, high = safety.voltage
    slows = [f"{safety.warm_c:g} degrees Celsius"]
    slows += [] if safety.current_warn_a is None else [f"{safety.current_warn_a:g} A for {safety.current_s:g} s"]
    stops = [f"{safety.temperature_c:g} degrees Celsius", f"outside {low:g} to {high:g} V"]
    stops += [] if safety.current_a is None else [f"{safety.current_a:g} A for {safety.current_s:g} s"]
    stops += [f"{safety.following_error:g} rad from the goal"]
    if safety.following_error_sustained is not None:
        stops += [f"{safety.following_error_sustained:g} rad for {safety.following_error_s:g} s"]
    stops += [f"silent for {safety.freshness:g} s"]
    warns = [] if safety.voltage_warn is None else ["outside {:g} to {:g} V".format(*safety.voltage_warn)]
    if safety.following_error_warn is not None:
        warns += [f"{safety.following_error_warn:g} rad from the goal for {safety.following_error_s:g} s"]
    warns += [] if safety.freshness_warn is None else [f"silent for {safety.freshness_warn:g} s"]
    return {
        "slows": f"to {safety.speed_caps.warm:.0%} at {', '.join(slows)}",
        "warns": ", ".join(warns) or "as it slows",
        "stops": ", ".join(stops),
    }


def _or_any(level: float | None) -> float:
    return inf if level is None else level
