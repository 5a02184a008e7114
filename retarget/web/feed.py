"""The run's end of a page: what it does goes out, and what the operator asks for on the page comes in.

The page is served by a process of its own. Between them is a pair of sockets whose ends never wait: what the other does
not take at once is dropped, so that a page that is slow, stopped or dead costs a tick nothing.
"""

import json
import math
import os
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from operator import methodcaller
from typing import Any

import numpy as np

from hardware.errors import RetargetError
from retarget.errors import ConfigError, install_step
from retarget.model.robot import Mounting
from retarget.run.record import Record
from retarget.run.run_result import Extras
from retarget.run.table import RunTable
from retarget.types import RunState

SERVER = "retarget.web.server"
"""The module that serves the page."""
SHOWN = (
    *("human_q", "sensors", "q", "present", "landmarks_asked", "landmarks_reached", "observer_modes", "temperature"),
    *("current", "truth", "doing", "reason", "imu_orientation", "imu_valid"),
)
"""The fields of a row that a page shows, besides its time, obstacles and latency."""
STATE_WORDS = {
    RunState.APPROACH: "approaching",
    RunState.FOLLOW: "following",
    RunState.HOLD: "holding",
    RunState.STOPPING: "stopping",
    RunState.RETURN_TO_STANCE: "returning to its stance",
    RunState.GO_TO_REST: "going to rest",
    RunState.STANDING: "standing, with torque",
    RunState.FALLING: "falling",
    RunState.OFF: "ended",
    RunState.FAULT: "stopped",
}
"""What a robot does in a state of the run."""
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
MOST_WORDS = 1024
"""Words of the page that wait for the run: of a minute in which it hears none."""


@dataclass(frozen=True)
class Settings:
    """How the page is served. listen: on every interface, with HTTPS, and not on this machine alone. port: of TCP, 0
    for any. robot: name or file of its profile. performs: a browser may be the performer, and pause the robot; else it
    looks on, and can only stop it. dead_man: the robot moves only while it is held. stick: it walks as the pads ask.
    poses: number of the socket to the run for poses, -1: none."""

    listen: bool
    port: int
    robot: str
    performs: bool = True
    dead_man: bool = False
    stick: bool = False
    poses: int = -1


@dataclass(frozen=True)
class PageSetup:
    """Who and what is seen, once the performer is known. robot: name or file of the profile, None for a human alone;
    root: how it stands in the world, None as its profile says; scene: file or name. sensors: of the
    performer, and landmarks: of the robot, names. servos_measure: temperatures and currents."""

    robot: str | None
    root: Mounting | None
    scene: str | None
    human_mjcf: str
    sensors: tuple[str, ...] = ()
    landmarks: tuple[str, ...] = ()
    servos_measure: bool = True


@dataclass(frozen=True)
class Note:
    """What the run says to the people at the page: an instruction to the performer, a warning, how it ended."""

    note: str


ROW = b"\0"
"""Begins a row; anything else is JSON."""


def packed(message: PageSetup | RunTable | Note | str) -> bytes:
    """A message to the process of the page. A text is a state. Of a row: a line of JSON with its words and the types
    and shapes of its arrays, then their bytes."""
    if not isinstance(message, RunTable):
        return json.dumps(message if isinstance(message, str) else vars(message)).encode()
    known = message.known
    arrays = {name: value for name, value in known.items() if isinstance(value, np.ndarray) and value.dtype != object}
    kinds = {name: (value.dtype.str, value.shape) for name, value in arrays.items()}
    words = {name: value for name, value in known.items() if name not in arrays}
    head = json.dumps([words, kinds], default=methodcaller("tolist")).encode()
    return b"".join([ROW, head, b"\n", *(value.tobytes() for value in arrays.values())])


def unpacked(data: bytes) -> PageSetup | RunTable | Note | str:
    """The message of these bytes."""
    if data.startswith(ROW):
        head, _, body = data[1:].partition(b"\n")
        known, kinds = json.loads(head)
        at = 0
        for name, (kind, shape) in kinds.items():
            count = math.prod(shape)
            known[name] = np.frombuffer(body, kind, count, at).reshape(shape)
            at += known[name].nbytes
        return RunTable(**known)
    said = json.loads(data)
    if isinstance(said, str):
        return said
    if "note" in said:
        return Note(**said)
    lists: Any = {name: tuple(value) if isinstance(value, list) else value for name, value in said.items()}
    return PageSetup(**lists)


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
        self._words: deque[str] = deque(maxlen=MOST_WORDS)
        self._last: tuple[Record, int] | None = None

    def announce(self, state: str) -> None:
        """Show a state of the run in which nothing moves yet."""
        with suppress(OSError):
            self._send(state)

    def note(self, text: str) -> None:
        """Show a sentence."""
        with suppress(OSError):
            self._send(Note(text))

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
        self._hear()
        return self._stop

    def words(self) -> list[str]:
        """What else was said on the page since the last call, oldest first, at most MOST_WORDS."""
        self._hear()
        words = [*self._words]
        self._words.clear()
        return words

    def _hear(self) -> None:
        for _ in range(MOST_WORDS):
            try:
                word = self._link.recv(LONGEST_ANSWER)
            except OSError:  # no message, or no process
                return
            if not word:
                return
            self._take(word)

    def _take(self, word: bytes) -> None:
        if word == STOP:
            self._stop = True
        else:
            self._words.append(word.decode(errors="replace"))

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
            while (answer := self._link.recv(LONGEST_ANSWER)) and not answer.startswith((READY, REFUSED)):
                self._take(answer)
        except OSError as error:
            answer = f"the page did not open: {error}".encode()
        self._link.setblocking(False)
        if not answer.startswith(READY):
            why = answer.removeprefix(REFUSED).decode(errors="replace")
            raise ConfigError(why.removesuffix(".") or "the page did not open")
        return answer.removeprefix(READY).decode()

    def _show(self, record: Record, row: int) -> None:
        """Raises OSError where the page does not take it at once."""
        extras = self.extras
        (doing, reason), time = extras.words(), (self._ticks - 1) * self._dt
        known: dict[str, Any] = {name: record.known[name][row] for name in SHOWN if name in record}
        if record.robot is not None:
            asked = np.full((len(self._landmarks), 3), np.nan)
            asked[[self._landmarks.index(name) for name in record.landmark_names]] = record.landmarks_asked[row]
            known |= {"landmarks_asked": asked, "current": extras.current(), "truth": extras.truth()}
        known |= {"obstacles": extras.obstacles(), "latency": extras.latency()}
        self._send(RunTable(**known | {"time": time, "doing": doing, "reason": reason}))

    def _send(self, message: PageSetup | RunTable | Note | str) -> None:
        self._link.send(packed(message))


@contextmanager
def needing_websockets() -> Iterator[None]:
    """Raise ConfigError where websockets are missing."""
    try:
        yield
    except ImportError as error:
        step = install_step("websockets")
        raise ConfigError("a page needs websockets", found=str(error), next_step=step) from error


@contextmanager
def open_feed(settings: Settings) -> Iterator[ViewFeed]:
    """The page of a run, from now on; in the end it shows how the run ended, and ends by itself, or is ended. Raises
    ConfigError or what it refuses."""
    with needing_websockets():
        import websockets  # noqa: F401  (the page's process needs it)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", SERVER, str(theirs.fileno()), json.dumps(asdict(settings))],
            pass_fds=[theirs.fileno(), *([settings.poses] if settings.poses >= 0 else [])],
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
            except RetargetError as error:
                feed.note(str(error))
                raise
            finally:
                feed.end()
    finally:
        try:
            process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
