"""The page of a run that goes on: what the robot does in large letters, a button that can only stop it, and the last
seconds of one joint.
"""

import json
import os
import select
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from hardware.clock import MonotonicClock
from hardware.errors import RetargetError
from retarget.model.body_file import Root, compile_body, compile_body_text
from retarget.model.robot import load_robot
from retarget.model.scene_shapes import scene_shapes
from retarget.run.run_result import in_truth
from retarget.schema.scene import load_scene
from retarget.types import FloatArray
from retarget.viewer.drawing import Drawing
from retarget.viewer.feed import LONGEST_MESSAGE, READY, REFUSED, STOP, Announced, LiveRow, PageSetup, RowSizes, unpack
from retarget.viewer.ground import MassMotion
from retarget.viewer.joint_plot import JointPlot
from retarget.viewer.page import WAITING, add_parts, headline
from retarget.viewer.server import open_server
from retarget.viewer.snapshot import Cast, Obstacle, Snapshot, Tracks, actor, obstacles

if TYPE_CHECKING:
    import viser


KEPT_S = 20.0
"""Of the plot."""
PLOTTED_EVERY, HEADLINE_EVERY = 25, 3
"""Rows from one drawing of the plot to the next, and of the headline while its state stays the same."""
MOST_KEPT = 2000
STOP_WORDS, STOPPING_WORDS = "STOP THE ROBOT", "STOP IS ASKED FOR"


class LivePage:
    """Shows one row after the other. stop: called when the operator presses the button."""

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
        self._last: Snapshot | None = None

    def name_landmarks(self, names: Sequence[str]) -> None:
        """Which landmarks the rows hold."""
        self._landmarks = tuple(names)
        self._drawing.name_landmarks(names)

    def show(self, row: LiveRow) -> None:
        """Keep the newest row; it is drawn if a browser is connected."""
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
        self._last = snapshot = snapshot_of(
            row, self._cast, landmarks=self._landmarks, begun=self._begun, mass=self._mass
        )
        self._drawing.show(snapshot)
        said = (snapshot.state, snapshot.why)
        if said != self._said or self._shown % HEADLINE_EVERY == 0:
            self._said, self._state.content = said, headline(snapshot)
        if self._plot is not None and self._shown % PLOTTED_EVERY == 0:
            self._plot.draw()

    async def _pressed(self, _: object) -> None:  # in the thread that serves the browser: nothing comes between
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


def snapshot_of(row: LiveRow, cast: Cast, *, landmarks: tuple[str, ...], begun: float, mass: MassMotion) -> Snapshot:
    """What a row shows. begun: its time of the first, s. mass: of the rows before it."""
    robot, none, time = cast.profile, np.zeros(0), row.time - begun
    if robot is None:
        com = cast.human.body.solver_body().centre_of_mass(row.human[None])[0]
        nothing, zmp, sensors = np.full((len(landmarks), 3), np.nan), mass.look(row.time, com), row.sensors
        poses = row.obstacle_poses if row.obstacle_poses.size else None
        alone = (none, none, row.human, none, none, nothing, nothing)
        return Snapshot(time, row.state, *alone, com, row.why, zmp, sensors=sensors, obstacle_poses=poses)
    columns, goal = robot.servo_columns, row.robot
    there, pressure = goal.copy(), None
    there[columns] = np.where(np.isfinite(row.present), row.present, goal[columns])
    if row.truth.size and np.isfinite(row.truth[:-2]).all():
        there, pressure = in_truth(robot.body, goal, row.truth)
    com = robot.body.solver_body().centre_of_mass(goal[None])[0]
    return Snapshot(
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
        obstacle_poses=row.obstacle_poses if row.obstacle_poses.size else None,
        modes=row.modes,
        temperature=row.temperature,
        current=row.current,
    )


# The process that serves the page of a run: `main([FD])`, its setup as JSON on stdin.
#
# FD is its end of the pair of sockets that `feed` has the other end of; when that one is closed, it ends.

NICENESS = 5
"""The run comes first, but a press of the button must not wait behind every other process."""
LAST_SHOWN_S = 1.5
"""So long the end stays on the page, with its reason."""
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
    page = LivePage(server, cast, stop)  # whole before the run begins: this work would slow the run
    link.send(READY + address.encode())
    first = link.recv(LONGEST_ROW)
    if first:
        sizes = announced(first)
        page.name_landmarks(sizes.landmarks)
        _serve(link, page, _sizes(cast, sizes))
        page.end("The run has ended: this page, too")
        server.flush()
        clock = MonotonicClock()
        clock.sleep_until(clock.now() + LAST_SHOWN_S)
    return 0


def announced(message: bytes) -> Announced:
    """What the run announces of its rows."""
    fields = json.loads(message)
    return Announced(tuple(fields["landmarks"]), fields["observers"], fields["obstacles"], fields["truth"])


def _sizes(cast: Cast, announced: Announced) -> RowSizes:
    robot = cast.profile
    return RowSizes(
        robot=0 if robot is None else robot.body.nq,
        human=cast.human.body.nq,
        servos=len(cast.joints),
        landmarks=len(announced.landmarks),
        observers=announced.observers,
        obstacles=announced.obstacles,
        truth=announced.truth,
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
        return Cast(setup.title, None, human, (), (), obstacles=_obstacles(setup.scene), sensors=tuple(setup.sensors))
    roots: dict[str, Root] = {"free": "free", "fixed": "fixed", "suspended": "suspended"}
    root = roots.get(setup.root)
    robot = load_robot(setup.robot, root=root)
    shown = actor(compile_body(robot.profile.body_path, root=root or robot.profile.root))
    scene, joints = _obstacles(setup.scene), robot.joint_map.joints
    return Cast(setup.title, shown, human, joints, (), robot, scene, setup.simulated, tuple(setup.sensors))


def _obstacles(scene: str) -> tuple[Obstacle, ...]:
    """The obstacles of a scene; rows hold where they are."""
    return obstacles(scene_shapes(load_scene(scene))) if scene else ()
