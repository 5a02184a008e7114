"""One datagram of a live stream, and what every receiver of them offers: sockets and recordings alike."""

from typing import NamedTuple, Protocol

from retarget.sources.stream_frame import Dropped

__all__ = ["MOST_BYTES_PER_POLL", "MOST_PER_POLL", "Datagram", "Receiver", "Source"]

MOST_PER_POLL = 128
"""Datagrams that one poll returns at most; the rest waits. 12,800 a second at 100 Hz."""
MOST_BYTES_PER_POLL = 2**20
"""Bytes after which a poll takes no further datagram."""

Source = tuple[str, int]
"""Address (as numbers) and port of a sender."""


class Datagram(NamedTuple):
    """What arrived at once. arrival: s of the clock whose `now` was given to `poll`; payload: 1 to 65,536 bytes."""

    arrival: float
    source: Source
    payload: bytes


class Receiver(Protocol):
    """Where datagrams come from."""

    dropped: Dropped

    @property
    def finished(self) -> bool:
        """Whether nothing will arrive any more, as at the end of a recording."""
        ...

    def poll(self, now: float) -> list[Datagram]:
        """What has arrived until `now` (s), oldest first, bounded in number and bytes. Never blocks, never raises."""
        ...

    def close(self) -> None:
        """Let go of what is open; twice does no harm."""
        ...
