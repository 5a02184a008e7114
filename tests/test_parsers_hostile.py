"""Parsers against a hostile line: noise without end, false lengths, headers where none should be."""

import os
import random

import pytest

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import Frame, Status
from hardware.dynamixel.parsers import parser1, parser2
from noise import LINES, bytes_of, noise, stretch
from packet_vectors import ONE, TWO

both = pytest.mark.parametrize("protocol", [1, 2])
PING = protocol2.ping(1)
FLOODS = {
    "FF": b"\xff",
    "FF FF FD": b"\xff\xff\xfd",
    "FF FF FD FD": b"\xff\xff\xfd\xfd",
    "headers": b"\xff\xff\xfd\x00",
    "huge lengths": bytes.fromhex("FFFFFD0001FF1F03"),
    "impossible lengths": bytes.fromhex("FFFFFD0001FFFF03"),
    "huge fast replies": bytes.fromhex("FFFFFD00FEFF1F55"),
    "huge lengths, far apart": bytes.fromhex("FFFFFD0001002003") + b"\xff" * 9000,
    "first protocol, longest": b"\xff\xff\x00\xff",
    "first protocol, id 253": b"\xff\xff\xfd\xff\xfe",
    "nothing": b"\x00",
}


def sweep(protocol: int, count: int, seed: int) -> None:
    """Feed `count` random strings; 500 of them make a stream, over which every promise is checked."""
    random_, line = random.Random(seed), LINES[protocol]
    for _ in range(0, count, 500):
        parser, strings, frames = line.parser(), [], []
        for _ in range(500):
            string = noise(random_, 40) if random_.random() < 0.7 else stretch(random_)
            strings.append(string)
            frames += parser.feed(string)
            assert len(parser.pending) < line.longest
        stream = b"".join(strings)
        used = bytes_of(line, stream, frames)
        assert parser.skipped + used + len(parser.pending) == len(stream)
        assert line.parser().feed(stream) == frames
        assert frames, "a stream without a frame checks nothing"


@both
def test_random_strings_yield_no_false_frame(protocol: int) -> None:
    sweep(protocol, 10_000, seed=11)


@pytest.mark.long
@both
def test_a_million_random_strings_yield_no_false_frame(protocol: int) -> None:
    sweep(protocol, 1_000_000, seed=12)


@both
@pytest.mark.parametrize("unit", FLOODS.values(), ids=FLOODS.keys())
def test_a_flood_is_bounded_in_memory_and_over_with_the_next_frame(protocol: int, unit: bytes) -> None:
    line = LINES[protocol]
    stream = (unit * 20_000)[:20_000]
    whole, single = line.parser(), line.parser()
    assert whole.feed(stream) == []
    for byte in stream:
        assert single.feed(bytes((byte,))) == []
        assert len(single.pending) < line.longest
    assert single.pending == whole.pending
    vector = (ONE if protocol == 1 else TWO)[0]
    assert (whole.feed(vector.printed) + whole.flush())[-1:] == [vector.heard]


@pytest.mark.long
@both
@pytest.mark.parametrize("unit", FLOODS.values(), ids=FLOODS.keys())
def test_time_grows_with_the_bytes_and_not_faster(protocol: int, unit: bytes) -> None:
    """Twice the bytes take twice the time, give or take: at one go and byte by byte, after megabytes."""

    def cost(size: int, step: int) -> float:
        stream, parser = (unit * (size // len(unit) + 1))[:size], LINES[protocol].parser()
        begun = sum(os.times()[:2])
        for at in range(0, size, step):
            parser.feed(stream[at : at + step])
        return sum(os.times()[:2]) - begun

    for step, size in ((1 << 30, 4_000_000), (1, 500_000)):
        assert cost(2 * size, step) < 3 * cost(size, step) + 0.2


REFUSED = {
    "id FD": "FFFFFD00 FD 0300 01",
    "id FF": "FFFFFD00 FF 0300 01",
    "LEN 0": "FFFFFD00 01 0000",
    "LEN 1": "FFFFFD00 01 0100 01",
    "LEN 2": "FFFFFD00 01 0200 01",
    "LEN 2, no instruction": "FFFFFD00 01 0200",
    "LEN 8193": "FFFFFD00 01 0120 01",
    "LEN 65535": "FFFFFD00 01 FFFF 01",
    "reserved byte": "FFFFFDFD 01 0300 01",
    "header alone": "FFFFFD00",
    "a header in the header": "FFFFFD00 FFFFFD00",
}


@pytest.mark.parametrize("beginning", REFUSED.values(), ids=REFUSED.keys())
def test_a_frame_that_cannot_be_is_passed_over_at_once(beginning: str) -> None:
    raw = bytes.fromhex(beginning)
    sealed = raw + protocol2.crc(raw).to_bytes(2, "little")
    parser = parser2()
    assert parser.feed(sealed) == []
    assert len(parser.pending) < protocol2.OVERHEAD
    assert parser.feed(PING) == [Frame(1, 1, b"")]
    assert parser.skipped == len(sealed)


def test_a_frame_with_an_unstuffed_header_inside_is_none() -> None:
    raw = protocol2.HEADER + bytes.fromhex("01 0900 03 7400 FFFFFD00")
    sealed = raw + protocol2.crc(raw).to_bytes(2, "little")
    assert parser2().feed(sealed + PING) == [Frame(1, 1, b"")]


def test_a_frame_that_nobody_stuffed_is_taken_when_no_header_is_inside() -> None:
    """So dynamixel-sdk sends it; header, length and CRC are sound, and nothing else is to be done with it."""
    raw = protocol2.HEADER + bytes.fromhex("01 0900 03 7400 FFFFFDFF")
    sealed = raw + protocol2.crc(raw).to_bytes(2, "little")
    assert parser2().feed(sealed) == [Frame(1, 3, b"\x74\0\xff\xff\xfd\xff")]


def sealed_by(tail: bytes, crc: bytes) -> tuple[Frame, bytes]:
    """A frame whose parameters end in `tail` and whose CRC is `crc`: one of 65536 values of two bytes does it."""
    for value in range(65536):
        params = value.to_bytes(2, "little") + tail
        raw = protocol2.frame(1, 3, params)
        if raw.endswith(tail + crc):
            return Frame(1, 3, params), raw
    raise AssertionError


@pytest.mark.parametrize(
    ("tail", "crc", "behind"),
    [
        (b"\xff\xff", b"\xfd\x00", b""),
        (b"\xff", b"\xff\xfd", b"\x00"),
        (b"\x00", b"\xff\xff", b"\xfd\x00"),
        (b"\x00", b"\x00\xff", b"\xff\xfd\x00"),
    ],
)
def test_last_parameters_and_crc_that_look_like_a_header(tail: bytes, crc: bytes, behind: bytes) -> None:
    frame, raw = sealed_by(tail, crc)
    stream = raw + behind + raw + PING
    assert parser2().feed(stream) == [frame, frame, Frame(1, 1, b"")]
    single = parser2()
    assert [heard for byte in stream for heard in single.feed(bytes((byte,)))] == [frame, frame, Frame(1, 1, b"")]
    assert single.skipped == len(behind)


def test_a_crc_is_not_the_beginning_of_the_next_frame() -> None:
    frame, raw = sealed_by(b"\x00", b"\x00\xff")
    assert parser2().feed(raw + PING[1:]) == [frame]
    parser = parser2()
    assert parser.feed(raw) == [frame]
    assert (parser.pending, parser.feed(PING[1:])) == (b"", [])


def test_the_other_protocols_bytes_are_noise() -> None:
    two, one = b"".join(vector.printed for vector in TWO), b"".join(vector.printed for vector in ONE)
    assert parser1().feed(two) == []
    assert parser2().feed(one) == []
    assert parser1().feed(PING + ONE[0].printed) == [ONE[0].heard]
    assert parser2().feed(ONE[0].printed + PING) == [Frame(1, 1, b"")]


def test_ids_at_the_edge_of_the_first_protocol() -> None:
    assert parser1().feed(protocol1.ping(253)) == [Frame(253, 1, b"")]
    assert parser1().feed(b"\xff" + protocol1.ping(0)) == [Frame(0, 1, b"")]
    assert parser1().feed(bytes.fromhex("FFFF FF 02 01 FD FFFF 01 00 FE FFFF 01 01 01 FC")) == []


def test_a_cut_fast_reply_holds_back_what_follows_until_silence() -> None:
    reply = protocol2.fast_status([Status(1, 0, bytes(10)), Status(2, 0, bytes(10))])
    parser = parser2()
    assert parser.feed(reply[:20] + PING) == []
    assert parser.flush() == [Frame(1, 1, b"")]
    assert parser.feed(reply[:20] + PING) == []
    parser.reset()
    assert parser.feed(PING) == [Frame(1, 1, b"")]
