"""The run's end of a page: what it does goes out, and nothing comes in but that the operator wants the run to stop.

The page is served by a process of its own. Between them is a pair of sockets whose ends never wait: what the other does
not take at once is dropped, so that a page that is slow, stopped or dead costs a tick nothing.
"""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.errors import ConfigError
from retarget.model.body_file import Root
from retarget.run.record import Record
from retarget.run.run_result import Extras
from retarget.viewer.snapshot import Row

SHOWN_HZ = 25.0
STOP = b"stop"
READY, REFUSED = b"ready ", b"refused "
START_S = 30.0
"""A page that is not there by then is not coming."""
LAST_ROW_S, ENDING_S = 0.2, 4.0
"""The last row is sent within the first of these, and the process of the page ends within the second, s."""
BUFFER_BYTES = 1 << 17
"""Room of the socket: two rows of the largest robot; what does not fit is dropped."""
LONGEST_ANSWER = 4096
"""Bytes of an answer of the page, and more."""


@dataclass(frozen=True)
class PageSetup:
    """Who and what is seen, once the performer is known. robot: name or file of the profile, None for a human alone;
    root: how it stands in the world, None as its profile says; scene: file or name. sensors: of the
    performer, and landmarks: of the robot, names."""

    robot: str | None
    root: Root | None
    scene: str | None
    human_mjcf: str
    sensors: tuple[str, ...] = ()
    landmarks: tuple[str, ...] = ()


def packed(message: PageSetup | Row | str) -> bytes:
    """A message to the process of the page, as JSON; a text is a state."""
    return json.dumps(message if isinstance(message, str) else vars(message), default=np.ndarray.tolist).encode()


def unpacked(data: bytes) -> PageSetup | Row | str:
    """The message of these bytes."""
    said = json.loads(data)
    if isinstance(said, str):
        return said
    lists: Any = tuple if "human_mjcf" in said else np.array
    known = {name: lists(value) if isinstance(value, list) else value for name, value in said.items()}
    return PageSetup(**known) if lists is tuple else Row(**known)


class ViewFeed:
    """link: to the process of the page (its number), which never waits while the run goes on."""

    def __init__(self, link: socket.socket, process: int) -> None:
        self.address, self.process = "", process
        self.extras = Extras()
        """What is not in the record."""
        self._link = link
        self._dt, self._every, self._ticks = 1.0 / SHOWN_HZ, 1, 0
        self.dropped = 0
        """Rows that the page did not take."""
        self._landmarks: tuple[str, ...] = ()
        self._stop = False
        self._last: tuple[Record, int] | None = None

    def announce(self, state: str) -> None:
        """Show a state of the run in which nothing moves yet."""
        with suppress(OSError):
            self._send(state)

    def begin(self, setup: PageSetup, *, rate_hz: float) -> None:
        """Wait until all that is seen is on the page. rate_hz: of the ticks. Raises ConfigError or what it refuses."""
        self._dt, self._every, self._landmarks = 1.0 / rate_hz, max(round(rate_hz / SHOWN_HZ), 1), setup.landmarks
        self.answer(setup)

    def on_row(self, record: Record, row: int) -> None:
        """A tick was kept in a row of the record; some times a second it is shown."""
        self._ticks += 1
        self._last = record, row
        if self._ticks % self._every:
            return
        try:
            self._show(record, row)
        except OSError:  # full, or gone
            self.dropped += 1

    def stop_asked(self) -> bool:
        """Whether the operator pressed the button of the page, ever."""
        try:
            if self._link.recv(LONGEST_ANSWER) == STOP:
                self._stop = True
        except OSError:  # no message, or no process
            pass
        return self._stop

    def end(self) -> None:
        """Show how it ended."""
        if self._last is not None:
            with suppress(OSError):
                self._link.settimeout(LAST_ROW_S)
                self._show(*self._last)

    def answer(self, *said: PageSetup) -> str:
        """Say something, if there is anything, and wait for what the page answers. Raises ConfigError for what it
        refuses."""
        self._link.settimeout(START_S)
        try:
            for message in said:
                self._send(message)
            while (answer := self._link.recv(LONGEST_ANSWER)) == STOP:
                self._stop = True
        except OSError as error:
            answer = f"the page did not open: {error}".encode()
        self._link.setblocking(False)
        if not answer.startswith(READY):
            why = answer.removeprefix(REFUSED).decode(errors="replace")
            raise ConfigError(why.removesuffix(".") or "the page did not open")
        return answer.removeprefix(READY).decode()

    def _show(self, record: Record, row: int) -> None:
        """Raises OSError where the page does not take it at once."""
        extras, human, robot = self.extras, record.human, record.robot
        (state, why), time = extras.words(), (self._ticks - 1) * self._dt
        known: dict[str, Any] = {"human": human.q[row], "sensors": human.sensors[row]}
        if robot is not None:
            asked = np.full((len(self._landmarks), 3), np.nan)
            asked[[self._landmarks.index(name) for name in robot.landmark_names]] = robot.landmarks_asked[row]
            known |= {"goal": robot.q[row], "modes": robot.observer_modes[row], "asked": asked}
            known |= {"present": robot.present[row], "temperature": robot.temperature[row]}
            known |= {"current": extras.current(), "truth": extras.truth()}
        self._send(Row(time=time, state=state, why=why, obstacle_poses=extras.obstacles(), **known))

    def _send(self, message: PageSetup | Row | str) -> None:
        self._link.send(packed(message))


@contextmanager
def open_feed(port: int, *, title: str) -> Iterator[ViewFeed]:
    """The page of a run, from now on; in the end it shows how the run ended, and ends by itself, or is ended.

    Raises ConfigError or what it refuses.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "retarget.viewer.live_page", str(theirs.fileno()), str(port), title],
            pass_fds=(theirs.fileno(),),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},  # the code that the run runs
        )
    try:
        with ours:
            feed = ViewFeed(ours, process.pid)
            feed.address = feed.answer()
            try:
                yield feed
            finally:
                feed.end()
    finally:
        try:
            process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
