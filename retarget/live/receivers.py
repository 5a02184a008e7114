"""Receivers of more than one UDP socket: NatNet with its requests and answers, and MVN over TCP."""

import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from hardware.clock import wall_to_monotonic
from retarget.errors import InputError
from retarget.live.address import NATNET_COMMAND_PORT, StreamAddress
from retarget.live.admission import MOST_PER_POLL, Datagram, Source
from retarget.live.udp import UdpReceiver, not_bound
from retarget.sources.mvn import MvnStream
from retarget.sources.natnet_session import PINNED, NatnetSession
from retarget.sources.natnet_wire import Version
from retarget.sources.stream_frame import Dropped

REACQUISITION_S = 5.0
"""Time between two attempts to join the multicast group that the server reports."""
NOT_THE_SERVER = "sender is not the server"


class NatnetReceiver:
    """Receives frames from Motive. Each poll also sends the requests of the session, and hands it the answers.

    In multicast, frames come through a second socket, which follows the group and port that the server reports.
    dropped: datagrams of others than the server. join_error: why the reported group could not be joined, "" if there is
    no error; the old group is then kept, and the new one tried again every REACQUISITION_S. bound: address and port
    that receive the server's answers, and in unicast its frames.
    """

    finished = False

    def __init__(
        self,
        address: StreamAddress,
        session: NatnetSession,
        *,
        command_port: int = NATNET_COMMAND_PORT,
        wall_offset: Callable[[], int] | None = wall_to_monotonic,
    ) -> None:
        """Open the sockets; nothing is sent yet. Raises InputError, see `udp.open_socket`."""
        assert address.kind == "natnet" and address.host is not None
        self.session = session
        self.join_error = ""
        self.dropped = Dropped()
        self._wall_offset = wall_offset
        self.host = address.host
        self._server = (address.host, command_port)
        self._frames_at = address
        self._frames: UdpReceiver | None = None
        self._tried = float("-inf")
        commands = replace(address, bind=address.interface, port=0, multicast=None)
        self._commands = UdpReceiver(commands, wall_offset=wall_offset)
        self.bound = self._commands.bound
        if address.multicast is not None:
            try:
                self._frames = UdpReceiver(address, wall_offset=wall_offset)
            except InputError:
                self._commands.close()
                raise

    @property
    def overflowed(self) -> int:
        """Datagrams that the kernel lost because they were not fetched in time."""
        return self._commands.overflowed + (self._frames.overflowed if self._frames is not None else 0)

    def close(self) -> None:
        """Close the sockets. A second call has no effect."""
        self._commands.close()
        if self._frames is not None:
            self._frames.close()

    def poll(self, now: float) -> list[Datagram]:
        """The datagrams of the server until `now` (s), oldest first, bounded as for two sockets. Never raises."""
        for message in self.session.poll(now):
            self._commands.send(message, self._server)
        found = self._commands.poll(now)
        if self._frames is not None:
            found += self._frames.poll(now)
            found.sort(key=lambda datagram: datagram.arrival)
        received = [datagram for datagram in found if datagram.source[0] == self._server[0]]
        for _ in range(len(found) - len(received)):
            self.dropped.note(NOT_THE_SERVER)
        for datagram in received:
            self.session.receive(now, datagram.payload)
        self._follow(now)
        return received

    def _follow(self, now: float) -> None:
        """Join the group that the server reports, where it is not the present one."""
        server = self.session.server
        if self._frames is None or server is None or not server.multicast:
            return
        group, port = self.session.group, self.session.data_port
        if (group, port) == (self._frames_at.multicast, self._frames_at.port) or now - self._tried < REACQUISITION_S:
            return
        self._tried = now
        address = replace(self._frames_at, bind=group, multicast=group, port=port)
        try:
            joined = UdpReceiver(address, wall_offset=self._wall_offset)
        except InputError as error:
            self.join_error = str(error)
            return
        self._frames.close()
        self._frames, self._frames_at, self.join_error = joined, address, ""


def session_for(address: StreamAddress) -> NatnetSession:
    """The NatNet session of an address: unicast or multicast, and the version to request."""
    wanted = PINNED if address.version is None else Version(*address.version)
    return NatnetSession(multicast=address.multicast is not None, wanted=wanted)


# MVN over TCP: the streamer connects to our port, and its datagrams come end to end.

CHUNK = 16_384
MOST_BYTES = 2 * CHUNK
"""Bytes that one poll reads: thirty times what MVN sends in a tick. The rest waits in the kernel, then at the
sender."""
SILENT_S = 1.0
"""A new connection replaces one that sent no byte for this long: its computer may be gone without closing it."""
MOST_CALLERS = 8
"""Connections that one poll accepts or refuses."""
NOT_THE_SENDER = "connection from another computer"
SECOND_CONNECTION = "a second connection"


class TcpReceiver:
    """A TCP port that is polled like a UDP socket. It has one connection at a time, from `host` only.

    Arrival is the time of the poll: TCP gives no other. dropped: connections that were refused, and bytes that are no
    datagram. What is not fetched waits in the kernel, which then slows the sender down. bound: address and port where
    it listens. connection: with the sender, as far as the last poll saw.
    """

    finished = False

    def __init__(self, address: StreamAddress) -> None:
        """Listen. Raises InputError: the port is taken or forbidden, there is no such interface."""
        assert address.host is not None
        self._host = address.host
        self.connection: socket.socket | None = None
        self._source: Source = ("", 0)
        self._last_byte = 0.0  # [s]
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
        self.bound: Source = self._listener.getsockname()

    def close(self) -> None:
        """Close the port and the connection. A second call has no effect."""
        self._listener.close()
        self._hang_up()
        self._waiting.clear()

    def poll(self, now: float) -> list[Datagram]:
        """The whole datagrams that arrived until `now` (s), oldest first, at most MOST_PER_POLL."""
        self._accept(now)
        room = MOST_BYTES
        while self.connection is not None and room > 0 and len(self._waiting) < MOST_PER_POLL:
            try:
                chunk = self.connection.recv(CHUNK)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                chunk = b""
            if not chunk:
                self._hang_up()
                break
            self._last_byte = now
            room -= len(chunk)
            self._waiting.extend(self._stream.feed(chunk))
        taken = min(len(self._waiting), MOST_PER_POLL)
        return [Datagram(now, self._source, self._waiting.popleft()) for _ in range(taken)]

    def _accept(self, now: float) -> None:
        """Accept the sender, if there is no connection or it has fallen silent; refuse all others."""
        for _ in range(MOST_CALLERS):
            try:
                caller, source = self._listener.accept()
            except OSError:
                return
            if source[0] != self._host:
                self.dropped.note(NOT_THE_SENDER)
                caller.close()
            elif self.connection is not None and now - self._last_byte < SILENT_S:
                self.dropped.note(SECOND_CONNECTION)
                caller.close()
            else:
                self._hang_up()
                caller.setblocking(False)
                self.connection, self._source, self._last_byte = caller, source, now

    def _hang_up(self) -> None:
        """End the connection, and drop its incomplete datagram."""
        if self.connection is not None:
            with suppress(OSError):
                self.connection.close()
        self.connection = None
        self._stream = MvnStream()
        self._stream.dropped = self.dropped
