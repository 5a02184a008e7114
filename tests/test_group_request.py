"""Parameters of group instructions, read back from the frames that a host builds; cut short they ask of nobody."""

from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import Frame, Instruction
from hardware.dynamixel.parsers import parser1, parser2
from sim.emulator.group_request import ReadItem, WriteItem, reads1, reads2, writes1, writes2

IDS = st.integers(0, 252)
WORDS = st.integers(0, 0xFFFF)


def _frame2(data: bytes) -> Frame:
    (frame,) = parser2().feed(data)
    return frame


@settings(max_examples=50)
@given(WORDS, WORDS, st.lists(IDS, max_size=40), st.booleans())
def test_a_sync_read_asks_each_id_for_the_same(address: int, length: int, ids: list[int], fast: bool) -> None:
    frame = _frame2(protocol2.sync_read(address, length, ids, fast=fast))
    assert list(reads2(frame.code, frame.params)) == [ReadItem(device, address, length) for device in ids]


@settings(max_examples=50)
@given(st.lists(st.tuples(IDS, WORDS, WORDS), max_size=40), st.booleans())
def test_a_bulk_read_asks_each_id_for_its_own(items: list[tuple[int, int, int]], fast: bool) -> None:
    frame = _frame2(protocol2.bulk_read(items, fast=fast))
    assert list(reads2(frame.code, frame.params)) == items


@settings(max_examples=50)
@given(st.lists(st.tuples(IDS, WORDS, st.binary(max_size=12)), max_size=20))
def test_a_bulk_write_gives_each_id_its_own(items: list[tuple[int, int, bytes]]) -> None:
    frame = _frame2(protocol2.bulk_write(items))
    assert writes2(frame.code, frame.params) == items


def test_sync_writes_of_both_protocols() -> None:
    items = [(1, b"\x96\0\0\0"), (2, b"\xaa\0\0\0")]
    frame = _frame2(protocol2.sync_write(116, 4, items))
    assert writes2(frame.code, frame.params) == [WriteItem(device, 116, data) for device, data in items]
    (frame,) = parser1().feed(protocol1.sync_write(30, 4, items))
    assert writes1(frame.params) == [WriteItem(device, 30, data) for device, data in items]


def test_a_bulk_read_of_protocol_1() -> None:
    (frame,) = parser1().feed(protocol1.bulk_read([(1, 30, 2), (2, 36, 2)]))
    assert list(reads1(frame.params)) == [ReadItem(1, 30, 2), ReadItem(2, 36, 2)]


@settings(max_examples=100)
@given(st.binary(max_size=30))
def test_any_parameters_are_read_without_an_error(params: bytes) -> None:
    for code in Instruction:
        for item in writes2(code, params):
            assert len(item.data) <= len(params)
        reads2(code, params)
    reads1(params)
    writes1(params)


def test_what_is_cut_short_asks_of_nobody() -> None:
    whole = _frame2(protocol2.bulk_write([(1, 32, b"\xa0\0"), (2, 31, b"P")])).params
    assert writes2(Instruction.BULK_WRITE, whole[:-1]) == [WriteItem(1, 32, b"\xa0\0")]
    assert writes2(Instruction.SYNC_WRITE, b"\x74\0\x04\0\x01\x96\0\0") == []
    assert not reads2(Instruction.BULK_READ, b"\x01\x90\0\x02")
