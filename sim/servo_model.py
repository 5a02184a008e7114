"""Plausible currents, voltages and temperatures of unloaded servos, and the lag with which they follow a goal."""

import numpy as np

from hardware.arrays import BoolArray, FloatArray

AMBIENT = 25.0  # [degrees Celsius]
IDLE_CURRENT = 0.03  # [A] electronics of one servo
FRICTION_CURRENT = 0.10  # [A] to overcome friction
SPEED_CURRENT = 0.30  # [A] more at no-load speed
LARGEST_CURRENT = 2.3  # [A] XM430-W350 at stall
TORQUE_PER_AMPERE = 1.8  # [N m/A] XM430-W350: 4.1 N m at 2.3 A
INERTIA = 0.01  # [kg m^2] at the shaft
SUPPLY_RESISTANCE = 0.05  # [ohm] of battery and wires, shared by all servos
ACCELERATION_TIME = 0.008  # [s] over which a servo's own loop spreads a change of speed
HEAT_PER_AMPERE2 = 12.0  # [degrees Celsius/A^2] final rise
HEAT_TIME = 300.0  # [s] thermal time constant


class ServoLoad:
    """Electrical and thermal state of servos with nominal voltages (n,) V and no-load speeds (n,) rad/s."""

    def __init__(self, voltage: FloatArray, top_speed: FloatArray) -> None:
        self._nominal = voltage
        self._still = 1e-3 * top_speed
        self._per_speed = SPEED_CURRENT / top_speed  # (n,) [A s/rad]
        self.current = np.full(voltage.size, IDLE_CURRENT)
        """Present current, (n,) A."""
        self.temperature = np.full(voltage.size, AMBIENT)
        """Present temperature, (n,) degrees Celsius."""

    @property
    def voltage(self) -> FloatArray:
        """Present input voltage, (n,) V: the supply sags with the current of all servos together."""
        sagged: FloatArray = self._nominal - SUPPLY_RESISTANCE * self.current.sum()
        return sagged

    def advance(self, *, before: FloatArray, after: FloatArray, torque: BoolArray, elapsed: float) -> None:
        """Move on by `elapsed` s, in which the shaft velocities (n,) rad/s went from `before` to `after`."""
        speed = np.abs(after)
        # Two updates in quick succession, as after late ticks, must not show a larger current.
        spread = max(elapsed, ACCELERATION_TIME)
        inertia = INERTIA / spread / TORQUE_PER_AMPERE * np.abs(after - before)  # [A]
        drive = FRICTION_CURRENT * (speed > self._still) + self._per_speed * speed + inertia
        self.current = IDLE_CURRENT + torque * np.minimum(drive, LARGEST_CURRENT)
        final = AMBIENT + HEAT_PER_AMPERE2 * self.current * self.current
        self.temperature = self.temperature - (final - self.temperature) * np.expm1(-elapsed / HEAT_TIME)


# How a servo's shaft follows its goal: the lag of its loop, with a drive that saturates at the no-load speed.


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
