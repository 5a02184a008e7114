"""The MVN decoder: a captured datagram, built ones of every type it reads, and everything a sender can do wrong."""

import struct
from pathlib import Path

import numpy as np
import pytest

from messages import shows
from mvn_packets import euler, mvn, quaternions, scale, standing
from retarget import rotations
from retarget.frames import mirrored_name
from retarget.live.roles import CONVENTIONS
from retarget.sources.streams.mvn import (
    HEADER_BYTES,
    MVN_JOINTS,
    SEGMENTS,
    TALL_SAMPLES,
    MvnDecoder,
    MvnHeader,
    SampleParts,
    read_scale,
)
from retarget.sources.streams.stream_frame import Dropped, StreamDecoder, StreamFrame

GOOD = quaternions(standing())
PLACES = np.array([place for _, place, _ in standing()])


def only(decoder: StreamDecoder, datagram: bytes) -> StreamFrame:
    (frame,) = decoder.decode(datagram)
    return frame


def refused(datagram: bytes) -> dict[str, int]:
    decoder = MvnDecoder()
    assert decoder.decode(datagram) == []
    return dict(decoder.dropped.reasons)


def test_the_t_pose_datagram_of_the_facts(shared: Path) -> None:
    decoder = MvnDecoder()
    frame = only(decoder, (shared / "streams/mxtp02_tpose.bin").read_bytes())
    assert frame.names == SEGMENTS
    assert (frame.stamp, frame.number) == (5.678, 1234)
    assert frame.tracked.all() and decoder.dropped.count == 0
    np.testing.assert_array_equal(frame.orientation, np.tile([1.0, 0.0, 0.0, 0.0], (23, 1)))
    place = dict(zip(frame.names, frame.position, strict=True))
    np.testing.assert_allclose(place["Pelvis"], [0.0, 0.0, 0.95], atol=1e-6)
    np.testing.assert_allclose(place["LeftHand"] * [1, -1, 1], place["RightHand"], atol=1e-6)
    assert place["LeftHand"][1] > 0.6  # y is left


def test_euler_angles_turn_about_x_then_y_then_z_of_y_up_axes() -> None:
    angles = np.array([30.0, -50.0, 110.0])
    frame = only(MvnDecoder(), euler([(1, (0.2, 0.95, 0.1), angles.tolist())]))
    # y-up axes of MVN: x left, y up, z forward.
    np.testing.assert_allclose(frame.position, [[0.1, 0.2, 0.95]], rtol=1e-6)
    about_left, about_up, about_forward = (
        rotations.from_axis_angle(axis, np.deg2rad(angle))
        for axis, angle in zip(np.eye(3)[[1, 2, 0]], angles, strict=True)
    )
    wanted = rotations.multiply(about_forward, rotations.multiply(about_up, about_left))
    assert rotations.angle_between(frame.orientation[0], wanted) < 1e-7


def test_a_sample_over_two_datagrams() -> None:
    segments = [*standing(), *((n, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)) for n in range(24, 64))]
    decoder = MvnDecoder()
    assert decoder.decode(quaternions(segments[:40], counter=0)) == []
    frame = only(decoder, quaternions(segments[40:], counter=0x81))
    assert frame.names == SEGMENTS and decoder.dropped.count == 0
    np.testing.assert_allclose(frame.position, PLACES, rtol=1e-6)


def test_centimetres_are_found_and_said_once() -> None:
    decoder = MvnDecoder()
    frames = [decoder.decode(quaternions(standing(100.0), sample=n)) for n in range(20)]
    assert [len(found) for found in frames] == [0] * (TALL_SAMPLES - 1) + [1] * (21 - TALL_SAMPLES)
    np.testing.assert_allclose(frames[-1][0].position, PLACES, rtol=1e-6)
    crouched = only(decoder, quaternions([(1, (0.0, 0.0, 8.0), (1.0, 0.0, 0.0, 0.0))]))
    assert crouched.position[0, 2] == pytest.approx(0.08)


def test_the_t_pose_in_metres_and_in_centimetres() -> None:
    origins = [(SEGMENTS[number - 1], place) for number, place, _ in standing()]
    for factor in (1.0, 100.0):
        decoder = MvnDecoder()
        sent = [(name, tuple(factor * x for x in place)) for name, place in [*origins, ("Prop1", (0.0, 0.0, 0.0))]]
        assert decoder.decode(scale(sent, points=2)) == []
        assert decoder.rest is not None and decoder.rest.names == tuple(MVN_JOINTS)
        places = dict(zip(SEGMENTS, PLACES, strict=True))
        wanted = [places[segment] - places["Pelvis"] for segment in MVN_JOINTS.values()]
        np.testing.assert_allclose(decoder.rest.position, wanted, rtol=1e-5, atol=1e-6)
        before = decoder.rest
        decoder.decode(scale([], points=2))  # points alone: the T-pose stays
        assert decoder.rest is before and decoder.dropped.count == 0


def test_impossible_t_poses() -> None:
    damaged, impossible = "type 13 (scale) damaged", "type 13 (scale) with an impossible T-pose"
    assert refused(mvn("13", b"\0\0\0\1")) == {damaged: 1}
    assert refused(scale([("Pelvis", (0.0, 0.0, np.nan))])) == {impossible: 1}
    assert refused(scale([("Pelvis", (0.0, 0.0, 1.0)), ("Pelvis", (0.0, 0.0, 1.0))])) == {impossible: 1}
    assert refused(scale([("L5", (0.0, 0.0, 1.0))])) == {impossible: 1}


def test_other_characters() -> None:
    second = mvn("02", GOOD[24:], items=23, character=1)
    first_seen, chosen = MvnDecoder(), MvnDecoder(character=1)
    assert [len(first_seen.decode(datagram)) for datagram in (GOOD, second, GOOD)] == [1, 0, 1]
    assert [len(chosen.decode(datagram)) for datagram in (GOOD, second, GOOD)] == [0, 1, 0]
    assert first_seen.dropped.reasons == {"another character": 1} and chosen.dropped.reasons["another character"] == 2


def test_a_wrong_type_is_named() -> None:
    decoder = MvnDecoder()
    for kind in ("05", "20", "21", "22", "23", "24", "25", "77"):
        assert decoder.decode(mvn(kind, b"whatever")) == []
    assert len(decoder.dropped.reasons) == decoder.dropped.count == 8
    shows(decoder.dropped.reasons)


def test_datagrams_that_are_none() -> None:
    assert refused(b"") == refused(GOOD[:20]) == refused(b"OSC" + GOOD) == {"not an MVN datagram": 1}
    old = GOOD[:17] + bytes(7) + GOOD[24:]  # before 2018 the end of the header was reserved
    assert only(MvnDecoder(), old).names == only(MvnDecoder(), GOOD).names
    assert refused(old[:-1]) == {"items do not fill the datagram": 1}
    assert refused(GOOD[:-1]) == refused(GOOD + b"x") == {"not of the size in its header": 1}
    assert refused(mvn("02", GOOD[24:], items=22)) == {"items do not fill the datagram": 1}
    assert refused(mvn("02", b"", items=0)) == {"no body segment": 1}
    assert refused(quaternions([standing()[0]] * 2)) == {"segment sent twice": 1}


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38])
@pytest.mark.parametrize("field", range(7))
def test_one_bad_pose_costs_only_itself(field: int, value: float) -> None:
    at = 24 + 5 * 32 + 4 + 4 * field
    decoder = MvnDecoder()
    frame = only(decoder, GOOD[:at] + struct.pack(">f", value) + GOOD[at + 4 :])
    assert np.flatnonzero(~frame.tracked).tolist() == [5]
    assert np.isnan(frame.position[5]).all() and np.isnan(frame.orientation[5]).all()
    good = frame.tracked
    np.testing.assert_allclose(frame.position[good], PLACES[good], rtol=1e-6)
    assert decoder.dropped.reasons == {"pose that is no number or no rotation": 1}


def header(part: int, *, last: bool = False, sample: int = 1) -> MvnHeader:
    return MvnHeader(2, sample, part, last, 1, 0, 0, 4)


def test_a_missing_part_gives_the_sample_up_and_one_sent_twice_is_used_once() -> None:
    for sent, reason in (
        (
            [(header(0), b"a", None), (header(0, sample=2), b"c", None), (header(1, sample=2, last=True), b"d", b"cd")],
            "sample with a part missing",
        ),
        ([(header(0), b"a", None), (header(0), b"x", None), (header(1, last=True), b"b", b"ab")], "part sent twice"),
    ):
        parts = SampleParts(dropped := Dropped())
        assert [parts.add(head, payload) for head, payload, _ in sent] == [whole for _, _, whole in sent]
        assert dropped.reasons == {reason: 1}


def other_side(segment: str) -> str:
    return segment.replace("Left", "?").replace("Right", "Left").replace("?", "Right")


def test_sides_agree() -> None:
    for name, role in CONVENTIONS["mvn"].items():
        twin = CONVENTIONS["mvn"][mirrored_name(name)]
        assert (other_side(role.position), other_side(role.orientation)) == (twin.position, twin.orientation)
        assert (name[:2] == "l_") == role.position.startswith("Left") == role.orientation.startswith("Left")
    for name, segment in MVN_JOINTS.items():
        assert MVN_JOINTS[mirrored_name(name)] == other_side(segment)


def test_a_t_pose_cut_short_or_with_counts_that_lie_is_damage() -> None:
    whole = scale([("Pelvis", (0.0, 0.0, 0.95)), ("L5", (0.0, 0.0, 1.0))])[HEADER_BYTES:-4]
    assert read_scale(whole) is not None
    assert all(read_scale(whole[:length]) is None for length in range(len(whole)))
    assert read_scale(struct.pack(">I", 256) + bytes(10_000)) is None
    for length in (2**32 - 1, 65, 64):
        assert (read_scale(struct.pack(">II", 1, length) + bytes(200)) is not None) == (length == 64)
