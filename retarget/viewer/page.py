"""What the pages of live and recorded runs share, and the page of a recorded run: timeline, scene and plot."""

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from hardware.clock import Clock
from retarget.types import FloatArray
from retarget.viewer.colours import LEGEND, legend
from retarget.viewer.drawing import Drawing
from retarget.viewer.joint_plot import JointPlot
from retarget.viewer.recorded import ShownRun
from retarget.viewer.snapshot import Snapshot

if TYPE_CHECKING:
    import viser


# What both pages have in their panel: what the robot does in large letters, and what of the scene is shown.

COLOURS = {"following": "#1b7f4b", "stopping": "#b3261e", "stopped": "#b3261e", "ended": "#5f6368"}
OTHERWISE = "#b26a00"
LARGE = "font-size:2em;font-weight:700;line-height:1.1;overflow-wrap:anywhere"
BOX = "padding:0.3em 0.8em"


def waiting(state: str) -> str:
    """A state of a run in which nothing moves yet."""
    word = escape(state.upper())
    return f'<div style="{BOX}"><div style="{LARGE};color:{OTHERWISE}">{word}</div>nothing has moved yet</div>'


def headline(snapshot: Snapshot, note: str = "") -> str:
    """What the robot does, in letters that are read from across a room. note: a line below."""
    colour = COLOURS.get(snapshot.state, OTHERWISE)
    lines = [f'<span style="font-variant-numeric:tabular-nums">{snapshot.time:.2f} s</span>']
    if not np.isnan(snapshot.off):
        lines.append(f"servos at most {np.degrees(snapshot.off):.1f} degrees off their goals")
    lines += [escape(note)] if note else []
    return (
        f'<div style="{BOX}"><div style="{LARGE};color:{colour}">{escape(snapshot.state.upper())}</div>'
        f"<div>{escape(snapshot.why)}</div>"
        + "".join(f'<div style="opacity:0.75">{line}</div>' for line in lines)
        + "</div>"
    )


def add_parts(server: "viser.ViserServer", drawing: Drawing) -> None:
    """A box for everything that can be hidden, and what the colours mean."""
    gui = server.gui
    with gui.add_folder("what is shown"):
        boxes = {part: gui.add_checkbox(LEGEND[part].box, True) for part in drawing.parts}
    with gui.add_folder("what it means"):
        meaning = gui.add_html("")

    def see(part: str) -> None:
        drawing.see(part, visible=bool(boxes[part].value))
        explain()

    def explain() -> None:
        meaning.content = legend((part for part, box in boxes.items() if box.value), drawing.limb_keys)

    for part, box in boxes.items():
        box.on_update(lambda _, part=part: see(part))  # type: ignore[misc]
    explain()


# Which row of a recording is shown now: playing over and over at any speed, standing, stepping.


class Timeline:
    """times (T,): of the rows, s, rising. Plays by the clock that `at` is called with."""

    def __init__(self, times: FloatArray) -> None:
        assert times.size > 0
        self._times = times
        self._here = float(times[0])
        self._last: float | None = None  # s of the clock, while it plays
        self.speed = 1.0

    @property
    def playing(self) -> bool:
        """Whether time goes by."""
        return self._last is not None

    @property
    def row(self) -> int:
        """The row that is shown."""
        return max(int(np.searchsorted(self._times, self._here, side="right")) - 1, 0)

    def play(self, now: float) -> None:
        """Go on, at `now` s."""
        self._last = now

    def pause(self) -> None:
        """Let the timeline stand."""
        self._last = None

    def go_to(self, row: int) -> None:
        """Show a row, the nearest that there is; go on from there if it plays."""
        self._here = float(self._times[min(max(row, 0), len(self._times) - 1)])

    def step(self, rows: int) -> None:
        """Stand, so many rows on (or back)."""
        self.pause()
        self.go_to(self.row + rows)

    def at(self, now: float) -> int:
        """The row for `now`, s."""
        if self._last is None:
            return self.row
        self._here += self.speed * max(now - self._last, 0.0)
        self._last = now
        first, last = float(self._times[0]), float(self._times[-1])
        if self._here > last:
            self._here = first + (self._here - first) % (last - first) if last > first else first
        return self.row


SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
PLAY = "play / pause"


class RecordedPage:
    """A recorded run on a page: `tick` shows the row of now to all connected browsers."""

    def __init__(self, server: "viser.ViserServer", viewed: ShownRun, clock: Clock) -> None:
        self._server, self._viewed, self._clock = server, viewed, clock
        self._timeline = Timeline(viewed.times)
        self._shown = -1
        gui, last = server.gui, len(viewed.times) - 1
        self._state = gui.add_html(headline(viewed.snapshot(0)))
        self._slider = gui.add_slider("tick", 0, max(last, 1), 1, 0, disabled=last == 0)
        self._slider.on_update(self._slid)
        buttons = gui.add_button_group("", (PLAY, "-1", "+1"))
        buttons.on_click(lambda event: self._pressed(str(event.target.value)))
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        speed.on_update(lambda _: setattr(self._timeline, "speed", float(speed.value)))
        self._drawing = Drawing(server, viewed.cast)
        add_parts(server, self._drawing)
        if viewed.cast.joints:
            JointPlot(server, viewed.cast, lambda: viewed)
        self._timeline.play(clock.now())
        self._show(0)

    def tick(self) -> None:
        """Show the row of now; nothing, while no browser is connected."""
        row = self._timeline.at(self._clock.now())
        if row != self._shown and self._server.get_clients():
            self._show(row)

    def _show(self, row: int) -> None:
        self._shown = row
        snapshot = self._viewed.snapshot(row)
        self._drawing.show(snapshot)
        self._state.content = headline(snapshot)
        if self._slider.value != row:
            self._slider.value = row  # type: ignore[misc]  # viser's own examples set it

    def _slid(self, event: "viser.GuiEvent[viser.GuiSliderHandle[int]]") -> None:
        if event.client_id is not None:  # a person, and not `tick`
            self._timeline.pause()
            self._timeline.go_to(int(self._slider.value))

    def _pressed(self, button: str) -> None:
        if button in ("-1", "+1"):
            self._timeline.step(int(button))
        elif self._timeline.playing:
            self._timeline.pause()
        else:
            self._timeline.play(self._clock.now())
