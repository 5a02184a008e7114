"""A recording's MCAP file, the bounded queue that the tick fills, and the thread that writes the one from the other.

Chunks are whole once they are flushed.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from hashlib import sha256
from operator import itemgetter
from pathlib import Path

import numpy as np

from hardware.clock import thread_cpu
from retarget.errors import UsageError, install_step
from retarget.recording.cdr import layout_of, schema
from retarget.recording.npz import MAX_BYTES
from retarget.recording.session import ConfigFile, Session
from retarget.recording.topics import EVENTS, RECORDED, Topic
from retarget.run.table import FIELDS, STAGES, RunTable, Widths
from retarget.schema.files import check_place, refuse_existing

OPTION = "--record"
METADATA = "retarget"
"""Name of the metadata that hold the session."""
PROFILE = "ros2"
CHUNK = 2**30
"""Bytes that never fill: chunks end when they are flushed."""
LARGEST = 4 * 2**20
"""Bytes of the largest config file that is attached."""
MOST_RECORDS = 2**21
"""Messages that are read of a file, and bytes in NPZ's MAX_BYTES; a file is full a little before. About 45 minutes of
a robot of 20 servos at 125 Hz."""
SPARE_RECORDS, SPARE_BYTES = 2**10, 2**20
"""For schemas and channels."""
MESSAGE_HEAD = 31
"""Bytes of a message before its data."""


def require_mcap(where: str) -> None:
    """Raise UsageError where the library is not installed."""
    try:
        import mcap.writer  # noqa: F401
    except ImportError:
        raise UsageError(
            "recordings need the library mcap, which is not installed",
            where=where,
            next_step=install_step("mcap"),
        ) from None


def check_target(path: Path) -> None:
    """Raise UsageError unless a recording can be written at `path`; nothing is left behind."""
    require_mcap(OPTION)
    if path.suffix.lower() != ".mcap":
        raise UsageError("a recording is MCAP", where=OPTION, found=str(path)[:200], allowed="FILE.mcap")
    check_place(path, option=OPTION)


class RecordingFile:
    """A new recording, an MCAP file that grows while a run goes on."""

    def __init__(self, path: Path, session: Session, configs: Iterable[tuple[ConfigFile, bytes]]) -> None:
        """Write what is known before the first cycle. Raises UsageError if there is a file, or none can be written."""
        from mcap.writer import CompressionType, Writer

        self.path = path
        refuse_existing(path, option=OPTION)
        try:
            self._stream = path.open("xb")
        except OSError as error:
            raise UsageError(f"cannot write here ({error.strerror})", where=OPTION, found=str(path)) from error
        self._writer = Writer(self._stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        try:
            self._writer.start(profile=PROFILE)
            text = session.model_dump_json()
            digest = sha256(text.encode()).hexdigest()
            self._writer.add_metadata(METADATA, {"format": str(session.format), "session": text, "sha256": digest})
            for config, content in configs:
                if len(content) <= LARGEST:
                    self._writer.add_attachment(session.begun_ns, session.begun_ns, config.name, "text/plain", content)
            self._stream.flush()
        except OSError as error:
            self.discard()
            raise UsageError(f"cannot write here ({error.strerror})", where=OPTION, found=str(path)) from error
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._room, self._records = MAX_BYTES - SPARE_BYTES, MOST_RECORDS - SPARE_RECORDS  # that are left

    def announce(self, topics: Sequence[Topic]) -> None:
        """Register the topics. Each one's metadata hold `layout`, a numpy dtype, and `names`."""
        for topic in topics:
            names = ["_".join(name.split()) or "_" for name in topic.names]  # blanks part one from the next
            metadata = {"layout": topic.layout.description, "names": " ".join(names)}
            self._register(topic.name, topic.schema, metadata)
        self._register(EVENTS, "rcl_interfaces/msg/Log", {})

    def takes(self, sizes: Sequence[int]) -> bool:
        """Whether messages of so many bytes can be added, of which all would be read back; they then count as added."""
        self._room -= sum(sizes) + MESSAGE_HEAD * len(sizes)
        self._records -= len(sizes)
        return self._room >= 0 and self._records >= 0

    def add(self, topic: str, *, index: int, stamp_ns: int, data: bytes) -> None:
        """Take a message of a topic. index: of its cycle."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, index)

    def flush(self) -> None:
        """Hand everything to the system: a crash of this process does not lose it. Raises OSError."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._stream.flush()

    def finish(self) -> None:
        """Write the rest and the index, and close. Raises OSError."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def close(self) -> None:
        """Close, whatever is missing. Twice does no harm."""
        with suppress(OSError):  # a full disk keeps the rest from it
            self._stream.close()

    def discard(self) -> None:
        """Close and remove it: nothing was recorded."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _register(self, topic: str, message: str, metadata: dict[str, str]) -> None:
        if message not in self._schemas:
            self._schemas[message] = self._writer.register_schema(message, "ros2msg", schema(message).encode())
        self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[message], metadata)


# The bounded queue between the tick and the writing thread: rows are filled in place and never wait for a disk.

ROWS = 1024
"""Eight seconds at 125 Hz."""
CLEARED = (
    *("readings", "asked", "velocity_asked", "sampled", "read", "written", "kept", "sensor_valid", "clock"),
    *STAGES,
)
"""The fields that say what happened in a cycle: in a new row nothing has."""


class Ring:
    """One thread fills the row `at` of `rows` and turns to the next; another one takes those that are finished.

    lost: finished rows for which there was no room. patient: the filling thread waits for room instead; for runs in
    which time is not real. index: number of the row that is being filled, lost ones counted.
    """

    def __init__(self, widths: Widths, *, patient: bool = False, rows: int = ROWS) -> None:
        self.rows = RunTable.empty(rows, widths, RECORDED)
        self._cleared = [(self.rows.known[name], FIELDS[name].fill) for name in CLEARED]
        self.at = self.index = self.lost = 0
        self.wanted = threading.Event()
        """Set when it is time to take rows."""
        self._size = rows
        self._patient = patient
        self._finished = self._taken = 0
        self._room = threading.Event()
        self._closed = False

    def turn(self) -> None:
        """The row is finished: go to the next one, which is as if nothing had happened."""
        if self._finished + 1 - self._taken >= self._size and not self._wait():
            self.lost += 1
        else:
            self._finished += 1
            if 2 * (self._finished - self._taken) >= self._size:
                self.wanted.set()
        self.index += 1
        self.at = self._finished % self._size
        self.rows.index[self.at] = self.index
        for array, fill in self._cleared:
            array[self.at] = fill

    def take(self) -> RunTable:
        """The rows that are finished and were not taken before, as copies."""
        first, last = self._taken, self._finished
        taken = self.rows[np.arange(first, last) % self._size]
        self._taken = last
        self._room.set()
        return taken

    def close(self) -> None:
        """No thread takes rows any more: the filling thread is not to wait for one."""
        self._closed = True
        self._room.set()

    def _wait(self) -> bool:
        """Whether there is room now; waits for it if `patient`."""
        while self._patient:
            self._room.clear()
            if self._finished + 1 - self._taken < self._size:
                return True
            if self._closed:
                break
            self.wanted.set()
            self._room.wait()
        return False


# Events: each is logged once, with the cycle in which it happened.

MOST_EVENTS = 10_000
"""Events that wait to be written; of more, the newest are kept."""
MAX_TEXT = 2000
"""Characters of an event; longer texts are cut, so that one message cannot fill the queue."""


class Level(IntEnum):
    """Levels of an rcl_interfaces/msg/Log."""

    INFO = 20
    WARN = 30
    ERROR = 40


@dataclass(frozen=True)
class Event:
    """time: s, on the run's clock. who: guard, bus, stream, ... cycle: in which it was."""

    time: float
    cycle: int
    level: Level
    who: str
    text: str


def log_message(event: Event, *, stamp_ns: int) -> bytes:
    """The event as rcl_interfaces/msg/Log in CDR; its `line` is the cycle."""
    row = layout_of("rcl_interfaces/msg/Log", {"name": event.who, "msg": event.text[:MAX_TEXT]}).rows(1)
    row["stamp.sec"], row["stamp.nanosec"] = divmod(stamp_ns, 10**9)
    row["level"], row["line"] = event.level, max(event.cycle, 0)
    return row.tobytes()


# The thread that writes a recording: it takes what the tick has finished, encodes it, and hands it to the system.

FLUSH_S = 0.4
"""Time, s, between two chunks: a crash loses so much, and a chunk that is under way."""
PATIENCE_S = 5.0
"""Time, s, that closing waits for a disk that hangs."""


class WritingThread:
    """Writes one recording. stamp: from s of the run's clock to ns of the file.

    failure: why it ended early, "" while all is well; a disk that is full ends the recording and nothing else. cpu_s:
    of this thread, s.
    """

    def __init__(
        self,
        file: RecordingFile,
        ring: Ring,
        events: deque[Event],
        topics: Sequence[Topic],
        stamp: Callable[[float], int],
    ) -> None:
        self.failure = ""
        self.cpu_s = 0.0
        self._file, self._ring, self._events, self._topics, self._stamp = file, ring, events, tuple(topics), stamp
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="record", daemon=True)

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def close(self) -> None:
        """Write the rest and the index; waits PATIENCE_S at most. Twice does no harm."""
        self._ending = True
        self._ring.wanted.set()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            self.failure = self.failure or "the disk does not answer"

    def _run(self) -> None:
        try:
            with np.errstate(all="ignore"):  # whatever was measured is kept, also what is not a number
                while not (self._ending or self.failure):
                    self._ring.wanted.wait(FLUSH_S)
                    self._ring.wanted.clear()
                    self._write()
                self._write()
            self._file.finish()
        except OSError as error:
            self.failure = error.strerror or str(error)
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot goes on without a recording
            self.failure = f"{type(error).__name__}: {error}"
        finally:
            self._ring.close()
            self._file.close()
            self.cpu_s = thread_cpu()

    def _write(self) -> None:
        """All that is there, as one chunk; nothing where the file is full."""
        events = [self._events.popleft() for _ in range(len(self._events))]
        cycles = self._ring.take()
        stamps = np.array([self._stamp(time) for time in cycles.time.tolist()], dtype=np.int64)
        messages = [
            (at, topic.name, cycle, data)
            for topic in self._topics
            for cycle, at, data in topic.messages(cycles, stamps)
        ]
        for event in events:
            at = self._stamp(event.time)
            messages.append((at, EVENTS, event.cycle, log_message(event, stamp_ns=at)))
        if not messages or self.failure:
            return
        messages.sort(key=itemgetter(0))
        if not self._file.takes([len(data) for *_, data in messages]):
            self.failure = f"it is full, no more than {MAX_BYTES >> 20} MiB are read of a file"
            return
        for at, name, cycle, data in messages:
            self._file.add(name, index=cycle, stamp_ns=at, data=data)
        self._file.flush()
        self.cpu_s = thread_cpu()
