"""From the gain registers of a servo to its position loop: drive (share of full voltage) per error, speed and time.

    drive = P e + I sum(e) - D w,    |drive| <= 1,    voltage = drive x supply

Source: e-Manual, Position PID Gain (80, 82, 84: units 1/16, 1/65536, 1/128 of a PWM count per tick) and Goal PWM (100,
full at 885); the units of time that it leaves open are those of `sim.emulator.tuning`, as is the rule that the default
D gain belongs to the loop that P alone describes. Protocol 1.0 (28: P, 32 the default): `sim.emulator.settings1`.
"""

from dataclasses import dataclass

from hardware.dynamixel.control_table import find_table
from hardware.servo import ServoSpec
from hardware.servo_lag import DEFAULT_P_GAIN, FULL_PWM, GAIN_UNIT, full_drive_error

_GAIN_OF_1 = 32.0
"""P gain register, or compliance slope, of Protocol 1.0 that is as stiff as DEFAULT_P_GAIN of 2.0."""


@dataclass(frozen=True)
class PositionLoop:
    """proportional 1/rad, derivative s/rad: drive per error and per speed of the shaft. integral: I over P gain,
    1/s."""

    proportional: float
    derivative: float
    integral: float


def position_loop(servo: ServoSpec, *, protocol: int) -> PositionLoop:
    """The loop of a servo with the profile's gains. A model without a P gain (AX-12A) has its default slope."""
    gains, model = servo.gains, servo.model
    register = gains.position_p
    if protocol == 1:
        gain = DEFAULT_P_GAIN * (register or _GAIN_OF_1) / _GAIN_OF_1
        integral = (gains.position_i or 0) * 1000.0 / 2048.0 / (gain / DEFAULT_P_GAIN * _GAIN_OF_1 / 8.0)
        return PositionLoop(1.0 / full_drive_error(model, gain), 0.0, integral)
    if not register:
        return PositionLoop(0.0, 0.0, 0.0)
    per_tick = register / GAIN_UNIT  # [PWM counts]
    usual = find_table(model.name, 2)["position_d_gain"].initial or 0
    damping = max((gains.position_d or 0) - usual, 0) / 16.0  # [PWM counts per tick/ms]
    return PositionLoop(
        proportional=1.0 / full_drive_error(model, float(register)),
        derivative=1e-3 * damping / FULL_PWM / model.tick_rad,
        integral=1e3 * (gains.position_i or 0) / 65536.0 / per_tick,
    )


def lacks_gain(servo: ServoSpec, *, protocol: int) -> bool:
    """Whether the profile does not say how stiff this servo is."""
    return servo.gains.position_p is None and find_table(servo.model.name, protocol).has(_P_GAIN[protocol])


_P_GAIN = {1: "p_gain", 2: "position_p_gain"}
