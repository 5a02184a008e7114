"""OSC: golden bytes, every type, nesting, bounds, and nothing that raises."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from osc_bytes import bundle, message
from retarget.sources.streams import osc
from retarget.sources.streams.osc import OscLayouts, OscPacket, read_osc
from retarget.sources.streams.stream_frame import TOO_LONG

GOLDEN = bytes.fromhex(
    "2362756e646c6500 0000000000000001"  # #bundle, immediately
    "00000014 2f564d432f4578742f540000 2c660000 3fa00000"  # /VMC/Ext/T ,f 1.25
    "00000014 2f564d432f4578742f4f4b00 2c690000 00000001"  # /VMC/Ext/OK ,i 1
)
REASONS = {osc.BAD_SIZE, osc.CUT_SHORT, osc.MANY_ARGUMENTS, osc.NO_ADDRESS, osc.NO_TAGS, osc.NOT_TEXT, osc.TOO_DEEP}
REASONS |= {TOO_LONG, osc.TOO_MANY, osc.UNKNOWN_TAG}


def test_golden_bytes() -> None:
    packet = read_osc(GOLDEN)
    assert [(m.address, m.tags, m.at) for m in packet.messages] == [
        ("/VMC/Ext/T", "f", (36,)),
        ("/VMC/Ext/OK", "i", (60,)),
    ]
    assert packet.time_tags == [8] and packet.dropped == []


def test_every_type_is_skipped_right() -> None:
    tags = "ifsbhdTFNIcrmtS[i]f"
    raw = message("/x", tags, -7, 0.5, "abc", b"12345", -(2**40), 0.1, 65, 1, 2, 3, "", 9, 2.5)
    (one,) = read_osc(raw).messages
    assert one.text == "abc"
    assert struct.unpack_from(">f", raw, one.at[-1]) == (2.5,)
    spans = read_osc(raw).variable()
    assert len(spans) == 10 and spans[2] == (one.at[4], one.at[4] + 8)  # i f h d c r m t i f; h is the third


def nested(depth: int) -> bytes:
    out = message("/deep", "i", 1)
    for _ in range(depth):
        out = bundle(out)
    return out


def test_bundles_to_depth_four() -> None:
    assert [m.address for m in read_osc(nested(osc.MAX_BUNDLE_DEPTH)).messages] == ["/deep"]
    assert read_osc(nested(osc.MAX_BUNDLE_DEPTH + 1)) == OscPacket(dropped=[osc.TOO_DEEP])
    mixed = bundle(message("/a", ""), bundle(message("/b", "")), message("/c", ""))
    assert [m.address for m in read_osc(mixed).messages] == ["/a", "/b", "/c"]


FINE = message("/fine", "i", 1)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"none\0\0\0\0,\0\0\0", osc.NO_ADDRESS),
        (b"/x\0\0", osc.NO_TAGS),
        (b"/x\0\0ifs\0", osc.NO_TAGS),
        (b"/xyz", osc.CUT_SHORT),
        (b"/x\0\0,iii", osc.CUT_SHORT),
        (b"/x\0\0,i\0\0", osc.CUT_SHORT),
        (b"/x\0\0,d\0\0\0\0\0\0", osc.CUT_SHORT),
        (b"/x\0\0,s\0\0abcd", osc.CUT_SHORT),
        (b"/x\0\0,b\0\0", osc.CUT_SHORT),
        (b"/x\0\0,b\0\0\xff\xff\xff\xff", osc.CUT_SHORT),
        (b"/x\0\0,b\0\0\0\0\0\5abcd", osc.CUT_SHORT),
        (b"/x\0\0,z\0\0\0\0\0\0", osc.UNKNOWN_TAG),
        (b"/\xff\0\0,\0\0\0", osc.NOT_TEXT),
        (b"/x\0\0,s\0\0\xc3\0\0\0", osc.NOT_TEXT),
        (message("/x", "T" * (osc.MAX_ARGUMENTS + 1)), osc.MANY_ARGUMENTS),
    ],
)
def test_a_bad_message_is_dropped_and_the_next_one_is_read(bad: bytes, reason: str) -> None:
    assert read_osc(bad) == OscPacket(dropped=[reason])
    packet = read_osc(bundle(FINE, bad, FINE))
    assert [m.address for m in packet.messages] == ["/fine", "/fine"] and packet.dropped == [reason]


def test_a_cut_datagram_has_nothing() -> None:
    whole = bundle(FINE, FINE)
    for length in range(len(whole)):
        packet = read_osc(whole[:length])
        complete = length in (16, 16 + 4 + len(FINE))  # cut exactly between two elements, which does not show
        assert complete == (packet.dropped == [])
        assert len(packet.messages) == (1 if length == 36 else 0)


@pytest.mark.parametrize("tag", ["T", "f"])
def test_the_arguments_of_all_messages_are_bounded(tag: str) -> None:
    """One datagram of many long messages must not cost a tick: it is given up where it passes the bound."""
    each = 64
    one = message("/x", tag * each, *([1.0] * each if tag == "f" else []))
    fits = read_osc(bundle(*[one] * (osc.MAX_ARGUMENTS_IN_ALL // each)))
    assert fits.arguments == osc.MAX_ARGUMENTS_IN_ALL and len(fits.messages) == osc.MAX_ARGUMENTS_IN_ALL // each
    packet = read_osc(bundle(*[one] * 100))
    assert (packet.messages, packet.dropped) == ([], [osc.TOO_MANY_ARGUMENTS])
    assert packet.arguments <= osc.MAX_ARGUMENTS_IN_ALL + each
    assert read_osc(bytes(65_540)) == OscPacket(dropped=[TOO_LONG])
    assert len(read_osc(message("/x", "T" * osc.MAX_ARGUMENTS)).messages) == 1


@settings(max_examples=300)
@given(st.binary(max_size=120))
def test_noise_never_raises(noise: bytes) -> None:
    for datagram in (noise, b"#bundle\0" + noise, b"/a\0\0," + noise):
        packet = read_osc(datagram)
        assert set(packet.dropped) <= REASONS
        for one in packet.messages:
            assert len(one.tags) == len(one.at)
        assert all(0 <= start < end <= len(datagram) and start % 4 == 0 for start, end in packet.variable())


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(st.text("abc/", max_size=9), st.floats(width=32, allow_nan=False), st.text("xyzé", max_size=7)),
        max_size=8,
    )
)
def test_what_is_written_is_read(rows: list[tuple[str, float, str]]) -> None:
    raw = bundle(*(message("/" + name, "fs", number, word) for name, number, word in rows))
    found = [(m.address, struct.unpack_from(">f", raw, m.at[0])[0], m.text) for m in read_osc(raw).messages]
    assert found == [("/" + name, number, word) for name, number, word in rows]


def four(number: float, name: str) -> bytes:
    row = message("/a", "sfih", name, number, int(number), int(number))
    return bundle(row, row, row, bundle(row))


def test_what_is_remembered_is_bounded() -> None:
    planned: list[OscPacket] = []
    layouts = OscLayouts(planned.append)
    for number in range(20):
        layouts.of(four(1.0, f"{number:03d}"))
    assert len(layouts) == osc.MAX_ALIKE
    for number in range(200):
        layouts.of(four(1.0, "x" * 4 * number))
        assert len(layouts) <= osc.MAX_ALIKE * osc.MAX_LENGTHS
    many = bundle(*[message("/" + "a" * 40, "f", 1.0)] * 500)
    assert len(many) > osc.MAX_REMEMBERED
    before = len(layouts)
    planned.clear()
    layouts.of(many)
    layouts.of(many)
    assert len(planned) == 2 and len(layouts) == before
