"""The bounded queue between the tick and whoever writes: rows that are filled in place and never wait for a disk."""

import threading

import numpy as np

from retarget.recording.cycles import Cycles, Done, Shape

__all__ = ["Ring"]

ROWS = 1024
"""Eight seconds at 125 Hz."""


class Ring:
    """One thread fills the row `at` of `rows` and turns to the next; another one takes those that are finished.

    lost: finished rows for which there was no room. patient: who fills waits for room instead; for runs in which time
    is not real. index: number of the row that is being filled, lost ones counted.
    """

    def __init__(self, shape: Shape, *, patient: bool = False, rows: int = ROWS) -> None:
        self.rows = Cycles.empty(rows, shape)
        self.at = self.index = self.lost = 0
        self.wanted = threading.Event()
        """Set when it is time to take rows."""
        self._size = rows
        self._patient = patient
        self._finished = self._taken = 0
        self._room = threading.Event()
        self._closed = False

    def turn(self) -> None:
        """The row is finished: go to the next one, which is as if nothing had happened."""
        if self._finished + 1 - self._taken >= self._size and not self._wait():
            self.lost += 1
        else:
            self._finished += 1
            if 2 * (self._finished - self._taken) >= self._size:
                self.wanted.set()
        self.index += 1
        self.at = self._finished % self._size
        rows, at = self.rows, self.at
        rows.index[at] = self.index
        rows.readings[at] = rows.asked[at] = 0
        rows.sampled[at] = rows.read[at] = rows.written[at] = Done.NOT
        rows.kept[at] = False

    def take(self) -> Cycles:
        """The rows that are finished and were not taken before, as copies."""
        first, last = self._taken, self._finished
        taken = self.rows.taken(np.arange(first, last) % self._size)
        self._taken = last
        self._room.set()
        return taken

    def close(self) -> None:
        """Nobody takes rows any more: nobody waits for it."""
        self._closed = True
        self._room.set()

    def _wait(self) -> bool:
        """Whether there is room now, for somebody who may wait for it."""
        while self._patient:
            self._room.clear()
            if self._finished + 1 - self._taken < self._size:
                return True
            if self._closed:
                break
            self.wanted.set()
            self._room.wait()
        return False
