"""The run's end of `web://`: its page in a process of its own, and the poses that browsers send."""

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
"""Before each frame of poses: when it arrived, s of this machine's monotonic clock, and the number of its performer."""
PAUSE, GO_ON = "pause", "go on"
GRIP, RELEASE, STICK, HEALTH, NOTE = "grip ", "release ", "stick ", "health ", "note "
"""Words of the page to the run. Behind the last five stand the number of a dead-man control, twice, three shares (-1 to
1) of the fastest walk, what a browser says of itself, as JSON, and a sentence."""


class PoseReceiver:
    """Frames of poses from the process of the page. Implements `retarget.live.admission.Receiver`.

    A performer is a source of its own: 127.0.0.1 and the number that the page's process gives it.
    """

    finished = False
    """A page may always send again."""

    def __init__(self, link: socket.socket) -> None:
        """link: a socket that keeps the limits of messages (SOCK_SEQPACKET)."""
        self.dropped = Dropped()
        self._link = link
        self._link.setblocking(False)

    def poll(self, now: float) -> list[Datagram]:
        """What has arrived until `now`, s, oldest first, at most MOST_PER_POLL. Never blocks or raises."""
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
    """The page of `web://`, until the run ends. Raises ConfigError or what it refuses."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    with ours, theirs, open_feed(replace(settings, poses=theirs.fileno())) as feed:
        yield feed, PoseReceiver(ours)
