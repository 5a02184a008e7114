"""What happened to a simulated robot, tick by tick, and the numbers that a report takes from it."""

from collections.abc import Callable

import numpy as np

from hardware.arrays import FloatArray
from sim.physics.state import PhysicsState

__all__ = ["SLIP_RESOLUTION_M", "PhysicsLog"]

MAX_ROWS = 2_000_000
"""Most ticks that are kept; the sums go on after them."""
FIRST_ROWS = 4096
SLIP_RESOLUTION_M = 1e-4
"""A sole that carries has slipped when it is this far from where it was: what trembles within does not add up."""


class PhysicsLog:
    """Rows of states; `rows` says how many. Arrays of properties are (rows, ...), as in `PhysicsState`.

    slip_m: horizontal way of all soles while they carried, added up. worst_tilt: of a sole that carried, rad.
    most_torque (n,), hottest (n,): of each servo. self_contact_ticks: with links touching each other.
    """

    def __init__(self, *, servos: int, soles: int, nq: int, loaded: Callable[[FloatArray], FloatArray]) -> None:
        widths = {"time": 1, "q": nq, "root": 7, "com": 3, "zmp": 2, "load": soles, "sole": 3 * soles, "tilt": soles}
        widths |= {"torque": servos, "temperature": servos}
        self._slices: dict[str, slice] = {}
        self._width = 0
        for name, width in widths.items():
            self._slices[name] = slice(self._width, self._width + width)
            self._width += width
        self._table = np.zeros((FIRST_ROWS, self._width))
        self._loaded = loaded
        self._anchor = np.full((soles, 2), np.nan)
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
        if self.rows == len(self._table):
            self._table = np.concatenate([self._table, np.zeros_like(self._table)])
        row = self._table[self.rows]
        np.concatenate(
            (
                (state.time,),
                state.q,
                state.root,
                state.com,
                state.zmp,
                state.load,
                state.sole.ravel(),
                state.tilt,
                state.torque,
                state.temperature,
            ),
            out=row,
        )
        self.rows += 1

    def column(self, name: str) -> FloatArray:
        """The rows of one quantity: time (rows,), else (rows, width); sole (rows, k, 3)."""
        values = self._table[: self.rows, self._slices[name]]
        if name == "time":
            return np.asarray(values[:, 0])
        return np.asarray(values.reshape(self.rows, -1, 3) if name == "sole" else values)

    def _sum(self, state: PhysicsState) -> None:
        """Sums and extremes."""
        carries = self._loaded(state.load)
        for sole, carrying in enumerate(carries):
            if not carrying:
                self._anchor[sole] = np.nan
                continue
            self.worst_tilt = max(self.worst_tilt, float(state.tilt[sole]))
            x, y = state.sole[sole, 0] - self._anchor[sole, 0], state.sole[sole, 1] - self._anchor[sole, 1]
            way = float(np.hypot(x, y))
            if way <= SLIP_RESOLUTION_M:
                continue
            if way == way:  # else it has just landed
                self.slip_m[sole] += way
            self._anchor[sole] = state.sole[sole, :2]
        np.maximum(self.most_torque, np.abs(state.torque), out=self.most_torque)
        np.maximum(self.hottest, state.temperature, out=self.hottest)
        self.self_contact_ticks += state.self_contacts > 0
        self.fixture_contact_ticks += state.fixture_contacts > 0
