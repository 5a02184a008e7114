"""The page of a run that goes on: what the robot does in large letters, a button that can only stop it, and the last
seconds of one joint.
"""

import os
import select
import signal
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hardware.clock import MonotonicClock
from hardware.errors import RetargetError
from retarget.model.body_file import compile_body, compile_body_text
from retarget.model.robot import load_robot
from retarget.model.scene_shapes import scene_shapes
from retarget.schema.scene import load_scene
from retarget.viewer.drawing import Drawing
from retarget.viewer.feed import BUFFER_BYTES, LONGEST_MESSAGE, READY, REFUSED, STOP, PageSetup, unpacked
from retarget.viewer.joint_plot import JointPlot
from retarget.viewer.page import add_parts, headline, waiting
from retarget.viewer.server import open_server
from retarget.viewer.snapshot import Cast, Row, Snapshot, actor, obstacles, snapshot_at

if TYPE_CHECKING:
    import viser


KEPT_S = 20.0
"""Time, s, that the plot shows."""
PLOTTED_EVERY, HEADLINE_EVERY = 25, 3
"""Rows from one drawing of the plot to the next, and of the headline while its state stays the same."""
MOST_KEPT = 2000
"""Rows of the plot: KEPT_S at 100 rows a second."""
STOP_WORDS, STOPPING_WORDS = "STOP THE ROBOT", "STOP IS ASKED FOR"


class Opening:
    """What the page has from the start: what the run does in large letters, and a button. stop: called when the
    operator presses it."""

    def __init__(self, server: "viser.ViserServer", stop: Callable[[], object]) -> None:
        self._stop = stop
        self.state = server.gui.add_html(waiting("waiting"))
        self.button = server.gui.add_button(
            STOP_WORDS, color="red", hint="It can only stop: brake, come to rest, torque off"
        )
        self.button.on_click(self.pressed)

    async def pressed(self, _: object) -> None:  # in the thread that serves the browser: nothing comes between
        """The operator wants the run to stop."""
        self._stop()
        self.button.label = STOPPING_WORDS


class LivePage:
    """Shows one row after the other."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, opening: Opening) -> None:
        self._server, self._cast, self._button, self._state = server, cast, opening.button, opening.state
        self._drawing = Drawing(server, cast)
        add_parts(server, self._drawing)
        self._kept: deque[Row] = deque(maxlen=MOST_KEPT)
        self._plot = JointPlot(server, cast, lambda: list(self._kept)) if cast.joints else None
        self._begun: float | None = None
        self._shown = 0
        self._said = ("", "")
        self._last: Snapshot | None = None

    def show(self, row: Row) -> None:
        """Keep the newest row; it is drawn if a browser is connected."""
        self._begun = row.time if self._begun is None else self._begun
        self._shown += 1
        self._kept.append(replace(row, time=row.time - self._begun))
        while self._kept[0].time < self._kept[-1].time - KEPT_S:
            self._kept.popleft()
        if self._last is None or self._server.get_clients():
            self._draw()

    def end(self, why: str) -> None:
        """The run is over."""
        self._button.disabled = True
        if self._last is not None:
            self._state.content = headline(self._last, why)

    def _draw(self) -> None:
        """Draw the newest row, with the zero-moment point of the one before it."""
        times, newest = np.array([row.time for row in self._kept]), len(self._kept) - 1
        self._last = snapshot = snapshot_at(self._kept, times, newest, max(newest - 1, 0), self._cast)
        self._drawing.show(snapshot)
        said = (snapshot.state, snapshot.why)
        if said != self._said or self._shown % HEADLINE_EVERY == 0:
            self._said, self._state.content = said, headline(snapshot)
        if self._plot is not None and self._shown % PLOTTED_EVERY == 0:
            self._plot.draw()


# The process that serves the page of a run: `main([FD, PORT, TITLE])`.
#
# FD is its end of the pair of sockets that `feed` has the other end of; when that one is closed, it ends.

NICENESS = 5
"""The run comes first, but a press of the button must not wait behind every other process."""
LAST_SHOWN_S = 1.5
"""Time, s, that the end stays on the page, with its reason."""
LONGEST_ROW = 1 << 16
"""Bytes of a row of the largest robot, and more."""


def main(arguments: list[str]) -> int:
    """Serve until the run ends."""
    # It stays in the session of the run, in which alone its niceness counts (autogroups); signals are for the run.
    os.nice(NICENESS)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    link = socket.socket(fileno=int(arguments[0]))

    def stop() -> None:
        with suppress(OSError):
            link.send(STOP)

    try:
        server, address = open_server(int(arguments[1]), title=arguments[2])
        opening = Opening(server, stop)
        link.send(READY + address.encode())
        setup = _setup(link, opening)
        if setup is None:  # there was no performer
            return 0
        page = LivePage(server, _cast(setup), opening)  # whole before the run begins: this work would slow the run
    except RetargetError as error:
        link.send(REFUSED + str(error).encode()[: LONGEST_MESSAGE - len(REFUSED)])
        return 2
    link.send(READY)
    first = link.recv(LONGEST_ROW)
    if first:
        _serve(link, page, first)
        page.end("The run has ended: this page, too")
        server.flush()
        clock = MonotonicClock()
        clock.sleep_until(clock.now() + LAST_SHOWN_S)
    return 0


def _setup(link: socket.socket, opening: Opening) -> PageSetup | None:
    """Show the states of the run until there is something to be seen; None: it has ended before."""
    while message := link.recv(BUFFER_BYTES):
        said = unpacked(message)
        if isinstance(said, PageSetup):
            return said
        opening.state.content = waiting(str(said))
    return None


def _serve(link: socket.socket, page: LivePage, newest: bytes) -> None:
    """Show the newest row, again and again, until the run has ended. newest: what came first."""
    while newest:
        later = newest
        while later and select.select([link], [], [], 0.0)[0]:  # what is older is not shown any more
            later = link.recv(LONGEST_ROW)
            newest = later or newest
        row = unpacked(newest)
        assert isinstance(row, Row), "a run that has begun sends rows alone"
        page.show(row)
        newest = link.recv(LONGEST_ROW) if later else b""


def _cast(setup: PageSetup) -> Cast:
    robot = None if setup.robot is None else load_robot(setup.robot, root=setup.root)
    human = actor(compile_body_text(setup.human_mjcf, source="human of the run", root="free"))
    shapes = obstacles(scene_shapes(load_scene(setup.scene))) if setup.scene else {}
    cast = Cast(None, human, (), (), obstacles=shapes, simulated=setup.simulated, sensors=setup.sensors)
    if robot is None:
        return cast
    return replace(
        cast,
        robot=actor(compile_body(robot.profile.body_path, root=setup.root or robot.profile.root)),
        joints=robot.joint_map.joints,
        landmarks=tuple(robot.profile.landmarks),
        profile=robot,
        columns=robot.servo_columns,
    )
