"""The sockets of a NatNet stream, against a server of loopback that speaks just enough."""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from datagrams import CLOCK, PATIENCE_S
from natnet_packets import Motion, frame, server_info
from retarget.errors import InputError
from retarget.live.address import StreamAddress, parse_address
from retarget.live.datagram import Datagram
from retarget.live.natnet_receiver import NOT_THE_SERVER, REJOIN_S, NatnetReceiver, session_for
from retarget.sources.natnet_wire import MessageId, Version, split
from support.messages import refuses, shows

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
    with server.socket, NatnetReceiver(address, session_for(address), command_port=server.port) as receiver:
        yield server, receiver


def heard(receiver: NatnetReceiver, count: int) -> list[Datagram]:
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
        assert kind == MessageId.CONNECT and client == ("127.0.0.1", receiver.port)
        server.socket.sendto(server_info(VERSION), client)
        assert len(heard(receiver, 1)) == 1 and receiver.session.server is not None
        receiver.poll(CLOCK.now())
        assert {server.asked()[0] for _ in range(2)} == {MessageId.DEFINITIONS_REQUEST, MessageId.KEEP_ALIVE}
        server.socket.sendto(frame(Motion(), VERSION), client)
        assert [datagram.payload for datagram in heard(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1 and receiver.dropped.count == receiver.overflowed == 0


def test_frames_come_through_the_group_and_the_port_that_the_server_tells() -> None:
    with conversation(MULTICAST) as (server, receiver):
        receiver.poll(CLOCK.now())
        client = server.asked()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((GROUP, 0))
            port = probe.getsockname()[1]
        server.socket.sendto(server_info(VERSION, multicast=True, port=port), client)
        heard(receiver, 1)
        assert receiver.trouble == "" and receiver._frames is not None and receiver._frames.port == port
        same = receiver._frames
        server.socket.sendto(frame(Motion(), VERSION), (GROUP, port))
        if not select.select([same], [], [], PATIENCE_S / 5)[0]:
            pytest.skip("this kernel delivers no multicast over loopback")
        assert [datagram.payload for datagram in heard(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1 and receiver._frames is same


def test_a_group_that_cannot_be_joined_is_told_and_tried_again() -> None:
    with conversation(MULTICAST) as (server, receiver):
        receiver.poll(CLOCK.now())
        client = server.asked()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind((GROUP, 0))
            port = taken.getsockname()[1]
            before = receiver._frames
            server.socket.sendto(server_info(VERSION, multicast=True, port=port), client)
            heard(receiver, 1)
            shows(receiver.trouble)
            assert receiver._frames is before
        receiver.poll(CLOCK.now())
        assert receiver.trouble, "not before its time"
        receiver.poll(CLOCK.now() + REJOIN_S)
        assert receiver.trouble == "" and receiver._frames is not None and receiver._frames.port == port


def test_what_others_send_is_not_the_servers_word() -> None:
    address = replace(UNICAST, bind="127.0.0.1", host="127.0.0.9")
    with conversation(address) as (server, receiver):
        server.socket.sendto(server_info(VERSION), ("127.0.0.1", receiver.port))
        assert select.select([receiver._commands], [], [], PATIENCE_S)[0]
        assert receiver.poll(CLOCK.now()) == [] and receiver.session.server is None
        assert receiver.dropped.reasons == {NOT_THE_SERVER: 1}


def test_a_group_without_interface_is_refused_at_start() -> None:
    address = replace(MULTICAST, interface="203.0.113.77")
    with refuses(InputError):
        NatnetReceiver(address, session_for(address))


def test_the_session_follows_the_address() -> None:
    assert session_for(UNICAST).settings.transport == "unicast"
    assert session_for(MULTICAST).settings.transport == "multicast"
    assert session_for(parse_address("natnet://127.0.0.1?version=3.1")).settings.version == Version(3, 1)


def test_a_closed_receiver_stays_quiet() -> None:
    with conversation(MULTICAST) as (_, receiver):
        receiver.close()
        receiver.close()
        assert receiver.poll(CLOCK.now()) == [] and receiver.port == 0
