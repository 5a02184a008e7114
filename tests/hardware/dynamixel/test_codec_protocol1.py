"""Protocol 1.0: printed frames, checksum; dynamixel-sdk as a second opinion."""

from collections.abc import Callable

import pytest
from dynamixel_sdk import Protocol1PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from hardware.dynamixel.codec import BROADCAST, protocol1
from messages import refuses
from packet_vectors import ONE, Vector
from sdk_port import SdkPort


@pytest.mark.parametrize("vector", ONE, ids=lambda vector: vector.printed.hex())
def test_frames_are_those_of_the_manual(vector: Vector) -> None:
    assert vector.built == vector.printed


@given(st.integers(0, 254), st.integers(0, 255), st.binary(max_size=253))
def test_content_and_checksum_add_up_to_nothing_but_ones(device: int, code: int, params: bytes) -> None:
    frame = protocol1.frame(device, code, params)
    assert sum(frame[2:]) & 0xFF == 0xFF
    assert frame[3] == len(frame) - 4
    assert frame[:2] == b"\xff\xff"


WRONG: dict[str, Callable[[], bytes]] = {
    "id FF": lambda: protocol1.ping(0xFF),
    "negative id": lambda: protocol1.ping(-1),
    "address": lambda: protocol1.read(1, 256, 1),
    "length": lambda: protocol1.read(1, 0, 256),
    "group id": lambda: protocol1.sync_write(30, 1, [(BROADCAST, b"\0")]),
    "bulk id": lambda: protocol1.bulk_read([(BROADCAST, 30, 1)]),
    "short data": lambda: protocol1.sync_write(30, 2, [(1, b"\0")]),
    "too much": lambda: protocol1.write(1, 0, bytes(253)),
    "too many": lambda: protocol1.sync_write(30, 4, [(device, bytes(4)) for device in range(1, 60)]),
}


@pytest.mark.parametrize("build", WRONG.values(), ids=WRONG.keys())
def test_what_cannot_be_sent_is_refused(build: Callable[[], bytes]) -> None:
    with refuses(ValueError):
        build()


@given(st.integers(0, 253), st.integers(0, 127), st.binary(max_size=60))
def test_the_sdk_understands_our_statuses(device: int, error: int, data: bytes) -> None:
    port = SdkPort(protocol1.status(device, error, data))
    packet, result = Protocol1PacketHandler().rxPacket(port)
    assert result == 0
    assert (packet[2], packet[4], bytes(packet[5:-1])) == (device, error, data)
