"""Whether a bus can still be trusted: that somebody on it is understood, and that not every other cycle is noise."""

import numpy as np

from hardware.bus import ServoStates
from hardware.few_values import all_of
from hardware.joint_map import JointMap

DEAF_CYCLES = 2
"""Cycles in a row without one sound answer."""
DEAF_S = 0.015
"""[s] since the last sound answer on a bus before it is given up."""
MOST_ROUGH = 0.6
"""Share of rough cycles that is no line to move a robot on (see `ServoStates.rough`)."""


class LineHealth:
    """Judges the buses of one robot. A bus with one servo is not told from that servo: it is left to the servo's age.

    The age is counted to the beginning of a cycle, so that one cycle in which the host was held up is not enough.
    """

    def __init__(self, joint_map: JointMap) -> None:
        buses = np.array([servo.bus for servo in joint_map.servos])
        groups = {str(name): np.flatnonzero(buses == name) for name in buses}
        self._columns = {name: columns for name, columns in groups.items() if columns.size > 1}
        self._deaf = dict.fromkeys(self._columns, 0)

    def lost(self, states: ServoStates) -> str | None:
        """Why there is no way to brake, because nobody on a bus is understood any more; or None."""
        if all_of(states.valid):
            self._deaf = dict.fromkeys(self._columns, 0)
            return None
        for name, columns in self._columns.items():
            if states.valid[columns].any():
                self._deaf[name] = 0
                continue
            self._deaf[name] += 1
            age = float(states.age[columns].min())
            if self._deaf[name] >= DEAF_CYCLES and DEAF_S < age < np.inf:
                return f"no sound answer from any servo of bus {name} for {age:.3f} s"
        return None

    def rough(self, states: ServoStates) -> str | None:
        """Why the robot must stop while it still can; or None."""
        if states.rough < MOST_ROUGH:
            return None
        share = f"in {states.rough:.0%} of the cycles of late"
        return f"answers came damaged or cut short {share}: a noisy line, or answers that come late"
