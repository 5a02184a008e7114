"""Numbers of a typical servo for models of current, supply and heat, and its lag behind a goal."""

import numpy as np

from hardware.arrays import FloatArray
from retarget.arithmetic import exp

AMBIENT = 25.0  # [degrees Celsius]
IDLE_CURRENT = 0.03  # [A] electronics of one servo
FRICTION_CURRENT = 0.10  # [A] to overcome friction
SPEED_CURRENT = 0.30  # [A] more at no-load speed
LARGEST_CURRENT = 2.3  # [A] XM430-W350 at stall
TORQUE_PER_AMPERE = 1.8  # [N m/A] XM430-W350: 4.1 N m at 2.3 A
INERTIA = 0.01  # [kg m^2] at the shaft
SUPPLY_RESISTANCE = 0.05  # [ohm] of battery and wires, shared by all servos
HEAT_PER_AMPERE2 = 12.0  # [degrees Celsius/A^2] final rise
HEAT_TIME = 300.0  # [s] thermal time constant


def saturated_lag(
    error: FloatArray, *, lag: FloatArray, top: FloatArray, elapsed: float
) -> tuple[FloatArray, FloatArray]:
    """Return displacement and final velocity (n,) after `elapsed` s of d/dt x = clip((goal - x) / lag, -top, top).

    error: goal - x at the start. The speed is constant while the error exceeds `top * lag`, then falls exponentially.
    """
    distance = np.abs(error)
    knee = top * lag  # below this error the loop no longer saturates
    cruise = np.minimum(np.maximum((distance - knee) / top, 0.0), elapsed)  # [s] at top speed
    left = distance - cruise * top  # error when the cruise ends
    lag = np.maximum(lag, 1e-12)
    final = left * exp((cruise - elapsed) / lag)
    return np.copysign(distance - final, error), np.copysign(np.minimum(final / lag, top), error)
