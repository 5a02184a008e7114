"""The run's end of a page: rows go out, and nothing comes in but that the operator wants the run to stop.

The page is served by a process of its own. Between them is a pair of sockets whose ends never wait: what the other does
not take at once is dropped, so that a page that is slow, stopped or dead costs a tick nothing.
"""

import json
import socket
import struct
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from types import TracebackType
from typing import Self

import numpy as np

from retarget.errors import ConfigError
from retarget.run.record import Record
from retarget.run.run_result import Extras
from retarget.types import FloatArray, ModeArray
from retarget.viewer.snapshot import placed

# What a run sends to the process of its page: one datagram per row that is shown, of numbers in a fixed order.

_HEAD = struct.Struct("<d48s256s")
"""Time, state, and why it is so; UTF-8, cut."""


@dataclass(frozen=True)
class RowSizes:
    """How many numbers a row has: of q of robot and human, of servos, landmarks, observers and obstacles, of the
    `Truth` of a simulated body, and of sensors."""

    robot: int
    human: int
    servos: int
    landmarks: int
    observers: int
    obstacles: int = 0
    truth: int = 0
    sensors: int = 0

    @property
    def lengths(self) -> tuple[int, ...]:
        """Of every part of a row after its head, in their order."""
        servos = (self.servos,) * 3
        points, poses = 3 * self.landmarks, 7 * self.obstacles
        return (self.robot, self.human, *servos, points, self.observers, poses, self.truth, 3 * self.sensors)


@dataclass(frozen=True, eq=False)
class LiveRow:
    """time: s of the run. robot (nq,): posture sent; human (nq,). present (s,) rad, temperature (s,) degrees Celsius
    and current (s,) A of the servos; asked (k, 3) m of the landmarks; modes (o,) of the observers; obstacle_poses
    (m, 7); truth: the numbers of a `Truth`, or none; sensors (s, 3) m."""

    time: float
    state: str
    why: str
    robot: FloatArray
    human: FloatArray
    present: FloatArray
    temperature: FloatArray
    current: FloatArray
    asked: FloatArray
    modes: ModeArray
    obstacle_poses: FloatArray
    truth: FloatArray
    sensors: FloatArray


def pack(row: LiveRow) -> bytes:
    """Bytes of a row, as 32-bit numbers: a tenth of a micrometre of a robot."""
    servos = (row.present, row.temperature, row.current)
    flat = [points.reshape(-1) for points in (row.asked, row.modes, row.obstacle_poses, row.truth, row.sensors)]
    parts = (row.robot, row.human, *servos, *flat)
    head = _HEAD.pack(row.time, row.state.encode(errors="replace")[:48], row.why.encode(errors="replace")[:256])
    return head + np.concatenate(parts).astype(np.float32).tobytes()


def unpack(data: bytes, sizes: RowSizes) -> LiveRow | None:
    """The row of these bytes; None for anything else."""
    if len(data) != _HEAD.size + 4 * sum(sizes.lengths):
        return None
    time, state, why = _HEAD.unpack_from(data)
    numbers = np.frombuffer(data, dtype=np.float32, offset=_HEAD.size).astype(np.float64)
    parts = np.split(numbers, np.cumsum(sizes.lengths)[:-1])
    robot, human, present, temperature, current, asked, modes, poses, truth, sensors = parts
    return LiveRow(
        time=time,
        state=_text(state),
        why=_text(why),
        robot=robot,
        human=human,
        present=present,
        temperature=temperature,
        current=current,
        asked=asked.reshape(-1, 3),
        modes=np.nan_to_num(modes).astype(np.uint8),
        obstacle_poses=poses.reshape(-1, 7),
        truth=truth,
        sensors=sensors.reshape(-1, 3),
    )


def _text(field: bytes) -> str:
    return field.rstrip(b"\0").decode(errors="ignore")


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
    """What the process of a page gets at its start. robot: name or file of the profile, "" for a human alone; root: how
    it stands in the world, "" as its profile says; scene: file or name, "" for none. simulated: it has mass, and rows
    hold where it really is. sensors: of the performer, names."""

    title: str
    port: int
    robot: str
    root: str
    scene: str
    human_mjcf: str
    simulated: bool = False
    sensors: tuple[str, ...] = ()


@dataclass(frozen=True)
class Announced:
    """What it gets before the first row: names of the landmarks, numbers of observers and obstacles, and how many
    numbers the `Truth` of a simulated body has."""

    landmarks: tuple[str, ...]
    observers: int
    obstacles: int
    truth: int


class ViewFeed:
    """link: to the process of the page, never waiting. rate_hz: of the ticks."""

    def __init__(
        self, link: socket.socket, process: "subprocess.Popen[bytes]", *, address: str, rate_hz: float
    ) -> None:
        self.address = address
        self.extras = Extras()
        """What is not in the record."""
        self._link, self._process, self._rate_hz = link, process, rate_hz
        self._every = max(round(rate_hz / SHOWN_HZ), 1)
        self._ticks = 0
        self.dropped = 0
        """Rows that the page did not take."""
        self._stop = self._announced = False
        self._last: tuple[Record, int] | None = None

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
        shown = _row(record, row, self.extras, time=self._ticks / self._rate_hz)
        if not self._announced:
            self._link.send(json.dumps(asdict(_announced(record, shown))).encode())
            self._announced = True
        self._link.send(pack(shown))

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


def open_feed(setup: PageSetup, *, rate_hz: float) -> ViewFeed:
    """Start the process of a page and wait until it is there. Raises ConfigError or what it refuses."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", SAME_CODE, json.dumps(sys.path), str(theirs.fileno())],
            pass_fds=(theirs.fileno(),),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
        )
    assert process.stdin is not None
    try:
        with process.stdin as stdin:
            stdin.write(json.dumps(asdict(setup)).encode())
        ours.settimeout(START_S)
        answer = ours.recv(LONGEST_MESSAGE)
    except OSError as error:
        answer = REFUSED + f"the page did not open: {error}".encode()
    if not answer.startswith(READY):
        ours.close()
        process.kill()
        process.wait()
        why = answer.removeprefix(REFUSED).decode(errors="replace")
        raise ConfigError(why.removesuffix(".") or "the page did not open")
    ours.setblocking(False)
    address = answer.removeprefix(READY).decode()
    return ViewFeed(ours, process, address=address, rate_hz=rate_hz)


def _announced(record: Record, first: LiveRow) -> Announced:
    names = () if record.robot is None else record.robot.landmark_names
    return Announced(names, len(first.modes), len(first.obstacle_poses), len(first.truth))


def _row(record: Record, row: int, extras: Extras, *, time: float) -> LiveRow:
    (state, why), obstacles, robot = extras.words(), extras.obstacles(), record.robot
    none, poses = np.zeros(0), np.zeros((0, 7)) if obstacles is None else placed(obstacles)
    if robot is None:
        points, modes = np.zeros((0, 3)), np.zeros(0, dtype=np.uint8)
        human, sensors = record.human.q[row], record.human.sensors[row]
        return LiveRow(time, state, why, none, human, none, none, none, points, modes, poses, none, sensors)
    current, truth = extras.current(), extras.truth()
    return LiveRow(
        time=float(robot.bus_time[row]),
        state=state,
        why=why,
        robot=robot.q[row],
        human=record.human.q[row],
        present=robot.present[row],
        temperature=robot.temperature[row],
        current=np.full(robot.present.shape[1], np.nan) if current is None else current,
        asked=robot.landmarks_asked[row],
        modes=robot.observer_modes[row],
        obstacle_poses=poses,
        truth=none if truth is None else truth.numbers(),
        sensors=record.human.sensors[row],
    )
