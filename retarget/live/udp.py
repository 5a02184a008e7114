"""Datagrams from a UDP socket, with the time at which the kernel got them; bounded, and never waiting."""

import errno
import socket
import struct
from collections.abc import Callable
from typing import Self

from hardware.clock import wall_to_monotonic
from retarget.live.address import StreamAddress
from retarget.live.datagram import MOST_BYTES_PER_POLL, MOST_PER_POLL, Datagram, Source
from retarget.live.udp_socket import SO_RXQ_OVFL, SO_TIMESTAMPNS, open_socket
from retarget.sources.stream_frame import MAX_DATAGRAM, Dropped

__all__ = ["UdpReceiver"]

REMEASURE_S = 1.0
"""Between two looks at how wall and monotonic clock lie: NTP may slew by 0.5 ms in it, hardly more."""
TOLERANCE_S = 0.001
"""A stamp up to this long before the last poll that found the socket empty is inexact; an earlier one is wrong."""
CONTROL_BYTES = socket.CMSG_SPACE(16) + socket.CMSG_SPACE(4)
TIMESPEC = struct.Struct("@ll")
COUNTER = struct.Struct("@I")
GONE = {errno.EAGAIN, errno.EWOULDBLOCK}
TRANSIENT = {errno.EINTR, errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH}
"""Also what a datagram of ours (a keep-alive) met on its way: told on the next receive, and no fault of the stream."""


class UdpReceiver:
    """A socket that is polled by the loop.

    dropped: what was not passed on, by reason. overflowed: datagrams that the kernel lost because nobody fetched them
    in time. buffer: bytes that the kernel granted. `wall_offset`: see `hardware.clock.wall_to_monotonic`; it is None
    where `now` is not of the machine's monotonic clock, and arrival is then the time of the poll.
    """

    def __init__(
        self,
        address: StreamAddress,
        *,
        wall_offset: Callable[[], int] | None = wall_to_monotonic,
        longest: int = MAX_DATAGRAM,
    ) -> None:
        """Open the socket. `longest`: bytes of a datagram that is passed on. Raises InputError, see `open_socket`."""
        assert 0 < longest <= MAX_DATAGRAM
        self.dropped = Dropped()
        self.overflowed = 0
        self._longest = longest
        self._socket = open_socket(address)
        self.buffer = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._wall_offset = wall_offset
        self._offset = 0
        self._measured = float("-inf")
        self._emptied = float("-inf")
        """When the socket was last found empty: what is read later arrived later."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def port(self) -> int:
        """Where the socket listens; 0 once it is closed."""
        return 0 if self._socket.fileno() < 0 else int(self._socket.getsockname()[1])

    @property
    def bound(self) -> Source:
        """Address and port where the socket listens; ("", 0) once it is closed."""
        if self._socket.fileno() < 0:
            return "", 0
        host, port = self._socket.getsockname()[:2]
        return str(host), int(port)

    def fileno(self) -> int:
        """For `select`; -1 once closed."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket; twice does no harm, and a poll then returns nothing."""
        self._socket.close()

    def send(self, payload: bytes, to: Source) -> bool:
        """Send a request or keep-alive from our port; whether the kernel took it. Never blocks, never raises."""
        try:
            return self._socket.sendto(payload, to) == len(payload)
        except OSError:
            return False

    @property
    def finished(self) -> bool:
        """Never: somebody may always send."""
        return False

    def poll(self, now: float) -> list[Datagram]:
        """What has arrived until `now` (s), oldest first, at most MOST_PER_POLL datagrams and MOST_BYTES_PER_POLL."""
        if self._wall_offset is not None and now - self._measured >= REMEASURE_S:
            self._offset, self._measured = self._wall_offset(), now
        found: list[Datagram] = []
        room = MOST_BYTES_PER_POLL
        receive, longest = self._socket.recvmsg, self._longest
        for _ in range(MOST_PER_POLL):
            try:
                payload, control, flags, source = receive(longest, CONTROL_BYTES)
            except OSError as error:
                if error.errno in GONE:
                    self._emptied = now
                    break
                if error.errno in TRANSIENT:
                    continue
                self.dropped.note("the socket cannot be read")
                break
            arrival = self._arrival(control, now)
            if flags & socket.MSG_TRUNC:
                self.dropped.note("datagram too long")
            elif not payload:
                self.dropped.note("empty datagram")
            else:
                found.append(Datagram(arrival, source, payload))
            room -= len(payload)
            if room <= 0:
                break
        return found

    def _arrival(self, control: list[tuple[int, int, bytes]], now: float) -> float:
        """When the kernel got a datagram, s on the clock of `now`; `now` where that cannot be known."""
        arrival = now
        for _, kind, content in control:
            if kind == SO_RXQ_OVFL and len(content) == COUNTER.size:
                self.overflowed = COUNTER.unpack(content)[0]
            elif kind == SO_TIMESTAMPNS and len(content) == TIMESPEC.size and self._wall_offset is not None:
                seconds, nanoseconds = TIMESPEC.unpack(content)
                arrival = self._checked((seconds * 1_000_000_000 + nanoseconds + self._offset) * 1e-9, now)
        return arrival

    def _checked(self, arrival: float, now: float) -> float:
        """A stamp that the wall clock cannot have spoilt: between the last empty socket and now, otherwise `now`.

        Somebody may set the wall clock at any time. Too late is harmless (the least delay counts), too early is not.
        """
        if arrival >= self._emptied - TOLERANCE_S:
            return min(max(arrival, self._emptied), now)
        self._measured = float("-inf")  # the next poll measures anew
        return now
