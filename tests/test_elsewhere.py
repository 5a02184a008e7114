"""Senders that send to another port of this machine."""

import select
import socket

from hardware.clock import MonotonicClock
from retarget.doctor.elsewhere import USUAL_PORTS, Elsewhere
from retarget.live.address import KINDS, parse_address
from retarget.live.interfaces import local_interfaces


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_the_usual_port_of_every_kind_is_listened_on() -> None:
    assert {kind.port for kind in KINDS.values()} - {None} <= set(USUAL_PORTS)


def test_a_sender_to_another_port_is_named_once() -> None:
    port = free_port()
    elsewhere = Elsewhere(parse_address(f"vmc://:{free_port()}"), everywhere=True, ports=[port])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for _ in range(3):
            sender.sendto(b"MXTP02" + bytes(18), ("127.0.0.1", port))
        ready, _, _ = select.select([receiver for _, _, receiver in elsewhere._receivers], [], [], 5.0)
    assert ready
    elsewhere.poll(MonotonicClock().now())
    elsewhere.close()
    (stray,) = elsewhere.strays
    assert (stray.host, stray.port, stray.got.kind) == ("127.0.0.1", port, "mvn")


def test_a_port_that_is_taken_is_left_out() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("0.0.0.0", 0))
        port = holder.getsockname()[1]
        elsewhere = Elsewhere(parse_address("vmc://0.0.0.0:1?allow=any"), everywhere=True, ports=[port])
        elsewhere.poll(0.0)
        assert elsewhere.strays == ()
        elsewhere.close()


def test_a_listener_on_loopback_looks_at_the_other_interfaces_too() -> None:
    elsewhere = Elsewhere(parse_address(f"vmc://:{free_port()}"), everywhere=True, ports=[])
    others = [number for number in local_interfaces().values() if not number.startswith("127.")]
    assert [bind for bind, _, _ in elsewhere._receivers] == others
    elsewhere.close()


def test_a_recording_has_no_elsewhere() -> None:
    assert Elsewhere(parse_address("replay://a.raw"), everywhere=True)._receivers == []


def test_it_stays_on_the_interface_that_was_asked_for() -> None:
    elsewhere = Elsewhere(parse_address(f"vmc://:{free_port()}"), everywhere=False)
    assert elsewhere._receivers and {bind for bind, _, _ in elsewhere._receivers} == {"127.0.0.1"}
    elsewhere.close()
