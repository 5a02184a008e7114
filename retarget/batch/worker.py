"""A separate process for clips, one after the other, so that no clip affects the others.

If a clip hangs, ends the process or takes too much memory, the next clip gets a new process.
"""

import multiprocessing
import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from hardware.clock import MonotonicClock
from hardware.errors import RetargetError
from retarget.batch.clip import BatchClip, BatchSettings, ClipRow, ClipStatus, failed_row

THREADS = tuple(f"{library}_NUM_THREADS" for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM"))
"""Variables that limit linear algebra libraries to one thread, read when they are loaded."""
START_S = 300.0
"""Longest time to load the program, from a slow disk that many processes share, s."""
MAX_STARTS = 3
"""Processes in a row that end before they begin a clip, from which on the machine is at fault."""
ENDED_S = 5.0
"""Longest wait for a killed process, s. One that hangs in a disk is left behind."""
LONGEST_WAIT_S = 3600.0
"""Longest single wait for a worker, s: the system's `poll` takes no more than 24 days."""

Work = Callable[[BatchClip, BatchSettings], ClipRow]
"""`process_clip`, or it with another `follow`. It is pickled by name."""


@dataclass(frozen=True)
class ClipLimits:
    """Limits of a clip. time_s: wall time. memory: address space of its process, bytes, which macOS does not limit."""

    time_s: float
    memory: int


class WorkerError(RetargetError):
    """Processes end before they begin a clip."""


class ClipWorker:
    """A spawned process that works on one clip at a time, and is restarted when it has ended."""

    def __init__(self, work: Work, settings: BatchSettings, limits: ClipLimits) -> None:
        self._work, self._settings, self._limits = work, settings, limits
        self._clock = MonotonicClock()
        self._process: SpawnProcess | None = None
        self._connection: Connection
        self._clip: BatchClip | None = None
        self._begun: float | None = None  # [s] when the process began with the clip
        self._deadline, self._starts = 0.0, 0

    def begin(self, clip: BatchClip) -> None:
        """Begin a clip, in a new process if there is none."""
        self._clip, self._begun = clip, None
        self._deadline = self._clock.now() + START_S
        if self._process is None:
            self._start()
        with suppress(OSError):  # it has ended, which `look` detects
            self._connection.send(clip)

    @property
    def signs(self) -> tuple[Any, ...]:
        """Objects for `multiprocessing.connection.wait`. If one is ready, call `look`."""
        assert self._process is not None, "a clip was begun"
        return self._connection, self._process.sentinel

    @property
    def time_left(self) -> float:
        """Time after which to call `look` in any case, s."""
        return min(max(self._deadline - self._clock.now(), 0.0), LONGEST_WAIT_S)

    def look(self) -> ClipRow | None:
        """The row of the clip if it is over. Raises WorkerError if processes do not start."""
        process, clip = self._process, self._clip
        assert process is not None and clip is not None, "a clip was begun"
        ended = not process.is_alive()  # before the last messages are read
        try:
            while self._connection.poll():
                message: ClipRow | None = self._connection.recv()
                if message is not None:
                    self._clip, self._starts = None, 0
                    if message.status is ClipStatus.OUT_OF_MEMORY:  # some of its memory may not be freed
                        self.end()
                    return message
                self._begun = self._clock.now()
                self._deadline = self._begun + self._limits.time_s
        except (EOFError, OSError):
            ended = True
        if ended:
            return self._crashed(clip, process)
        if self.time_left > 0.0:
            return None
        self.end()
        if self._begun is None:
            self._start_again(clip, f"a process did not begin within {START_S:g} s")
            return None
        return self._lost(clip, ClipStatus.TIMED_OUT, "TimeLimit", f"not done after {self._limits.time_s:g} s")

    def run(self, clip: BatchClip) -> ClipRow:
        """Run a clip, and return its row."""
        self.begin(clip)
        while True:
            wait(self.signs, self.time_left)
            if row := self.look():
                return row

    def end(self) -> None:
        """Kill the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join(ENDED_S)
            self._connection.close()
            self._process = None

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        arguments = (theirs, self._work, self._settings, self._limits)
        process = context.Process(target=_serve, args=arguments, daemon=True)
        with _for_children():
            process.start()
        self._process = process
        theirs.close()

    def _crashed(self, clip: BatchClip, process: SpawnProcess) -> ClipRow | None:
        process.join(ENDED_S)
        code = process.exitcode
        self.end()
        how = f"exit code {code}" if code is None or code >= 0 else signal.Signals(-code).name
        if self._begun is None:
            self._start_again(clip, f"a process ended with {how} before it began")
            return None
        if code == -signal.SIGKILL:
            how += ": another program, or the system, which had no memory left"
        return self._lost(clip, ClipStatus.CRASHED, "Crash", f"the process ended with {how}")

    def _start_again(self, clip: BatchClip, why: str) -> None:
        self._starts += 1
        if self._starts >= MAX_STARTS:
            raise WorkerError(f"no clip can be begun: {why}, {self._starts} times in a row")
        self.begin(clip)

    def _lost(self, clip: BatchClip, status: ClipStatus, error: str, message: str) -> ClipRow:
        self._clip, self._starts = None, 0
        return failed_row(clip, self._settings, status, error, message)


@contextmanager
def _for_children() -> Iterator[None]:
    """Start processes in this context with one thread per library, and without Ctrl-C, which only ends the driver."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    resource_tracker.ensure_running()  # when it starts, it unblocks Ctrl-C in this thread
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGQUIT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


# The process.


def _serve(connection: Connection, work: Work, settings: BatchSettings, limits: ClipLimits) -> None:
    """Process clips until the driver is gone. For each, None is sent when it begins, then its row."""
    threading.Thread(target=_end_with_driver, daemon=True).start()
    _limit_memory(limits.memory)
    with suppress(EOFError, OSError):
        while True:
            clip = connection.recv()
            connection.send(None)
            # Native code that never ends may block the thread above. Then the system ends the process.
            signal.setitimer(signal.ITIMER_REAL, limits.time_s + ENDED_S)
            row = work(clip, settings)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            connection.send(row)


def _end_with_driver() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None, "this process was spawned"
    wait([parent.sentinel])
    os._exit(1)


def _limit_memory(most: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    known = [one for one in (most, soft, hard) if one != resource.RLIM_INFINITY]
    with suppress(ValueError, OSError):  # a system that has no such limit
        resource.setrlimit(resource.RLIMIT_AS, (min(known), hard))
