"""The grid on which sensors are followed: finer than any sensor tells, so that a recording of them stays small.

Whatever is interpolated, smoothed or turned fills all 52 bits of a number, of which the last 30 say nothing. They
cannot be compressed, and replay needs what was followed to the bit. So what is followed has none of them.
"""

from dataclasses import replace

import numpy as np

from retarget.frames import SensorSample

__all__ = ["STEP_M", "STEP_TURN", "on_grid"]

STEP_M = 2.0**-20
"""Between two positions, m: a micrometre."""
STEP_TURN = 2.0**-22
"""Between two numbers of a quaternion: half a microradian. It misses unit length by less than that."""


def on_grid(sensors: SensorSample) -> SensorSample:
    """The same sensors at the nearest points of the grid; what is NaN stays so."""
    return replace(
        sensors,
        position=np.rint(sensors.position / STEP_M) * STEP_M,
        orientation=np.rint(sensors.orientation / STEP_TURN) * STEP_TURN,
    )
