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
from hardware.clock import wall_to_monotonic
from messages import Facts, refuses
from natnet_packets import Motion, frame, server_info
from retarget.errors import InputError
from retarget.live import receivers
from retarget.live.address import StreamAddress, local_interfaces, parse_address
from retarget.live.admission import MOST_BYTES_PER_POLL, MOST_PER_POLL, Datagram
from retarget.live.open_stream import open_receiver
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.receivers import (
    NOT_THE_SERVER,
    NatnetReceiver,
    UdpReceiver,
    open_socket,
    port_holder,
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
        NatnetReceiver(address)


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


HEAD = (
    "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops"
)
ROW = " 1: {address}:{port:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000  1000        0 {inode} 2 0 0"


def processes(folder: Path) -> Path:
    (folder / "net").mkdir()
    (folder / "net/udp").write_text("\n".join([HEAD, ROW.format(address="0100007F", port=39539, inode=77), "odd"]))
    (folder / "net/udp6").write_text("\n".join([HEAD, ROW.format(address="0" * 32, port=9000, inode=78)]))
    for number, inode in ((12, 77), (345, 78), (346, 99)):
        (folder / str(number) / "fd").mkdir(parents=True)
        (folder / str(number) / "fd/3").symlink_to(f"socket:[{inode}]")
        (folder / str(number) / "cmdline").write_bytes(b"/opt/studio\0--port\0" + str(number).encode() + b"\0")
    return folder


def test_the_holder_is_found_by_its_socket(tmp_path: Path) -> None:
    tables = processes(tmp_path)
    assert port_holder(39539, tables) == "process 12 (studio --port 12)"
    assert port_holder(9000, tables) == "process 345 (studio --port 345)"


def test_what_cannot_be_seen_is_said(tmp_path: Path) -> None:
    assert port_holder(39539, tmp_path) == "another process"
    tables = processes(tmp_path)
    assert port_holder(1, tables) == "another process"
    (tables / "12/fd/3").unlink()
    assert port_holder(39539, tables) == "another process"


HOUR_NS = 3_600 * 10**9


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


@pytest.mark.parametrize("jump", [HOUR_NS, -HOUR_NS, 10_000_000, -10_000_000, -500_000])
def test_a_wall_clock_that_is_set_has_no_effect(jump: int) -> None:
    """As the receiver sees it: the stamps are off from where its looks at both clocks put them, by turns or always."""
    looks = iter([jump, 0, jump, jump, -jump])

    def wall_offset() -> int:
        return wall_to_monotonic() + next(looks, jump)

    with closing(UdpReceiver(LOOPBACK, wall_offset=wall_offset)) as receiver, sending(receiver) as sender:
        for _ in range(7):
            emptied = CLOCK.now()
            receiver.poll(emptied)
            sender.send(b"x")
            (datagram,) = arrived(receiver)
            assert emptied <= datagram.arrival <= CLOCK.now()


def test_a_wrong_look_at_the_clocks_is_taken_again_at_once() -> None:
    looks = []

    def look() -> int:
        looks.append(1)
        return wall_to_monotonic() - HOUR_NS

    with closing(UdpReceiver(LOOPBACK, wall_offset=look)) as receiver, sending(receiver) as sender:
        for _ in range(3):
            receiver.poll(CLOCK.now())
            sender.send(b"x")
            assert len(arrived(receiver)) == 1
    assert len(looks) >= 3


def test_on_another_clock_the_arrival_is_that_of_the_poll() -> None:
    with closing(UdpReceiver(LOOPBACK, wall_offset=None)) as receiver, sending(receiver) as sender:
        sender.send(b"x")
        arrived_at = 12.5
        found = []
        for _ in range(1000):
            found += receiver.poll(arrived_at)
            if found:
                break
        assert [datagram.arrival for datagram in found] == [arrived_at]


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


def granted(receiver: UdpReceiver) -> int:
    """Bytes that the kernel granted."""
    with socket.socket(fileno=os.dup(receiver.fileno())) as same:
        return same.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def test_a_poll_is_bounded_and_the_rest_waits() -> None:
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for number in range(MOST_PER_POLL + 20):
            sender.send(number.to_bytes(2))
        first, second = arrived(receiver), arrived(receiver)
        assert [len(first), len(second)] == [MOST_PER_POLL, 20]
        numbers = [int.from_bytes(datagram.payload) for datagram in first + second]
        assert numbers == list(range(MOST_PER_POLL + 20))


def test_a_poll_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receivers, "RECEIVE_BUFFER", 4 * 2**20)
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        if granted(receiver) < 3 * MOST_BYTES_PER_POLL:
            pytest.skip(f"the kernel grants {granted(receiver)} bytes only (net.core.rmem_max)")
        for _ in range(20):
            sender.send(bytes(60_000))
        first, second = arrived(receiver), arrived(receiver)
        assert len(first) == -(-MOST_BYTES_PER_POLL // 60_000) and len(second) == 20 - len(first)


def test_what_the_kernel_lost_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receivers, "RECEIVE_BUFFER", 8192)
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        for _ in range(200):
            sender.send(bytes(1000))
        kept = len(arrived(receiver))
        sender.send(b"x")  # the count travels with what comes after the loss
        assert len(arrived(receiver)) == 1
        assert 0 < kept < 200 and receiver.overflowed == 200 - kept


def test_a_request_that_no_program_receives_is_no_fault_of_the_stream() -> None:
    with closing(UdpReceiver(LOOPBACK)) as gone:
        port = gone.bound[1]
    with closing(UdpReceiver(LOOPBACK)) as receiver, sending(receiver) as sender:
        receiver.send(b"keep-alive", ("127.0.0.1", port))
        sender.send(b"x")
        assert len(arrived(receiver)) == 1 and receiver.dropped.count == 0


def test_a_closed_receiver_stays_quiet() -> None:
    receiver = UdpReceiver(LOOPBACK)
    assert receiver.bound[1] > 0 and receiver.fileno() >= 0
    receiver.close()
    receiver.close()
    assert (receiver.fileno(), receiver.poll(CLOCK.now())) == (-1, [])


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


def test_a_group_is_received_on_the_interface_that_was_chosen() -> None:
    with closing(UdpReceiver(MULTICAST)) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        try:
            sender.sendto(b"frame", (GROUP, receiver.bound[1]))
        except OSError as error:
            pytest.skip(f"this kernel sends no multicast over loopback: {error}")
        if not select.select([receiver], [], [], PATIENCE_S)[0]:
            pytest.skip("this kernel delivers no multicast over loopback")
        assert [datagram.payload for datagram in receiver.poll(CLOCK.now())] == [b"frame"]
        sender.sendto(b"unicast to the same port", ("127.0.0.1", receiver.bound[1]))
        sender.sendto(b"group", (GROUP, receiver.bound[1]))
        assert select.select([receiver], [], [], PATIENCE_S)[0]
        assert [datagram.payload for datagram in receiver.poll(CLOCK.now())] == [b"group"]


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


def test_a_group_may_have_several_listeners_and_a_port_only_one() -> None:
    with (
        closing(UdpReceiver(MULTICAST)) as first,
        closing(UdpReceiver(replace(MULTICAST, port=first.bound[1]))) as second,
    ):
        assert first.bound[1] == second.bound[1]
    with open_socket(LOOPBACK) as single:
        assert single.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR) == 0
        assert not single.getblocking()


def test_nothing_stays_open_after_a_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[socket.socket] = []

    def interrupted(self: socket.socket, _: object) -> None:
        opened.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(socket.socket, "bind", interrupted)
    with pytest.raises(KeyboardInterrupt):
        open_socket(LOOPBACK)
    assert opened[0].fileno() == -1
