"""The page of a run that goes on: what the robot does in large letters, a button that can only stop it, and the last
seconds of one joint."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from retarget.rotations import FloatArray
from retarget.viewer.beside import in_truth
from retarget.viewer.drawing import Drawing
from retarget.viewer.joint_plot import JointPlot
from retarget.viewer.moment import Cast, Moment, Tracks
from retarget.viewer.panel import WAITING, add_parts, headline
from retarget.viewer.wire import LiveRow
from retarget.viewer.zero_moment import MassMotion

if TYPE_CHECKING:
    import viser

__all__ = ["LivePage", "moment_of"]

KEPT_S = 20.0
"""Of the plot."""
PLOTTED_EVERY, TOLD_EVERY = 25, 3
"""Moments from one drawing of the plot to the next, and of the letters while they say the same."""
MOST_KEPT = 2000
STOP_WORDS, STOPPING_WORDS = "STOP THE ROBOT", "STOP IS ASKED FOR"


class LivePage:
    """Shows one row after the other. stop: called when somebody presses the button."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, stop: Callable[[], object]) -> None:
        self._server, self._cast, self._stop = server, cast, stop
        self._state = server.gui.add_html(WAITING)
        self._button = server.gui.add_button(
            STOP_WORDS, color="red", hint="It can only stop: brake, come to rest, torque off"
        )
        self._button.on_click(self._pressed)
        self._drawing = Drawing(server, cast)
        add_parts(server, self._drawing)
        self._kept: deque[tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]] = deque(maxlen=MOST_KEPT)
        self._plot = JointPlot(server, cast, self._track) if cast.joints else None
        self._landmarks: tuple[str, ...] = ()
        self._mass = MassMotion()
        self._begun: float | None = None
        self._shown = 0
        self._said = ("", "")
        self._last: Moment | None = None

    def name_landmarks(self, names: Sequence[str]) -> None:
        """Of which landmarks rows tell."""
        self._landmarks = tuple(names)
        self._drawing.name_landmarks(names)

    def show(self, row: LiveRow) -> None:
        """The newest of what happened; it is drawn if anybody looks."""
        self._begun = row.time if self._begun is None else self._begun
        self._shown += 1
        self._keep(row)
        if self._last is None or self._server.get_clients():
            self._draw(row)

    def end(self, why: str) -> None:
        """The run is over."""
        self._button.disabled = True
        if self._last is not None:
            self._state.content = headline(self._last, why)

    def _draw(self, row: LiveRow) -> None:
        assert self._begun is not None
        self._last = moment = moment_of(row, self._cast, landmarks=self._landmarks, begun=self._begun, mass=self._mass)
        self._drawing.show(moment)
        said = (moment.state, moment.why)
        if said != self._said or self._shown % TOLD_EVERY == 0:
            self._said, self._state.content = said, headline(moment)
        if self._plot is not None and self._shown % PLOTTED_EVERY == 0:
            self._plot.draw()

    async def _pressed(self, _: object) -> None:  # of the thread that hears the browser: nothing comes between
        self._stop()
        self._button.label = STOPPING_WORDS

    def _keep(self, row: LiveRow) -> None:
        if self._cast.profile is None or self._begun is None:
            return
        sent = row.robot[self._cast.profile.servo_columns]
        self._kept.append((row.time - self._begun, sent, row.present, row.temperature, row.current))
        while self._kept[0][0] < self._kept[-1][0] - KEPT_S:
            self._kept.popleft()

    def _track(self, joint: int) -> Tracks | None:
        kept = list(self._kept)
        if not kept:
            return None
        time, *others = zip(*kept, strict=True)
        return Tracks(np.array(time), *(np.array([one[joint] for one in other]) for other in others))


def moment_of(row: LiveRow, cast: Cast, *, landmarks: tuple[str, ...], begun: float, mass: MassMotion) -> Moment:
    """What a row shows. begun: its time of the first, s. mass: of the rows before it."""
    robot, none, time = cast.profile, np.zeros(0), row.time - begun
    if robot is None:
        com = cast.human.body.solver_body().centre_of_mass(row.human[None])[0]
        nothing, zmp, said = np.full((len(landmarks), 3), np.nan), mass.look(row.time, com), row.sensors
        around = row.around if row.around.size else None
        alone = (none, none, row.human, none, none, nothing, nothing)
        return Moment(time, row.state, *alone, com, row.why, zmp, sensors=said, around=around)
    columns, goal = robot.servo_columns, row.robot
    there, pressure = goal.copy(), None
    there[columns] = np.where(np.isfinite(row.present), row.present, goal[columns])
    if row.truth.size and np.isfinite(row.truth[:-2]).all():
        there, pressure = in_truth(robot.body, goal, row.truth)
    com = robot.body.solver_body().centre_of_mass(goal[None])[0]
    return Moment(
        time=time,
        state=row.state,
        robot=there,
        goal=goal,
        human=row.human,
        present=row.present,
        sent=goal[columns],
        asked=row.asked,
        reached=robot.points(goal[None], robot.landmark_frames(landmarks))[0],
        com=com,
        why=row.why,
        zmp=mass.look(row.time, com),
        pressure=pressure,
        sensors=row.sensors,
        around=row.around if row.around.size else None,
        modes=row.modes,
        temperature=row.temperature,
        current=row.current,
    )
