"""The thread that writes a recording: it takes what the tick has finished, encodes it, and hands it to the system."""

import threading
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from hardware.clock import thread_cpu
from retarget.recording.cycles import Cycles
from retarget.recording.events import Events, log_message
from retarget.recording.file import RecordingFile
from retarget.recording.ring import Ring
from retarget.recording.topics import EVENTS, Topic

__all__ = ["FLUSH_S", "WritingThread"]

FLUSH_S = 0.4
"""Between two chunks: what a crash loses, and a chunk that is under way."""
PATIENCE_S = 5.0
"""How long closing waits for a disk that hangs."""


class WritingThread:
    """Writes one recording. stamp: from s of the run's clock to ns of the file.

    trouble: why it ended early, "" while all is well; a disk that is full ends the recording and nothing else. cpu_s:
    of this thread, s. written: cycles in the file.
    """

    def __init__(
        self, file: RecordingFile, ring: Ring, events: Events, topics: Sequence[Topic], stamp: Callable[[float], int]
    ) -> None:
        self.trouble = ""
        self.cpu_s = 0.0
        self.written = 0
        self._file, self._ring, self._events, self._topics, self._stamp = file, ring, events, tuple(topics), stamp
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="record", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """Write the rest and the index; waits PATIENCE_S at most. Twice does no harm."""
        self._ending = True
        self._ring.wanted.set()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            self.trouble = self.trouble or "the disk does not answer"

    def _run(self) -> None:
        try:
            with np.errstate(all="ignore"):  # whatever was measured is kept, also what is not a number
                while not self._ending:
                    self._ring.wanted.wait(FLUSH_S)
                    self._ring.wanted.clear()
                    self._write()
                self._write()
            self._file.finish()
        except OSError as error:
            self.trouble = error.strerror or str(error)
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot goes on without a recording
            self.trouble = f"{type(error).__name__}: {error}"
        finally:
            self._ring.close()
            self._file.close()
            self.cpu_s = thread_cpu()

    def _write(self) -> None:
        """All that is there, as one chunk."""
        events, cycles = self._events.take(), self._ring.take()
        stamps = np.array([self._stamp(time) for time in cycles.time.tolist()], dtype=np.int64)
        messages = [(at, name, cycle, data) for name, cycle, at, data in self._encoded(cycles, stamps)]
        for event in events:
            at = self._stamp(event.time)
            messages.append((at, EVENTS, event.cycle, log_message(event, stamp_ns=at)))
        if not messages:
            return
        messages.sort(key=itemgetter(0))
        for at, name, cycle, data in messages:
            self._file.add(name, index=cycle, stamp_ns=at, data=data)
        self._file.flush()
        self.written += len(cycles)
        self.cpu_s = thread_cpu()

    def _encoded(self, cycles: Cycles, stamps: NDArray[np.int64]) -> Iterator[tuple[str, int, int, bytes]]:
        for topic in self._topics:
            for index, stamp, data in topic.messages(cycles, stamps):
                yield topic.name, index, stamp, data
