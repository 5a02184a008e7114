"""Servos as data: models, servos of a robot, couplings, and position loops.

A new Dynamixel model is a row of `servo_models.tsv` and one of `dynamixel/tables/models.tsv`, both from the e-Manual;
registers or limits of its own are a layer in `registers.tsv` or `values.tsv` there.
`motors.yaml` holds published identifications.
"""

import csv
import math
from dataclasses import dataclass
from enum import Enum, StrEnum
from pathlib import Path

import numpy as np

from hardware.errors import HardwareError

MAX_CONDITION = 1e3
"""Highest condition number of a coupling."""


@dataclass(frozen=True)
class ServoCoupling:
    """A differential: joint angles = `matrix` @ shaft angles, rad, both in the order of `joints`. A shaft angle is
    `direction * (tick - zero_tick) * model.tick_rad`. Both servos carry the same coupling."""

    joints: tuple[str, str]
    matrix: tuple[tuple[float, float], tuple[float, float]]

    @property
    def determinant(self) -> float:
        """Determinant of the matrix."""
        (a, b), (c, d) = self.matrix
        return a * d - b * c

    @property
    def inverse(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Inverse of the matrix. Raises ZeroDivisionError."""
        (a, b), (c, d) = self.matrix
        size = self.determinant
        return ((d / size, -b / size), (-c / size, a / size))

    @property
    def condition(self) -> float:
        """Condition number of the matrix; inf for a singular one."""
        if not 0.0 < abs(self.determinant) < math.inf:
            return math.inf
        return float(np.linalg.cond(self.matrix))

    def problems(self) -> tuple[str, ...]:
        """The findings about the coupling."""
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
"""[ticks] Largest goal in either direction, with many turns (e-Manual, register 116)."""

HOMING_REACH = 1024
"""[ticks] Largest homing offset in either direction, within one turn (e-Manual, register 20)."""


class ServoMode(StrEnum):
    """Operating modes with a goal position (e-Manual, register 11: 3, 4 and 5)."""

    POSITION = "position"
    EXTENDED_POSITION = "extended_position"
    CURRENT_BASED_POSITION = "current_based_position"

    @property
    def many_turns(self) -> bool:
        """True if goals may lie beyond one turn."""
        return self is not ServoMode.POSITION


@dataclass(frozen=True)
class ServoStiffness:
    """Torque per angle that holds a shaft at its goal, N m/rad. lowest, highest: published range."""

    nominal: float
    lowest: float
    highest: float

    def scaled(self, factor: float) -> "ServoStiffness":
        """The stiffness at `factor` times the P gain."""
        return ServoStiffness(factor * self.nominal, factor * self.lowest, factor * self.highest)


class Layout(Enum):
    """Layout of a control table: its registers and units of gains."""

    X = "the layout of the X series"
    """X series, and MX with protocol 2.0."""
    OLDER = "the older layout (protocol 1.0, XL-320)"
    """Protocol 1.0 servos and the XL-320: one turn or a wheel, moving speed and torque limit."""


FULL_PWM = 885.0  # register value of full drive
GAIN_UNIT = 128.0  # position P gain register per unit of gain
DEFAULT_P_GAIN = 800  # XM430 series
DEFAULT_P_GAINS = {Layout.X: DEFAULT_P_GAIN, Layout.OLDER: 32}
"""The default loop of the older layout is assumed to be equally stiff."""


def full_drive_error(gain: float) -> float:
    """The shaft's error, rad, at which a P `gain` (counts of the X series) gives full drive. The gain acts on
    4096 ticks per turn for all encoders."""
    return FULL_PWM * GAIN_UNIT / gain * (2.0 * math.pi / 4096.0)


SOFT = DEFAULT_P_GAIN / 150.0
"""[N m/rad] At the default P gain: ToddlerBot's identification of six X models, kp = P / 150."""
FIRM = 21.1 / 18.9
"""Ratio of MuJoCo's public OP3 to the e-Manual's numbers of the same servo."""


def estimated_stiffness(torque: float) -> ServoStiffness:
    """The stiffness at the default P gain for a stall torque, N m.

    By the e-Manual, drive is gain x error, and full drive gives the stall torque. The range spans public
    identifications, which differ by a factor of four. `retarget servo stiffness` measures it.
    """
    nominal = torque / full_drive_error(DEFAULT_P_GAIN)
    return ServoStiffness(nominal, min(nominal, SOFT), max(FIRM * nominal, SOFT))


@dataclass(frozen=True)
class ServoModel:
    """One servo model (e-Manual overview table).

    ticks: over `travel` rad. no_load_speed: rad/s, and stall_torque: N m, at `voltage` V. current_unit: A per count;
    None without a current register. stiffness: at the default P gain and `voltage`. layout: with protocol 2.0.
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
        """The layout with a protocol."""
        return Layout.OLDER if protocol == 1 else self.layout

    @property
    def has_turns(self) -> bool:
        """True if it has modes of many turns."""
        return any(self.layout_in(protocol) is Layout.X for protocol in self.protocols)

    @property
    def tick_rad(self) -> float:
        """Shaft angle of one tick, rad."""
        return self.travel / self.ticks


def _read_models() -> dict[str, ServoModel]:
    lines = (line for line in MODELS.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    found: dict[str, ServoModel] = {}
    for row in csv.DictReader(lines, delimiter="\t"):
        torque, ticks = float(row["torque"]), int(row["ticks"])
        found[row["model"]] = ServoModel(
            name=row["model"],
            ticks=ticks,
            travel=math.radians(float(row["travel"])),
            centre_tick=ticks // 2,
            no_load_speed=float(row["speed"]) * RPM,
            stall_torque=torque,
            voltage=float(row["volts"]),
            current_unit=float(row["current_step"]) if row["current_step"] else None,
            stiffness=estimated_stiffness(float(row["identified"]) if row["identified"] else torque),
            protocols=tuple(map(int, row["protocols"].split())),
            layout=Layout[row["layout"]],
        )
    return found


MODELS = Path(__file__).with_name("servo_models.tsv")
SERVO_MODELS = _read_models()
"""Models by their maker's names, without the suffix of the connector (-T, -R)."""


def find_model(name: str) -> ServoModel:
    """A model, with or without the suffix of its connector. Raises HardwareError."""
    model = SERVO_MODELS.get(name) or SERVO_MODELS.get(name.removesuffix("-T").removesuffix("-R"))
    if model is None:
        known = ", ".join(SERVO_MODELS)
        raise HardwareError(
            "unknown servo model", found=repr(name), allowed=known, then="Use the name printed on the servo's case"
        )
    return model


@dataclass(frozen=True)
class ServoGains:
    """Position gains, counts; None: the servo's default."""

    position_p: int | None = None
    position_i: int | None = None
    position_d: int | None = None
    feedforward_1: int | None = None
    feedforward_2: int | None = None


@dataclass(frozen=True)
class ServoSpec:
    """One servo of a robot and its joint.

    Joint angle q is at shaft tick `zero_tick + direction * gear * q / model.tick_rad`; `gear` is shaft turns per joint
    turn. With a `coupling` the gear is 1, and q is the coupling's shaft angle. Limits are the joint's: rad, rad/s,
    rad/s^2. current_limit: A. homing_offset: register 20, ticks, which the servo adds to its positions, and so do all
    ticks here.
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
        """Name in messages."""
        return f"{self.joint} (id {self.id})"

    @property
    def ticks_per_rad(self) -> float:
        """Signed ticks per radian of the joint, or of the shaft if it is coupled."""
        return self.direction * self.gear / self.model.tick_rad

    @property
    def lowest_tick(self) -> int:
        """First goal tick that the servo accepts in its mode."""
        return -MULTI_TURN_REACH if self.mode.many_turns else max(0, self.homing_offset)

    @property
    def highest_tick(self) -> int:
        """Last goal tick that the servo accepts in its mode."""
        return MULTI_TURN_REACH if self.mode.many_turns else self.model.ticks - 1 + min(0, self.homing_offset)

    def problems(self) -> tuple[str, ...]:
        """The reasons why this servo cannot be driven. `hardware.joint_map` checks the limits of coupled
        ones."""
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
        # The mode, and its other settings.
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
        if found or self.coupling is not None:
            return tuple(found)
        # Limits that the servo cannot serve.
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
        return tuple(found)


# The position loop of a servo: a P gain, whose drive is full at the no-load speed.


def loop_lag(servo: ServoSpec) -> float:
    """The time constant of the position loop, s: drive = gain x error, full drive = no-load speed.

    Source: e-Manual, Position PID Gain (84, unit 1/128; MX with protocol 1: 28), Goal PWM (100, full at 885).
    """
    return lag_of_gain(servo.model, p_gain(servo))


def loop_stiffness(servo: ServoSpec) -> float:
    """The torque per angle, N m/rad, that holds the shaft at its goal, at its model's voltage."""
    return servo.model.stiffness.nominal * p_gain(servo) / DEFAULT_P_GAIN


def integral_rate(servo: ServoSpec) -> float:
    """The share of the error that the I gain adds to the P term per second, 1/s.

    Source: e-Manual, Position PID Gain (82, unit 1/65536 per ms; MX with protocol 1: 27, 1/2048).
    """
    layout = servo.model.layout_in(servo.protocol)
    unit = 2048.0 / 8.0 if layout is Layout.OLDER else 65536.0 / GAIN_UNIT  # of the I gain, in units of the P gain
    gain = servo.gains.position_p or DEFAULT_P_GAINS[layout]
    return 1e3 * (servo.gains.position_i or 0) / (unit * gain)


def p_gain(servo: ServoSpec) -> float:
    """The P gain or its default, in counts of the X series."""
    usual = DEFAULT_P_GAINS[servo.model.layout_in(servo.protocol)]
    return DEFAULT_P_GAIN * (servo.gains.position_p or usual) / usual


def lag_of_gain(model: ServoModel, gain: float) -> float:
    """The time constant, s, with a P `gain` (counts of the X series)."""
    return full_drive_error(gain) / model.no_load_speed
