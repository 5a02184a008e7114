"""VMC: names, poses, states, what is dropped, and that remembering layouts changes nothing."""

import random
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from osc_bytes import bundle, damaged, message, pose, text
from retarget.sources.stream_frame import MAX_POSES, StreamFrame
from retarget.sources.vmc import (
    BAD_POSE,
    BAD_SERIAL,
    BAD_STAMP,
    TOLD_TWICE,
    TOO_MANY_POSES,
    UNKNOWN_ADDRESS,
    UNKNOWN_BONE,
    WRONG_ARGUMENTS,
    VmcDecoder,
)

ROOT, BONE, HMD, CON, TRA = (f"/VMC/Ext/{part}/Pos" for part in ("Root", "Bone", "Hmd", "Con", "Tra"))
TURNED = (0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5)
NAN, INF = float("nan"), float("inf")


def decode(*messages: bytes) -> tuple[list[StreamFrame], VmcDecoder]:
    decoder = VmcDecoder()
    return decoder.decode(bundle(*messages)), decoder


def one(*messages: bytes) -> StreamFrame:
    (frame,), decoder = decode(*messages)
    assert not decoder.dropped.reasons
    return frame


def same(first: list[StreamFrame], second: list[StreamFrame]) -> bool:
    return len(first) == len(second) and all(
        a.names == b.names
        and a.stamp == b.stamp
        and np.array_equal(a.tracked, b.tracked)
        and np.array_equal(a.position, b.position, equal_nan=True)
        and np.array_equal(a.orientation, b.orientation, equal_nan=True)
        for a, b in zip(first, second, strict=True)
    )


def test_golden_bytes() -> None:
    golden = (
        b"/VMC/Ext/Tra/Pos\0\0\0\0,sfffffff\0\0\0LHR-1\0\0\0"
        b"\x3f\x80\0\0\x40\0\0\0\x40\x40\0\0"  # 1 2 3
        b"\xbf\0\0\0\x3f\0\0\0\xbf\0\0\0\x3f\0\0\0"  # -0.5 0.5 -0.5 0.5
    )
    assert golden == pose(TRA, "LHR-1", 1.0, 2.0, 3.0, -0.5, 0.5, -0.5, 0.5)
    (frame,) = VmcDecoder().decode(golden)
    assert frame.names == ("LHR-1",) and frame.stamp is None and frame.number is None
    assert_allclose(frame.position, [[3.0, -1.0, 2.0]])
    assert_allclose(frame.orientation, [[0.5, 0.5, -0.5, -0.5]])
    assert frame.tracked.tolist() == [True]


def test_names_by_serial_bone_and_root() -> None:
    frame = one(
        message("/VMC/Ext/T", "f", 7.5),
        pose(ROOT, "root"),
        pose(BONE, "leftupperarm"),
        pose(HMD, "human://HEAD"),
        pose(TRA, "human://WAIST"),
        pose(CON, "human://LEFT_HAND"),
        pose(HMD + "/Local", "human://HEAD"),
    )
    devices = ("human://HEAD", "human://WAIST", "human://LEFT_HAND", "local://human://HEAD")
    assert frame.names == ("root://root", "bone://LeftUpperArm", *devices)
    assert frame.stamp == 7.5


def test_a_zero_position_is_untold_for_bones_only() -> None:
    frame = one(
        pose(ROOT, "root"), pose(BONE, "Hips", -0.0, 0.0, 0.0, 0, 0, 0, 1), pose(TRA, "a"), pose(BONE, "Neck", *TURNED)
    )
    assert_array_equal(np.isnan(frame.position).all(axis=1), [False, True, False, False])
    assert not np.isnan(frame.orientation).any() and frame.tracked.all()


def test_surplus_arguments_are_ignored_and_quaternions_are_made_unit() -> None:
    scale = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    values = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.99)
    frame = one(message(ROOT, "sfffffffffffff", "root", *values, *scale))
    assert_allclose(frame.orientation, [[1.0, 0.0, 0.0, 0.0]], atol=1e-15)


def test_the_sign_of_a_quaternion_stays() -> None:
    frame = one(pose(TRA, "a", 0, 0, 0, 0, 0, 0, -1))
    assert frame.orientation[0, 0] == -1.0


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (message(TRA, "sffffff", "a", *[0.0] * 6), WRONG_ARGUMENTS),
        (message(TRA, "ifffffff", 1, *[0.0] * 7), WRONG_ARGUMENTS),
        (message(TRA, "sdffffff", "a", *[0.0] * 7), WRONG_ARGUMENTS),
        (message("/VMC/Ext/T", "i", 1), WRONG_ARGUMENTS),
        (message("/VMC/Ext/OK", "f", 1.0), WRONG_ARGUMENTS),
        (message("/other", ""), UNKNOWN_ADDRESS),
        (message("/VMC/Extra", ""), UNKNOWN_ADDRESS),
        (pose(BONE, "Tail"), UNKNOWN_BONE),
        (pose(TRA, ""), BAD_SERIAL),
        (pose(TRA, "bone://Hips"), BAD_SERIAL),
        (pose(TRA, "x" * 129), BAD_SERIAL),
        (message("/VMC/Ext/T", "f", NAN), BAD_STAMP),
        (message("/VMC/Ext/T", "f", INF), BAD_STAMP),
    ],
)
def test_what_is_dropped_by_reason_leaves_the_rest(bad: bytes, reason: str) -> None:
    decoder = VmcDecoder()
    for _ in range(2):  # the second time from the remembered layout
        (frame,) = decoder.decode(bundle(bad, *(pose(TRA, name) for name in "wxyz")))
        assert frame.names == ("w", "x", "y", "z") and frame.stamp is None
    assert decoder.dropped.reasons == {reason: 2}
    assert decode(bad)[0] == []


@pytest.mark.parametrize(
    "address", ["/VMC/Ext/Blend/Val", "/VMC/Ext/Con", "/VMC/Ext/Cam", "/VMC/Thru/a", "/VMC/Ext/Key"]
)
def test_messages_without_a_pose_are_no_fault(address: str) -> None:
    frames, decoder = decode(message(address, "sf", "A", 1.0))
    assert frames == [] and decoder.dropped.count == 0


@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize("value", [NAN, INF, -INF, 1e30])
def test_a_pose_out_of_this_world_is_nan_and_untracked(index: int, value: float) -> None:
    numbers = list(TURNED)
    numbers[index] = value
    frames, decoder = decode(pose(TRA, "good", *TURNED), pose(TRA, "bad", *numbers), pose(TRA, "fine", *TURNED))
    (frame,) = frames
    assert frame.names == ("good", "bad", "fine") and frame.tracked.tolist() == [True, False, True]
    assert np.isnan(frame.position[1]).all() and np.isnan(frame.orientation[1]).all()
    assert np.isfinite(frame.position[[0, 2]]).all() and np.isfinite(frame.orientation[[0, 2]]).all()
    assert decoder.dropped.reasons == {BAD_POSE: 1}


def test_a_zero_quaternion_and_a_signalling_nan_are_dropped() -> None:
    assert decode(pose(TRA, "a", *[0.0] * 7))[1].dropped.reasons == {BAD_POSE: 1}
    signalling = pose(TRA, "a", *TURNED)[:-4] + b"\x7f\xa0\0\1"
    assert decode(signalling)[1].dropped.reasons == {BAD_POSE: 1}


def test_a_name_told_twice_counts_last() -> None:
    frames, decoder = decode(pose(TRA, "a"), pose(HMD, "a", *TURNED))
    assert frames[0].names == ("a",) and decoder.dropped.reasons == {TOLD_TWICE: 1}
    assert_allclose(frames[0].position[0], [0.3, -0.1, 0.2], atol=1e-7)


def test_poses_are_bounded() -> None:
    frames, decoder = decode(*(pose(TRA, str(number)) for number in range(MAX_POSES + 3)))
    assert len(frames[0].names) == MAX_POSES and decoder.dropped.reasons == {TOO_MANY_POSES: 3}


def test_states_are_remembered_until_told_otherwise() -> None:
    decoder = VmcDecoder()
    tracker = pose(TRA, "a")
    assert (decoder.loaded, decoder.calibration, decoder.calibration_mode, decoder.tracking) == (None,) * 4
    assert decoder.decode(tracker)[0].tracked.all()
    assert decoder.decode(message("/VMC/Ext/OK", "iiii", 1, 3, 2, 1)) == []
    assert (decoder.loaded, decoder.calibration, decoder.calibration_mode, decoder.tracking) == (True, 3, 2, True)
    decoder.decode(message("/VMC/Ext/OK", "iiii", 1, 2, 0, 0))
    assert not decoder.decode(tracker)[0].tracked.any() and decoder.tracking is False
    decoder.decode(message("/VMC/Ext/OK", "iii", 1, 1, 0))
    assert decoder.calibration == 1 and decoder.tracking is False
    decoder.decode(message("/VMC/Ext/OK", "iiii", 0, 3, 0, 1))
    assert not decoder.decode(tracker)[0].tracked.any() and decoder.loaded is False
    decoder.decode(message("/VMC/Ext/OK", "ii", 1, 0))  # no form of the protocol: the first argument counts
    assert decoder.decode(tracker)[0].tracked.all() and decoder.calibration == 3


def test_a_time_of_its_own_datagram_only() -> None:
    decoder = VmcDecoder()
    assert decoder.decode(message("/VMC/Ext/T", "f", 1.25)) == [] and decoder.time == 1.25
    assert decoder.decode(pose(TRA, "a"))[0].stamp is None


def test_names_stay_the_same_object() -> None:
    decoder = VmcDecoder()
    rows = [pose(TRA, name) for name in "abcd"]
    first = decoder.decode(bundle(*rows))[0]
    second = decoder.decode(bundle(*rows, message("/VMC/Ext/Key", "")))[0]
    assert first.names is second.names


def test_numbers_are_read_afresh_from_a_remembered_layout() -> None:
    decoder = VmcDecoder()
    for number in range(5):
        time = message("/VMC/Ext/T", "f", float(number))
        state = message("/VMC/Ext/OK", "i", number % 2)
        rows = [pose(TRA, name, float(number), *TURNED[1:]) for name in "abcd"]
        (frame,) = decoder.decode(bundle(time, state, *rows, time_tag=number))
        assert frame.stamp == number and decoder.loaded == bool(number % 2) and frame.tracked.all() == number % 2
        assert_allclose(frame.position[:, 1], -float(number))


def whole() -> bytes:
    bones = [pose(BONE, name, *TURNED) for name in ("Hips", "Spine", "Head")]
    state = message("/VMC/Ext/OK", "iiii", 1, 3, 0, 1)
    return bundle(
        message("/VMC/Ext/T", "f", 1.0), state, pose(ROOT, "root"), *bones, pose(HMD, "human://HEAD", *TURNED)
    )


def check_damaged(count: int, seed: int, datagram: bytes) -> None:
    """One decoder that remembers against a fresh one, on damaged datagrams."""
    source = random.Random(seed)
    used = VmcDecoder()
    for number in range(count):
        raw = damaged(source, datagram)
        frames = used.decode(raw)
        for frame in frames:
            told = ~np.isnan(frame.orientation[:, 0])
            assert_allclose(np.linalg.norm(frame.orientation[told], axis=1), 1.0, atol=1e-9)
            assert not np.isinf(frame.position).any() and len(set(frame.names)) == len(frame.names)
        if number % 10 == 0:
            fresh = VmcDecoder()
            fresh.loaded, fresh.tracking = used.loaded, used.tracking
            assert same(frames, fresh.decode(raw)), (seed, number)
    assert len(used.dropped.reasons) < 20


def test_damaged_datagrams() -> None:
    check_damaged(2000, 1, whole())


@pytest.mark.long
def test_a_million_damaged_datagrams(shared: Path) -> None:
    real = shared / "streams/slimevr/one_bundle_pose_left_arm_T_right_elbow90_left_hip60.bin"
    check_damaged(500_000, 2, real.read_bytes())
    check_damaged(500_000, 3, whole())


def test_texts_are_padded_as_the_golden_bytes() -> None:
    assert text("abc") == b"abc\0" and text("abcd") == b"abcd\0\0\0\0"
