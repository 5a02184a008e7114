"""A raw recording in place of a socket: the same datagrams, as far apart as they came, on whatever clock is given."""

from collections.abc import Iterator
from itertools import islice
from typing import Self

from retarget.errors import InputError, UsageError
from retarget.live.address import StreamAddress, parse_address
from retarget.live.address_options import RECORDED
from retarget.live.datagram import MOST_BYTES_PER_POLL, MOST_PER_POLL, Datagram
from retarget.sources import raw_record
from retarget.sources.datagram_kinds import recognise
from retarget.sources.raw_record import RawReader
from retarget.sources.stream_frame import Dropped

__all__ = ["ReplayReceiver", "open_replay", "recorded_kind"]

UNKNOWN_SOURCE = "127.0.0.1"
"""Address of the senders of a recording that holds none."""
LOOKED_AT = 100
"""Datagrams by which a recording is recognised that does not say what it holds."""
LONE_GAP_S = 0.1
"""Between two rounds of a recording whose datagrams all have one time."""


class ReplayReceiver:
    """Datagrams of a recording that fall due as the time that `poll` is given goes on; the first one at once.

    A time of the recording that goes back counts as none passed. With `loop`, each round follows the one before by the
    mean gap of its datagrams. The file is read as it is played, through a buffer, one datagram ahead.
    """

    def __init__(self, reader: RawReader, *, speed: float = 1.0, loop: bool = False) -> None:
        """`speed`: recorded seconds per second. Raises ValueError unless it is above 0."""
        if not 0.0 < speed < float("inf"):
            raise ValueError(f"a replay goes forward at a finite speed; found {speed}")
        self.dropped = Dropped()
        self._reader, self._speed, self._loop = reader, speed, loop
        self._rows: Iterator[raw_record.Datagram] = iter(reader)
        self._next: raw_record.Datagram | None = None
        self._due = 0.0
        """When `_next` arrives, s on the clock of `poll`; before that, when the one before it arrived."""
        self._recorded: float | None = None
        """Recorded time of the last datagram, s; None at the start of a round."""
        self._count = 0
        self._round_began = 0.0
        self._started = self._finished = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def finished(self) -> bool:
        """Whether everything has been returned; never with `loop`, unless the recording is empty."""
        return self._finished

    @property
    def damage(self) -> str:
        """Where and how the recording broke off; "" if it is whole, as far as it was played."""
        return self._reader.damage

    def close(self) -> None:
        """End the replay."""
        self._next, self._finished = None, True

    def poll(self, now: float) -> list[Datagram]:
        """What has fallen due until `now` (s), with the times at which it did. Bounded as that of a socket is."""
        if not self._started:
            self._started, self._due, self._round_began = True, now, now
            self._load()
        found: list[Datagram] = []
        room = MOST_BYTES_PER_POLL
        while self._next is not None and self._due <= now and len(found) < MOST_PER_POLL and room > 0:
            row = self._next
            found.append(Datagram(self._due, (row.address or UNKNOWN_SOURCE, row.port), row.payload))
            room -= len(row.payload)
            self._load()
        return found

    def _load(self) -> None:
        """Fetch the next datagram and when it is due."""
        row = next(self._rows, None)
        if row is None:
            row = self._next_round()
        if row is None:
            self.close()
            return
        if self._recorded is not None:
            self._due += max(row.time_s - self._recorded, 0.0) / self._speed
        self._next, self._recorded = row, row.time_s
        self._count += 1

    def _next_round(self) -> raw_record.Datagram | None:
        if self._reader.damage:
            self.dropped.note("the recording is damaged")
        if not self._loop or self._count == 0:
            return None
        span = self._due - self._round_began
        self._due += span / (self._count - 1) if span > 0.0 else LONE_GAP_S / self._speed
        self._round_began, self._recorded, self._count = self._due, None, 0
        self._rows = iter(self._reader)
        return next(self._rows, None)


def open_replay(address: StreamAddress) -> ReplayReceiver:
    """Open the recording of a `replay://` address. Raises InputError if it is missing or no recording."""
    assert address.path is not None
    return ReplayReceiver(RawReader(address.path), speed=address.speed, loop=address.loop)


def recorded_kind(address: StreamAddress) -> str:
    """What kind of stream a recording holds: by `?kind=`, by the address that it was recorded from, or by its first
    datagrams, if all that are known are of one kind.

    Raises InputError if none says so, or if the file is missing or no recording.
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
    raise InputError(
        "the recording does not say what kind of stream it holds",
        where=address.text,
        found=repr(url[:100]) if url else "",
        allowed=", ".join(RECORDED),
        next_step="Add ?kind=vmc, for example",
    )
