"""Each address has its receiver."""

from dataclasses import replace
from pathlib import Path

import pytest

from retarget.live.address import parse_address
from retarget.live.open_stream import open_receiver
from retarget.live.raw_recording import ReplayReceiver
from retarget.live.receivers import NatnetReceiver, TcpReceiver
from retarget.live.udp import UdpReceiver
from retarget.sources.raw_record import RawWriter


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
