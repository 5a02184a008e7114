"""Raw recordings of a stream: every admitted datagram written to a file, and played back in place of a socket."""

import threading
from collections.abc import Iterator
from itertools import islice
from typing import Self

from retarget.errors import InputError, UsageError
from retarget.live.address import RECORDED, StreamAddress, parse_address
from retarget.live.admission import MOST_BYTES_PER_POLL, MOST_PER_POLL, Datagram
from retarget.live.advice import refusal
from retarget.sources.streams.datagram_kinds import recognise
from retarget.sources.streams.raw_record import RawReader, RawWriter, RecordedDatagram
from retarget.sources.streams.stream_frame import Dropped
from retarget.types import Notify

UNKNOWN_SOURCE = "127.0.0.1"  # address of the sender where a recording holds none
LOOKED_AT = 100  # datagrams by which a recording without a kind in its header is recognised


class ReplayReceiver:
    """Plays a recording: its datagrams fall due with the time of `poll`, the first one at once."""

    def __init__(self, reader: RawReader, *, speed: float = 1.0) -> None:
        """speed: recorded seconds per second, above 0."""
        self.dropped = Dropped()
        self._reader, self._speed = reader, speed
        self._rows: Iterator[RecordedDatagram] = iter(reader)
        self._next: RecordedDatagram | None = None
        self._due: float | None = None  # arrival of `_next`, s on the clock of `poll`
        self.finished = False  # everything has been returned

    def close(self) -> None:
        """End the replay."""
        self._next, self.finished = None, True

    def poll(self, now: float) -> list[Datagram]:
        """The datagrams that have fallen due until `now` (s), with their due times. Bounded as for a socket."""
        if self._due is None:
            self._due = now
            self._next = self._following()
        found: list[Datagram] = []
        room = MOST_BYTES_PER_POLL
        while self._next is not None and self._due <= now and len(found) < MOST_PER_POLL and room > 0:
            row = self._next
            found.append(Datagram(self._due, (row.address or UNKNOWN_SOURCE, row.port), row.payload))
            room -= len(row.payload)
            self._next = self._following()
            if self._next is not None:
                self._due += max(self._next.time_s - row.time_s, 0.0) / self._speed
        return found

    def _following(self) -> RecordedDatagram | None:
        row = next(self._rows, None)
        if row is None:
            self.finished = True
            if self._reader.damage:
                self.dropped.note("the recording is damaged")
        return row


def open_replay(address: StreamAddress) -> ReplayReceiver:
    """Open the recording of a `replay://` address. Raises InputError if it is missing or no recording."""
    assert address.path is not None
    return ReplayReceiver(RawReader(address.path), speed=address.speed)


def recorded_kind(address: StreamAddress) -> str:
    """The kind of a recorded stream: by `?kind=`, by its recorded address, or by its first datagrams if they agree.

    Raises InputError without any of these, or if the file is missing or no recording.
    """
    assert address.path is not None
    if address.recorded is not None:
        return address.recorded
    reader = RawReader(address.path)
    url = reader.url
    try:
        kind = parse_address(url).kind
    except UsageError:
        kind = ""
    if kind in RECORDED:
        return kind
    kinds = {recognise(row.payload).kind for row in islice(reader, LOOKED_AT)} - {""}
    if len(kinds) == 1:
        return kinds.pop()
    found = repr(url[:100]) if url else ""
    raise refusal(InputError, "unknown recording", address.text, found=found, allowed=", ".join(RECORDED))


FLUSH_S = 0.2  # between two writes; a crash may lose as much
DISK_WAIT_S = 2.0  # closing waits this long for a disk that hangs


class RawTap:
    """Takes datagrams in the tick, and writes them in a thread, so that the tick does not wait for the disk.

    A disk that is full or gone ends the recording and nothing else: `failure` gives the reason. `lost` counts the
    datagrams that come then, or faster than the disk.
    """

    def __init__(self, writer: RawWriter, *, notify: Notify = lambda text: None) -> None:
        """Start the thread. The tap owns the writer. notify: receives what is missing, on closing."""
        self._writer, self._notify = writer, notify
        self._hung = ""
        self._reported = ""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="record-raw", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def failure(self) -> str:
        """Reason of an early end, or ""."""
        return self._hung or self._writer.error

    @property
    def lost(self) -> int:
        """Number of datagrams that are not in the file."""
        return self._writer.lost

    def news(self) -> str:
        """Problem of the recording in a sentence, once each."""
        news = "the disk is too slow: datagrams are missing in the recording" if self.lost else ""
        if self.failure:
            news = f"the recording has ended, the run goes on: {self.failure}"
        if news == self._reported:
            return ""
        self._reported = news
        return news

    def take(self, datagram: Datagram) -> None:
        """Keep one datagram; after `close`, or after a failure, it is only counted."""
        address, port = datagram.source
        self._writer.append(datagram.payload, time_ns=round(datagram.arrival * 1e9), address=address, port=port)

    def close(self) -> None:
        """Write the rest and close the file; waits DISK_WAIT_S at most."""
        if self._ending.is_set():
            return
        self._ending.set()
        self._thread.join(DISK_WAIT_S)
        if self._thread.is_alive():
            self._hung = "the disk does not answer"
        if self.failure or self.lost:
            reason = self.failure or "the disk was too slow"
            self._notify(f"the recording is not whole: {reason}; {self.lost} datagrams are missing")

    def _run(self) -> None:
        while not self._ending.wait(FLUSH_S) and not self._writer.error:
            self._writer.flush()
        self._writer.close()
