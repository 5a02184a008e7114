"""A bus without servos, for runs that only compute."""

import numpy as np

from hardware.arrays import TickArray
from hardware.bus import ServoGoals, ServoStates, check_open
from hardware.clock import Clock


class NoBus:
    """A `ServoBus` that answers every goal with itself. start: ticks (n,)."""

    def __init__(self, clock: Clock, *, start: TickArray) -> None:
        self._clock = clock
        self._position = np.array(start, dtype=np.int64)
        count = self._position.size
        self._zeros = np.zeros(count)
        self._unknown = np.full(count, np.nan)
        self._no_bits = np.zeros(count, dtype=np.uint8)
        self._all = np.ones(count, dtype=np.bool_)
        self._open = False

    def open(self) -> None:
        """See `ServoBus`."""
        self._open = True

    def read(self) -> ServoStates:
        """Return every servo at its goal. Currents, voltages and temperatures are unknown."""
        check_open(self._open, where="no bus")
        return ServoStates(
            time=self._clock.now(),
            position=self._position,
            velocity=self._zeros,
            current=self._unknown,
            voltage=self._unknown,
            temperature=self._unknown,
            error=self._no_bits,
            alert=self._no_bits,
            age=self._zeros,
            valid=self._all,
            driven=self._all,
        )

    def write(self, goals: ServoGoals) -> None:
        """See `ServoBus`."""
        check_open(self._open, where="no bus")
        self._position = goals.ticks

    def limit_drive(self, share: float) -> None:
        """See `ServoBus`."""

    def torque(self, on: bool) -> None:
        """See `ServoBus`."""

    def close(self) -> None:
        """See `ServoBus`."""
        self._open = False
