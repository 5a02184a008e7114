"""How a servo's shaft follows its goal: a position loop with a pure P gain whose drive saturates at the no-load
speed."""

import numpy as np

from hardware.arrays import FloatArray
from hardware.servo import ServoModel, ServoSpec

FULL_PWM = 885.0  # register value of full drive
GAIN_UNIT = 128.0  # position P gain register per unit of gain
DEFAULT_P_GAIN = 800  # XM430 series
DEFAULT_P_GAIN_1 = 32
"""Of Protocol 1.0, whose default loop is taken to be as stiff as that of 2.0."""


def loop_lag(servo: ServoSpec, *, protocol: int = 2) -> float:
    """Time constant in s of the servo's position loop, from its P gain: drive = gain x error, full drive = no-load
    speed.

    Source: e-Manual, Position PID Gain (84, unit 1/128; protocol 1: 28) and Goal PWM (100, full at 885).
    """
    usual = DEFAULT_P_GAIN if protocol == 2 else DEFAULT_P_GAIN_1
    return lag_of_gain(servo.model, DEFAULT_P_GAIN * (servo.gains.position_p or usual) / usual)


def lag_of_gain(model: ServoModel, gain: float) -> float:
    """Time constant in s of a model's position loop with a P `gain` (register counts of the X series, above 0)."""
    return full_drive_error(model, gain) / model.no_load_speed


def full_drive_error(model: ServoModel, gain: float) -> float:
    """Error in rad of the shaft at which a P `gain` (register counts of the X series, above 0) asks for full drive."""
    return FULL_PWM * GAIN_UNIT / gain * _tick_of_x_series(model)


def _tick_of_x_series(model: ServoModel) -> float:
    """The P gain acts on encoder ticks of a turn of 4096, whatever the model counts in, rad."""
    return 2.0 * np.pi / 4096.0 if model.ticks < 4096 else model.tick_rad


def saturated_lag(
    error: FloatArray, *, lag: FloatArray, top: FloatArray, elapsed: float
) -> tuple[FloatArray, FloatArray]:
    """Displacement and final velocity (n,) after `elapsed` s of d/dt x = clip((goal - x) / lag, -top, top), `error` =
    goal - x at start.

    At top speed while the error exceeds `top * lag`, exponential after; `lag` 0 is a servo that runs at top speed to
    its goal.
    """
    distance = np.abs(error)
    knee = top * lag  # below this error the loop no longer saturates
    cruise = np.minimum(np.maximum((distance - knee) / top, 0.0), elapsed)  # [s] at top speed
    left = distance - cruise * top  # error when the cruise ends
    lag = np.maximum(lag, 1e-12)
    final = left * np.exp((cruise - elapsed) / lag)
    return np.copysign(distance - final, error), np.copysign(np.minimum(final / lag, top), error)
