"""Frames of both protocols, as printed and as dynamixel-sdk has them; parsers: whole after damage, in any pieces."""

import itertools
import os
import random
from collections.abc import Callable

import pytest
from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from hardware.dynamixel.codec import (
    ALERT,
    BROADCAST,
    STATUS,
    Status,
    WireFrame,
    fast_length,
    protocol1,
    protocol2,
    valid_parts,
    whole_reply,
)
from messages import refuses
from noise import LINES, bytes_of, noise, pieces, stretch
from packet_vectors import FAST_BULK, FAST_BULK_REPLY, FAST_SYNC, FAST_SYNC_REPLY, ONE, TWO, SdkPort, Vector

both = pytest.mark.parametrize("protocol", [1, 2])
SEEDS = st.integers(0, 2**32 - 1)


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
    assert line.parser().feed(line.frame(device, code, params)) == [WireFrame(device, code, params)]
    reply = more_frames.fast_status([Status(device, code, params), Status(0, 0, b"")])
    assert protocol == 1 or line.parser().feed(reply) == [WireFrame(0xFE, 0x55, reply[8:-2])]


@both
@settings(max_examples=150)
@given(seed=SEEDS)
def test_a_valid_frame_behind_garbage_is_found(protocol: int, seed: int) -> None:
    """At once, or after silence when the garbage claims its bytes; unless both together make another valid frame."""
    random_, line = random.Random(seed), LINES[protocol]
    garbage, frame = stretch(random_), line.frame(1, 0x55, b"\x00\x2a\xff\xff\x17")
    parser = line.parser()
    frames = parser.feed(garbage + frame)
    frames += parser.flush()
    assert parser.pending == b""
    if WireFrame(1, 0x55, b"\x00\x2a\xff\xff\x17") not in frames:
        begun = [at for at in range(len(garbage)) if garbage.startswith(line.header[:2], at)]
        assert any(line.stands_at(garbage + frame, at, received) > len(garbage) for at in begun for received in frames)


STATUSES = [WireFrame(device, 0x55, bytes((0, device, 0xFF, 0xFF, 0xFD, 0xFD, 0, 5))) for device in range(1, 8)]


def test_every_damaged_byte_costs_one_frame() -> None:
    """CRC-16 sees every error of one byte; a damaged length swallows nothing of the next frame."""
    raws = [protocol2.frame(*status) for status in STATUSES]
    for hit in (0, 3):
        clean = b"".join(raws[:hit]), raws[hit], b"".join(raws[hit + 1 :])
        for at in range(len(raws[hit])):
            for flip in range(1, 256):
                damaged = bytearray(clean[1])
                damaged[at] ^= flip
                frames = protocol2.parser().feed(clean[0] + bytes(damaged) + clean[2])
                assert frames == STATUSES[:hit] + STATUSES[hit + 1 :], (at, flip)


def test_what_a_damaged_length_claims_in_the_first_protocol_comes_back_after_silence() -> None:
    """There a header may stand in the data, so only silence shows the end."""
    damaged, good = bytearray(protocol1.status(1, 0, b"\x01\x02")), protocol1.status(2, 0, b"\x03\x04")
    damaged[3] = 60
    parser = protocol1.parser()
    assert parser.feed(bytes(damaged) + good + good) == []
    assert len(parser.pending) == len(damaged) + 2 * len(good)
    assert parser.flush() == [WireFrame(2, 0, b"\x03\x04")] * 2
    assert (parser.pending, parser.skipped) == (b"", len(damaged))


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


@both
@pytest.mark.parametrize(("count", "seed"), [(10_000, 11), pytest.param(1_000_000, 12, marks=pytest.mark.long)])
def test_random_strings_yield_no_false_frame(protocol: int, count: int, seed: int) -> None:
    """500 strings make a stream, over which every promise is checked."""
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
    assert (whole.feed(vector.printed) + whole.flush())[-1:] == [vector.frame]


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
    sealed = raw + more_frames.crc(raw).to_bytes(2, "little")
    parser = protocol2.parser()
    assert parser.feed(sealed) == []
    assert len(parser.pending) < protocol2.OVERHEAD
    assert parser.feed(PING) == [WireFrame(1, 1, b"")]
    assert parser.skipped == len(sealed)


def test_a_frame_without_stuffing_is_taken_when_no_header_is_inside() -> None:
    """dynamixel-sdk sends such frames; header, length and CRC are valid, so the frame counts."""
    raw = protocol2.HEADER + bytes.fromhex("01 0900 03 7400 FFFFFDFF")
    sealed = raw + more_frames.crc(raw).to_bytes(2, "little")
    assert protocol2.parser().feed(sealed) == [WireFrame(1, 3, b"\x74\0\xff\xff\xfd\xff")]


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
    candidates = (value.to_bytes(2, "little") + tail for value in range(65536))  # one of them has this CRC
    params, raw = next((one, raw) for one in candidates if (raw := protocol2.frame(1, 3, one)).endswith(tail + crc))
    stream, frame = raw + behind + raw + PING, WireFrame(1, 3, params)
    all_of_them = [frame, frame, WireFrame(1, 1, b"")]
    assert protocol2.parser().feed(stream) == all_of_them
    single = protocol2.parser()
    assert [received for byte in stream for received in single.feed(bytes((byte,)))] == all_of_them
    assert single.skipped == len(behind)


@st.composite
def answers(draw: st.DrawFn) -> list[Status]:
    ids = draw(st.lists(st.integers(0, 252), min_size=1, max_size=12, unique=True))
    size = draw(st.integers(0, 12))
    return [
        Status(device, draw(st.sampled_from((0, ALERT))), draw(st.binary(min_size=size, max_size=size)))
        for device in ids
    ]


@settings(max_examples=150)
@given(answers(), st.data())
def test_it_is_taken_only_where_every_part_is_valid(said: list[Status], data: st.DataObject) -> None:
    reply, ids, size = more_frames.fast_status(said), tuple(one.id for one in said), len(said[0].data)
    found = whole_reply(reply, ids, size)
    assert found is not None and found.statuses == said
    damaged = bytearray(reply)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(reply) - 1))] ^= data.draw(st.integers(1, 255))
    parts = valid_parts(bytes(damaged), [size] * len(ids))
    good = [part for part, device in zip(parts, ids, strict=False) if part.id == device and not part.error & 0x7F]
    whole = whole_reply(bytes(damaged), ids, size)
    assert (whole is not None) == (len(good) == len(ids))
    if whole is not None:
        assert whole.statuses == good


def test_a_part_whose_followers_took_its_damage_for_granted_is_not_taken() -> None:
    """A device on the line sums what it has received: all CRCs behind a damaged part may be right again."""
    ids, chance = tuple(range(1, 21)), random.Random(3)
    reply = more_frames.fast_status([Status(device, 0, bytes(range(device, device + 10))) for device in ids])
    for _ in range(200):
        out, part = bytearray(reply), chance.randrange(20)
        out[8 + 14 * part + chance.randrange(12)] ^= chance.randrange(1, 256)
        for end in range(8 + 14 * (part + 2) - 2, len(out), 14):
            out[end : end + 2] = more_frames.crc(bytes(out[:end])).to_bytes(2, "little")
        assert whole_reply(bytes(out), ids, 10) is None


# Printed frames, checksums and stuffing; dynamixel-sdk as a second opinion where it is right.


@pytest.mark.parametrize("vector", [*ONE, *TWO], ids=lambda vector: vector.printed[:24].hex())
def test_frames_are_those_of_the_manual(vector: Vector) -> None:
    assert vector.built == vector.printed


WRONG: dict[str, Callable[[], bytes]] = {
    "1 id FF": lambda: protocol1.ping(0xFF),
    "1 negative id": lambda: protocol1.ping(-1),
    "1 address": lambda: protocol1.read(1, 256, 1),
    "1 length": lambda: protocol1.read(1, 0, 256),
    "1 group id": lambda: protocol1.sync_write(30, 1, [(BROADCAST, b"\0")]),
    "1 bulk id": lambda: protocol1.bulk_read([(BROADCAST, 30, 1)]),
    "1 short data": lambda: protocol1.sync_write(30, 2, [(1, b"\0")]),
    "1 too much": lambda: protocol1.write(1, 0, bytes(253)),
    "1 too many": lambda: protocol1.sync_write(30, 4, [(device, bytes(4)) for device in range(1, 60)]),
    "2 id FD": lambda: protocol2.ping(0xFD),
    "2 id FF": lambda: protocol2.ping(0xFF),
    "2 negative id": lambda: protocol2.ping(-1),
    "2 address": lambda: protocol2.sync_read(65536, 1, [1]),
    "2 negative address": lambda: protocol2.write(1, -1, b""),
    "2 length": lambda: protocol2.sync_read(0, 65536, [1]),
    "2 group id": lambda: protocol2.sync_read(0, 1, [1, BROADCAST]),
    "2 group id FD": lambda: protocol2.sync_write(0, 1, [(0xFD, b"\0")]),
    "2 short data": lambda: protocol2.sync_write(0, 2, [(1, b"\0")]),
    "2 long data": lambda: protocol2.sync_write(0, 2, [(1, b"\0\0\0")]),
    "2 huge frame": lambda: protocol2.write(1, 0, bytes(protocol2.MAX_LENGTH)),
    "2 huge when stuffed": lambda: protocol2.write(1, 0, b"\xff\xff\xfd" * (protocol2.MAX_LENGTH // 4)),
}


@pytest.mark.parametrize("build", WRONG.values(), ids=WRONG.keys())
def test_what_cannot_be_sent_is_refused(build: Callable[[], bytes]) -> None:
    with refuses(ValueError):
        build()


@given(st.integers(0, 252), st.integers(0, 255), st.binary(max_size=60).filter(lambda data: b"\xff\xfd" not in data))
def test_the_sdk_understands_our_statuses(device: int, error: int, data: bytes) -> None:
    packet, result = Protocol1PacketHandler().rxPacket(SdkPort(protocol1.status(device + 1, error & 0x7F, data)))
    assert result == 0
    assert (packet[2], packet[4], bytes(packet[5:-1])) == (device + 1, error & 0x7F, data)
    packet, result = Protocol2PacketHandler().rxPacket(SdkPort(protocol2.status(device, error, data)), False)
    assert result == 0
    assert (packet[4], packet[7], packet[8], bytes(packet[9:-2])) == (device, STATUS, error, data)


def test_stuffing_round_trips_for_every_short_string_of_hot_bytes() -> None:
    """Among them those from which the vendor's unstuffing loses a byte: FF FF FD FF FD FD."""
    for size in range(8):
        for body in map(bytes, itertools.product((0xFF, 0xFD, 0x00, 0x55), repeat=size)):
            stuffed = protocol2.stuff(body)
            assert protocol2.unstuff(stuffed) == body
            assert protocol2.HEADER not in stuffed


HOT = st.lists(st.sampled_from((0xFF, 0xFD, 0x00, 0x55, 0xFE)), max_size=12).map(bytes)
PARTS = st.lists(
    st.builds(Status, st.integers(0, 252), st.integers(0, 255), HOT | st.binary(max_size=12)), min_size=1, max_size=8
)


def whole_parts(sizes: list[int], received: int) -> int:
    """How many parts of a fast reply are whole after so many bytes."""
    return sum(fast_length(sizes[: count + 1]) <= received for count in range(len(sizes)))


@pytest.mark.parametrize(("reply", "answers"), [(FAST_SYNC_REPLY, FAST_SYNC), (FAST_BULK_REPLY, FAST_BULK)])
def test_the_manuals_examples_cut_at_every_byte(reply: bytes, answers: tuple[Status, ...]) -> None:
    sizes = [len(answer.data) for answer in answers]
    assert fast_length(sizes) == len(reply)
    for length in range(len(reply) + 1):
        assert valid_parts(reply[:length], sizes) == list(answers[: whole_parts(sizes, length)])


@settings(max_examples=150)
@given(PARTS, st.data())
def test_any_reply_cut_or_damaged_yields_what_stands_before(answers: list[Status], data: st.DataObject) -> None:
    sizes, reply = [len(answer.data) for answer in answers], more_frames.fast_status(answers)
    assert valid_parts(reply + b"\xff\xff\xfd\0", sizes) == answers
    cut = data.draw(st.integers(0, len(reply)))
    assert valid_parts(reply[:cut], sizes) == answers[: whole_parts(sizes, cut)]
    at = data.draw(st.integers(8, len(reply) - 1))
    damaged = reply[:at] + bytes((reply[at] ^ data.draw(st.integers(1, 255)),)) + reply[at + 1 :]
    assert valid_parts(damaged, sizes) == answers[: whole_parts(sizes, at)]


def test_a_reply_to_another_question_has_no_parts() -> None:
    for sizes in ([4, 4], [4, 4, 5], [5, 4, 3]):  # the last: same length, other layout
        assert valid_parts(FAST_SYNC_REPLY, sizes) == []
    assert valid_parts(protocol2.status(1, 0, b"\x01\x02\x03\x04"), [4]) == []
    assert valid_parts(protocol2.sync_read(132, 4, (3, 7, 4), fast=True), [4, 4, 4]) == []
    assert valid_parts(b"", [4]) == []
