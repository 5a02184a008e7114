"""The MVN decoder: a captured datagram, built ones of every type it reads, and everything a sender can do wrong."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mutated import mutated
from mvn_packets import euler, meta, mvn, quaternions, scale, standing
from retarget import rotations
from retarget.sources.mvn import CENTIMETRES, TALL_SAMPLES, MvnDecoder
from retarget.sources.mvn_wire import SEGMENTS
from retarget.sources.stream_frame import StreamDecoder, StreamFrame
from support.messages import shows

GOOD = quaternions(standing())
PLACES = np.array([place for _, place, _ in standing()])
TURNS = np.array([turn for _, _, turn in standing()])


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
    assert frame.tracked.all() and decoder.dropped.count == 0 and not decoder.notes
    np.testing.assert_array_equal(frame.orientation, np.tile([1.0, 0.0, 0.0, 0.0], (23, 1)))
    place = dict(zip(frame.names, frame.position, strict=True))
    np.testing.assert_allclose(place["Pelvis"], [0.0, 0.0, 0.95], atol=1e-6)
    np.testing.assert_allclose(place["LeftHand"] * [1, -1, 1], place["RightHand"], atol=1e-6)
    assert place["LeftHand"][1] > 0.6  # y is left


def test_quaternions_arrive_as_sent() -> None:
    frame = only(MvnDecoder(), quaternions(standing(), sample=2**32 - 1, time_ms=2**32 - 1))
    np.testing.assert_allclose(frame.position, PLACES, rtol=1e-6)
    np.testing.assert_allclose(frame.orientation, TURNS, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(frame.orientation, axis=1), 1.0, atol=1e-15)
    assert (frame.stamp, frame.number) == (4294967.295, 2**32 - 1)
    assert frame.position.flags.c_contiguous and frame.orientation.flags.c_contiguous


def test_a_rounded_quaternion_becomes_a_rotation() -> None:
    frame = only(MvnDecoder(), quaternions([(1, (0.0, 0.0, 1.0), (0.6 * 0.99, 0.8 * 0.99, 0.0, 0.0))]))
    np.testing.assert_allclose(frame.orientation, [[0.6, 0.8, 0.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(frame.orientation), 1.0, atol=1e-15)


def test_names_are_one_tuple_as_long_as_they_stay() -> None:
    decoder = MvnDecoder()
    assert only(decoder, GOOD).names is only(decoder, GOOD).names


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


def test_both_types_tell_the_same_pose() -> None:
    turn = rotations.from_axis_angle([0.0, 0.0, 1.0], np.pi / 2)
    upright = only(MvnDecoder(), quaternions([(1, (0.1, 0.2, 0.95), turn.tolist())]))
    y_up = only(MvnDecoder(), euler([(1, (0.2, 0.95, 0.1), (0.0, 90.0, 0.0))]))
    np.testing.assert_allclose(upright.position, y_up.position, atol=1e-7)
    np.testing.assert_allclose(upright.orientation, y_up.orientation, atol=1e-7)


def test_quaternions_are_preferred() -> None:
    decoder = MvnDecoder()
    angles = euler([(1, (0.0, 0.95, 0.0), (0.0, 0.0, 0.0))])
    assert decoder.decode(angles)
    decoder.decode(mvn("02", b"x"))  # no sample in it: nothing to prefer yet
    assert decoder.decode(angles)
    assert decoder.decode(GOOD)
    assert decoder.decode(angles) == []
    assert decoder.dropped.reasons["type 01 (Euler angles) beside quaternions"] == 1


def test_props_and_fingers_are_left_out() -> None:
    for make, turn in ((quaternions, (1.0, 0.0, 0.0, 0.0)), (euler, (0.0, 0.0, 0.0))):
        frame = only(MvnDecoder(), make([(n, (0.0, 0.0, 0.9), turn) for n in (24, 1, 30, 7, 0, 63)]))
        assert frame.names == ("Pelvis", "Head")


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
    assert decoder.notes == [CENTIMETRES]
    crouched = only(decoder, quaternions([(1, (0.0, 0.0, 8.0), (1.0, 0.0, 0.0, 0.0))]))
    assert crouched.position[0, 2] == pytest.approx(0.08)


def test_one_wild_sample_changes_no_unit() -> None:
    decoder = MvnDecoder()
    for n in range(20):
        decoder.decode(quaternions(standing(100.0 if n % 2 else 1.0), sample=n))
    assert not decoder.notes and decoder.dropped.reasons == {"pelvis above 10 m": 10}
    np.testing.assert_allclose(only(decoder, GOOD).position, PLACES, rtol=1e-6)


def test_the_height_of_euler_poses_is_y() -> None:
    decoder = MvnDecoder()
    for _ in range(TALL_SAMPLES):
        found = decoder.decode(euler([(1, (20.0, 95.0, 10.0), (0.0, 0.0, 0.0))]))
    np.testing.assert_allclose(found[0].position, [[0.1, 0.2, 0.95]], rtol=1e-6)


def test_the_t_pose_in_metres_and_in_centimetres() -> None:
    origins = [(SEGMENTS[number - 1], place) for number, place, _ in standing()]
    for factor in (1.0, 100.0):
        decoder = MvnDecoder()
        sent = [(name, tuple(factor * x for x in place)) for name, place in [*origins, ("Prop1", (0.0, 0.0, 0.0))]]
        assert decoder.decode(scale(sent, points=2)) == []
        assert decoder.rest is not None and decoder.rest.names == SEGMENTS
        np.testing.assert_allclose(decoder.rest.position, PLACES, rtol=1e-5)
        decoder.decode(scale([], points=2))  # points alone: the T-pose stays
        assert decoder.rest.names == SEGMENTS and decoder.dropped.count == 0


def test_impossible_t_poses() -> None:
    damaged, impossible = "type 13 (scale) damaged", "type 13 (scale) with an impossible T-pose"
    assert refused(mvn("13", b"\0\0\0\1")) == {damaged: 1}
    assert refused(scale([("Pelvis", (0.0, 0.0, np.nan))])) == {impossible: 1}
    assert refused(scale([("Pelvis", (0.0, 0.0, 1.0)), ("Pelvis", (0.0, 0.0, 1.0))])) == {impossible: 1}
    assert refused(scale([("L5", (0.0, 0.0, 1.0))])) == {impossible: 1}


def test_the_name() -> None:
    decoder = MvnDecoder()
    assert decoder.decode(meta("name:Ann\nxmid:1\n")) == [] and decoder.name == "Ann"
    assert refused(meta("xmid:1")) == {"type 12 (names) without a name": 1}


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
    assert decoder.types == dict.fromkeys((5, 20, 21, 22, 23, 24, 25, 77), 1)


def test_datagrams_that_are_none() -> None:
    assert refused(b"") == refused(GOOD[:20]) == refused(b"OSC" + GOOD) == {"not an MVN datagram": 1}
    assert refused(GOOD[:-1]) == refused(GOOD + b"x") == {"not of the size it tells": 1}
    assert refused(mvn("02", GOOD[24:], items=22)) == {"items do not fill the datagram": 1}
    assert refused(mvn("02", b"", items=0)) == {"no body segment": 1}
    assert refused(quaternions([standing()[0]] * 2)) == {"segment told twice": 1}


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


def test_a_zero_quaternion_and_a_signalling_nan() -> None:
    zero = only(MvnDecoder(), quaternions([(1, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0))]))
    assert not zero.tracked.any()
    signalling = only(MvnDecoder(), GOOD[:28] + bytes.fromhex("7f800001") + GOOD[32:])
    assert not signalling.tracked[0] and signalling.tracked[1:].all()
    for value in (np.nan, np.inf, 1e30):
        assert not only(MvnDecoder(), euler([(1, (0.0, 1.0, 0.0), (0.0, value, 0.0))])).tracked.any()


REAL = [
    GOOD,
    euler([(1, (0.0, 1.0, 0.0), (0.0, 90.0, 0.0))]),
    meta("name:A\n"),
    scale([("Pelvis", (0, 0, 1))], points=1),
]
SPLIT = [quaternions(standing()[:12], counter=0), quaternions(standing()[12:], counter=0x81)]


def check(decoder: MvnDecoder, datagram: bytes) -> None:
    """Whatever comes, a frame is finite where it is tracked, and the state stays small."""
    for frame in decoder.decode(datagram):
        assert 0 < len(frame.names) == len(set(frame.names)) <= 23
        assert np.isfinite(frame.position[frame.tracked]).all()
        assert np.allclose(np.linalg.norm(frame.orientation[frame.tracked], axis=1), 1.0, atol=1e-9)
    assert len(decoder.dropped.reasons) <= 30 and len(decoder.types) <= 100 and len(decoder.notes) <= 1


@given(st.sampled_from(REAL + SPLIT), st.lists(st.tuples(st.integers(0, 900), st.integers(0, 255)), max_size=6))
@example(SPLIT[0], [(0, 77)])
def test_mutated_datagrams(datagram: bytes, changes: list[tuple[int, int]]) -> None:
    decoder, mutable = MvnDecoder(), bytearray(datagram)
    for place, value in changes:
        mutable[place % len(mutable)] = value
    for sent in (bytes(mutable), datagram, SPLIT[1], GOOD):
        check(decoder, sent)


@pytest.mark.long
def test_a_million_datagrams() -> None:
    generator = np.random.default_rng(5)
    decoder = MvnDecoder()
    for count in range(1_000_000):
        check(decoder, mutated(generator, REAL + SPLIT))
        if count % 100 == 0:
            decoder = MvnDecoder()
