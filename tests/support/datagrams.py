"""Real datagrams over loopback: nothing sleeps, every wait is a bounded `select`."""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from hardware.clock import MonotonicClock
from retarget.live.address import StreamAddress
from retarget.live.admission import Datagram
from retarget.live.receivers import UdpReceiver

LOOPBACK = StreamAddress("vmc://", "vmc")
"""Loopback, at any free port."""
PATIENCE_S = 5.0
CLOCK = MonotonicClock()


@contextmanager
def sending(to: UdpReceiver) -> Iterator[socket.socket]:
    """A socket that is connected to a receiver on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", to.bound[1]))
        yield sender


def arrived(receiver: UdpReceiver) -> list[Datagram]:
    """One poll, once there is something to fetch."""
    ready, _, _ = select.select([receiver], [], [], PATIENCE_S)
    assert ready, "nothing arrived over loopback"
    return receiver.poll(CLOCK.now())
