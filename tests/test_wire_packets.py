"""What a host sent is taken apart as its driver put it together."""

from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel.protocol2 import ping, reboot, sync_read, sync_write, write
from sim.faults.wire_packets import Sent, Written, goal_writes, packets, torque_off, written


@given(st.dictionaries(st.integers(0, 252), st.integers(-(2**31), 2**31 - 1), min_size=1, max_size=30))
@settings(max_examples=60)
def test_goals_are_read_from_the_bytes(ticks: dict[int, int]) -> None:
    """Those that hold a header, and are stuffed, too."""
    data = sync_write(116, 4, [(device, tick.to_bytes(4, "little", signed=True)) for device, tick in ticks.items()])
    sent = [Sent(1.5, sync_read(126, 10, [7], fast=True) + data + ping(3))]
    assert goal_writes(written(sent)) == [(1.5, ticks)]
    assert [(one.id, one.instruction) for one in packets(sent)] == [(254, 0x8A), (254, 0x83), (3, 0x01)]


def test_single_writes_count() -> None:
    sent = [Sent(2.0, write(9, 64, b"\1")), Sent(3.0, write(9, 64, b"\0")), Sent(4.0, reboot(9))]
    writes = written(sent)
    assert writes == [Written(2.0, 64, {9: 1}), Written(3.0, 64, {9: 0})]
    assert torque_off(writes, 0.0) == 3.0
    assert torque_off(writes, 3.5) is None
    assert goal_writes(writes) == []


@given(st.binary(max_size=40))
@settings(max_examples=60)
def test_what_is_no_packet_is_none(data: bytes) -> None:
    list(packets([Sent(0.0, data), Sent(0.0, b"\xff\xff\xfd\x00\x01\xff\xff" + data)]))
