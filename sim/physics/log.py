"""What happened to a simulated robot, tick by tick, and the numbers that a report takes from it."""

from collections.abc import Callable
from math import hypot

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import FloatArray
from sim.physics.state import PhysicsState

__all__ = ["SLIP_RESOLUTION_M", "PhysicsLog"]

MAX_ROWS = 450_000
"""Most ticks that are kept, an hour at 125 Hz; the sums go on after them."""
BLOCK_ROWS = 4096
"""Room is made for so many at a time, and nothing is ever moved."""
SLIP_RESOLUTION_M = 1e-4
"""A sole that carries has slipped when it is this far from where it was: what trembles within does not add up."""


class PhysicsLog:
    """Rows of states, in single precision but for the time; `rows` says how many.

    slip_m: horizontal way of all soles while they carried, added up. worst_tilt: of a sole that carried, rad.
    most_torque (n,), hottest (n,): of each servo. self_contact_ticks: with links touching each other.
    """

    def __init__(self, *, servos: int, soles: int, nq: int, loaded: Callable[[FloatArray], FloatArray]) -> None:
        widths = {"q": nq, "root": 7, "com": 3, "zmp": 2, "load": soles, "sole": 3 * soles, "tilt": soles}
        widths |= {"torque": servos}
        self._slices: dict[str, slice] = {}
        self._width = 0
        for name, width in widths.items():
            self._slices[name] = slice(self._width, self._width + width)
            self._width += width
        self._blocks: list[NDArray[np.float32]] = []
        self._times: list[FloatArray] = []
        self._loaded = loaded
        self._anchor: list[tuple[float, float] | None] = [None] * soles
        self.rows = 0
        self.slip_m = np.zeros(soles)
        self.worst_tilt = 0.0
        self.most_torque = np.zeros(servos)
        self.hottest = np.full(servos, -np.inf)
        self.self_contact_ticks = 0
        self.fixture_contact_ticks = 0

    def add(self, state: PhysicsState) -> None:
        """Take a state."""
        self._sum(state)
        if self.rows == MAX_ROWS:
            return
        row = self.rows % BLOCK_ROWS
        if row == 0:
            self._blocks.append(np.zeros((BLOCK_ROWS, self._width), dtype=np.float32))
            self._times.append(np.zeros(BLOCK_ROWS))
        self._times[-1][row] = state.time
        np.concatenate(
            (
                state.q,
                state.root,
                state.com,
                state.zmp,
                state.load,
                state.sole.ravel(),
                state.tilt,
                state.torque,
            ),
            out=self._blocks[-1][row],
        )
        self.rows += 1

    def column(self, name: str) -> FloatArray:
        """The rows of one quantity of `PhysicsState`: time (rows,), else (rows, width); sole (rows, k, 3).

        Kept are time, q, root, com, zmp, load, sole, tilt and torque.
        """
        if name == "time":
            return np.concatenate(self._times)[: self.rows] if self._times else np.zeros(0)
        part = self._slices[name]
        blocks = [block[:, part] for block in self._blocks] or [np.zeros((0, part.stop - part.start), dtype=np.float32)]
        values = np.concatenate(blocks)[: self.rows].astype(np.float64)
        return values.reshape(self.rows, values.shape[1] // 3, 3) if name == "sole" else values

    def _sum(self, state: PhysicsState) -> None:
        """Sums and extremes."""
        carries, places, tilts = self._loaded(state.load).tolist(), state.sole.tolist(), state.tilt.tolist()
        for sole, (x, y, _) in enumerate(places):
            if not carries[sole]:
                self._anchor[sole] = None
                continue
            self.worst_tilt = max(self.worst_tilt, tilts[sole])
            anchor = self._anchor[sole]
            if anchor is None:  # it has just landed
                self._anchor[sole] = (x, y)
                continue
            way = hypot(x - anchor[0], y - anchor[1])
            if way > SLIP_RESOLUTION_M:
                self.slip_m[sole] += way
                self._anchor[sole] = (x, y)
        np.maximum(self.most_torque, np.abs(state.torque), out=self.most_torque)
        np.maximum(self.hottest, state.temperature, out=self.hottest)
        self.self_contact_ticks += state.self_contacts > 0
        self.fixture_contact_ticks += state.fixture_contacts > 0
