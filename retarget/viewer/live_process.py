"""The process that serves the page of a run: `main([FD])`, its setup as JSON on stdin.

FD is its end of the pair of sockets that `feed` has the other end of; when that one is closed, it ends.
"""

import json
import os
import select
import signal
import socket
import sys
from contextlib import suppress

from hardware.clock import MonotonicClock
from retarget.body_file import Root, compile_body, compile_body_text
from retarget.errors import RetargetError
from retarget.robot_body import load_robot
from retarget.scene import load_scene
from retarget.scene_shapes import scene_shapes
from retarget.viewer.feed import LONGEST_MESSAGE, READY, REFUSED, STOP, Announced, PageSetup
from retarget.viewer.live_page import LivePage
from retarget.viewer.moment import Cast, Obstacle, actor, obstacles
from retarget.viewer.server import open_server
from retarget.viewer.wire import RowSizes, unpack

NICENESS = 5
"""The run comes first; but whoever presses the button must not wait behind everybody."""
LAST_SHOWN_S = 1.5
"""So long the end stays on the page: whoever looks sees why."""
LONGEST_ROW = 1 << 16


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
        setup = _setup(sys.stdin.read())
        cast = _cast(setup)
        server, address = open_server(setup.port, title=setup.title, option="--view")
    except RetargetError as error:
        link.send(REFUSED + str(error).encode()[: LONGEST_MESSAGE - len(REFUSED)])
        return 2
    page = LivePage(server, cast, stop)  # whole before the run begins: it is work that the run would feel
    link.send(READY + address.encode())
    first = link.recv(LONGEST_ROW)
    if first:
        told = announced(first)
        page.name_landmarks(told.landmarks)
        _serve(link, page, _sizes(cast, told))
        page.end("The run has ended: this page, too")
        server.flush()
        clock = MonotonicClock()
        clock.sleep_until(clock.now() + LAST_SHOWN_S)
    return 0


def announced(message: bytes) -> Announced:
    """What the run says of its rows."""
    told = json.loads(message)
    return Announced(tuple(told["landmarks"]), told["observers"], told["around"], told["truth"])


def _sizes(cast: Cast, told: Announced) -> RowSizes:
    robot = cast.profile
    return RowSizes(
        robot=0 if robot is None else robot.body.nq,
        human=cast.human.body.nq,
        servos=len(cast.joints),
        landmarks=len(told.landmarks),
        observers=told.observers,
        around=told.around,
        truth=told.truth,
        sensors=len(cast.sensors),
    )


def _serve(link: socket.socket, page: LivePage, sizes: RowSizes) -> None:
    """Show the newest row, again and again, until the run has ended."""
    ended = False
    while not ended:
        newest = link.recv(LONGEST_ROW)
        while newest and not ended and select.select([link], [], [], 0.0)[0]:  # what is older is not shown any more
            later = link.recv(LONGEST_ROW)
            ended, newest = not later, later or newest
        row = unpack(newest, sizes)
        if row is not None:
            page.show(row)
        ended = ended or not newest


def _setup(text: str) -> PageSetup:
    return PageSetup(**json.loads(text))


def _cast(setup: PageSetup) -> Cast:
    human = actor(compile_body_text(setup.human_mjcf, source="human of the run", root="free"))
    if not setup.robot:
        return Cast(setup.title, None, human, (), (), around=_around(setup.scene), sensors=tuple(setup.sensors))
    roots: dict[str, Root] = {"free": "free", "fixed": "fixed", "suspended": "suspended"}
    root = roots.get(setup.root)
    robot = load_robot(setup.robot, root=root)
    shown = actor(compile_body(robot.profile.body_path, root=root or robot.profile.root))
    around, joints = _around(setup.scene), robot.joint_map.joints
    return Cast(setup.title, shown, human, joints, (), robot, around, setup.simulated, tuple(setup.sensors))


def _around(scene: str) -> tuple[Obstacle, ...]:
    """The obstacles of a scene; rows tell where they are."""
    return obstacles(scene_shapes(load_scene(scene))) if scene else ()
