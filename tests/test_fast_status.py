"""Replies to fast reads: whole, cut short, damaged."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel import protocol2
from hardware.dynamixel.fast_status import fast_length, sound_parts
from hardware.dynamixel.packets import Status
from packet_vectors import FAST_BULK, FAST_BULK_REPLY, FAST_SYNC, FAST_SYNC_REPLY

HOT = st.lists(st.sampled_from((0xFF, 0xFD, 0x00, 0x55, 0xFE)), max_size=12).map(bytes)
PARTS = st.lists(
    st.builds(Status, st.integers(0, 252), st.integers(0, 255), HOT | st.binary(max_size=12)), min_size=1, max_size=8
)


def ends(sizes: list[int]) -> list[int]:
    """Bytes after which each part is whole."""
    return [fast_length(sizes[: count + 1]) for count in range(len(sizes))]


@pytest.mark.parametrize(("reply", "answers"), [(FAST_SYNC_REPLY, FAST_SYNC), (FAST_BULK_REPLY, FAST_BULK)])
def test_the_manuals_examples_cut_at_every_byte(reply: bytes, answers: tuple[Status, ...]) -> None:
    sizes = [len(answer.data) for answer in answers]
    assert fast_length(sizes) == len(reply)
    for length in range(len(reply) + 1):
        whole = sum(end <= length for end in ends(sizes))
        assert sound_parts(reply[:length], sizes) == list(answers[:whole])


@pytest.mark.parametrize(("reply", "answers"), [(FAST_SYNC_REPLY, FAST_SYNC), (FAST_BULK_REPLY, FAST_BULK)])
def test_one_damaged_byte_costs_its_part_and_what_follows(reply: bytes, answers: tuple[Status, ...]) -> None:
    sizes = [len(answer.data) for answer in answers]
    for at in range(len(reply)):
        before = 0 if at < 8 else sum(end <= at for end in ends(sizes))
        for flip in range(1, 256):
            damaged = bytearray(reply)
            damaged[at] ^= flip
            assert sound_parts(bytes(damaged), sizes) == list(answers[:before]), (at, flip)


@settings(max_examples=150)
@given(PARTS, st.data())
def test_any_reply_cut_or_damaged_yields_what_stands_before(answers: list[Status], data: st.DataObject) -> None:
    sizes, reply = [len(answer.data) for answer in answers], protocol2.fast_status(answers)
    assert sound_parts(reply + b"\xff\xff\xfd\0", sizes) == answers
    cut = data.draw(st.integers(0, len(reply)))
    assert sound_parts(reply[:cut], sizes) == answers[: sum(end <= cut for end in ends(sizes))]
    at = data.draw(st.integers(8, len(reply) - 1))
    damaged = reply[:at] + bytes((reply[at] ^ data.draw(st.integers(1, 255)),)) + reply[at + 1 :]
    assert sound_parts(damaged, sizes) == answers[: sum(end <= at for end in ends(sizes))]


def test_a_lost_byte_costs_its_part_and_what_follows() -> None:
    sizes = [4, 4, 4]
    for at in range(8, len(FAST_SYNC_REPLY)):
        lost = FAST_SYNC_REPLY[:at] + FAST_SYNC_REPLY[at + 1 :]
        whole = sum(end <= at for end in ends(sizes))
        assert sound_parts(lost, sizes) == list(FAST_SYNC[:whole])


def test_a_reply_to_another_question_has_no_parts() -> None:
    assert sound_parts(FAST_SYNC_REPLY, [4, 4]) == []
    assert sound_parts(FAST_SYNC_REPLY, [4, 4, 5]) == []
    assert sound_parts(FAST_SYNC_REPLY, [5, 4, 3]) == []  # same length, other layout
    assert sound_parts(protocol2.status(1, 0, b"\x01\x02\x03\x04"), [4]) == []
    assert sound_parts(protocol2.sync_read(132, 4, (3, 7, 4), fast=True), [4, 4, 4]) == []
    assert sound_parts(b"", [4]) == []


def test_alerts_of_every_part_are_kept() -> None:
    answers = [Status(1, 0, b"\x01"), Status(2, 0x80, b"\x02"), Status(3, 0x87, b"\x03")]
    assert sound_parts(protocol2.fast_status(answers), [1, 1, 1]) == answers
