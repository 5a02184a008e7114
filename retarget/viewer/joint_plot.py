"""A plot of one joint on the page: its angle, how far it is off its goal, its servo's temperature or current."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from retarget.types import FloatArray
from retarget.viewer.colours import GOAL, ROBOT, web
from retarget.viewer.snapshot import Cast, Tracks

if TYPE_CHECKING:
    import viser


QUANTITIES = ("angle", "off its goal", "temperature", "current")
OF_ANGLES = QUANTITIES[:2]
"""Those of a run that knows no more of its servos than where they were."""
TITLES = {
    "angle": "degrees: goal and servo",
    "off its goal": "degrees between goal and servo",
    "temperature": "degrees Celsius",
    "current": "A",
}
LEAST_HEIGHT = 0.1
"""Of what a plot shows, in its unit: what trembles by less is flat."""
PLOTTED = 1500
"""Points of a plot, at most."""


class JointPlot:
    """cast: whose joints; track: what is known of one, by its number."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, track: Callable[[int], Tracks | None]) -> None:
        from viser import uplot

        self._joints, self._track = cast.joints, track
        with server.gui.add_folder("plot"):
            self._joint = server.gui.add_dropdown("joint", cast.joints)
            self._quantity = server.gui.add_dropdown("shows", QUANTITIES if cast.servos_commanded else OF_ANGLES)
            self._plot = server.gui.add_uplot(
                (np.zeros(2), np.zeros(2), np.zeros(2)),
                (
                    uplot.Series(label="s"),
                    uplot.Series(label="goal", stroke=web(GOAL), width=2),
                    uplot.Series(label="servo", stroke=web(ROBOT), width=1),
                ),
                scales={"x": uplot.Scale(time=False)},
                title=TITLES[QUANTITIES[0]],
                aspect=1.3,
            )
        self._reach = (0.0, 0.0)
        self._joint.on_update(lambda _: self.draw())
        self._quantity.on_update(lambda _: self.draw())
        self.draw()

    def draw(self) -> None:
        """Draw what is known by now."""
        tracks, quantity = self._track(self._joints.index(self._joint.value)), self._quantity.value
        if tracks is not None and len(tracks.time) > 1:
            self._plot.title = TITLES[quantity]
            shown = curves(tracks, quantity)
            self._reach_to(heights(*shown[1:]))
            self._plot.data = shown

    def _reach_to(self, reach: tuple[float, float]) -> None:
        """What the upright axis shows; the page makes the plot anew for another one."""
        from viser import uplot

        if reach != self._reach:
            self._reach = reach
            self._plot.scales = {"x": uplot.Scale(time=False), "y": uplot.Scale(range=reach)}


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


def curves(tracks: Tracks, quantity: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, what was sent and what the servo reported, for one of QUANTITIES, (P,) each; NaN: not known."""
    rows = np.unique(np.linspace(0, len(tracks.time) - 1, PLOTTED).astype(int))
    sent, present = np.degrees(tracks.sent[rows]), np.degrees(tracks.present[rows])
    nothing = np.full(len(rows), np.nan)
    shown = {
        "angle": (sent, present),
        "off its goal": (nothing, sent - present),
        "temperature": (nothing, tracks.temperature[rows]),
        "current": (nothing, tracks.current[rows]),
    }[quantity]
    return tracks.time[rows], *shown
