"""Opening a stream's socket: multicast on loopback, and errors that say what to do."""

import errno
import os
import select
import socket
from dataclasses import replace

import pytest

from datagrams import CLOCK, LOOPBACK, PATIENCE_S
from retarget.errors import InputError
from retarget.live.address import parse_address
from retarget.live.interfaces import local_interfaces
from retarget.live.udp import UdpReceiver
from retarget.live.udp_socket import open_socket
from support.messages import Facts, refuses

ABSENT = "203.0.113.77"
"""Of a network that is reserved for documents: no interface has it."""
GROUP = "239.255.42.99"
MULTICAST = replace(parse_address(f"natnet://127.0.0.1?multicast={GROUP}"), port=0)


def test_a_port_that_is_taken_names_its_holder() -> None:
    with UdpReceiver(LOOPBACK) as first, refuses(InputError, os.getpid()):
        open_socket(replace(LOOPBACK, port=first.port))


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


def test_a_group_is_heard_on_the_interface_that_was_chosen() -> None:
    with UdpReceiver(MULTICAST) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        try:
            sender.sendto(b"frame", (GROUP, receiver.port))
        except OSError as error:
            pytest.skip(f"this kernel sends no multicast over loopback: {error}")
        if not select.select([receiver], [], [], PATIENCE_S)[0]:
            pytest.skip("this kernel delivers no multicast over loopback")
        assert [datagram.payload for datagram in receiver.poll(CLOCK.now())] == [b"frame"]
        sender.sendto(b"unicast to the same port", ("127.0.0.1", receiver.port))
        sender.sendto(b"group", (GROUP, receiver.port))
        assert select.select([receiver], [], [], PATIENCE_S)[0]
        assert [datagram.payload for datagram in receiver.poll(CLOCK.now())] == [b"group"]


def test_a_group_is_not_heard_on_an_interface_that_was_not_chosen() -> None:
    others = [address for address in local_interfaces().values() if not address.startswith("127.")]
    if not others:
        pytest.skip("this machine has loopback only")
    with UdpReceiver(MULTICAST) as chosen, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(others[0]))
        with UdpReceiver(replace(MULTICAST, port=chosen.port, interface=others[0])) as other:
            try:
                sender.sendto(b"frame", (GROUP, chosen.port))
            except OSError as error:
                pytest.skip(f"no multicast over {others[0]}: {error}")
            if not select.select([other], [], [], PATIENCE_S / 5)[0]:
                pytest.skip(f"this kernel delivers no multicast of its own over {others[0]}")
            assert [datagram.payload for datagram in other.poll(CLOCK.now())] == [b"frame"]
            assert chosen.poll(CLOCK.now()) == []


def test_a_group_may_have_several_listeners_and_a_port_only_one() -> None:
    with UdpReceiver(MULTICAST) as first, UdpReceiver(replace(MULTICAST, port=first.port)) as second:
        assert first.port == second.port
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
