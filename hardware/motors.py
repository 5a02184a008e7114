"""Motors and gears of servos, at the output shaft: rows of `motors.yaml`, else derived from the maker's numbers.

The model is u = R i + kt w, torque = kt i.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml

from hardware.dynamixel.control_table import find_table
from hardware.servo import ServoModel

ARC_MINUTE = 2.908882e-4  # [rad]
BACKLASH = 15.0 * ARC_MINUTE
"""Play between output shaft and gears, e-Manual of the X540 series; assumed for all."""

FRICTION_SHARE, ARMATURE_SHARE = 0.025, 0.003
"""Shares of the stall torque (the latter in s^2) for other models: the middle of the identified values."""


@dataclass(frozen=True)
class DriveNumbers:
    """torque_constant: kt, N m/A. resistance: ohm. armature: kg m^2. friction: Coulomb, N m. viscous: N m s/rad.
    backlash: rad. most_torque: N m. temperature_limit: degrees Celsius, of the servo itself."""

    torque_constant: float
    resistance: float
    armature: float
    friction: float
    viscous: float
    backlash: float
    most_torque: float
    temperature_limit: float
    source: str

    def stall_torque(self, voltage: float) -> float:
        """The stall torque, N m, at full drive and `voltage` V."""
        return self.torque_constant * voltage / self.resistance

    @property
    def back_emf(self) -> float:
        """Torque lost per speed, N m s/rad."""
        return self.torque_constant * self.torque_constant / self.resistance


@dataclass(frozen=True)
class _Identified:
    """A row of `motors.yaml`. motor: (kt, R). line: highest speed with most_torque, rad/s, and a point beyond."""

    armature: float
    friction: float
    viscous: float
    source: str
    most_torque: float | None = None
    motor: tuple[float, float] | None = None
    line: tuple[float, float, float] | None = None


MEASURED = Path(__file__).with_name("motors.yaml")


@cache
def _identified() -> dict[str, _Identified]:
    rows = yaml.safe_load(MEASURED.read_text(encoding="utf-8"))
    return {model: _Identified(**row) for model, row in rows.items()}


def drive_numbers(model: ServoModel) -> DriveNumbers:
    """The numbers of a model."""
    known = _identified().get(model.name)
    if known is None:
        share = model.stall_torque
        known = _Identified(ARMATURE_SHARE * share, FRICTION_SHARE * share, 0.0, "derived from stall torque and speed")
    kt, resistance = known.motor or _motor_of_line(model, known)
    return DriveNumbers(
        torque_constant=kt,
        resistance=resistance,
        armature=known.armature,
        friction=known.friction,
        viscous=known.viscous,
        backlash=BACKLASH,
        most_torque=known.most_torque or kt * model.voltage / resistance,
        temperature_limit=float(find_table(model.name, max(model.protocols))["temperature_limit"].initial or 80),
        source=known.source,
    )


def _motor_of_line(model: ServoModel, known: _Identified) -> tuple[float, float]:
    """Return kt and R of the motor whose torque falls along the identified line, or faster, so that it does not exceed
    the maker's speed.

    Torque at full drive: kt V / R - (kt^2 / R) x speed, less friction and viscous x speed.
    """
    first, torque, fall = 0.0, model.stall_torque, 0.0
    if known.line is not None and known.most_torque is not None:
        first, speed, left = known.line
        torque = known.most_torque
        fall = (torque - left) / (speed - first)
    top = model.no_load_speed
    fall = max(fall, (torque - known.friction - known.viscous * top) / (top - first))
    stall = torque + fall * first
    kt = model.voltage * fall / stall
    return kt, kt * model.voltage / stall
