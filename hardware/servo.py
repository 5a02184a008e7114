"""Servos as data: what a model is by its maker's numbers, and what one servo of a robot is by its profile."""

import math
from dataclasses import dataclass

from hardware.errors import HardwareError, describe

RPM = 2.0 * math.pi / 60.0  # [rad/s]


@dataclass(frozen=True)
class ServoModel:
    """One servo model (e-Manual overview table).

    `ticks` counts over `travel` rad, `centre_tick` is the middle of travel; `no_load_speed` rad/s and `stall_torque` N
    m at `voltage` V; `current_unit` A per register step, None where the servo reports a load instead of a current.
    """

    name: str
    ticks: int
    travel: float
    centre_tick: int
    no_load_speed: float
    stall_torque: float
    voltage: float
    current_unit: float | None

    @property
    def tick_rad(self) -> float:
        """Shaft angle of one tick, rad."""
        return self.travel / self.ticks


def _turn(name: str, rpm: float, stall_torque: float, voltage: float, current_unit: float | None) -> ServoModel:
    """A servo with the X and MX series' encoder: 4096 ticks per turn, 0 rad at 2048."""
    return ServoModel(name, 4096, 2.0 * math.pi, 2048, rpm * RPM, stall_torque, voltage, current_unit)


# name, no-load speed [rpm], stall torque [N m], both at [V], current step [A]
_MODELS = (
    _turn("XM430-W350", 46.0, 4.1, 12.0, 2.69e-3),
    _turn("XM430-W210", 77.0, 3.0, 12.0, 2.69e-3),
    _turn("XL430-W250", 61.0, 1.5, 12.0, None),
    _turn("XC430-W240", 70.0, 1.9, 12.0, None),
    _turn("2XL430-W250", 61.0, 1.5, 12.0, None),
    _turn("2XC430-W250", 64.0, 1.8, 12.0, None),
    _turn("XL330-M288", 103.0, 0.52, 5.0, 1.0e-3),
    _turn("XC330-T288", 71.0, 1.0, 12.0, 1.0e-3),
    _turn("XC330-T181", 113.0, 0.80, 12.0, 1.0e-3),
    _turn("XH540-W270", 46.0, 11.7, 14.8, 2.69e-3),
    _turn("MX-28", 55.0, 2.5, 12.0, None),
    _turn("MX-64", 63.0, 6.0, 12.0, 3.36e-3),
    _turn("MX-106", 45.0, 8.4, 12.0, 3.36e-3),
    ServoModel("AX-12A", 1024, math.radians(300.0), 512, 59.0 * RPM, 1.5, 12.0, None),
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
            describe(
                what="unknown servo model",
                found=repr(name),
                allowed=known,
                then="Use the name printed on the servo's case",
            )
        )
    return model


@dataclass(frozen=True)
class ServoGains:
    """Position gains as written to the servo's registers (0 to 16383); None keeps the servo's own default."""

    position_p: int | None = None
    position_i: int | None = None
    position_d: int | None = None


@dataclass(frozen=True)
class ServoSpec:
    """One servo of a robot and the joint that it drives.

    A joint angle q is held at shaft tick `zero_tick + direction * gear * q / model.tick_rad`; `gear` is shaft turns per
    joint turn. `lower`, `upper` rad, `max_velocity` rad/s and `max_acceleration` rad/s^2 are the joint's;
    `current_limit` in A, None: unlimited.
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

    @property
    def ticks_per_rad(self) -> float:
        """Signed ticks per radian of the joint."""
        return self.direction * self.gear / self.model.tick_rad

    def problems(self) -> tuple[str, ...]:
        """Return what keeps this servo from being driven, one text per finding; empty when sound."""
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
        if not found:
            found.extend(self._beyond_the_servo())
        return tuple(found)

    def _beyond_the_servo(self) -> list[str]:
        """Findings about limits that the servo itself cannot serve."""
        found: list[str] = []
        ends = sorted(self.zero_tick + self.ticks_per_rad * q for q in (self.lower, self.upper))
        last = self.model.ticks - 1
        if ends[0] < -0.5 or ends[1] > last + 0.5:
            found.append(
                f"{self.joint}: limits {self.lower:.4f} to {self.upper:.4f} rad need ticks {ends[0]:.0f} to "
                f"{ends[1]:.0f}; allowed: 0 to {last} ({self.model.name})"
            )
        fastest = self.model.no_load_speed / self.gear
        if self.max_velocity > fastest:
            found.append(
                f"{self.joint}: max_velocity {self.max_velocity:.3f} rad/s is above the no-load speed "
                f"{fastest:.3f} rad/s of {self.model.name} at {self.model.voltage} V"
            )
        return found
