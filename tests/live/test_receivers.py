"""The sockets of a NatNet stream, against a server of loopback that speaks just enough."""

import errno
import os
import select
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from datagrams import CLOCK, LOOPBACK, PATIENCE_S, arrived, sending
from messages import Facts, refuses
from natnet_packets import Motion, frame, server_info
from retarget.errors import InputError
from retarget.live import receivers
from retarget.live.address import StreamAddress, local_interfaces, parse_address
from retarget.live.admission import MOST_PER_POLL, Datagram
from retarget.live.open_stream import open_receiver
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.receivers import (
    NatnetReceiver,
    UdpReceiver,
    open_socket,
)
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
    with server.socket, closing(NatnetReceiver(address, command_port=server.port)) as receiver:
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


def test_frames_come_through_the_group() -> None:
    with conversation(MULTICAST) as (server, receiver):
        assert receiver._frames is not None
        server.socket.sendto(frame(Motion(), VERSION), (GROUP, receiver._frames.bound[1]))
        if not select.select([receiver._frames], [], [], PATIENCE_S / 5)[0]:
            pytest.skip("this kernel delivers no multicast over loopback")
        assert [datagram.payload for datagram in received(receiver, 1)] == [frame(Motion(), VERSION)]
        assert receiver.session.frames == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("vmc://", UdpReceiver),
        ("vrchat://", UdpReceiver),
        ("json://:7000", UdpReceiver),
        ("mvn://", UdpReceiver),
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


def test_datagrams_come_in_order_with_source_and_time() -> None:
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        assert receiver.poll(CLOCK.now()) == []
        before = CLOCK.now()
        for payload in (b"one", b"two", b"three"):
            sender.send(payload)
        found = arrived(receiver)
        after = CLOCK.now()
        assert [datagram.payload for datagram in found] == [b"one", b"two", b"three"]
        assert {datagram.source for datagram in found} == {sender.getsockname()}
        times = [datagram.arrival for datagram in found]
        assert times == sorted(times) and before - 0.001 <= times[0] and times[-1] <= after
        assert receiver.poll(CLOCK.now()) == [] and receiver.dropped.count == receiver.overflowed == 0


def test_the_arrival_is_the_kernels_not_that_of_the_poll() -> None:
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        stamps = 0
        for _ in range(50):  # a kernel may switch its stamps on a moment after the first socket asks
            receiver.poll(CLOCK.now())
            sender.send(b"x")
            now = CLOCK.now() + 0.5
            (datagram,) = receiver.poll(now)
            stamps += datagram.arrival < now - 0.4
            if stamps:
                return
    pytest.skip("this kernel gives no times of arrival")


def test_the_longest_datagram_passes_and_an_empty_one_does_not() -> None:
    longest = 65_507  # of UDP over IPv4
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        sender.send(bytes(longest))
        assert [len(datagram.payload) for datagram in arrived(receiver)] == [longest]
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for size in (100, 0, 99):
            sender.send(bytes(size))
        assert [len(datagram.payload) for datagram in arrived(receiver)] == [100, 99]
        assert receiver.dropped.reasons == {"empty datagram": 1}


def test_a_poll_is_bounded_and_the_rest_waits() -> None:
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for number in range(MOST_PER_POLL + 20):
            sender.send(number.to_bytes(2))
        first, second = arrived(receiver), arrived(receiver)
        assert [len(first), len(second)] == [MOST_PER_POLL, 20]
        numbers = [int.from_bytes(datagram.payload) for datagram in first + second]
        assert numbers == list(range(MOST_PER_POLL + 20))


def test_what_the_kernel_lost_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receivers, "RECEIVE_BUFFER", 8192)
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for _ in range(200):
            sender.send(bytes(1000))
        kept = len(arrived(receiver))
        sender.send(b"x")  # the count travels with what comes after the loss
        assert len(arrived(receiver)) == 1
        assert 0 < kept < 200 and receiver.overflowed == 200 - kept


ABSENT = "203.0.113.77"
"""Of a network that is reserved for documents: no interface has it."""


def test_a_port_that_is_taken_names_its_holder() -> None:
    with closing(UdpReceiver(LOOPBACK)) as first, refuses(InputError, os.getpid()):
        open_socket(replace(LOOPBACK, port=first.bound[1]))


@pytest.mark.parametrize(
    "text", [f"vmc://{ABSENT}:39539?allow=any", f"natnet://127.0.0.1?multicast={GROUP}&interface={ABSENT}"]
)
def test_an_interface_that_is_not_there_lists_those_that_are(text: str) -> None:
    with refuses(InputError, ABSENT, "127.0.0.1"):
        open_socket(parse_address(text))


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (errno.EACCES, ()),
        (errno.EINVAL, "127.0.0.1:0"),
        (errno.ENOBUFS, ()),
    ],
)
def test_other_reasons_not_to_bind(number: int, expected: Facts, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(socket.socket, "bind", refuse)
    with refuses(InputError, expected):
        open_socket(LOOPBACK)


@pytest.mark.parametrize(
    ("host", "number", "expected"),
    [
        ("127.0.0.1", errno.ENOBUFS, GROUP),
        ("127.0.0.1", errno.ENODEV, "127.0.0.1"),
        ("255.255.255.255", errno.ENODEV, (GROUP, "interface=ADDRESS")),
    ],
)
def test_reasons_not_to_join(host: str, number: int, expected: Facts, monkeypatch: pytest.MonkeyPatch) -> None:
    real = socket.socket.setsockopt

    def refuse(self: socket.socket, level: int, option: int, value: int | bytes) -> None:
        if option == socket.IP_ADD_MEMBERSHIP and level == socket.IPPROTO_IP:
            raise OSError(number, os.strerror(number))
        real(self, level, option, value)

    monkeypatch.setattr(socket.socket, "setsockopt", refuse)
    address = replace(parse_address(f"natnet://{host}?multicast={GROUP}"), port=0)
    with refuses(InputError, expected):
        open_socket(address)


def test_a_group_is_not_received_on_an_interface_that_was_not_chosen() -> None:
    others = [address for address in local_interfaces().values() if not address.startswith("127.")]
    if not others:
        pytest.skip("this machine has loopback only")
    with closing(UdpReceiver(MULTICAST)) as chosen, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(others[0]))
        with closing(UdpReceiver(replace(MULTICAST, port=chosen.bound[1], interface=others[0]))) as other:
            try:
                sender.sendto(b"frame", (GROUP, chosen.bound[1]))
            except OSError as error:
                pytest.skip(f"no multicast over {others[0]}: {error}")
            if not select.select([other], [], [], PATIENCE_S / 5)[0]:
                pytest.skip(f"this kernel delivers no multicast of its own over {others[0]}")
            assert [datagram.payload for datagram in other.poll(CLOCK.now())] == [b"frame"]
            assert chosen.poll(CLOCK.now()) == []


def test_nothing_stays_open_after_a_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[socket.socket] = []

    def interrupted(self: socket.socket, _: object) -> None:
        opened.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(socket.socket, "bind", interrupted)
    with pytest.raises(KeyboardInterrupt):
        open_socket(LOOPBACK)
    assert opened[0].fileno() == -1
