"""Whatever arrives, every decoder gives frames of finite poses or counts why it gave none, and keeps nothing of it."""

import gc
import json
import random
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from struct import pack

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camera_people import datagrams, landmarks
from mvn_packets import euler, meta, quaternions, scale
from mvn_packets import standing as segments
from natnet_packets import CATALOGUE, MOTION, VERSIONS, definitions, frame, server_info
from osc_bytes import bundle, message, pose
from rendered import performer, standing
from retarget.sources.streams.camera import CameraDecoder, WebDecoder
from retarget.sources.streams.json_pose import JsonPoseDecoder
from retarget.sources.streams.mvn import MvnDecoder
from retarget.sources.streams.natnet_decoder import NatnetDecoder
from retarget.sources.streams.stream_frame import MAX_POSES, StreamDecoder, StreamFrame
from retarget.sources.streams.vmc import VmcDecoder
from retarget.sources.streams.vrchat import VrchatDecoder

TURNED = (0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5)
AVATAR = bundle(
    message("/VMC/Ext/T", "f", 1.0),
    message("/VMC/Ext/OK", "iiii", 1, 3, 0, 1),
    pose("/VMC/Ext/Root/Pos", "root"),
    *(pose("/VMC/Ext/Bone/Pos", name, *TURNED) for name in ("Hips", "Spine", "Head")),
    pose("/VMC/Ext/Hmd/Pos", "human://HEAD", *TURNED),
)
TRACKERS = bundle(
    *(message(f"/tracking/trackers/{n}/position", "fff", 1.0, 2.0, 3.0) for n in ("head", "1", "-1", "5")),
    *(message(f"/tracking/trackers/{n}/rotation", "fff", 10.0, 20.0, 30.0) for n in ("1", "5")),
)
POSES = {"l_wrist": {"p": [1.0, 2.0, 3.0], "q": [0.0, 0.6, 0.0, 0.8], "tracked": True}, "head": {"p": [0, 1, 0]}}
MVN = [quaternions(segments()), euler([(1, (0.0, 1.0, 0.0), (0.0, 90.0, 0.0))]), meta("name:A\n")]
MVN += [scale([("Pelvis", (0, 0, 1))], points=1), quaternions(segments()[:12], counter=0)]
MVN += [quaternions(segments()[12:], counter=0x81)]
MOTIVE = [one for v in VERSIONS for one in (frame(MOTION, v), definitions(CATALOGUE, v), server_info(v))]
GOOD: Mapping[str, tuple[Callable[[], StreamDecoder], Sequence[bytes], Sequence[str]]] = {
    "MVN": (MvnDecoder, MVN, ["mxtp02_tpose.bin"]),
    "JSON": (JsonPoseDecoder, [json.dumps({"axes": "unity", "quaternion": "xyzw", "poses": POSES}).encode()], []),
    "VMC": (VmcDecoder, [AVATAR], ["slimevr/one_bundle_pose_left_arm_T_right_elbow90_left_hip60.bin"]),
    "VRChat": (VrchatDecoder, [TRACKERS], ["slimevr/one_vrchat_osc_bundle.bin"]),
    "NatNet": (NatnetDecoder, MOTIVE, ["natnet/mocapframe_packet_v3.bin"]),
    "NatNet, local bones": (partial(NatnetDecoder, bones="local", up="z"), MOTIVE, []),
    "camera": (CameraDecoder, datagrams(landmarks(standing(performer(1.7), 0.1))), []),
}
"""Decoder, good datagrams, and those of other programs."""
WORDS = (b"\x7f\x80\0\0", b"\xff\xc0\0\0", b"\x7f\xa0\0\1", bytes(4), b"\x7f\x7f\xff\xff", b"\xff" * 4, b"\0\0\0\4")


def damaged(source: random.Random, good: Sequence[bytes], *, sized: bool) -> bytes:
    """One of them with a few bytes changed, cut out, doubled or set to odd numbers, or cut short; or noise. sized: most
    have the length of what they are in their header, as NatNet's."""
    data = bytearray(source.choice(good))
    if source.random() < 0.1:
        data[source.choice((0, 4, 8)) :] = source.randbytes(source.randrange(300))
    for _ in range(source.randrange(5)):
        at = source.randrange(source.choice((len(data), min(len(data), 32))) + 1)
        span, kind = source.choice((1, 2, 4, 8, 80)), source.randrange(6)
        if kind == 0:
            del data[at : at + span]
        elif kind == 1:
            data[at:at] = data[at : at + span]
        elif kind == 2:
            data[at & ~3 : (at & ~3) + 4] = source.choice((*WORDS, source.randbytes(4)))
        else:
            data[at : at + 1] = source.randbytes(1)
    if source.random() < 0.1:
        del data[source.randrange(len(data) + 1) :]
    if sized and len(data) >= 4 and source.random() < 0.7:
        data[2:4] = pack("<H", len(data) - 4)
    return bytes(data)


def check(decoder: StreamDecoder, datagram: bytes) -> list[StreamFrame]:
    before, frames = decoder.dropped.count, decoder.decode(datagram)
    for one in frames:
        assert len(one.names) == len(set(one.names)) <= MAX_POSES
        assert not np.isinf(one.position).any()
        turns = one.orientation[~np.isnan(one.orientation).any(axis=1)]
        np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-9)
        if not isinstance(decoder, VmcDecoder | VrchatDecoder | JsonPoseDecoder):  # these also know turns alone
            assert (np.isfinite(one.position).all(axis=1) >= one.tracked).all()
    if isinstance(decoder, JsonPoseDecoder | CameraDecoder):
        assert frames or decoder.dropped.count > before
    assert len(decoder.dropped.reasons) <= 40
    return frames


def storm(name: str, used: StreamDecoder, *, seed: int, count: int, more: Sequence[bytes] = ()) -> None:
    """Damage through one decoder; every tenth datagram of those that remember layouts through a fresh one, too."""
    new, good, _ = GOOD[name]
    source, found = random.Random(seed), 0
    for number in range(count):
        if name in ("MVN", "camera") and number % 100 == 0:
            used = new()  # it would wait for the character or the time that damage made up
        raw = damaged(source, [*good, *more], sized="NatNet" in name)
        frames = check(used, raw)
        found += len(frames)
        if number % 10 == 0 and isinstance(used, VmcDecoder | VrchatDecoder):
            fresh = new()
            if isinstance(fresh, VmcDecoder) and isinstance(used, VmcDecoder):
                fresh.loaded, fresh.tracking = used.loaded, used.tracking
            for one, other in zip(frames, fresh.decode(raw), strict=True):
                assert (one.names, one.stamp, *one.tracked) == (other.names, other.stamp, *other.tracked)
                np.testing.assert_array_equal(one.position, other.position)
                np.testing.assert_array_equal(one.orientation, other.orientation)
    assert found > 0.01 * count


@pytest.mark.parametrize("name", GOOD)
def test_damaged_datagrams_give_finite_poses_or_none(name: str) -> None:
    storm(name, GOOD[name][0](), seed=1, count=1000)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", GOOD)
def test_of_very_many_damaged_datagrams_nothing_is_kept(name: str, shared: Path) -> None:
    decoder, more = GOOD[name][0](), [(shared / "streams" / file).read_bytes() for file in GOOD[name][2]]
    storm(name, decoder, seed=2, count=100_000 if "NatNet" in name else 1_000_000, more=more)
    tracemalloc.start()
    try:
        storm(name, decoder, seed=3, count=1000)
        gc.collect()  # empties the interpreter's own free lists, which are no state of ours
        before = tracemalloc.get_traced_memory()[0]
        storm(name, decoder, seed=4, count=8000)
        gc.collect()
        grown = tracemalloc.get_traced_memory()[0] - before
        assert grown < (500_000 if isinstance(decoder, VmcDecoder | VrchatDecoder) else 50_000)  # these know layouts
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("decoder", [MvnDecoder, JsonPoseDecoder, VmcDecoder, VrchatDecoder, NatnetDecoder, WebDecoder])
@given(st.binary(max_size=200))
def test_any_bytes_give_no_frame_but_a_reason(decoder: Callable[[], StreamDecoder], noise: bytes) -> None:
    for head in (b"", b"#bundle\0", b"/a\0\0,", b"MXTP02", b"\7\0", b'{"axes": "camera", '):
        fresh = decoder()
        assert check(fresh, head + noise) == [] and (fresh.dropped.count > 0 or head == b"#bundle\0")
