"""A plot of one joint on the page: its angle, how far it is off its goal, its servo's temperature or current."""

from typing import TYPE_CHECKING

import numpy as np

from retarget.types import FloatArray
from retarget.viewer.colours import GOAL, ROBOT, web
from retarget.viewer.snapshot import Cast, Rows

if TYPE_CHECKING:
    import viser


QUANTITIES = {
    "angle": "degrees: goal and servo",
    "off its goal": "degrees between goal and servo",
    "temperature": "degrees Celsius",
    "current": "A",
}
"""What can be plotted, and the title of its plot."""
OF_ANGLES = ("angle", "off its goal")
"""Those of a run that knows no more of its servos than where they were: those of a mock bus measure nothing else."""
LEAST_HEIGHT = 0.1
"""Least height of a plot, in its unit: what trembles by less is flat."""
PLOTTED = 1500
"""Points of a plot, at most."""


class JointPlot:
    """cast: whose joints; rows: what is known, and more may come."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, rows: Rows) -> None:
        from viser import uplot

        self._cast, self._rows, self._reach = cast, rows, (0.0, 0.0)
        with server.gui.add_folder("plot"):
            self._joint = server.gui.add_dropdown("joint", cast.joints)
            quantities = tuple(QUANTITIES) if cast.servos_measure else OF_ANGLES
            self._quantity = server.gui.add_dropdown("shows", quantities)
            self._plot = server.gui.add_uplot(
                (np.zeros(2), np.zeros(2), np.zeros(2)),
                (
                    uplot.Series(label="s"),
                    uplot.Series(label="goal", stroke=web(GOAL), width=2),
                    uplot.Series(label="servo", stroke=web(ROBOT), width=1),
                ),
                scales={"x": uplot.Scale(time=False)},
                title=QUANTITIES["angle"],
                aspect=1.3,
            )
        self._joint.on_update(lambda _: self.draw())
        self._quantity.on_update(lambda _: self.draw())
        self.draw()

    def draw(self) -> None:
        """Draw what is known by now."""
        from viser import uplot

        rows, quantity = self._rows, self._quantity.value
        if len(rows) < 2:
            return
        self._plot.title = QUANTITIES[quantity]
        shown = curves(rows, self._cast, self._cast.joints.index(self._joint.value), quantity)
        reach = heights(*shown[1:])
        if reach != self._reach:  # the page makes the plot anew for another one
            self._reach = reach
            self._plot.scales = {"x": uplot.Scale(time=False), "y": uplot.Scale(range=reach)}
        self._plot.data = shown


def heights(*values: FloatArray) -> tuple[float, float]:
    """Lowest and highest value to show, rounded outward so that a curve that grows seldom moves them.

    A page that had to find them itself would find none where one value is NaN, and show nothing at all.
    """
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    room = max(high - low, LEAST_HEIGHT)
    step = 0.5 * 10.0 ** np.floor(np.log10(room))
    edges = np.floor((low - 0.05 * room) / step), np.ceil((high + 0.05 * room) / step)
    return float(edges[0] * step), float(edges[1] * step)


def curves(rows: Rows, cast: Cast, joint: int, quantity: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Curves (P,) of one of QUANTITIES of a joint: time, s, what was sent and what its servo reported; NaN: not
    known."""
    shown = [rows[at] for at in np.unique(np.linspace(0, len(rows) - 1, PLOTTED).astype(int))]
    time, unknown = np.array([row.time for row in shown]), np.full(len(shown), np.nan)
    if quantity not in OF_ANGLES:
        values = [row.known.get(quantity) for row in shown]
        return time, unknown, np.array([np.nan if value is None else value[joint] for value in values])
    sent = np.degrees([row.q[cast.columns[joint]] for row in shown])
    present = np.degrees([row.present[joint] for row in shown])
    return (time, sent, present) if quantity == "angle" else (time, unknown, sent - present)
