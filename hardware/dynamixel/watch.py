"""Reading servos that somebody else set up: no register is written, torque stays as it is."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from hardware.bus import ServoStates
from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.cycle import read_cycle
from hardware.dynamixel.readings import Readings

KEPT = 500
"""Cycles over which times are told."""


class Watch:
    """The servos of lines with open ports. losses (n,): cycles in which a servo did not answer."""

    def __init__(self, lines: Sequence[BusLine]) -> None:
        self._lines = lines
        tables = {line.index_of[one]: table for line in lines for one, table in line.tables.items()}
        self._place = {index: place for place, index in enumerate(sorted(tables))}
        assert list(self._place) == list(range(len(tables)))
        self._readings = Readings([tables[index] for index in sorted(tables)])
        self.losses = np.zeros(len(tables), dtype=np.int64)
        self._times: deque[float] = deque(maxlen=KEPT)
        for line in lines:
            for device, image in line.images.items():
                index = line.index_of[device]
                self._readings.take_drive(index, bool(image.value("torque_enable")))
                if image.has("hardware_error_status"):
                    self._readings.take_alert(index, image.value("hardware_error_status"))

    @property
    def retries(self) -> int:
        """Requests that had to be repeated."""
        return sum(line.cyclic.retries for line in self._lines)

    def times(self) -> tuple[float, float]:
        """Median and 99th percentile of the cycles' times, s."""
        low, high = np.percentile(self._times, (50, 99)) if self._times else (np.nan, np.nan)
        return float(low), float(high)

    def read(self) -> ServoStates:
        """One cycle of all ports, with voltage and temperature. Raises BusError when a port is gone."""
        begun = self._lines[0].port.now()
        read_cycle(self._lines, self._readings, wide=True)
        now = self._lines[0].port.now()
        self._times.append(now - begun)
        states = self._readings.states(now)
        self.losses += ~states.valid
        return states
