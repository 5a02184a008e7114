"""The run's end of `web://`: the process of the page, and the poses that browsers send."""

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from retarget.live.address import LOOPBACK
from retarget.live.admission import MOST_PER_POLL, Datagram
from retarget.sources.streams.stream_frame import MAX_DATAGRAM, Dropped
from retarget.web.feed import BUFFER_BYTES, Settings, ViewFeed, open_feed

HEADER = struct.Struct("<dI")
"""Precedes each frame of poses: time of arrival, s, and number of the performer."""
PAUSE, GO_ON = "pause", "go on"
GRIP, RELEASE, STICK, HEALTH, NOTE = "grip ", "release ", "stick ", "health ", "note "
"""Messages of the page to the run. The number of a dead-man control follows GRIP and RELEASE, three shares (-1 to 1) of
the fastest walk follow STICK, JSON follows HEALTH, and a sentence NOTE."""


class PoseReceiver:
    """Frames of poses from the process of the page, a `retarget.live.admission.Receiver`. The port of an address is the
    number of the performer."""

    finished = False
    """A page may always send again."""

    def __init__(self, link: socket.socket) -> None:
        """link: of type SOCK_SEQPACKET."""
        self.dropped = Dropped()
        self._link = link
        self._link.setblocking(False)

    def poll(self, now: float) -> list[Datagram]:
        """Return at most MOST_PER_POLL new frames, oldest first. now: s. Never blocks or raises."""
        found: list[Datagram] = []
        for _ in range(MOST_PER_POLL):
            try:
                message = self._link.recv(HEADER.size + MAX_DATAGRAM)
            except OSError:
                break
            if len(message) <= HEADER.size:  # the process of the page has ended
                break
            arrival, number = HEADER.unpack_from(message)
            found.append(Datagram(min(arrival, now), (LOOPBACK, number), message[HEADER.size :]))
        return found

    def close(self) -> None:
        """Close the socket. A second call has no effect."""
        self._link.close()


@contextmanager
def open_web(settings: Settings) -> Iterator[tuple[ViewFeed, PoseReceiver]]:
    """Serve the page of `web://` until the run ends. Raises ConfigError if the page does not open."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    with ours, theirs, open_feed(replace(settings, poses=theirs.fileno())) as feed:
        yield feed, PoseReceiver(ours)
