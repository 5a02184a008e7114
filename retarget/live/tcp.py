"""MVN over TCP: the streamer connects to our port, and its datagrams come end to end."""

import socket
from collections import deque
from contextlib import suppress
from typing import Self

from retarget.live.address import StreamAddress
from retarget.live.datagram import MOST_PER_POLL, Datagram, Source
from retarget.live.udp_socket import not_bound
from retarget.sources.mvn_stream import MvnStream

__all__ = ["NOT_THE_SENDER", "SECOND_CONNECTION", "SILENT_S", "TcpReceiver"]

CHUNK = 16_384
MOST_BYTES = 2 * CHUNK
"""That one poll reads: thirty times what MVN sends in a tick. The rest waits in the kernel, and then at the sender."""
SILENT_S = 1.0
"""A connection without a byte for so long gives way to a new one: its computer may be gone without a word."""
MOST_CALLERS = 8
"""Connections that one poll looks at."""
NOT_THE_SENDER = "connection from another computer"
SECOND_CONNECTION = "a second connection"


class TcpReceiver:
    """A port of ours that is polled as a UDP socket is. It hears one connection at a time, from `host` only.

    Arrival is the time of the poll: TCP tells no other. dropped: connections that were refused, and bytes that are no
    datagram. What is not fetched waits in the kernel, which then slows the sender down.
    """

    def __init__(self, address: StreamAddress) -> None:
        """Listen. Raises InputError: the port is taken or forbidden, there is no such interface."""
        assert address.host is not None
        self._host = address.host
        self._connection: socket.socket | None = None
        self._source: Source = ("", 0)
        self._heard = 0.0
        self._stream = MvnStream()
        self.dropped = self._stream.dropped
        self._waiting: deque[bytes] = deque()
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        # A port whose last connection has just ended may be used again; one that is listened on may not.
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((address.bind, address.port))
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise not_bound(address, error, protocol="tcp") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def port(self) -> int:
        """Where it listens; 0 once it is closed."""
        return 0 if self._listener.fileno() < 0 else int(self._listener.getsockname()[1])

    @property
    def connected(self) -> bool:
        """Whether the sender has connected, as far as the last poll saw."""
        return self._connection is not None

    def close(self) -> None:
        """Close the port and the connection; twice does no harm."""
        self._listener.close()
        self._hang_up()
        self._waiting.clear()

    @property
    def finished(self) -> bool:
        """Never: somebody may always send."""
        return False

    def poll(self, now: float) -> list[Datagram]:
        """The datagrams that came whole until `now` (s), oldest first, at most MOST_PER_POLL."""
        self._accept(now)
        room = MOST_BYTES
        while self._connection is not None and room > 0 and len(self._waiting) < MOST_PER_POLL:
            try:
                chunk = self._connection.recv(CHUNK)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                chunk = b""
            if not chunk:
                self._hang_up()
                break
            self._heard = now
            room -= len(chunk)
            self._waiting.extend(self._stream.feed(chunk))
        taken = min(len(self._waiting), MOST_PER_POLL)
        return [Datagram(now, self._source, self._waiting.popleft()) for _ in range(taken)]

    def _accept(self, now: float) -> None:
        """Answer who calls: the sender, if nobody is connected or the one who is has fallen silent."""
        for _ in range(MOST_CALLERS):
            try:
                caller, source = self._listener.accept()
            except OSError:
                return
            if source[0] != self._host:
                self.dropped.note(NOT_THE_SENDER)
                caller.close()
            elif self._connection is not None and now - self._heard < SILENT_S:
                self.dropped.note(SECOND_CONNECTION)
                caller.close()
            else:
                self._hang_up()
                caller.setblocking(False)
                self._connection, self._source, self._heard = caller, source, now

    def _hang_up(self) -> None:
        """End the connection; half a datagram of it is not put together with what the next one brings."""
        if self._connection is not None:
            with suppress(OSError):
                self._connection.close()
        self._connection = None
        self._stream = MvnStream()
        self._stream.dropped = self.dropped
