"""Servos as data: models by their makers' numbers, servos of a robot by its profile, couplings, and position loops.

A new Dynamixel model is two rows of data from the maker's e-Manual: one of `_MODELS` here (name without the suffix
of the connector, no-load speed in rpm, stall torque in N m at a voltage, A per step of its current register or
None), and one of `dynamixel/tables/models.tsv` (number, firmwares, modes, baud family, layers of the control table,
whose registers are in `registers.tsv`). `FIRST` in `tests/hardware/dynamixel/test_control_table.py` has its first
values, typed from the manual a second time. A row of `motors.yaml` has a published identification;
without it friction is derived.
"""

import math
from dataclasses import dataclass
from enum import Enum, StrEnum

import numpy as np

from hardware.errors import HardwareError

# Two joints that two servos turn together, as data: a differential such as the waist of a humanoid.

MAX_CONDITION = 1e3
"""Worst ratio of the largest to the smallest turn of the joints by one of the servos; beyond it the servos cannot set
both."""


@dataclass(frozen=True)
class ServoCoupling:
    """joint angles of `joints` = `matrix` @ shaft angles of the servos of `joints`, rad, both in this order.

    A shaft angle is `direction * (tick - zero_tick) * model.tick_rad`: at the zero ticks of both servos both joints are
    at 0. Rows of the matrix are joints, columns servos. Both servos carry the same coupling.
    """

    joints: tuple[str, str]
    matrix: tuple[tuple[float, float], tuple[float, float]]

    @property
    def determinant(self) -> float:
        """Determinant of the matrix."""
        (a, b), (c, d) = self.matrix
        return a * d - b * c

    @property
    def inverse(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Inverse of the matrix: shaft angles = inverse @ joint angles, rad. Raises ZeroDivisionError for a singular
        one (see `problems`)."""
        (a, b), (c, d) = self.matrix
        size = self.determinant
        return ((d / size, -b / size), (-c / size, a / size))

    @property
    def condition(self) -> float:
        """Ratio of the singular values of the matrix, at least 1; inf for a singular one."""
        if not 0.0 < abs(self.determinant) < math.inf:
            return math.inf
        return float(np.linalg.cond(self.matrix))

    def problems(self) -> tuple[str, ...]:
        """Return what is wrong with the coupling by itself, one text per finding; empty when valid."""
        found: list[str] = []
        here = f"coupling of {self.joints[0]} and {self.joints[1]}"
        if self.joints[0] == self.joints[1]:
            found.append(f"{here}: needs two different joints")
        if not all(math.isfinite(value) for row in self.matrix for value in row):
            found.append(f"{here}: the matrix has a number that is not finite")
        elif self.condition > MAX_CONDITION:
            found.append(
                f"{here}: the matrix {self.matrix} is singular or nearly so: the servos cannot set both joints"
            )
        return tuple(found)


RPM = 2.0 * math.pi / 60.0  # [rad/s]

MULTI_TURN_REACH = 1_048_575
"""Goal position of a mode with more than one turn: at most this many ticks either way (e-Manual, register 116)."""

HOMING_REACH = 1024
"""Largest homing offset, ticks either way, that a servo honours within one turn (e-Manual, register 20)."""


class ServoMode(StrEnum):
    """How a servo follows its goal position (e-Manual, register 11: 3, 4 and 5)."""

    POSITION = "position"
    EXTENDED_POSITION = "extended_position"
    CURRENT_BASED_POSITION = "current_based_position"

    @property
    def many_turns(self) -> bool:
        """Whether goals may lie beyond one turn."""
        return self is not ServoMode.POSITION


@dataclass(frozen=True)
class ServoStiffness:
    """Torque per angle with which a shaft holds against being turned off its goal, N m/rad. nominal: what physics has
    and goals are planned for; lowest, highest: where the truth may be."""

    nominal: float
    lowest: float
    highest: float

    def scaled(self, factor: float) -> "ServoStiffness":
        """The stiffness with a P gain that is `factor` times as high."""
        return ServoStiffness(factor * self.nominal, factor * self.lowest, factor * self.highest)


class Layout(Enum):
    """How the control table of a servo is laid out, which is apart from the protocol that carries its registers: what
    registers there are, and what gains count. All servos of a bus have one layout."""

    X = "the layout of the X series"
    """X series, and MX with protocol 2.0: operating modes, turns, currents, a bus watchdog, 32-bit positions."""
    OLDER = "the older layout (protocol 1.0, XL-320)"
    """Protocol 1.0 servos and the XL-320: one turn or a wheel, 16-bit positions, a moving speed and a torque limit."""


FULL_PWM = 885.0  # register value of full drive
GAIN_UNIT = 128.0  # position P gain register per unit of gain
DEFAULT_P_GAIN = 800  # XM430 series
DEFAULT_P_GAINS = {Layout.X: DEFAULT_P_GAIN, Layout.OLDER: 32}
"""Default P gain; the default loop of the older layout is taken to be as stiff as that of the X series."""


def full_drive_error(gain: float) -> float:
    """Error in rad of the shaft at which a P `gain` (register counts of the X series, above 0) asks for full drive. It
    acts on encoder ticks of a turn of 4096, whatever the model counts in."""
    return FULL_PWM * GAIN_UNIT / gain * (2.0 * math.pi / 4096.0)


SOFT = DEFAULT_P_GAIN / 150.0
"""[N m/rad] at the default P gain: ToddlerBot's identification of six X models, kp = P / 150 for all of them."""
FIRM = 21.1 / 18.9
"""Ratio of MuJoCo's public OP3 to the e-Manual's numbers of the same servo."""


def estimated_stiffness(torque: float) -> ServoStiffness:
    """Stiffness with the default P gain of a model that stalls at `torque`, N m, by the e-Manual: drive is gain x
    error, and full drive gives the stall torque. The truth is not known: public identifications differ by a factor of
    four, so the range spans them all. `retarget servo stiffness` measures it."""
    nominal = torque / full_drive_error(DEFAULT_P_GAIN)
    return ServoStiffness(nominal, min(nominal, SOFT), max(FIRM * nominal, SOFT))


@dataclass(frozen=True)
class ServoModel:
    """One servo model (e-Manual overview table).

    `ticks` counts over `travel` rad, `centre_tick` is the middle of travel; `no_load_speed` rad/s and `stall_torque` N
    m at `voltage` V; `current_unit` A per register step, None where the servo neither reports nor limits a current;
    `protocols`: those that its firmware can speak; `stiffness`: with the default P gain, at `voltage`. `layout`: of its
    control table with protocol 2.0, see `layout_in`.
    """

    name: str
    ticks: int
    travel: float
    centre_tick: int
    no_load_speed: float
    stall_torque: float
    voltage: float
    current_unit: float | None
    stiffness: ServoStiffness
    protocols: tuple[int, ...] = (2,)
    layout: Layout = Layout.X

    def layout_in(self, protocol: int) -> Layout:
        """The layout of its control table with a protocol; with 1.0 it is the older one for all models."""
        return Layout.OLDER if protocol == 1 else self.layout

    @property
    def has_turns(self) -> bool:
        """Whether it has modes of many turns, with one of its protocols."""
        return any(self.layout_in(protocol) is Layout.X for protocol in self.protocols)

    @property
    def tick_rad(self) -> float:
        """Shaft angle of one tick, rad."""
        return self.travel / self.ticks


def _turn(
    name: str, rpm: float, stall_torque: float, voltage: float, current_unit: float | None, stall: float | None = None
) -> ServoModel:
    """A servo with the X and MX series' encoder: 4096 ticks per turn, 0 rad at 2048. stall: identified stall torque,
    N m at `voltage`, from which its stiffness is taken instead."""
    protocols = (1, 2) if name in ("MX-28", "MX-64") else (2,)
    stiffness = estimated_stiffness(stall_torque if stall is None else stall)
    speed = rpm * RPM
    return ServoModel(name, 4096, 2.0 * math.pi, 2048, speed, stall_torque, voltage, current_unit, stiffness, protocols)


def _part_of_turn(name: str, rpm: float, stall_torque: float, voltage: float, *, protocol: int) -> ServoModel:
    """A servo of the older layout with a potentiometer: 1024 ticks over 300 degrees, 0 rad at 512."""
    stiffness, speed = estimated_stiffness(stall_torque), rpm * RPM
    travel, layout = math.radians(300.0), Layout.OLDER
    return ServoModel(name, 1024, travel, 512, speed, stall_torque, voltage, None, stiffness, (protocol,), layout)


# name, no-load speed [rpm], stall torque [N m], both at [V], current step [A]; identified stall torque [N m]: kt V / R
# of Rhoban bam, model m1
_MODELS = (
    _turn("XM430-W350", 46.0, 4.1, 12.0, 2.69e-3),
    _turn("XM430-W210", 77.0, 3.0, 12.0, 2.69e-3),
    _turn("XL430-W250", 61.0, 1.5, 12.0, None),
    _turn("XC430-W240", 70.0, 1.9, 12.0, None),
    _turn("2XL430-W250", 61.0, 1.5, 12.0, None),
    _turn("2XC430-W250", 64.0, 1.8, 12.0, None),
    _turn("XL330-M288", 103.0, 0.52, 5.0, 1.0e-3, 0.481),
    _turn("XL330-M077", 383.0, 0.215, 5.0, 1.0e-3),
    _turn("XC330-M288", 81.0, 0.93, 5.0, 1.0e-3),
    _turn("XC330-M181", 129.0, 0.60, 5.0, 1.0e-3),
    _turn("XC330-T288", 71.0, 1.0, 12.0, 1.0e-3),
    _turn("XC330-T181", 113.0, 0.80, 12.0, 1.0e-3),
    _turn("XH540-W270", 46.0, 11.7, 14.8, 2.69e-3),
    _turn("XH540-W150", 86.0, 8.5, 14.8, 2.69e-3),
    _turn("XM540-W270", 30.0, 10.6, 12.0, 2.69e-3),
    _turn("XM540-W150", 53.0, 7.3, 12.0, 2.69e-3),
    _turn("MX-28", 55.0, 2.5, 12.0, None),
    _turn("MX-64", 63.0, 6.0, 12.0, 3.36e-3, 4.93),
    _turn("MX-106", 45.0, 8.4, 12.0, 3.36e-3, 8.87),
    _part_of_turn("AX-12A", 59.0, 1.5, 12.0, protocol=1),
    _part_of_turn("XL-320", 114.0, 0.39, 7.4, protocol=2),
)

SERVO_MODELS: dict[str, ServoModel] = {model.name: model for model in _MODELS}
"""Every known model by its maker's name, without the suffix of the connector (-T, -R)."""


def find_model(name: str) -> ServoModel:
    """Return the model called `name`; a trailing connector suffix (-T or -R) is accepted. Raises HardwareError with the
    known names."""
    model = SERVO_MODELS.get(name) or SERVO_MODELS.get(name.removesuffix("-T").removesuffix("-R"))
    if model is None:
        known = ", ".join(SERVO_MODELS)
        raise HardwareError(
            "unknown servo model", found=repr(name), allowed=known, then="Use the name printed on the servo's case"
        )
    return model


@dataclass(frozen=True)
class ServoGains:
    """Position gains as written to the servo's registers (0 to 16383, older layout: 0 to 254); None keeps the servo's
    own default."""

    position_p: int | None = None
    position_i: int | None = None
    position_d: int | None = None
    feedforward_1: int | None = None
    feedforward_2: int | None = None


@dataclass(frozen=True)
class ServoSpec:
    """One servo of a robot and the joint that it drives.

    A joint angle q is held at shaft tick `zero_tick + direction * gear * q / model.tick_rad`; `gear` is shaft turns per
    joint turn. With a `coupling` the servo turns two joints together with another one: then `gear` is 1, and q in this
    formula is the shaft angle of the coupling. `lower`, `upper` rad, `max_velocity` rad/s and `max_acceleration`
    rad/s^2 are the joint's; `current_limit` in A, None: unlimited. `homing_offset`: what the servo's own register 20
    holds, in ticks; it is part of every tick here, as the servo adds it to all that it reports. `protocol`: of its bus.
    """

    joint: str
    id: int
    model: ServoModel
    bus: str
    direction: int
    zero_tick: int
    lower: float
    upper: float
    max_velocity: float
    max_acceleration: float
    gear: float = 1.0
    gains: ServoGains = ServoGains()
    current_limit: float | None = None
    mode: ServoMode = ServoMode.POSITION
    homing_offset: int = 0
    coupling: ServoCoupling | None = None
    protocol: int = 2

    @property
    def label(self) -> str:
        """The name of the servo in messages."""
        return f"{self.joint} (id {self.id})"

    @property
    def ticks_per_rad(self) -> float:
        """Signed ticks per radian of the joint; of the shaft where it is coupled."""
        return self.direction * self.gear / self.model.tick_rad

    @property
    def lowest_tick(self) -> int:
        """First goal tick that the servo takes in its mode."""
        return -MULTI_TURN_REACH if self.mode.many_turns else max(0, self.homing_offset)

    @property
    def highest_tick(self) -> int:
        """Last goal tick that the servo takes in its mode."""
        return MULTI_TURN_REACH if self.mode.many_turns else self.model.ticks - 1 + min(0, self.homing_offset)

    def problems(self) -> tuple[str, ...]:
        """Return what keeps this servo from being driven, one text per finding; empty when valid.

        For a coupled servo, `hardware.joint_map` checks what needs the other servo.
        """
        found: list[str] = []
        numbers = (self.lower, self.upper, self.max_velocity, self.max_acceleration, self.gear)
        if not all(map(math.isfinite, numbers)):
            return (f"{self.joint}: a limit or the gear is not a finite number",)
        if not 0 <= self.id <= 252:
            found.append(f"{self.joint}: id {self.id}; allowed: 0 to 252")
        if self.direction not in (-1, 1):
            found.append(f"{self.joint}: direction {self.direction}; allowed: 1 or -1")
        if self.gear <= 0.0 or self.max_velocity <= 0.0 or self.max_acceleration <= 0.0:
            found.append(f"{self.joint}: gear, max_velocity and max_acceleration must be above 0")
        if self.lower >= self.upper:
            found.append(f"{self.joint}: limits {self.lower} to {self.upper} rad are not in ascending order")
        found.extend(self._unfit_mode())
        if not found and self.coupling is None:
            found.extend(self._beyond_the_servo())
        return tuple(found)

    def _unfit_mode(self) -> list[str]:
        """Findings about the mode, and about what goes with it."""
        found: list[str] = []
        if not self.mode.many_turns and abs(self.homing_offset) > HOMING_REACH:
            found.append(
                f"{self.joint}: homing_offset {self.homing_offset} ticks; allowed in mode {self.mode}: "
                f"{-HOMING_REACH} to {HOMING_REACH}"
            )
        if self.mode.many_turns and not self.model.has_turns:
            found.append(f"{self.joint}: {self.model.name} has no mode {self.mode}")
        if self.mode is ServoMode.CURRENT_BASED_POSITION and self.model.current_unit is None:
            found.append(f"{self.joint}: {self.model.name} limits no current, so it has no mode {self.mode}")
        if self.mode is ServoMode.CURRENT_BASED_POSITION and self.current_limit is None:
            found.append(f"{self.joint}: mode {self.mode} needs a current")
        if self.coupling is not None and self.gear != 1.0:
            found.append(f"{self.joint}: a coupled servo has gear 1: the gear is part of the coupling's matrix")
        return found

    def _beyond_the_servo(self) -> list[str]:
        """Findings about limits that the servo itself cannot serve."""
        found: list[str] = []
        ends = sorted(self.zero_tick + self.ticks_per_rad * q for q in (self.lower, self.upper))
        if ends[0] < self.lowest_tick - 0.5 or ends[1] > self.highest_tick + 0.5:
            found.append(
                f"{self.joint}: limits {self.lower:.4f} to {self.upper:.4f} rad need ticks {ends[0]:.0f} to "
                f"{ends[1]:.0f}; allowed: {self.lowest_tick} to {self.highest_tick} ({self.model.name}, {self.mode})"
            )
        fastest = self.model.no_load_speed / self.gear
        if self.max_velocity > fastest:
            found.append(
                f"{self.joint}: max_velocity {self.max_velocity:.3f} rad/s is above the no-load speed "
                f"{fastest:.3f} rad/s of {self.model.name} at {self.model.voltage} V"
            )
        return found


# The lag of a servo's shaft behind its goal: a position loop with a P gain alone, whose drive is full at the no-load
# speed.


def loop_lag(servo: ServoSpec) -> float:
    """Time constant in s of the servo's position loop, from its P gain: drive = gain x error, full drive = no-load
    speed.

    Source: e-Manual, Position PID Gain (84, unit 1/128; MX with protocol 1: 28) and Goal PWM (100, full at 885).
    """
    return lag_of_gain(servo.model, p_gain(servo))


def loop_stiffness(servo: ServoSpec) -> float:
    """Torque by which the servo's shaft holds against being turned off its goal, N m/rad, at its model's voltage: the
    nominal one of its model, with its P gain. Physics and the compensation of deflection both take it from here."""
    return servo.model.stiffness.nominal * p_gain(servo) / DEFAULT_P_GAIN


def integral_rate(servo: ServoSpec) -> float:
    """Share of its error that the servo's I gain adds to it in a second, 1/s: with it a shaft that is held off its goal
    by a load creeps towards it.

    Source: e-Manual, Position PID Gain (82, unit 1/65536 per ms; MX with protocol 1: 27, 1/2048).
    """
    layout = servo.model.layout_in(servo.protocol)
    unit = 2048.0 / 8.0 if layout is Layout.OLDER else 65536.0 / GAIN_UNIT  # of the I gain, in units of the P gain
    gain = servo.gains.position_p or DEFAULT_P_GAINS[layout]
    return 1e3 * (servo.gains.position_i or 0) / (unit * gain)


def p_gain(servo: ServoSpec) -> float:
    """The servo's P gain, or its default, in register counts of the X series."""
    usual = DEFAULT_P_GAINS[servo.model.layout_in(servo.protocol)]
    return DEFAULT_P_GAIN * (servo.gains.position_p or usual) / usual


def lag_of_gain(model: ServoModel, gain: float) -> float:
    """Time constant in s of a model's position loop with a P `gain` (register counts of the X series, above 0)."""
    return full_drive_error(gain) / model.no_load_speed
