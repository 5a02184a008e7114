"""The run's end of a page: what it does goes out, and nothing comes in but that the operator wants the run to stop.

The page is served by a process of its own. Between them is a pair of sockets whose ends never wait: what the other does
not take at once is dropped, so that a page that is slow, stopped or dead costs a tick nothing.
"""

import json
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np

from retarget.errors import ConfigError
from retarget.model.body_file import Root
from retarget.run.record import Record
from retarget.run.run_result import Extras
from retarget.viewer.snapshot import Row, placed

SHOWN_HZ = 25.0
STOP = b"stop"
READY, REFUSED = b"ready ", b"refused "
START_S = 30.0
"""A page that is not there by then is not coming."""
LAST_ROW_S, ENDING_S = 0.2, 4.0
"""The last row is sent within the first of these, and the process of the page ends within the second, s."""
BUFFER_BYTES = 1 << 17
LONGEST_MESSAGE = 4096
SAME_CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from retarget.viewer.live_page import main; sys.exit(main(sys.argv[2:]))"
)
"""The process of the page runs the code that the run runs, wherever that was found."""


@dataclass(frozen=True)
class PageSetup:
    """Who and what is seen, once the performer is known. robot: name or file of the profile, None for a human alone;
    root: how it stands in the world, None as its profile says; scene: file or name. simulated: it has mass, and rows
    hold where it really is. sensors: of the performer, names."""

    robot: str | None
    root: Root | None
    scene: str | None
    human_mjcf: str
    simulated: bool = False
    sensors: tuple[str, ...] = ()


def packed(message: PageSetup | Row) -> bytes:
    """A message to the process of the page, as JSON."""
    return json.dumps(vars(message), default=np.ndarray.tolist).encode()


def unpacked(data: bytes) -> PageSetup | Row | str:
    """The message of these bytes; a text is a state."""
    said = json.loads(data)
    if isinstance(said, str):
        return said
    if "human_mjcf" in said:
        return PageSetup(**said | {"sensors": tuple(said["sensors"])})
    arrays = {name: np.array(value) for name, value in said.items() if isinstance(value, list)}
    return Row(**said | arrays | {"landmarks": tuple(said["landmarks"])})


class ViewFeed:
    """link: to the process of the page, which never waits while the run goes on."""

    def __init__(self, link: socket.socket, process: "subprocess.Popen[bytes]", *, address: str) -> None:
        self.address = address
        self.extras = Extras()
        """What is not in the record."""
        self._link, self._process = link, process
        self._rate_hz, self._every, self._ticks = SHOWN_HZ, 1, 0
        self.dropped = 0
        """Rows that the page did not take."""
        self._stop = False
        self._last: tuple[Record, int] | None = None

    def announce(self, state: str) -> None:
        """Show a state of the run in which nothing moves yet."""
        with suppress(OSError):
            self._link.send(json.dumps(state).encode())

    def begin(self, setup: PageSetup, *, rate_hz: float) -> None:
        """Wait until all that is seen is on the page. rate_hz: of the ticks. Raises ConfigError or what it refuses."""
        self._rate_hz, self._every = rate_hz, max(round(rate_hz / SHOWN_HZ), 1)
        try:
            self._link.settimeout(START_S)
            self._link.send(packed(setup))
            answer = self._link.recv(LONGEST_MESSAGE)
            while answer == STOP:
                self._stop = True
                answer = self._link.recv(LONGEST_MESSAGE)
        except OSError as error:
            answer = REFUSED + f"the page did not open: {error}".encode()
        _require_ready(answer)
        self._link.setblocking(False)

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

    def _show(self, record: Record, row: int) -> None:
        """Raises OSError where the page does not take it at once."""
        self._link.send(packed(_row(record, row, self.extras, time=self._ticks / self._rate_hz)))

    def stop_asked(self) -> bool:
        """Whether the operator pressed the button of the page, ever."""
        try:
            if self._link.recv(LONGEST_MESSAGE) == STOP:
                self._stop = True
        except OSError:  # no message, or no process
            pass
        return self._stop

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Show how it ended; then the page ends by itself, or is ended."""
        if self._last is not None:
            with suppress(OSError):
                self._link.settimeout(LAST_ROW_S)
                self._show(*self._last)
        self._link.close()
        try:
            self._process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def open_feed(port: int, *, title: str) -> ViewFeed:
    """Start the process of a page and wait until it is there. Raises ConfigError or what it refuses."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", SAME_CODE, json.dumps(sys.path), str(theirs.fileno()), str(port), title],
            pass_fds=(theirs.fileno(),),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
    try:
        ours.settimeout(START_S)
        answer = ours.recv(LONGEST_MESSAGE)
    except OSError as error:
        answer = REFUSED + f"the page did not open: {error}".encode()
    try:
        address = _require_ready(answer)
    except ConfigError:
        ours.close()
        process.kill()
        process.wait()
        raise
    ours.setblocking(False)
    return ViewFeed(ours, process, address=address)


def _require_ready(answer: bytes) -> str:
    """What follows READY in an answer. Raises ConfigError for any other."""
    if not answer.startswith(READY):
        why = answer.removeprefix(REFUSED).decode(errors="replace")
        raise ConfigError(why.removesuffix(".") or "the page did not open")
    return answer.removeprefix(READY).decode()


def _row(record: Record, row: int, extras: Extras, *, time: float) -> Row:
    (state, why), obstacles, robot = extras.words(), extras.obstacles(), record.robot
    known: dict[str, Any] = {
        "time": time,
        "human": record.human.q[row],
        "sensors": record.human.sensors[row],
        "obstacle_poses": None if obstacles is None else placed(obstacles),
    }
    if robot is not None:
        known |= {
            "time": float(robot.bus_time[row]),
            "goal": robot.q[row],
            "present": robot.present[row],
            "temperature": robot.temperature[row],
            "current": extras.current(),
            "landmarks": robot.landmark_names,
            "asked": robot.landmarks_asked[row],
            "modes": robot.observer_modes[row],
            "truth": extras.truth(),
        }
    return Row(state=state, why=why, **known)
