"""Parsers of both protocols: frames of a clean line, whole after damage, the same however the bytes arrive."""

import os
import random
from collections.abc import Callable

import pytest
from dynamixel_sdk import Protocol1PacketHandler
from hypothesis import given, settings
from hypothesis import strategies as st

import more_frames
from hardware.dynamixel.codec import ALERT, BROADCAST, Status, WireFrame, protocol1, protocol2, valid_parts, whole_reply
from messages import refuses
from noise import LINES, bytes_of, noise, pieces, stretch
from packet_vectors import ONE, TWO, SdkPort, Vector

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
    parser = line.parser()
    assert parser.feed(line.frame(device, code, params)) == [WireFrame(device, code, params)]


@given(st.lists(st.builds(Status, st.integers(0, 252), st.integers(0, 255), st.binary(max_size=12)), min_size=1))
def test_a_fast_status_is_taken_as_it_is(answers: list[Status]) -> None:
    reply = more_frames.fast_status(answers)
    assert protocol2.parser().feed(reply) == [WireFrame(0xFE, 0x55, reply[8:-2])]


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


def sealed_by(tail: bytes, crc: bytes) -> tuple[WireFrame, bytes]:
    """A frame whose parameters end in `tail` and whose CRC is `crc`: one of 65536 values of two bytes does it."""
    for value in range(65536):
        params = value.to_bytes(2, "little") + tail
        raw = protocol2.frame(1, 3, params)
        if raw.endswith(tail + crc):
            return WireFrame(1, 3, params), raw
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
    assert protocol2.parser().feed(stream) == [frame, frame, WireFrame(1, 1, b"")]
    single = protocol2.parser()
    assert [received for byte in stream for received in single.feed(bytes((byte,)))] == [
        frame,
        frame,
        WireFrame(1, 1, b""),
    ]
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
    said = [Status(device, 0, bytes(range(device, device + 10))) for device in range(1, 21)]
    ids = tuple(one.id for one in said)
    chance = random.Random(3)
    for _ in range(200):
        out = bytearray(more_frames.fast_status(said))
        part = chance.randrange(20)
        at = 8 + 14 * part + chance.randrange(12)
        out[at] ^= chance.randrange(1, 256)
        total = more_frames.crc(bytes(out[: 8 + 14 * (part + 1)]))
        for k in range(part + 1, 20):
            end = 8 + 14 * (k + 1) - 2
            total = more_frames.crc(bytes(out[8 + 14 * k : end]), total)
            out[end : end + 2] = total.to_bytes(2, "little")
            total = more_frames.crc(bytes(out[end : end + 2]), total)
        assert whole_reply(bytes(out), ids, 10) is None


# Protocol 1.0: printed frames, checksum; dynamixel-sdk as a second opinion.


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
