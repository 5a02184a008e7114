"""What a servo's motor and gears are by measurement, one row per model; what nobody has measured is derived, and says
so.

All at the output shaft, N m, rad, A, V. The motor is the usual one: u = R i + kt w, torque = kt i, so that at supply V
it stalls at kt V / R and turns no faster than V / kt.
"""

from dataclasses import dataclass

from hardware.dynamixel.control_table import find_table
from hardware.servo import ServoModel

ARC_MINUTE = 2.908882e-4  # [rad]
BACKLASH = 15.0 * ARC_MINUTE
"""Play between the output shaft and its gears, e-Manual of the X540 series; taken for every model that says none."""

FRICTION_SHARE, ARMATURE_SHARE = 0.025, 0.003
"""Of the stall torque (the latter in s^2): the middle of what was identified, for models that nobody has identified."""


@dataclass(frozen=True)
class DriveNumbers:
    """torque_constant kt N m/A (V s/rad), resistance ohm, armature kg m^2, friction (Coulomb) N m, viscous N m s/rad,
    backlash rad, most_torque N m that the motor gives at any speed, temperature_limit degrees Celsius at which it
    switches itself off. source: where each comes from."""

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
        """At full drive and `voltage` V, N m."""
        return self.torque_constant * voltage / self.resistance

    @property
    def back_emf(self) -> float:
        """Torque lost per speed to the voltage that the motor generates, N m s/rad."""
        return self.torque_constant**2 / self.resistance


@dataclass(frozen=True)
class _Identified:
    """armature kg m^2, friction N m, viscous N m s/rad; most_torque N m, motor (kt, R), None: the maker's numbers."""

    armature: float
    friction: float
    viscous: float
    source: str
    most_torque: float | None = None
    motor: tuple[float, float] | None = None


_BAM = "Rhoban bam, model m1"
_TODDLERBOT = "ToddlerBot 2.0 identification; kt and R of the maker's stall torque and no-load speed"
_OP3 = "friction and torque: ToddlerBot 2.0; armature: public OP3 model, the larger; kt, R: the maker's numbers"
_WOLFGANG = "Wolfgang model (as MX-106); kt and R of the maker's stall torque and no-load speed"

_IDENTIFIED = {
    "MX-64": _Identified(0.01195, 0.0904, 0.01169, _BAM, motor=(1.6225, 3.949)),
    "MX-106": _Identified(0.02661, 0.1035, 0.0352, _BAM, motor=(2.1914, 2.965)),
    "XL330-M288": _Identified(0.00181, 0.01283, 0.00366, _BAM, motor=(0.3867, 4.017)),
    "XH540-W270": _Identified(0.025, 0.1, 0.0352, _WOLFGANG),
    "XM430-W350": _Identified(0.045, 0.105, 0.0133, _OP3, most_torque=2.95),
    "XM430-W210": _Identified(0.0022, 0.038, 0.0064, _TODDLERBOT, most_torque=1.94),
    "XC430-W240": _Identified(0.0044, 0.014, 0.0072, _TODDLERBOT, most_torque=1.47),
    "2XC430-W250": _Identified(0.0044, 0.06, 0.0028, _TODDLERBOT, most_torque=1.09),
    "2XL430-W250": _Identified(0.0083, 0.069, 0.0013, _TODDLERBOT, most_torque=0.93),
    "XC330-T288": _Identified(0.0048, 0.006, 0.001, _TODDLERBOT, most_torque=0.68),
}
"""XC330 and XC430 stand without a suffix in ToddlerBot's files; the types are those of the robot."""


def drive_numbers(model: ServoModel) -> DriveNumbers:
    """The numbers of a model, by identification where there is one."""
    known = _IDENTIFIED.get(model.name)
    if known is None:
        share = model.stall_torque
        known = _Identified(ARMATURE_SHARE * share, FRICTION_SHARE * share, 0.0, "derived from stall torque and speed")
    kt, resistance = known.motor or _motor_by_maker(model, known)
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


def _motor_by_maker(model: ServoModel, known: _Identified) -> tuple[float, float]:
    """kt and R with which it stalls at the maker's torque and, against its friction, turns at the maker's speed.

    kt V / R = stall torque, and (kt^2 / R + viscous) x no-load speed = stall torque - friction.
    """
    back_emf = (model.stall_torque - known.friction) / model.no_load_speed - known.viscous
    kt = model.voltage * back_emf / model.stall_torque
    return kt, kt * model.voltage / model.stall_torque
