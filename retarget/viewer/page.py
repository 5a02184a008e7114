"""The panel of the page: what the robot does in large letters, the timeline, what is shown, and a plot of one joint."""

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from hardware.clock import Clock
from retarget.rotations import FloatArray
from retarget.viewer.drawing import Drawing
from retarget.viewer.moment import Moment, Viewed
from retarget.viewer.timeline import Timeline

if TYPE_CHECKING:
    import viser

__all__ = ["RecordedPage", "add_curves", "add_parts", "headline"]

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
PLOTTED = 1500
"""Points of a plot, at most."""
COLOURS = {"following": "#1b7f4b", "stopping": "#b3261e", "stopped": "#b3261e"}
OTHERWISE = "#b26a00"
LABELS = {
    "robot": "robot, as its servos say",
    "goal": "goal that was sent",
    "performer": "performer, as tall as the robot",
    "asked": "asked of hands, feet, head",
    "reached": "reached by the goal",
    "balance": "centre of mass",
    "soles": "support polygon",
    "observers": "observers and their influence",
    "warmth": "warm servos in red",
    "around": "obstacles",
}
HIDDEN_AT_FIRST = ("observers",)


class RecordedPage:
    """A recorded run on a page: `run` plays it until it is asked to stop."""

    def __init__(self, server: "viser.ViserServer", viewed: Viewed, clock: Clock) -> None:
        self._viewed, self._clock, self._timeline = viewed, clock, Timeline(viewed.times)
        first = viewed.moment(0)
        self._drawing = Drawing(server, viewed.cast, first)
        self._shown = -1
        gui = server.gui
        self._state = gui.add_html(headline(first))
        last = len(viewed.times) - 1
        self._slider = gui.add_slider("tick", 0, max(last, 1), 1, 0, disabled=last == 0)
        self._slider.on_update(self._slid)
        buttons = gui.add_button_group("", ("play / pause", "-1", "+1"))
        buttons.on_click(lambda event: self._pressed(str(event.target.value)))
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        speed.on_update(lambda _: setattr(self._timeline, "speed", float(speed.value)))
        loops = gui.add_checkbox("over and over", True)
        loops.on_update(lambda _: setattr(self._timeline, "loops", loops.value))
        add_parts(server, self._drawing)
        if viewed.cast.joints:
            self._add_plot(server)
        self._timeline.play(clock.now())

    def tick(self) -> None:
        """Show what is to be shown now."""
        row = self._timeline.at(self._clock.now())
        if row == self._shown:
            return
        self._shown = row
        moment = self._viewed.moment(row)
        self._drawing.show(moment)
        self._state.content = headline(moment)
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

    def _add_plot(self, server: "viser.ViserServer") -> None:
        joints = self._viewed.cast.joints
        with server.gui.add_folder("joint"):
            chosen = server.gui.add_dropdown("joint", joints)
            plot = add_curves(server, self._curves(0))
            chosen.on_update(lambda _: setattr(plot, "data", self._curves(joints.index(chosen.value))))

    def _curves(self, joint: int) -> tuple[FloatArray, ...]:
        sent, present = self._viewed.track(joint)
        rows = np.unique(np.linspace(0, len(sent) - 1, PLOTTED).astype(int))
        return self._viewed.times[rows], np.degrees(sent[rows]), np.degrees(present[rows])


def add_parts(server: "viser.ViserServer", drawing: Drawing) -> None:
    """A box for everything that can be hidden."""
    with server.gui.add_folder("what is shown"):
        for part in drawing.parts:
            box = server.gui.add_checkbox(LABELS[part], part not in HIDDEN_AT_FIRST)
            drawing.see(part, visible=bool(box.value))
            box.on_update(
                lambda _, part=part, box=box: drawing.see(part, visible=bool(box.value))  # type: ignore[misc]
            )


def add_curves(server: "viser.ViserServer", curves: tuple[FloatArray, ...]) -> "viser.GuiUplotHandle":
    """A plot of one joint. curves (T,) each: s; degrees sent, and of the servo."""
    from viser import uplot

    return server.gui.add_uplot(
        curves,
        (
            uplot.Series(label="s"),
            uplot.Series(label="sent", stroke="#f29e2e", width=2),
            uplot.Series(label="servo", stroke="#4a6284", width=1),
        ),
        scales={"x": uplot.Scale(time=False)},
        title="degrees",
        aspect=1.3,
    )


def headline(moment: Moment) -> str:
    """What the robot does, in letters that are read from across a room."""
    colour = COLOURS.get(moment.state, OTHERWISE)
    off = "" if np.isnan(moment.off) else f"servos {np.degrees(moment.off):.1f} degrees off their goals at most"
    return (
        f'<div style="padding:0.3em 0.8em"><div style="font-size:2em;font-weight:700;line-height:1.1;color:{colour}">'
        f"{escape(moment.state.upper())}</div><div>{escape(moment.why)}</div>"
        f'<div style="font-variant-numeric:tabular-nums;opacity:0.75">{moment.time:.2f} s</div>'
        f'<div style="opacity:0.75">{off}</div></div>'
    )
