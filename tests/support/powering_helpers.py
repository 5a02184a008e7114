"""A bus with a servo of many turns."""

import math
from dataclasses import replace

from bus_rig import BusRig, spec
from hardware.servo import ServoMode

TURN = 4096
FAR = 2048 + round(4.5 / math.tau * TURN)
"""Tick of a joint at 4.5 rad, on the second turn of its servo."""


def of_many_turns() -> BusRig:
    """A plain servo and one of many turns that stands on its second."""
    servos = [spec(1), replace(spec(2), mode=ServoMode.EXTENDED_POSITION, lower=3.5, upper=6.0)]
    return BusRig(servos, start=[2048, FAR])
