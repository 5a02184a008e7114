"""The run's end of a page: ticks go out, and requests of the operator come in.

The page is served by another process. Sockets to it never block, and drop messages that are not taken at once, so that
no page delays a tick.
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
"""Fields of a row that a page shows, besides its time, obstacles and latency."""
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
"""Words for the states of a run."""
SHOWN_HZ = 25.0
STOP = b"stop"
READY, REFUSED = b"ready ", b"refused "
START_S = 30.0
"""Longest time to wait for the page, s."""
LAST_ROW_S, ENDING_S = 0.2, 4.0
"""Longest times to send the last row, and for the process of the page to end, s."""
BUFFER_BYTES = 1 << 17
"""Size of the socket's buffer: two rows of the largest robot."""
LONGEST_ANSWER = 4096
"""Largest message of the page, bytes."""
MOST_MESSAGES = 1024
"""Messages of the page that wait for the run: a minute of them."""


@dataclass(frozen=True)
class Settings:
    """Settings of the server. listen: on every interface, with HTTPS. port: 0 for any. robot: name or file of its
    profile. performs: a browser may be the performer, and pause the robot. dead_man: the robot moves only while it is
    held. stick: pads make it walk. poses: file descriptor of the socket for poses, -1 for none."""

    listen: bool
    port: int
    robot: str
    performs: bool = True
    dead_man: bool = False
    stick: bool = False
    poses: int = -1


@dataclass(frozen=True)
class PageSetup:
    """The bodies of a page. robot: name or file of the profile, None for a human alone. root: None for that of the
    profile. scene: file or name. sensors, landmarks: names. servos_measure: rows have temperatures and currents."""

    robot: str | None
    root: Mounting | None
    scene: str | None
    human_mjcf: str
    sensors: tuple[str, ...] = ()
    landmarks: tuple[str, ...] = ()
    servos_measure: bool = True


@dataclass(frozen=True)
class Note:
    """A sentence on the page: an instruction to the performer, a warning, or how the run ended."""

    note: str


ROW = b"\0"
"""First byte of a row. All other messages are JSON."""


def packed(message: PageSetup | RunTable | Note | str) -> bytes:
    """Encode a message. A text is a state. A row is a line of JSON, with its words and the types and shapes of its
    arrays, followed by their bytes."""
    if not isinstance(message, RunTable):
        return json.dumps(message if isinstance(message, str) else vars(message)).encode()
    known = message.known
    arrays = {name: value for name, value in known.items() if isinstance(value, np.ndarray) and value.dtype != object}
    kinds = {name: (value.dtype.str, value.shape) for name, value in arrays.items()}
    words = {name: value for name, value in known.items() if name not in arrays}
    head = json.dumps([words, kinds], default=methodcaller("tolist")).encode()
    return b"".join([ROW, head, b"\n", *(value.tobytes() for value in arrays.values())])


def unpacked(data: bytes) -> PageSetup | RunTable | Note | str:
    """Decode a message of `packed`."""
    if data.startswith(ROW):
        head, _, body = data[1:].partition(b"\n")
        known, kinds = json.loads(head)
        at = 0
        for name, (kind, shape) in kinds.items():
            count = math.prod(shape)
            known[name] = np.frombuffer(body, kind, count, at).reshape(shape)
            at += known[name].nbytes
        return RunTable(**known)
    content = json.loads(data)
    if isinstance(content, str):
        return content
    if "note" in content:
        return Note(**content)
    lists: Any = {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}
    return PageSetup(**lists)


class ViewFeed:
    """The run's connection to a page. link: to the process of the page; process: its PID."""

    def __init__(self, link: socket.socket, process: int) -> None:
        self.address, self.process = "", process
        self.extras = Extras()
        """Values that are shown but not in the record."""
        self._link = link
        self._dt, self._every, self._ticks = 1.0 / SHOWN_HZ, 1, 0
        self.dropped = 0
        """Number of rows that the page did not take."""
        self._landmarks: tuple[str, ...] = ()
        self._stop = False
        self._messages: deque[str] = deque(maxlen=MOST_MESSAGES)
        self._last: tuple[Record, int] | None = None

    def announce(self, state: str) -> None:
        """Show a state of the run before the first tick."""
        with suppress(OSError):
            self._send(state)

    def note(self, text: str) -> None:
        """Show a sentence."""
        with suppress(OSError):
            self._send(Note(text))

    def begin(self, setup: PageSetup, *, rate_hz: float) -> None:
        """Wait until the page has loaded the bodies. rate_hz: of the ticks. Raises ConfigError if it refuses."""
        self._dt, self._every, self._landmarks = 1.0 / rate_hz, max(round(rate_hz / SHOWN_HZ), 1), setup.landmarks
        self.answer(setup)

    def on_row(self, record: Record, row: int) -> None:
        """Show a row of the record, at SHOWN_HZ."""
        self._ticks += 1
        self._last = record, row
        if self._ticks % self._every:
            return
        try:
            self._show(record, row)
        except OSError:  # full, or gone
            self.dropped += 1

    def stop_requested(self) -> bool:
        """True once STOP was pressed on the page."""
        self._poll()
        return self._stop

    def messages(self) -> list[str]:
        """The other messages of the page since the last call, oldest first."""
        self._poll()
        messages = [*self._messages]
        self._messages.clear()
        return messages

    def _poll(self) -> None:
        for _ in range(MOST_MESSAGES):
            try:
                message = self._link.recv(LONGEST_ANSWER)
            except OSError:  # no message, or no process
                return
            if not message:
                return
            self._take(message)

    def _take(self, message: bytes) -> None:
        if message == STOP:
            self._stop = True
        else:
            self._messages.append(message.decode(errors="replace"))

    def end(self) -> None:
        """Show the last row."""
        if self._last is not None:
            with suppress(OSError):
                self._link.settimeout(LAST_ROW_S)
                self._show(*self._last)

    def answer(self, *messages: PageSetup) -> str:
        """Send messages, and wait for the answer. Raises ConfigError if the page refuses."""
        self._link.settimeout(START_S)
        try:
            for message in messages:
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
        """Send a row. Raises OSError if the page does not take it at once."""
        extras = self.extras
        (doing, reason), time = extras.words(), (self._ticks - 1) * self._dt
        known: dict[str, Any] = {name: record.known[name][row] for name in SHOWN if name in record}
        if record.robot is not None:
            desired = np.full((len(self._landmarks), 3), np.nan)
            desired[[self._landmarks.index(name) for name in record.landmark_names]] = record.landmarks_asked[row]
            known |= {"landmarks_asked": desired, "current": extras.current(), "truth": extras.truth()}
        known |= {"obstacles": extras.obstacles(), "latency": extras.latency()}
        self._send(RunTable(**known | {"time": time, "doing": doing, "reason": reason}))

    def _send(self, message: PageSetup | RunTable | Note | str) -> None:
        self._link.send(packed(message))


@contextmanager
def needing_websockets() -> Iterator[None]:
    """Raise ConfigError if websockets are missing."""
    try:
        yield
    except ImportError as error:
        step = install_step("websockets")
        raise ConfigError("a page needs websockets", found=str(error), next_step=step) from error


@contextmanager
def open_feed(settings: Settings) -> Iterator[ViewFeed]:
    """Serve the page of a run, which at last shows how the run ended. Raises ConfigError if it does not open."""
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
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},  # the same code as in this process
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
