"""Writing of recordings: the MCAP file, the bounded queue that the tick fills, and the thread that empties it."""

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
"""Name of the metadata record with the session."""
MCAP_PROFILE = "ros2"
CHUNK = 2**30
"""Bytes that a chunk never reaches, because a flush ends it."""
LARGEST = 4 * 2**20
"""Bytes of the largest config file that is attached."""
MOST_RECORDS = 2**21
"""Largest number of messages that a reader takes: 45 minutes of 20 servos at 125 Hz. NPZ's MAX_BYTES bounds their
bytes."""
SPARE_RECORDS, SPARE_BYTES = 2**10, 2**20
"""Reserve for schemas and channels."""
MESSAGE_OVERHEAD = 31
"""Bytes of a message before its data."""


def require_mcap(where: str) -> None:
    """Raise UsageError if the library is not installed."""
    try:
        import mcap.writer  # noqa: F401
    except ImportError:
        raise UsageError(
            "recordings need the library mcap, which is not installed",
            where=where,
            next_step=install_step("mcap"),
        ) from None


def check_target(path: Path) -> None:
    """Raise UsageError unless a recording can be written at `path`."""
    require_mcap(OPTION)
    if path.suffix.lower() != ".mcap":
        raise UsageError("a recording is MCAP", where=OPTION, found=str(path)[:200], allowed="FILE.mcap")
    check_place(path, option=OPTION)


class RecordingFile:
    """A new MCAP file that grows during a run, flushed chunk by chunk."""

    def __init__(self, path: Path, session: Session, configs: Iterable[tuple[ConfigFile, bytes]]) -> None:
        """Write session and configs. Raises UsageError for an unusable place."""
        from mcap.writer import CompressionType, Writer

        self.path = path
        refuse_existing(path, option=OPTION)
        try:
            self._stream = path.open("xb")
        except OSError as error:
            raise UsageError(f"cannot write here ({error.strerror})", where=OPTION, found=str(path)) from error
        self._writer = Writer(self._stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        try:
            self._writer.start(profile=MCAP_PROFILE)
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
        """Register the topics. Their metadata hold `layout`, a NumPy dtype, and `names`."""
        for topic in topics:
            names = ["_".join(name.split()) or "_" for name in topic.names]  # blanks part one from the next
            metadata = {"layout": topic.layout.description, "names": " ".join(names)}
            self._register(topic.name, topic.schema, metadata)
        self._register(EVENTS, "rcl_interfaces/msg/Log", {})

    def takes(self, sizes: Sequence[int]) -> bool:
        """Count messages of these sizes, bytes. True if a reader would take them all."""
        self._room -= sum(sizes) + MESSAGE_OVERHEAD * len(sizes)
        self._records -= len(sizes)
        return self._room >= 0 and self._records >= 0

    def add(self, topic: str, *, index: int, stamp_ns: int, data: bytes) -> None:
        """Add a message of a topic. index: of its cycle."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, index)

    def flush(self) -> None:
        """Hand everything to the system. Raises OSError."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._stream.flush()

    def finish(self) -> None:
        """Write the index and close. Raises OSError."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def close(self) -> None:
        """Close, even if the rest cannot be written."""
        with suppress(OSError):  # a full disk keeps the rest from it
            self._stream.close()

    def discard(self) -> None:
        """Close and remove the file."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _register(self, topic: str, message: str, metadata: dict[str, str]) -> None:
        if message not in self._schemas:
            self._schemas[message] = self._writer.register_schema(message, "ros2msg", schema(message).encode())
        self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[message], metadata)


ROWS = 1024
"""Eight seconds at 125 Hz."""
CLEARED = (
    *("readings", "asked", "velocity_command", "sampled", "read", "written", "kept", "sensor_valid", "clock"),
    *STAGES,
)
"""Fields of events in a cycle, which are reset in a new row."""


class Ring:
    """A queue of rows between two threads: one fills the row `at` of `rows`, the other takes the finished ones.

    lost: finished rows without room. patient: the filling thread waits for room. index: number of the current row.
    """

    def __init__(self, widths: Widths, *, patient: bool = False, rows: int = ROWS) -> None:
        self.rows = RunTable.empty(rows, widths, RECORDED)
        self._cleared = [(self.rows.known[name], FIELDS[name].fill) for name in CLEARED]
        self.at = self.index = self.lost = 0
        self.due = threading.Event()
        """Set when it is time to take rows."""
        self._size = rows
        self._patient = patient
        self._finished = self._taken = 0
        self._room = threading.Event()
        self._closed = False

    def turn(self) -> None:
        """Finish the row, and go to the next one, which is reset."""
        if self._finished + 1 - self._taken >= self._size and not self._wait():
            self.lost += 1
        else:
            self._finished += 1
            if 2 * (self._finished - self._taken) >= self._size:
                self.due.set()
        self.index += 1
        self.at = self._finished % self._size
        self.rows.index[self.at] = self.index
        for array, fill in self._cleared:
            array[self.at] = fill

    def take(self) -> RunTable:
        """Copies of the finished rows that were not taken before."""
        first, last = self._taken, self._finished
        taken = self.rows[np.arange(first, last) % self._size]
        self._taken = last
        self._room.set()
        return taken

    def close(self) -> None:
        """Release the filling thread, because no thread takes rows any more."""
        self._closed = True
        self._room.set()

    def _wait(self) -> bool:
        """True if there is room now; waits for it if `patient`."""
        while self._patient:
            self._room.clear()
            if self._finished + 1 - self._taken < self._size:
                return True
            if self._closed:
                break
            self.due.set()
            self._room.wait()
        return False


MOST_EVENTS = 10_000
"""Queued events, of which the newest are kept."""
MAX_TEXT = 2000
"""Characters of an event; longer texts are cut to bound the queue."""


class LogLevel(IntEnum):
    """Levels of rcl_interfaces/msg/Log."""

    INFO = 20
    WARN = 30
    ERROR = 40


@dataclass(frozen=True)
class LogEvent:
    """An event of a cycle. time: s, on the run's clock. source: guard, bus, stream, ..."""

    time: float
    cycle: int
    level: LogLevel
    source: str
    text: str


def log_message(event: LogEvent, *, stamp_ns: int) -> bytes:
    """The event as rcl_interfaces/msg/Log in CDR. Its `line` is the cycle."""
    row = layout_of("rcl_interfaces/msg/Log", {"name": event.source, "msg": event.text[:MAX_TEXT]}).rows(1)
    row["stamp.sec"], row["stamp.nanosec"] = divmod(stamp_ns, 10**9)
    row["level"], row["line"] = event.level, max(event.cycle, 0)
    return row.tobytes()


FLUSH_S = 0.4
"""Time, s, between two chunks, which bounds the loss in a crash."""
PATIENCE_S = 5.0
"""Longest time, s, that closing waits for the disk."""


class WritingThread:
    """The thread that writes a recording. stamp: converts s of the run's clock to ns of the file.

    failure: reason of an early end, else "". cpu_s: CPU time of this thread, s.
    """

    def __init__(
        self,
        file: RecordingFile,
        ring: Ring,
        events: deque[LogEvent],
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
        """Write the rest and the index, for PATIENCE_S at most."""
        self._ending = True
        self._ring.due.set()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            self.failure = self.failure or "the disk does not answer"

    def _run(self) -> None:
        try:
            with np.errstate(all="ignore"):  # whatever was measured is kept, also what is not a number
                while not (self._ending or self.failure):
                    self._ring.due.wait(FLUSH_S)
                    self._ring.due.clear()
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
