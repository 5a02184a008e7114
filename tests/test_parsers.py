"""Parsers of both protocols: frames of a clean line, whole after damage, the same however the bytes arrive."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import Frame, Status
from hardware.dynamixel.parsers import parser1, parser2
from noise import LINES, bytes_of, pieces, stretch
from packet_vectors import ONE, TWO

VECTORS = {1: ONE, 2: TWO}
both = pytest.mark.parametrize("protocol", [1, 2])
SEEDS = st.integers(0, 2**32 - 1)


@both
def test_the_manuals_frames_are_understood(protocol: int) -> None:
    for vector in VECTORS[protocol]:
        parser = LINES[protocol].parser()
        assert parser.feed(vector.printed) == [vector.heard]
        assert (parser.pending, parser.skipped) == (b"", 0)


@both
def test_frames_come_with_their_last_byte(protocol: int) -> None:
    parser, heard = LINES[protocol].parser(), []
    for vector in VECTORS[protocol]:
        for at, byte in enumerate(vector.printed):
            frames = parser.feed(bytes((byte,)))
            assert bool(frames) == (at == len(vector.printed) - 1)
            heard += frames
    assert heard == [vector.heard for vector in VECTORS[protocol]]
    assert parser.skipped == 0


@both
@settings(max_examples=150)
@given(seed=SEEDS, count=st.integers(1, 30))
def test_frames_depend_on_the_bytes_not_on_the_pieces(protocol: int, seed: int, count: int) -> None:
    random_, line = random.Random(seed), LINES[protocol]
    stream = b"".join(stretch(random_) for _ in range(count))
    whole, parts, single = line.parser(), line.parser(), line.parser()
    frames = whole.feed(stream)
    assert [frame for piece in pieces(random_, stream) for frame in parts.feed(piece)] == frames
    assert [frame for byte in stream for frame in single.feed(bytes((byte,)))] == frames
    assert whole.pending == parts.pending == single.pending
    assert whole.skipped == parts.skipped == single.skipped
    assert whole.skipped == len(stream) - len(whole.pending) - bytes_of(line, stream, frames)
    assert whole.flush() == parts.flush() == single.flush()


@both
@given(device=st.integers(0, 252), code=st.integers(0, 255), params=st.binary(max_size=200))
def test_any_frame_round_trips(protocol: int, device: int, code: int, params: bytes) -> None:
    line = LINES[protocol]
    parser = line.parser()
    assert parser.feed(line.frame(device, code, params)) == [Frame(device, code, params)]


@given(st.lists(st.builds(Status, st.integers(0, 252), st.integers(0, 255), st.binary(max_size=12)), min_size=1))
def test_a_fast_status_is_taken_as_it_is(answers: list[Status]) -> None:
    reply = protocol2.fast_status(answers)
    assert parser2().feed(reply) == [Frame(0xFE, 0x55, reply[8:-2])]


def test_headers_and_stuffing_inside_a_fast_status_are_data() -> None:
    reply = protocol2.fast_status([Status(1, 0, protocol2.ping(3)), Status(2, 0, b"\xff\xff\xfd\xfd")])
    assert parser2().feed(reply) == [Frame(0xFE, 0x55, reply[8:-2])]


@both
@settings(max_examples=150)
@given(seed=SEEDS)
def test_a_sound_frame_behind_garbage_is_found(protocol: int, seed: int) -> None:
    """At once, or after silence when the garbage claims its bytes; unless both together make another sound frame."""
    random_, line = random.Random(seed), LINES[protocol]
    garbage, frame = stretch(random_), line.frame(1, 0x55, b"\x00\x2a\xff\xff\x17")
    parser = line.parser()
    frames = parser.feed(garbage + frame)
    frames += parser.flush()
    assert parser.pending == b""
    if Frame(1, 0x55, b"\x00\x2a\xff\xff\x17") not in frames:
        begun = [at for at in range(len(garbage)) if garbage.startswith(line.header[:2], at)]
        assert any(line.stands_at(garbage + frame, at, heard) > len(garbage) for at in begun for heard in frames)


STATUSES = [Frame(device, 0x55, bytes((0, device, 0xFF, 0xFF, 0xFD, 0xFD, 0, 5))) for device in range(1, 8)]


def test_every_damaged_byte_costs_one_frame() -> None:
    """CRC-16 sees every error of one byte; a damaged length swallows nothing of the next frame."""
    raws = [protocol2.frame(*status) for status in STATUSES]
    for hit in (0, 3):
        clean = b"".join(raws[:hit]), raws[hit], b"".join(raws[hit + 1 :])
        for at in range(len(raws[hit])):
            for flip in range(1, 256):
                damaged = bytearray(clean[1])
                damaged[at] ^= flip
                frames = parser2().feed(clean[0] + bytes(damaged) + clean[2])
                assert frames == STATUSES[:hit] + STATUSES[hit + 1 :], (at, flip)


@pytest.mark.parametrize("length", [0, 1, 2, 3, 8, 11, 13, 14, 15, 16, 17, 18, 19, 20, 40, 200, 8192, 8193, 65535])
def test_a_damaged_length_is_over_when_the_next_header_is_seen(length: int) -> None:
    damaged, good = bytearray(protocol2.frame(*STATUSES[0])), protocol2.frame(*STATUSES[1])
    damaged[5:7] = length.to_bytes(2, "little")
    parser = parser2()
    assert parser.feed(bytes(damaged) + good) == STATUSES[1:2]
    assert parser.skipped == len(damaged)


def test_every_lost_or_doubled_byte_costs_one_frame() -> None:
    raws = [protocol2.frame(*status) for status in STATUSES]
    rest = b"".join(raws[1:])
    for at in range(len(raws[0])):
        for raw in (raws[0][:at] + raws[0][at + 1 :], raws[0][:at] + raws[0][at : at + 1] + raws[0][at:]):
            frames = parser2().feed(raw + rest)
            # A doubled first or last byte is noise beside a whole frame.
            assert frames in (STATUSES[1:], STATUSES), at
            assert (frames == STATUSES) == (raws[0] in raw), at


def test_what_a_damaged_length_claims_in_the_first_protocol_comes_back_after_silence() -> None:
    """There a header may stand in the data, so only silence tells."""
    damaged, good = bytearray(protocol1.status(1, 0, b"\x01\x02")), protocol1.status(2, 0, b"\x03\x04")
    damaged[3] = 60
    parser = parser1()
    assert parser.feed(bytes(damaged) + good + good) == []
    assert len(parser.pending) == len(damaged) + 2 * len(good)
    assert parser.flush() == [Frame(2, 0, b"\x03\x04")] * 2
    assert (parser.pending, parser.skipped) == (b"", len(damaged))


@both
def test_reset_forgets_and_counts(protocol: int) -> None:
    vector = VECTORS[protocol][0]
    parser = LINES[protocol].parser()
    assert parser.feed(vector.printed[:-1]) == []
    assert parser.pending == vector.printed[:-1]
    parser.reset()
    assert (parser.pending, parser.skipped) == (b"", len(vector.printed) - 1)
    assert parser.feed(vector.printed) == [vector.heard]


@both
def test_an_echo_comes_before_its_answer(protocol: int) -> None:
    line = LINES[protocol]
    question, answer = VECTORS[protocol][2 + (protocol == 2)], VECTORS[protocol][3 + (protocol == 2)]
    assert line.parser().feed(question.printed + answer.printed) == [question.heard, answer.heard]


@both
def test_a_bytearray_may_be_fed_and_changed_afterwards(protocol: int) -> None:
    vector = VECTORS[protocol][0]
    parser, data = LINES[protocol].parser(), bytearray(vector.printed[:-1])
    assert parser.feed(data) == []
    data[:] = bytes(len(data))
    assert parser.feed(vector.printed[-1:]) == [vector.heard]
