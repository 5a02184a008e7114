"""How a servo's shaft lags behind its goal: a position loop with a pure P gain whose drive is full at the no-load
speed."""

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.servo import ServoModel, ServoSpec

__all__ = [
    "DEFAULT_P_GAIN",
    "FULL_PWM",
    "GAIN_UNIT",
    "ExpectedWay",
    "full_drive_error",
    "lag_of_gain",
    "loop_lag",
    "loop_stiffness",
]

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
    return lag_of_gain(servo.model, _gain(servo, protocol))


def loop_stiffness(servo: ServoSpec, *, protocol: int = 2) -> float:
    """Torque by which the servo's shaft holds against being turned off its goal, N m/rad: stalled at full drive, from
    its P gain, at its model's voltage."""
    return servo.model.stall_torque / full_drive_error(servo.model, _gain(servo, protocol))


def _gain(servo: ServoSpec, protocol: int) -> float:
    """The servo's P gain, or its default, in register counts of the X series."""
    usual = DEFAULT_P_GAIN if protocol == 2 else DEFAULT_P_GAIN_1
    return DEFAULT_P_GAIN * (servo.gains.position_p or usual) / usual


def lag_of_gain(model: ServoModel, gain: float) -> float:
    """Time constant in s of a model's position loop with a P `gain` (register counts of the X series, above 0)."""
    return full_drive_error(model, gain) / model.no_load_speed


def full_drive_error(model: ServoModel, gain: float) -> float:
    """Error in rad of the shaft at which a P `gain` (register counts of the X series, above 0) asks for full drive."""
    return FULL_PWM * GAIN_UNIT / gain * _tick_of_x_series(model)


def _tick_of_x_series(model: ServoModel) -> float:
    """The P gain acts on encoder ticks of a turn of 4096, whatever the model counts in, rad."""
    return 2.0 * np.pi / 4096.0 if model.ticks < 4096 else model.tick_rad


class ExpectedWay:
    """Where n shafts may be on the way to their goals: anywhere from where a loop with its lag would be to the goal.

    So a servo that follows as its gain lets it is not off, however fast it is asked to go.
    """

    def __init__(self, lag: FloatArray) -> None:
        """lag (n,): s."""
        self._lag = np.maximum(lag, 1e-9)
        self._at: FloatArray | None = None
        self._time = 0.0

    def forget(self) -> None:
        """What comes next begins at its goal."""
        self._at = None

    def off(self, time: float, goal: TickArray, position: TickArray) -> FloatArray:
        """How far (n,) ticks shafts at `position` are off the way to goals that they have had until `time`, s; positive
        is beyond it."""
        end, here = goal.astype(np.float64), position.astype(np.float64)
        if self._at is None:
            self._at = end
        else:
            self._at = end + (self._at - end) * np.exp((self._time - time) / self._lag)
        self._time = time
        lowest, highest = np.minimum(self._at, end), np.maximum(self._at, end)
        return np.asarray(here - np.minimum(np.maximum(here, lowest), highest))
