"""The page of a run that goes on: what the robot does in large letters, a button that can only stop it, and the last
seconds of one joint."""

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from retarget.rotations import FloatArray
from retarget.viewer.drawing import Drawing
from retarget.viewer.moment import Cast, Moment
from retarget.viewer.page import add_curves, add_parts, headline
from retarget.viewer.wire import LiveRow

if TYPE_CHECKING:
    import viser

__all__ = ["LivePage", "moment_of"]

KEPT_S = 20.0
"""Of the plot."""
PLOTTED_EVERY = 12
"""Moments from one drawing of the plot to the next."""
MOST_KEPT = 2000


class LivePage:
    """Shows one row after the other. stop: called when somebody presses the button."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, stop: Callable[[], object]) -> None:
        self._server, self._cast, self._stop = server, cast, stop
        self._state = server.gui.add_html("<p>nothing has moved yet</p>")
        self._button = server.gui.add_button(
            "STOP THE ROBOT", color="red", hint="It can only stop it: brake, rest, off"
        )
        self._button.on_click(lambda _: self._pressed())
        self._drawing: Drawing | None = None
        self._kept: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=MOST_KEPT)
        self._begun: float | None = None
        self._shown = 0
        self._chosen: viser.GuiDropdownHandle[str] | None = None
        self._plot: viser.GuiUplotHandle | None = None

    def show(self, row: LiveRow) -> None:
        """The newest of what happened."""
        self._begun = row.time if self._begun is None else self._begun
        moment = moment_of(row, self._cast, begun=self._begun)
        if self._drawing is None:
            self._drawing = Drawing(self._server, self._cast, moment)
            add_parts(self._server, self._drawing)
            if self._cast.joints:
                self._add_plot()
        self._drawing.show(moment)
        self._state.content = headline(moment)
        self._kept.append((moment.time, moment.sent, moment.present))
        while self._kept[0][0] < moment.time - KEPT_S:
            self._kept.popleft()
        self._shown += 1
        if self._shown % PLOTTED_EVERY == 0:
            self._draw_plot()

    def end(self, why: str) -> None:
        """The run is over."""
        self._button.disabled = True
        self._state.content += f"<p style='padding:0 0.8em'>{why}</p>"

    def _pressed(self) -> None:
        self._stop()
        self._button.label = "STOPPING"

    def _add_plot(self) -> None:
        gui = self._server.gui
        with gui.add_folder("joint"):
            self._chosen = gui.add_dropdown("joint", self._cast.joints)
            self._chosen.on_update(lambda _: self._draw_plot())
            self._plot = add_curves(self._server, (np.zeros(2), np.zeros(2), np.zeros(2)))

    def _draw_plot(self) -> None:
        if self._plot is None or self._chosen is None or len(self._kept) < 2:
            return
        joint, kept = self._cast.joints.index(self._chosen.value), list(self._kept)
        time = np.array([at for at, _, _ in kept])
        sent = np.degrees([told[joint] for _, told, _ in kept])
        self._plot.data = (time, sent, np.degrees([there[joint] for _, _, there in kept]))


def moment_of(row: LiveRow, cast: Cast, *, begun: float) -> Moment:
    """What a row shows. begun: its time of the first, s."""
    robot, none = cast.profile, np.zeros(0)
    if robot is None:
        com = cast.human.body.solver_body().centre_of_mass(row.human[None])[0]
        nothing = np.full((len(cast.landmarks), 3), np.nan)
        return Moment(row.time - begun, row.state, none, none, row.human, none, none, nothing, nothing, com, row.why)
    columns, goal = robot.servo_columns, row.robot
    present = goal.copy()
    present[columns] = np.where(np.isfinite(row.present), row.present, goal[columns])
    return Moment(
        time=row.time - begun,
        state=row.state,
        robot=present,
        goal=goal,
        human=row.human,
        present=row.present,
        sent=goal[columns],
        asked=row.asked,
        reached=robot.points(goal[None], robot.landmark_frames(cast.landmarks))[0],
        com=robot.body.solver_body().centre_of_mass(goal[None])[0],
        why=row.why,
        modes=row.modes,
        temperature=row.temperature,
    )
