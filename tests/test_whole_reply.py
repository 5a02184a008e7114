"""A whole reply, checked in one go: the same verdict as part by part, or frame by frame, for every damage."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel import protocol2
from hardware.dynamixel.fast_status import sound_parts
from hardware.dynamixel.packets import ALERT, Status
from hardware.dynamixel.parsers import parser2
from hardware.dynamixel.whole_reply import whole_frames, whole_reply


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
def test_it_is_taken_only_where_every_part_is_sound(said: list[Status], data: st.DataObject) -> None:
    reply, ids, size = protocol2.fast_status(said), tuple(one.id for one in said), len(said[0].data)
    found = whole_reply(reply, ids, size)
    assert found is not None and found.statuses == said
    damaged = bytearray(reply)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(reply) - 1))] ^= data.draw(st.integers(1, 255))
    parts = sound_parts(bytes(damaged), [size] * len(ids))
    good = [part for part, device in zip(parts, ids, strict=False) if part.id == device and not part.error & 0x7F]
    whole = whole_reply(bytes(damaged), ids, size)
    assert (whole is not None) == (len(good) == len(ids))
    if whole is not None:
        assert whole.statuses == good


def test_a_part_whose_followers_took_its_damage_for_granted_is_not_taken() -> None:
    """Who listens on the line sums what it heard: all CRCs behind a damaged part may be right again."""
    said = [Status(device, 0, bytes(range(device, device + 10))) for device in range(1, 21)]
    ids = tuple(one.id for one in said)
    chance = random.Random(3)
    for _ in range(200):
        out = bytearray(protocol2.fast_status(said))
        part = chance.randrange(20)
        at = 8 + 14 * part + chance.randrange(12)
        out[at] ^= chance.randrange(1, 256)
        total = protocol2.crc(bytes(out[: 8 + 14 * (part + 1)]))
        for k in range(part + 1, 20):
            end = 8 + 14 * (k + 1) - 2
            total = protocol2.crc(bytes(out[8 + 14 * k : end]), total)
            out[end : end + 2] = total.to_bytes(2, "little")
            total = protocol2.crc(bytes(out[end : end + 2]), total)
        assert whole_reply(bytes(out), ids, 10) is None


@pytest.mark.parametrize("cut", [1, 14, 20])
def test_neither_short_nor_long_is_whole(cut: int) -> None:
    reply = protocol2.fast_status([Status(1, 0, b"\x01\x02\x03\x04"), Status(2, 0, b"\x05\x06\x07\x08")])
    assert whole_reply(reply[:-cut], (1, 2), 4) is None
    assert whole_reply(reply + reply[:cut], (1, 2), 4) is None
    assert whole_reply(reply, (2, 1), 4) is None
    assert whole_reply(reply, (1, 2), 3) is None


def test_a_refusal_in_place_of_data_is_no_answer() -> None:
    said = [Status(1, 0, b"\x01\x02\x03\x04"), Status(2, 7, bytes(4))]
    assert whole_reply(protocol2.fast_status(said), (1, 2), 4) is None


def one_by_one(heard: bytes, ids: tuple[int, ...], size: int) -> list[Status]:
    """What a parser makes of it, as far as it answers the request."""
    parser = parser2()
    found = [protocol2.status_of(frame) for frame in [*parser.feed(heard), *parser.flush()]]
    return [one for one in found if one and one.id in ids and len(one.data) == size and not one.error & ~ALERT]


@settings(max_examples=150)
@given(answers(), st.data())
def test_frames_are_taken_only_where_every_one_is_sound(said: list[Status], data: st.DataObject) -> None:
    frames = [protocol2.status(*one) for one in said]
    reply, ids, size = b"".join(frames), tuple(one.id for one in said), len(said[0].data)
    found = whole_frames(reply, ids, size)
    assert (found is None) == (reply.count(protocol2.PATTERN) > len(ids))  # stuffed, or what looks like it
    assert found is None or found.statuses == said
    damaged = bytearray(reply)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(reply) - 1))] ^= data.draw(st.integers(1, 255))
    whole = whole_frames(bytes(damaged), ids, size)
    assert whole is None or whole.statuses == one_by_one(bytes(damaged), ids, size)


def test_frames_with_stuffing_out_of_order_refused_or_cut_are_looked_at_one_by_one() -> None:
    frame = protocol2.status
    calm = frame(1, 0, b"\x01\x02\x03\x04") + frame(2, ALERT, b"\x05\x06\x07\x08")
    found = whole_frames(calm, (1, 2), 4)
    assert found is not None and found.errors == bytes((0, ALERT))
    stuffed = frame(1, 0, b"\xff\xff\xfd")
    assert len(stuffed) == protocol2.STATUS_BYTES + 4 and whole_frames(stuffed, (1,), 4) is None
    raw = b"\xff\xff\xfd\x00\x01\x08\x00\x55\x00\xff\xff\xfd\x07"  # unstuffed, CRC right
    assert whole_frames(raw + protocol2.crc(raw).to_bytes(2, "little"), (1,), 4) is None
    assert whole_frames(calm, (2, 1), 4) is None
    assert whole_frames(calm[:-1], (1, 2), 4) is None and whole_frames(calm + b"\0", (1, 2), 4) is None
    assert whole_frames(frame(1, 7, bytes(4)), (1,), 4) is None
    assert whole_frames(frame(1, 0, bytes(3)) + b"\0", (1,), 4) is None
