"""The page of a recorded run: timeline, scene and plot."""

from typing import TYPE_CHECKING

from hardware.clock import Clock
from retarget.viewer.drawing import Drawing
from retarget.viewer.joint_plot import JointPlot
from retarget.viewer.moment import Viewed
from retarget.viewer.panel import add_parts, headline
from retarget.viewer.timeline import Timeline

if TYPE_CHECKING:
    import viser

__all__ = ["RecordedPage"]

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
PLAY = "play / pause"


class RecordedPage:
    """A recorded run on a page: `tick` shows what is to be shown now, to whoever looks."""

    def __init__(self, server: "viser.ViserServer", viewed: Viewed, clock: Clock) -> None:
        self._server, self._viewed, self._clock = server, viewed, clock
        self._timeline = Timeline(viewed.times)
        self._shown = -1
        gui, last = server.gui, len(viewed.times) - 1
        self._state = gui.add_html(headline(viewed.moment(0)))
        self._slider = gui.add_slider("tick", 0, max(last, 1), 1, 0, disabled=last == 0)
        self._slider.on_update(self._slid)
        buttons = gui.add_button_group("", (PLAY, "-1", "+1"))
        buttons.on_click(lambda event: self._pressed(str(event.target.value)))
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        speed.on_update(lambda _: setattr(self._timeline, "speed", float(speed.value)))
        loops = gui.add_checkbox("over and over", True)
        loops.on_update(lambda _: setattr(self._timeline, "loops", loops.value))
        self._drawing = Drawing(server, viewed.cast)
        add_parts(server, self._drawing)
        if viewed.cast.joints:
            JointPlot(server, viewed.cast, viewed.track)
        self._timeline.play(clock.now())
        self._show(0)

    def tick(self) -> None:
        """Show what is to be shown now; nothing, while nobody looks."""
        row = self._timeline.at(self._clock.now())
        if row != self._shown and self._server.get_clients():
            self._show(row)

    def _show(self, row: int) -> None:
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
