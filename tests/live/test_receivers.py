"""The sockets of a NatNet stream, against a server of loopback that speaks just enough."""

import select
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from datagrams import CLOCK, PATIENCE_S
from messages import refuses, shows
from mvn_packets import quaternions, standing
from natnet_packets import Motion, frame, server_info
from retarget.errors import InputError
from retarget.live.address import StreamAddress, parse_address
from retarget.live.admission import MOST_PER_POLL, Datagram
from retarget.live.open_stream import open_receiver
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.receivers import (
    NOT_THE_SENDER,
    NOT_THE_SERVER,
    REACQUISITION_S,
    SECOND_CONNECTION,
    SILENT_S,
    NatnetReceiver,
    TcpReceiver,
    session_for,
)
from retarget.live.udp import UdpReceiver
from retarget.sources.natnet_wire import MessageId, Version, split
from retarget.sources.raw_record import RawWriter

GROUP = "239.255.42.99"
UNICAST = parse_address("natnet://127.0.0.1")
MULTICAST = replace(parse_address(f"natnet://127.0.0.1?multicast={GROUP}"), port=0)
VERSION = Version(4, 1)


class Server:
    """Motive, as far as its socket goes."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        self.socket.settimeout(PATIENCE_S)
        self.port: int = self.socket.getsockname()[1]

    def asked(self) -> tuple[int, tuple[str, int]]:
        """The kind of the next question, and who asks."""
        question, source = self.socket.recvfrom(65_536)
        parts = split(question)
        assert parts is not None
        return parts[0], source


@contextmanager
def conversation(address: StreamAddress) -> Iterator[tuple[Server, NatnetReceiver]]:
    server = Server()
    with server.socket, closing(NatnetReceiver(address, session_for(address), command_port=server.port)) as receiver:
        yield server, receiver


def received(receiver: NatnetReceiver, count: int) -> list[Datagram]:
    """Polls until `count` datagrams came."""
    found: list[Datagram] = []
    sockets = [part for part in (receiver._commands, receiver._frames) if part is not None]
    while len(found) < count:
        assert select.select(sockets, [], [], PATIENCE_S)[0], "nothing arrived over loopback"
        found += receiver.poll(CLOCK.now())
    return found


def test_unicast_goes_through_one_socket() -> None:
    with conversation(UNICAST) as (server, receiver):
        assert receiver.poll(CLOCK.now()) == []
        kind, client = server.asked()
        assert kind == MessageId.CONNECT and client == ("127.0.0.1", receiver.bound[1])
        server.socket.sendto(server_info(VERSION), client)
        assert len(received(receiver, 1)) == 1 and receiver.session.server is not None
        receiver.poll(CLOCK.now())
        assert {server.asked()[0] for _ in range(2)} == {MessageId.DEFINITIONS_REQUEST, MessageId.KEEP_ALIVE}
        server.socket.sendto(frame(Motion(), VERSION), client)
        assert [datagram.payload for datagram in received(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1 and receiver.dropped.count == receiver.overflowed == 0


def test_frames_come_through_the_group_and_the_port_that_the_server_reports() -> None:
    with conversation(MULTICAST) as (server, receiver):
        receiver.poll(CLOCK.now())
        client = server.asked()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((GROUP, 0))
            port = probe.getsockname()[1]
        server.socket.sendto(server_info(VERSION, multicast=True, port=port), client)
        received(receiver, 1)
        assert receiver.join_error == "" and receiver._frames is not None and receiver._frames.bound[1] == port
        same = receiver._frames
        server.socket.sendto(frame(Motion(), VERSION), (GROUP, port))
        if not select.select([same], [], [], PATIENCE_S / 5)[0]:
            pytest.skip("this kernel delivers no multicast over loopback")
        assert [datagram.payload for datagram in received(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1 and receiver._frames is same


def test_a_group_that_cannot_be_joined_is_reported_and_tried_again() -> None:
    with conversation(MULTICAST) as (server, receiver):
        receiver.poll(CLOCK.now())
        client = server.asked()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind((GROUP, 0))
            port = taken.getsockname()[1]
            before = receiver._frames
            server.socket.sendto(server_info(VERSION, multicast=True, port=port), client)
            received(receiver, 1)
            shows(receiver.join_error)
            assert receiver._frames is before
        receiver.poll(CLOCK.now())
        assert receiver.join_error, "not before its time"
        receiver.poll(CLOCK.now() + REACQUISITION_S)
        assert receiver.join_error == "" and receiver._frames is not None and receiver._frames.bound[1] == port


def test_only_datagrams_of_the_server_are_returned() -> None:
    address = replace(UNICAST, bind="127.0.0.1", host="127.0.0.9")
    with conversation(address) as (server, receiver):
        server.socket.sendto(server_info(VERSION), ("127.0.0.1", receiver.bound[1]))
        assert select.select([receiver._commands], [], [], PATIENCE_S)[0]
        assert receiver.poll(CLOCK.now()) == [] and receiver.session.server is None
        assert receiver.dropped.reasons == {NOT_THE_SERVER: 1}


def test_a_group_without_interface_is_refused_at_start() -> None:
    address = replace(MULTICAST, interface="203.0.113.77")
    with refuses(InputError):
        NatnetReceiver(address, session_for(address))


def test_the_session_follows_the_address() -> None:
    assert not session_for(UNICAST).multicast
    assert session_for(MULTICAST).multicast
    assert session_for(parse_address("natnet://127.0.0.1?version=3.1")).wanted == Version(3, 1)


ADDRESS = replace(parse_address("mvn://?tcp=127.0.0.1"), port=0)


@contextmanager
def calling(receiver: TcpReceiver, source: str = "127.0.0.1") -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", receiver.bound[1]), PATIENCE_S, (source, 0)) as caller:
        yield caller


def datagram(number: int) -> bytes:
    return quaternions(standing(), sample=number)


def connected(receiver: TcpReceiver) -> bool:
    return receiver.connection is not None


def ready(connection: socket.socket | None) -> None:
    assert connection is not None
    assert select.select([connection], [], [], PATIENCE_S)[0], "nothing arrived over loopback"


def tcp_received(receiver: TcpReceiver, count: int, now: float = 0.0) -> list[Datagram]:
    found: list[Datagram] = []
    while len(found) < count:
        if not receiver._waiting:
            ready(receiver.connection or receiver._listener)
        found += receiver.poll(now)
    return found


def test_datagrams_that_come_end_to_end_and_in_pieces() -> None:
    with closing(TcpReceiver(ADDRESS)) as receiver, calling(receiver) as caller:
        assert not connected(receiver)
        sent = [datagram(number) for number in range(5)]
        whole = b"".join(sent)
        for piece in (whole[:10], whole[10:1000], whole[1000:]):
            caller.sendall(piece)
        found = tcp_received(receiver, 5, now=7.5)
        assert [row.payload for row in found] == sent and connected(receiver)
        assert {(row.arrival, row.source) for row in found} == {(7.5, caller.getsockname())}
        assert receiver.poll(8.0) == [] and receiver.dropped.count == 0


def test_another_computer_is_turned_away() -> None:
    with closing(TcpReceiver(ADDRESS)) as receiver, calling(receiver, "127.0.0.9") as other:
        other.sendall(datagram(1))
        ready(receiver._listener)
        assert receiver.poll(0.0) == [] and not connected(receiver)
        assert receiver.dropped.reasons == {NOT_THE_SENDER: 1}
        with calling(receiver) as caller:
            caller.sendall(datagram(2))
            assert [row.payload for row in tcp_received(receiver, 1)] == [datagram(2)]


def test_a_second_connection_waits_until_the_first_is_silent() -> None:
    with closing(TcpReceiver(ADDRESS)) as receiver, calling(receiver) as first:
        first.sendall(datagram(1))
        tcp_received(receiver, 1, now=10.0)
        with calling(receiver) as second:
            ready(receiver._listener)
            assert receiver.poll(10.0 + 0.9 * SILENT_S) == []
            assert receiver.dropped.reasons == {SECOND_CONNECTION: 1}
            assert second.recv(1) == b"", "turned away"
        first.sendall(datagram(2)[:100])
        ready(receiver.connection)
        receiver.poll(11.0)
        with calling(receiver) as third:
            third.sendall(datagram(3))
            ready(receiver._listener)
            found = receiver.poll(11.0 + SILENT_S) or tcp_received(receiver, 1, now=11.0 + SILENT_S)
            assert [(row.payload, row.source) for row in found] == [(datagram(3), third.getsockname())]


def test_the_sender_may_come_back() -> None:
    with closing(TcpReceiver(ADDRESS)) as receiver:
        for number in range(3):
            with calling(receiver) as caller:
                caller.sendall(datagram(number) + datagram(9)[:50])
                assert [row.payload for row in tcp_received(receiver, 1)] == [datagram(number)]
            while receiver.connection:
                ready(receiver.connection)
                assert receiver.poll(0.0) == []
        assert receiver.dropped.count == 0, "half a datagram is no mistake of the next connection"


def test_a_connection_that_breaks_is_only_the_end_of_it() -> None:
    with closing(TcpReceiver(ADDRESS)) as receiver, calling(receiver) as caller:
        caller.sendall(datagram(1))
        tcp_received(receiver, 1)
        caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        caller.close()
        ready(receiver.connection)
        assert receiver.poll(0.0) == [] and not receiver.connection


def test_garbage_is_counted_and_a_poll_is_bounded() -> None:
    small = quaternions([])
    with closing(TcpReceiver(ADDRESS)) as receiver, calling(receiver) as caller:
        caller.sendall(b"no datagram at all" + small * 1000)
        found = tcp_received(receiver, 1)
        assert len(found) == MOST_PER_POLL
        found += tcp_received(receiver, 1000 - MOST_PER_POLL)
        assert {row.payload for row in found} == {small} and len(found) == 1000
        assert receiver.dropped.count == 1


def test_a_port_that_is_taken_is_named() -> None:
    with closing(TcpReceiver(ADDRESS)) as first, refuses(InputError, "TCP"):
        TcpReceiver(replace(ADDRESS, port=first.bound[1]))


def test_tcp_a_closed_receiver_stays_quiet() -> None:
    receiver = TcpReceiver(ADDRESS)
    with calling(receiver) as caller:
        caller.sendall(datagram(1) * (MOST_PER_POLL + 5))
        tcp_received(receiver, 1)
        receiver.close()
        receiver.close()
        assert receiver.poll(0.0) == [] and receiver.connection is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("vmc://", UdpReceiver),
        ("vrchat://", UdpReceiver),
        ("json://:7000", UdpReceiver),
        ("mvn://", UdpReceiver),
        ("mvn://?tcp=127.0.0.1", TcpReceiver),
        ("natnet://127.0.0.1", NatnetReceiver),
        ("natnet://127.0.0.1?multicast=239.255.42.99", NatnetReceiver),
        ("replay://FILE", ReplayReceiver),
    ],
)
def test_an_address_finds_its_receiver(text: str, expected: type, tmp_path: Path) -> None:
    RawWriter(tmp_path / "a.raw", url="vmc://").close()
    address = replace(parse_address(text.replace("FILE", str(tmp_path / "a.raw"))), port=0)
    receiver = open_receiver(address)
    assert isinstance(receiver, expected)
    assert receiver.poll(0.0) == []
    receiver.close()
