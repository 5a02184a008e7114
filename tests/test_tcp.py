"""MVN over TCP on loopback: datagrams end to end, one connection, one computer."""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from datagrams import PATIENCE_S
from mvn_packets import quaternions, standing
from retarget.errors import InputError
from retarget.live.address import parse_address
from retarget.live.datagram import MOST_PER_POLL, Datagram
from retarget.live.tcp import NOT_THE_SENDER, SECOND_CONNECTION, SILENT_S, TcpReceiver
from support.messages import refuses

ADDRESS = replace(parse_address("mvn://?tcp=127.0.0.1"), port=0)


@contextmanager
def calling(receiver: TcpReceiver, source: str = "127.0.0.1") -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S, (source, 0)) as caller:
        yield caller


def datagram(number: int) -> bytes:
    return quaternions(standing(), sample=number)


def connected(receiver: TcpReceiver) -> bool:
    return receiver.connected


def ready(connection: socket.socket | None) -> None:
    assert connection is not None
    assert select.select([connection], [], [], PATIENCE_S)[0], "nothing arrived over loopback"


def heard(receiver: TcpReceiver, count: int, now: float = 0.0) -> list[Datagram]:
    found: list[Datagram] = []
    while len(found) < count:
        if not receiver._waiting:
            ready(receiver._connection or receiver._listener)
        found += receiver.poll(now)
    return found


def test_datagrams_that_come_end_to_end_and_in_pieces() -> None:
    with TcpReceiver(ADDRESS) as receiver, calling(receiver) as caller:
        assert not connected(receiver)
        sent = [datagram(number) for number in range(5)]
        whole = b"".join(sent)
        for piece in (whole[:10], whole[10:1000], whole[1000:]):
            caller.sendall(piece)
        found = heard(receiver, 5, now=7.5)
        assert [row.payload for row in found] == sent and connected(receiver)
        assert {(row.arrival, row.source) for row in found} == {(7.5, caller.getsockname())}
        assert receiver.poll(8.0) == [] and receiver.dropped.count == 0


def test_another_computer_is_turned_away() -> None:
    with TcpReceiver(ADDRESS) as receiver, calling(receiver, "127.0.0.9") as stranger:
        stranger.sendall(datagram(1))
        ready(receiver._listener)
        assert receiver.poll(0.0) == [] and not connected(receiver)
        assert receiver.dropped.reasons == {NOT_THE_SENDER: 1}
        with calling(receiver) as caller:
            caller.sendall(datagram(2))
            assert [row.payload for row in heard(receiver, 1)] == [datagram(2)]


def test_a_second_connection_waits_until_the_first_is_silent() -> None:
    with TcpReceiver(ADDRESS) as receiver, calling(receiver) as first:
        first.sendall(datagram(1))
        heard(receiver, 1, now=10.0)
        with calling(receiver) as second:
            ready(receiver._listener)
            assert receiver.poll(10.0 + 0.9 * SILENT_S) == []
            assert receiver.dropped.reasons == {SECOND_CONNECTION: 1}
            assert second.recv(1) == b"", "turned away"
        first.sendall(datagram(2)[:100])
        ready(receiver._connection)
        receiver.poll(11.0)
        with calling(receiver) as third:
            third.sendall(datagram(3))
            ready(receiver._listener)
            found = receiver.poll(11.0 + SILENT_S) or heard(receiver, 1, now=11.0 + SILENT_S)
            assert [(row.payload, row.source) for row in found] == [(datagram(3), third.getsockname())]


def test_the_sender_may_come_back() -> None:
    with TcpReceiver(ADDRESS) as receiver:
        for number in range(3):
            with calling(receiver) as caller:
                caller.sendall(datagram(number) + datagram(9)[:50])
                assert [row.payload for row in heard(receiver, 1)] == [datagram(number)]
            while receiver.connected:
                ready(receiver._connection)
                assert receiver.poll(0.0) == []
        assert receiver.dropped.count == 0, "half a datagram is no mistake of the next connection"


def test_a_connection_that_breaks_is_only_the_end_of_it() -> None:
    with TcpReceiver(ADDRESS) as receiver, calling(receiver) as caller:
        caller.sendall(datagram(1))
        heard(receiver, 1)
        caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        caller.close()
        ready(receiver._connection)
        assert receiver.poll(0.0) == [] and not receiver.connected


def test_garbage_is_counted_and_a_poll_is_bounded() -> None:
    small = quaternions([])
    with TcpReceiver(ADDRESS) as receiver, calling(receiver) as caller:
        caller.sendall(b"no datagram at all" + small * 1000)
        found = heard(receiver, 1)
        assert len(found) == MOST_PER_POLL
        found += heard(receiver, 1000 - MOST_PER_POLL)
        assert {row.payload for row in found} == {small} and len(found) == 1000
        assert receiver.dropped.count == 1


def test_a_port_that_is_taken_is_named() -> None:
    with TcpReceiver(ADDRESS) as first, refuses(InputError, "TCP"):
        TcpReceiver(replace(ADDRESS, port=first.port))


def test_a_closed_receiver_stays_quiet() -> None:
    receiver = TcpReceiver(ADDRESS)
    with calling(receiver) as caller:
        caller.sendall(datagram(1) * (MOST_PER_POLL + 5))
        heard(receiver, 1)
        receiver.close()
        receiver.close()
        assert (receiver.poll(0.0), receiver.port, receiver.connected) == ([], 0, False)
