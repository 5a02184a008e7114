"""`--record-raw FILE`: every admitted datagram goes to a file, by a thread of its own; the tick waits for no disk."""

import threading
from collections.abc import Callable
from typing import Self

from retarget.live.datagram import Datagram
from retarget.sources.raw_record import RawWriter

__all__ = ["FLUSH_S", "RawTap"]

FLUSH_S = 0.2
"""Between two writes; what a crash may lose."""
PATIENCE_S = 2.0
"""How long closing waits for a disk that hangs."""


class RawTap:
    """Takes datagrams in the tick and lets a thread write them.

    A disk that is full or gone ends the recording and nothing else: `trouble` then says why, and what comes later is
    counted in `lost`, as is what comes faster than the disk takes it (the writer holds a bounded number of bytes).
    """

    def __init__(self, writer: RawWriter, *, tell: Callable[[str], object] = lambda text: None) -> None:
        """Start the thread. The tap owns the writer from here on. tell: hears, when it is closed, what is missing."""
        self._writer, self._tell = writer, tell
        self._hung = ""
        self._told_trouble = self._told_lost = False
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="record-raw", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def trouble(self) -> str:
        """Why the recording ended early; "" while all is well."""
        return self._hung or self._writer.trouble

    @property
    def lost(self) -> int:
        """Datagrams that are not in the file."""
        return self._writer.lost

    def news(self) -> str:
        """What is wrong with the recording, in a sentence, the first time that it is asked; "" otherwise."""
        if self.trouble and not self._told_trouble:
            self._told_trouble = self._told_lost = True
            return f"the recording has ended, the run goes on: {self.trouble}"
        if self.lost and not self._told_lost:
            self._told_lost = True
            return "the disk is too slow: datagrams are missing in the recording"
        return ""

    def take(self, datagram: Datagram) -> None:
        """Keep one datagram; after `close`, or after trouble, it is only counted."""
        address, port = datagram.source
        self._writer.append(datagram.payload, time_ns=round(datagram.arrival * 1e9), address=address, port=port)

    def close(self) -> None:
        """Write the rest and close the file; waits PATIENCE_S at most. Twice does no harm."""
        if self._ending.is_set():
            return
        self._ending.set()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            self._hung = "the disk does not answer"
        if self.trouble or self.lost:
            reason = self.trouble or "the disk was too slow"
            self._tell(f"the recording is not whole: {reason}; {self.lost} datagrams are missing")

    def _run(self) -> None:
        while not self._ending.wait(FLUSH_S) and not self._writer.trouble:
            self._writer.flush()
        self._writer.close()
