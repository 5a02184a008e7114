"""The page of a run that goes on, served by a process of its own: what the robot does in large letters, a button that
can only stop it, and the last seconds of one joint.

`python -m retarget.viewer.live_page FD PORT TITLE`: FD is its end of the pair of sockets that `feed` has the other end
of; when that one is closed, it ends.
"""

import os
import select
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from hardware.clock import MonotonicClock
from hardware.errors import RetargetError
from retarget.model.body import body_from_file
from retarget.model.body_file import compile_body_text
from retarget.model.meshes import solid_body
from retarget.model.robot import load_robot
from retarget.model.scene_shapes import scene_shapes
from retarget.run.table import RunTable
from retarget.schema.scene import load_scene
from retarget.viewer.feed import BUFFER_BYTES, LONGEST_ANSWER, READY, REFUSED, SHOWN_HZ, STOP, PageSetup, unpacked
from retarget.viewer.page import Page, headline
from retarget.viewer.server import open_server
from retarget.viewer.snapshot import Cast, obstacle_meshes

if TYPE_CHECKING:
    import viser


KEPT_S = 20.0
"""Of the plot."""
PLOTTED_EVERY = 25
"""Rows from one drawing of the plot to the next."""
STOP_WORDS, STOPPING_WORDS = "STOP THE ROBOT", "STOP IS ASKED FOR"


class LivePage:
    """Shows what the run says of itself. stop: called when the operator presses the button, which is there from the
    start."""

    def __init__(self, server: "viser.ViserServer", stop: Callable[[], object]) -> None:
        self._server, self._stop = server, stop
        self.state = server.gui.add_html("")
        self.button = server.gui.add_button(
            STOP_WORDS, color="red", hint="It can only stop: brake, come to rest, torque off"
        )
        self.button.on_click(self.pressed)
        self._page: Page | None = None
        self.rows: deque[RunTable] = deque(maxlen=round(KEPT_S * SHOWN_HZ))
        self._received = 0
        self.announce("waiting")

    async def pressed(self, _: object) -> None:  # in the thread that serves the browser: nothing comes between
        """The operator wants the run to stop."""
        self._stop()
        self.button.label = STOPPING_WORDS

    def announce(self, state: str) -> None:
        """Show a state of the run in which nothing moves yet."""
        self.state.content = headline(state, "nothing has moved yet")

    def begin(self, cast: Cast) -> None:
        """Robot and performer are known."""
        self._page = Page(self._server, cast, self.rows, self.state)

    def show(self, row: RunTable, *, newest: bool) -> None:
        """Keep a row; it is drawn if it is the newest, and a browser is connected."""
        assert self._page is not None, "a run says first who is seen"
        self.rows.append(row)
        self._received += 1
        if newest and (self._received == 1 or self._server.get_clients()):
            self._draw(self._page)
            if self._page.plot is not None and self._received % PLOTTED_EVERY == 0:
                self._page.plot.draw()

    def end(self) -> None:
        """The run is over; this stays to be seen for a while."""
        self.button.disabled = True
        if self._page is not None and self._received:
            self._draw(self._page, "The run has ended: this page, too")
            self._server.flush()
            clock = MonotonicClock()
            clock.sleep_until(clock.now() + LAST_SHOWN_S)

    def _draw(self, page: Page, *notes: str) -> None:
        """Draw the newest row, with the zero-moment point of the one before it."""
        newest = len(self.rows) - 1
        page.show(newest, *notes, balanced_at=max(newest - 1, 0))


NICENESS = 5
"""The run comes first, but a press of the button must not wait behind every other process."""
LAST_SHOWN_S = 1.5
"""So long the end stays on the page, with its reason."""


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
        page = LivePage(server, stop)
        link.send(READY + address.encode())
        serve(link, page)
    except RetargetError as error:
        link.send(REFUSED + str(error).encode()[: LONGEST_ANSWER - len(REFUSED)])
        return 2
    page.end()
    return 0


def serve(link: socket.socket, page: LivePage) -> None:
    """Show what the run says until it has ended. Raises RetargetError for what cannot be shown."""
    while message := link.recv(BUFFER_BYTES):
        said = unpacked(message)
        if isinstance(said, str):
            page.announce(said)
        elif isinstance(said, PageSetup):
            page.begin(cast_of(said))  # whole before the run goes on: this work would slow it
            link.send(READY)
        elif isinstance(said, RunTable):
            page.show(said, newest=not select.select([link], [], [], 0.0)[0])


def cast_of(setup: PageSetup) -> Cast:
    """Robot and performer of a run. Raises RetargetError for a robot or scene that cannot be read."""
    robot = None if setup.robot is None else load_robot(setup.robot, root=setup.root)
    human = compile_body_text(setup.human_mjcf, source="human of the run", root="free", own=True)
    return Cast(
        human=solid_body(body_from_file(human)),
        robot=None if robot is None else robot.solid,
        profile=robot,
        joints=() if robot is None else robot.joint_map.joints,
        landmarks=setup.landmarks,
        sensors=setup.sensors,
        obstacles=obstacle_meshes(scene_shapes(load_scene(setup.scene))) if setup.scene else (),
        servos_measure=setup.servos_measure,
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
