"""What the pages of live and recorded runs share, and the page of a recorded run: timeline, scene and plot."""

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from hardware.clock import Clock
from retarget.viewer.colours import legend
from retarget.viewer.drawing import Drawing
from retarget.viewer.joint_plot import JointPlot
from retarget.viewer.recorded import ShownRun
from retarget.viewer.snapshot import Cast, Rows, Snapshot, snapshot_at

if TYPE_CHECKING:
    import viser


# What the robot does, in letters that are read from across a room.

COLOURS = {"following": "#1b7f4b", "stopping": "#b3261e", "stopped": "#b3261e", "ended": "#5f6368"}
OTHERWISE = "#b26a00"
LARGE = "font-size:2em;font-weight:700;line-height:1.1;overflow-wrap:anywhere"


def headline(state: str, *lines: str) -> str:
    """A state of the run, and lines below it."""
    letters = f'<div style="{LARGE};color:{COLOURS.get(state, OTHERWISE)}">{escape(state.upper())}</div>'
    below = "".join(f'<div style="font-variant-numeric:tabular-nums">{escape(line)}</div>' for line in lines if line)
    return f'<div style="padding:0.3em 0.8em">{letters}{below}</div>'


def headline_of(snapshot: Snapshot, *notes: str) -> str:
    """What the robot does, why, when, and how far its servos are off. notes: lines below."""
    off = () if np.isnan(snapshot.off) else (f"servos at most {np.degrees(snapshot.off):.1f} degrees off their goals",)
    return headline(str(snapshot.doing), str(snapshot.reason), f"{snapshot.time:.2f} s", *off, *notes)


class Page:
    """Rows of a run in the scene, in the letters `state` and in the plot of a page, and what of them is shown."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, rows: Rows, state: "viser.GuiHtmlHandle") -> None:
        self._cast, self._rows, self._state = cast, rows, state
        self._drawing = Drawing(server, cast)
        with server.gui.add_folder("what is shown"):
            for part in self._drawing.parts:
                box = server.gui.add_checkbox(part, True)
                box.on_update(lambda event, part=part: self._drawing.see(part, visible=event.target.value))  # type: ignore[misc]
        with server.gui.add_folder("what it means"):
            server.gui.add_html(legend(self._drawing.keys))
        self.plot = JointPlot(server, cast, rows) if cast.joints else None

    def show(self, row: int, *notes: str, balanced_at: int | None = None) -> None:
        """Show a row. notes: lines below the letters; balanced_at: as of `snapshot_at`."""
        snapshot = snapshot_at(self._rows, self._cast, row, balanced_at=balanced_at)
        self._drawing.show(snapshot)
        self._state.content = headline_of(snapshot, *notes)


SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
PLAY = "play / pause"


class RecordedPage:
    """A recorded run on a page, which plays over and over at any speed, stands, or goes step by step: `tick` shows the
    row of now to all connected browsers."""

    def __init__(self, server: "viser.ViserServer", run: ShownRun, clock: Clock) -> None:
        self._server, self._clock, self._times = server, clock, run.time
        self._here, self._shown = float(run.time[0]), 0
        self._played: float | None = clock.now()
        """Until when it was played, s of the clock; None: it stands."""
        gui, last = server.gui, len(run) - 1
        state = gui.add_html("")
        self._slider = gui.add_slider("tick", 0, max(last, 1), 1, 0, disabled=last == 0)
        self._slider.on_update(self._slid)
        buttons = gui.add_button_group("", (PLAY, "-1", "+1"))
        buttons.on_click(lambda event: self._pressed(str(event.target.value)))
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self._page = Page(server, run.cast, run, state)
        self._page.show(0)

    def tick(self) -> None:
        """Show the row of now; nothing, while no browser is connected."""
        if self._played is not None:
            now, (first, last) = self._clock.now(), self._times[[0, -1]].tolist()
            further = self._here - first + float(self._speed.value) * (now - self._played)
            self._here, self._played = first + (further % (last - first) if last > first else 0.0), now
        row = self._row
        if row != self._shown and self._server.get_clients():
            self._shown = row
            self._page.show(row)
            if self._slider.value != row:
                self._slider.value = row  # type: ignore[misc]  # viser's own examples set it

    @property
    def _row(self) -> int:
        return max(int(np.searchsorted(self._times, self._here, side="right")) - 1, 0)

    def _stand_at(self, row: int) -> None:
        """Stand at a row, the nearest that there is."""
        self._played, self._here = None, float(self._times[min(max(row, 0), len(self._times) - 1)])

    def _slid(self, event: "viser.GuiEvent[viser.GuiSliderHandle[int]]") -> None:
        if event.client_id is not None:  # a person, and not `tick`
            self._stand_at(int(self._slider.value))

    def _pressed(self, button: str) -> None:
        if button != PLAY:
            self._stand_at(self._row + int(button))
        else:
            self._played = self._clock.now() if self._played is None else None
