"""Headers and texts of the MVN streamer, from golden bytes, and damaged ones."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvn_packets import meta, mvn, scale
from retarget.sources.mvn_wire import HEADER_BYTES, SEGMENTS, MvnHeader, read_header, read_name, read_scale

GOLDEN = bytes.fromhex("4d5854503032 000004d2 82 17 0000162e 05 17 00 28 0000 02e0")


def test_the_fields_of_a_header() -> None:
    assert HEADER_BYTES == len(GOLDEN) == 24
    wanted = MvnHeader(kind=2, sample=1234, part=2, last=True, items=23, time_ms=5678, character=5, size=736)
    assert read_header(GOLDEN) == wanted
    assert read_header(b"??" + GOLDEN, 2) == wanted
    assert read_header(GOLDEN.replace(b"\x82", b"\x02")) == MvnHeader(2, 1234, 2, False, 23, 5678, 5, 736)


@pytest.mark.parametrize(
    "bad", [b"", GOLDEN[:23], b"MXTQ" + GOLDEN[4:], b"MXTPab" + GOLDEN[6:], b"MXTP\xb2\xb3" + GOLDEN[6:]]
)
def test_what_is_no_header(bad: bytes) -> None:
    assert read_header(bad) is None


def test_segments_in_the_order_of_their_ids() -> None:
    assert len(set(SEGMENTS)) == 23
    assert (SEGMENTS[0], SEGMENTS[6]) == ("Pelvis", "Head")
    assert (SEGMENTS[7], SEGMENTS[10], SEGMENTS[11], SEGMENTS[14]) == (
        *("RightShoulder", "RightHand"),
        *("LeftShoulder", "LeftHand"),
    )
    assert (SEGMENTS[15], SEGMENTS[18], SEGMENTS[19], SEGMENTS[22]) == (
        *("RightUpperLeg", "RightToe"),
        *("LeftUpperLeg", "LeftToe"),
    )


def test_the_name_of_the_performer() -> None:
    payload = meta("name:Ann: B\nxmid:00100234\ncolor:ff8800\n")[HEADER_BYTES:]
    assert read_name(payload) == "Ann: B"
    assert read_name(meta("xmid:1\n")[HEADER_BYTES:]) is None
    assert read_name(meta("name:a\x1b[2J\n")[HEADER_BYTES:]) is None
    assert read_name(payload[:-1]) is None
    assert read_name(struct.pack(">I", 2) + b"\xff\xff") is None
    assert len(read_name(meta("name:" + 500 * "x")[HEADER_BYTES:]) or "") == 64


def test_the_t_pose() -> None:
    origins = [("Pelvis", (0.0, 0.0, 0.95)), ("RightHand", (0.25, -0.5, 1.5))]
    found = read_scale(scale(origins, points=3)[HEADER_BYTES:])
    assert found is not None
    assert found[0] == ("Pelvis", "RightHand")
    np.testing.assert_allclose(found[1], [place for _, place in origins], rtol=1e-6)


def test_points_alone_are_an_empty_t_pose() -> None:
    found = read_scale(scale([], points=5)[HEADER_BYTES:])
    assert found is not None
    assert found[0] == () and found[1].shape == (0, 3)


def test_every_shortening_of_a_t_pose_is_damage() -> None:
    whole = scale([("Pelvis", (0.0, 0.0, 0.95)), ("L5", (0.0, 0.0, 1.0))])[HEADER_BYTES:-4]
    assert read_scale(whole) is not None
    assert all(read_scale(whole[:length]) is None for length in range(len(whole)))


def test_counts_that_lie() -> None:
    assert read_scale(struct.pack(">I", 256) + bytes(10_000)) is None
    assert read_scale(struct.pack(">II", 1, 2**32 - 1) + bytes(100)) is None
    assert read_scale(struct.pack(">II", 1, 65) + bytes(200)) is None
    assert read_scale(struct.pack(">II", 1, 64) + bytes(200)) is not None


@given(st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    read_header(data)
    read_name(data)
    read_scale(data)
    assert read_header(mvn("99", data)) is not None
