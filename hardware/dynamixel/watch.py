"""Reading servos that somebody else set up: no register is written, torque stays as it is."""

from collections import deque
from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from hardware.bus import ServoStates
from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.cycle import read_cycle
from hardware.dynamixel.readings import Readings
from hardware.dynamixel.register import Register

KEPT = 500
"""Cycles over which times are told."""
TORQUE_PERIOD = 0.2
"""[s] Between two looks at everybody's torque."""
TORQUE_AGE = 1.0
"""[s] After which what was said of it is not known any more."""


class Torque(StrEnum):
    """What a servo says of its torque."""

    UNKNOWN = "?"
    OFF = "off"
    ON = "on"
    HELD = "on, stopped by its watchdog"


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
        self._torque = [Torque.UNKNOWN] * len(tables)
        self._torque_at = np.full(len(tables), -np.inf)  # [s] when it was told
        self._looked = -np.inf
        for line in lines:
            for device, image in line.images.items():
                if image.has("hardware_error_status"):
                    self._readings.take_alert(line.index_of[device], image.value("hardware_error_status"))

    @property
    def torque(self) -> list[Torque]:
        """Of every servo, as it said within TORQUE_AGE."""
        known = self._torque_at >= self._lines[0].port.now() - TORQUE_AGE
        return [one if told else Torque.UNKNOWN for one, told in zip(self._torque, known, strict=True)]

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
        if now >= self._looked + TORQUE_PERIOD:
            self._looked = now
            for line in self._lines:
                self._look_at_torque(line)
        states = self._readings.states(now)
        self.losses += ~states.valid
        return states

    def _look_at_torque(self, line: BusLine) -> None:
        """Ask everybody who answers on a line for torque, and whether a watchdog has stopped it."""
        valid = self._readings.valid
        heard = [device for device in line.servos if valid[line.index_of[device]]]
        on = line.read_all(_register(line, "torque_enable"), heard)
        watched = [device for device in on if line.tables[device].has("bus_watchdog")]
        watchdogs = line.read_all(_register(line, "bus_watchdog"), watched) if watched else {}
        for device, value in on.items():
            held = value and watchdogs.get(device, 0) < 0
            index = line.index_of[device]
            self._torque[index] = Torque.HELD if held else Torque.ON if value else Torque.OFF
            self._torque_at[index] = line.port.now()


def _register(line: BusLine, name: str) -> Register:
    """The servos of a line that have it keep it in one place."""
    return next(table[name] for table in line.tables.values() if table.has(name))
