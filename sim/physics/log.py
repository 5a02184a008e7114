"""What happened to a simulated robot, tick by tick, and the numbers that a report takes from it."""

from collections.abc import Callable, Sequence
from math import hypot

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray, FloatArray
from sim.physics.state import PhysicsState

__all__ = ["SLIP_RESOLUTION_M", "PhysicsLog"]

MAX_ROWS = 450_000
"""Most ticks that are kept, an hour at 125 Hz; the sums go on after them."""
BLOCK_ROWS = 4096
"""Room is made for so many at a time, and nothing is ever moved."""
SLIP_RESOLUTION_M = 1e-4
"""A sole that carries has slipped when its corners are this far from where they were: what trembles within does not add
up."""


LIFTED_S = 0.05
"""A sole that bears nothing for longer has been lifted: where it comes down, it has not slipped to. One that slides
trembles, and bears nothing for moments."""


class PhysicsLog:
    """Rows of states, in single precision but for the time; `rows` says how many.

    slip_m (k,): horizontal way of each sole while it carried, added up: the mean of its corners, each by what presses
    on it. So a sole slips that turns on its spot, and one that rocks on an edge that stays does not. worst_tilt: of a
    sole that carried, rad.
    most_torque (n,), hottest (n,): of each servo. self_contact_ticks: with links touching each other.
    """

    def __init__(
        self,
        *,
        servos: int,
        soles: int,
        corners: Sequence[int],
        nq: int,
        loaded: Callable[[FloatArray], BoolArray],
    ) -> None:
        """corners (c,): of which sole each corner is. loaded: which soles carry, by the load on each."""
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
        self._corners = [[row for row, of in enumerate(corners) if of == sole] for sole in range(soles)]
        self._anchors: list[list[tuple[float, float]] | None] = [None] * soles
        self._borne = [-np.inf] * soles  # when each carried last, s
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
        carries, tilts = self._loaded(state.load).tolist(), state.tilt.tolist()
        places, pressed = state.corner.tolist(), state.pressed.tolist()
        for sole, corners in enumerate(self._corners):
            if not carries[sole]:
                continue
            if state.time - self._borne[sole] > LIFTED_S:
                self._anchors[sole] = None
            self._borne[sole] = state.time
            self.worst_tilt = max(self.worst_tilt, tilts[sole])
            self._slide(sole, [places[row] for row in corners], [pressed[row] for row in corners])
        np.maximum(self.most_torque, np.abs(state.torque), out=self.most_torque)
        np.maximum(self.hottest, state.temperature, out=self.hottest)
        self.self_contact_ticks += state.self_contacts > 0
        self.fixture_contact_ticks += state.fixture_contacts > 0

    def _slide(self, sole: int, places: list[tuple[float, float]], pressed: list[float]) -> None:
        """Hold where the corners of a sole that carries are against where they were. In plain floats: they are few."""
        anchors, load = self._anchors[sole], sum(pressed)
        if anchors is None or load <= 0.0:  # it has just landed
            self._anchors[sole] = places
            return
        way = sum(force * hypot(x - u, y - v) for force, (x, y), (u, v) in zip(pressed, places, anchors, strict=True))
        if way > SLIP_RESOLUTION_M * load:
            self.slip_m[sole] += way / load
            self._anchors[sole] = places
