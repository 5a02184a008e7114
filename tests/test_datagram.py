"""Sockets and recordings are polled alike."""

from pathlib import Path

import pytest

from datagrams import CLOCK, LOOPBACK, arrived, sending
from retarget.live.datagram import Datagram, Receiver
from retarget.live.replay import ReplayReceiver
from retarget.live.udp import UdpReceiver
from retarget.sources.raw_record import RawReader, RawWriter


def test_a_recording_of_a_socket_gives_what_the_socket_gave(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path / "a.raw", url="vmc://")
    with UdpReceiver(LOOPBACK) as live, sending(live) as sender:
        live.poll(CLOCK.now())
        for payload in (b"one", b"two", b"three"):
            sender.send(payload)
        told = arrived(live)
    for datagram in told:
        address, port = datagram.source
        writer.append(datagram.payload, time_ns=round(datagram.arrival * 1e9), address=address, port=port)
    writer.close()
    receivers: list[Receiver] = [live, ReplayReceiver(RawReader(tmp_path / "a.raw"))]
    again = receivers[1].poll(0.0) + receivers[1].poll(60.0)
    assert [datagram[1:] for datagram in again] == [datagram[1:] for datagram in told]
    first = told[0].arrival
    assert [d.arrival for d in again] == pytest.approx([d.arrival - first for d in told], abs=1e-6)
    for receiver in receivers:
        receiver.close()
        assert receiver.poll(1e6) == [] and isinstance(receiver.dropped.count, int)


def test_a_datagram_is_a_plain_row() -> None:
    arrival, source, payload = Datagram(1.0, ("127.0.0.1", 5), b"x")
    assert (arrival, source, payload) == (1.0, ("127.0.0.1", 5), b"x")
