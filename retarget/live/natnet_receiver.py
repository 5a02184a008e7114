"""The sockets of a NatNet stream: questions and keep-alives out; answers and frames, unicast or multicast, in."""

from collections.abc import Callable
from dataclasses import replace
from typing import Self

from hardware.clock import wall_to_monotonic
from retarget.errors import InputError
from retarget.live.address import NATNET_COMMAND_PORT, StreamAddress
from retarget.live.datagram import Datagram
from retarget.live.udp import UdpReceiver
from retarget.sources.natnet_session import NatnetSession, SessionSettings
from retarget.sources.natnet_wire import Version
from retarget.sources.stream_frame import Dropped

__all__ = ["REJOIN_S", "NatnetReceiver", "session_for"]

REJOIN_S = 5.0
"""Between two tries to join a group that the server told of."""
NOT_THE_SERVER = "sender is not the server"


class NatnetReceiver:
    """Polled as a socket is; each poll also sends what the session has to say, and tells it what the server answered.

    In multicast, frames come through a second socket, which follows the group and port that the server tells.
    dropped: what others than the server sent. trouble: why that group is not heard, "" while all is well; the old one
    is then kept, and the new one tried again every REJOIN_S.
    """

    def __init__(
        self,
        address: StreamAddress,
        session: NatnetSession,
        *,
        command_port: int = NATNET_COMMAND_PORT,
        wall_offset: Callable[[], int] | None = wall_to_monotonic,
    ) -> None:
        """Open the sockets; nothing is sent yet. Raises InputError, see `udp_socket.open_socket`."""
        assert address.kind == "natnet" and address.host is not None
        self.session = session
        self.trouble = ""
        self.dropped = Dropped()
        self._wall_offset = wall_offset
        self.host = address.host
        self._server = (address.host, command_port)
        self._frames_at = address
        self._frames: UdpReceiver | None = None
        self._tried = float("-inf")
        commands = replace(address, bind=address.interface, port=0, multicast=None)
        self._commands = UdpReceiver(commands, wall_offset=wall_offset)
        if address.multicast is not None:
            try:
                self._frames = UdpReceiver(address, wall_offset=wall_offset)
            except InputError:
                self._commands.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def port(self) -> int:
        """Where the server's answers, and in unicast its frames, come to; 0 once closed."""
        return self._commands.port

    @property
    def overflowed(self) -> int:
        """Datagrams that the kernel lost because nobody fetched them in time."""
        return self._commands.overflowed + (self._frames.overflowed if self._frames is not None else 0)

    def close(self) -> None:
        """Close the sockets; twice does no harm."""
        self._commands.close()
        if self._frames is not None:
            self._frames.close()

    @property
    def finished(self) -> bool:
        """Never: somebody may always send."""
        return False

    def poll(self, now: float) -> list[Datagram]:
        """What the server sent until `now` (s), oldest first; bounded by what two sockets may give. Never raises."""
        for message in self.session.poll(now):
            self._commands.send(message, self._server)
        found = self._commands.poll(now)
        if self._frames is not None:
            found += self._frames.poll(now)
            found.sort(key=lambda datagram: datagram.arrival)
        heard = [datagram for datagram in found if datagram.source[0] == self._server[0]]
        for _ in range(len(found) - len(heard)):
            self.dropped.note(NOT_THE_SERVER)
        for datagram in heard:
            self.session.receive(now, datagram.payload)
        self._follow(now)
        return heard

    def _follow(self, now: float) -> None:
        """Join the group that the server told of, where it is another one than that which is heard."""
        server = self.session.server
        if self._frames is None or server is None or not server.multicast:
            return
        group, port = self.session.group, self.session.data_port
        if (group, port) == (self._frames_at.multicast, self._frames_at.port) or now - self._tried < REJOIN_S:
            return
        self._tried = now
        address = replace(self._frames_at, bind=group, multicast=group, port=port)
        try:
            joined = UdpReceiver(address, wall_offset=self._wall_offset)
        except InputError as error:
            self.trouble = str(error)
            return
        self._frames.close()
        self._frames, self._frames_at, self.trouble = joined, address, ""


def session_for(address: StreamAddress) -> NatnetSession:
    """The conversation that a `natnet://` address asks for: unicast or multicast, and the version to pin."""
    settings = SessionSettings(transport="unicast" if address.multicast is None else "multicast")
    if address.version is not None:
        settings = replace(settings, version=Version(*address.version))
    return NatnetSession(settings)
