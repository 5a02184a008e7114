"""Real bytes of Motive 2.1 (NatNet 3.0), with numbers read off the bytes by hand."""

import gc
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random
from struct import pack, unpack

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from natnet_packets import VERSIONS, Body, Catalogue, Motion, Pose, definitions, frame, server_info
from retarget.live.stream_report import natnet_problems
from retarget.sources.streams.natnet_decoder import (
    BAD_DEFINITIONS,
    BAD_FRAME,
    BAD_SERVER,
    DATAGRAM_CUT_SHORT,
    DOUBLED,
    NO_PARENT,
    NO_POSE,
    STRANGE,
    SURPLUS_POSE,
    NatnetDecoder,
)
from retarget.sources.streams.natnet_session import NatnetSession
from retarget.sources.streams.natnet_wire import (
    MessageId,
    Version,
    connect_message,
    message,
    read_flags,
    read_frame,
)
from retarget.sources.streams.stream_frame import MAX_POSES, TOO_LONG, StreamFrame

V3 = Version(3, 0)
CLOCK_HZ = 0x328C93


@pytest.fixture(scope="module")
def recorded(shared: Path) -> Path:
    folder = shared / "streams" / "natnet"
    if not folder.is_dir():
        pytest.skip(f"no recorded streams at {folder}")
    return folder


def single(word: str) -> float:
    """A little-endian float32 as it stands in the bytes."""
    return float(unpack("<f", bytes.fromhex(word))[0])


def learned(recorded: Path) -> NatnetDecoder:
    decoder = NatnetDecoder()
    for name in ("serverinfo", "modeldef"):
        assert decoder.decode((recorded / f"{name}_packet_v3.bin").read_bytes()) == []
    return decoder


def test_a_frame(recorded: Path) -> None:
    decoder = learned(recorded)
    (found,) = decoder.decode((recorded / "mocapframe_packet_v3.bin").read_bytes())
    assert found.names == ("rigid://RaceQuad",)
    assert found.number == 0x27BAE
    assert found.tracked.tolist() == [True]
    assert found.stamp == 0x149CDD813D6 / CLOCK_HZ
    x, y, z = single("24a2323e"), single("9a3bb93f"), single("59fb3bbf")
    np.testing.assert_array_equal(found.position, [[z, x, y]])
    qx, qy, qz, qw = (single(word) for word in ("349e5fbd", "f78b023f", "8402333d", "cb7b5bbf"))
    np.testing.assert_allclose(found.orientation, [[qw, qz, qx, qy]], atol=2e-7)
    assert np.linalg.norm(found.orientation) == pytest.approx(1.0, abs=1e-12)
    assert decoder.dropped.count == 0
    assert not decoder.names_missing


@pytest.mark.parametrize(("name", "size"), [("mocapframe", 336), ("mocapframe_occluded", 365)])
def test_every_byte_of_a_frame_is_used(recorded: Path, name: str, size: int) -> None:
    stem = name.replace("mocapframe", "mocapframe_packet")
    whole = (recorded / f"{stem}_v3.bin").read_bytes()
    assert len(whole) == size
    found = read_frame(whole[4:], V3)
    assert found is not None
    assert found.surplus == 0
    assert found.mid_exposure > 0 and read_flags(whole[4:]) == 0


def test_questions_are_as_the_real_client_asks_them(recorded: Path) -> None:
    real, ours = (recorded / "connect_packet_v3.bin").read_bytes(), connect_message()
    assert len(real) == len(ours)
    assert (real[:4], real[260:]) == (ours[:4], ours[260:])
    assert (recorded / "requestmodeldef_packet_v3.bin").read_bytes() == message(MessageId.DEFINITIONS_REQUEST)


REASONS = {
    TOO_LONG,
    DATAGRAM_CUT_SHORT,
    STRANGE,
    BAD_FRAME,
    BAD_DEFINITIONS,
    BAD_SERVER,
    DOUBLED,
    SURPLUS_POSE,
    NO_POSE,
    NO_PARENT,
}
"""Everything that a decoder may count."""

ANN = 5 << 16
MOTION = Motion(
    bodies=[Pose(2, (1, 2, 3))],
    skeletons=[(5, [Pose(ANN | bone) for bone in (1, 2, 3)])],
    assets=[(8, [Pose(8 << 16 | 1)])],
)
BONES = [Body("Hip", 1, 0), Body("Spine", 2, 1), Body("Head", 3, 2)]
CATALOGUE = Catalogue([Body("Quad", 2)], [("Ann", 5, BONES)], [("Cloth", 8, [Body("Patch", 1)])])
MADE = [
    whole
    for version in VERSIONS
    for whole in (frame(MOTION, version), definitions(CATALOGUE, version), server_info(version))
]
GOOD = frame(Motion(number=99, bodies=[Pose(2, (1, 2, 3))]), Version(3, 0))
KINDS = (0, 1, 2, 3, 4, 5, 7, 7, 7, 8, 10, 12, 13, 14, 100)


def decoders() -> list[NatnetDecoder]:
    return [NatnetDecoder(), NatnetDecoder(bones="local", up="z")]


def check(frames: list[StreamFrame]) -> None:
    for found in frames:
        assert len(found.names) == len(set(found.names)) <= MAX_POSES
        known = np.isfinite(found.position).all(axis=1)
        np.testing.assert_allclose(np.linalg.norm(found.orientation[known], axis=1), 1.0, atol=1e-9)
        assert not found.tracked[~known].any()


def fed(decoder: NatnetDecoder, session: NatnetSession, whole: bytes, now: float) -> int:
    frames = decoder.decode(whole)
    session.receive(now, whole)
    assert len(session.poll(now)) <= 5
    check(frames)
    return len(frames)


@pytest.mark.parametrize(
    ("version", "mended"),
    [*((version, True) for version in VERSIONS if version <= (4, 2)), (Version(4, 2), False)],
    ids=str,
)
def test_cut_at_every_byte_it_is_dropped_with_a_reason(version: Version, mended: bool) -> None:
    small = replace(CATALOGUE, crowd=False)
    for whole in (frame(MOTION, version), definitions(small, version), server_info(version)):
        decoder = NatnetDecoder()
        for end in range(4 if mended else 0, len(whole)):
            cut = whole[:2] + pack("<H", end - 4) + whole[4:end] if mended else whole[:end]
            assert decoder.decode(cut) == []
        assert decoder.dropped.count == len(whole) - (4 if mended else 0)


@given(st.sampled_from(KINDS), st.binary(max_size=400), st.lists(st.integers(0, 8), max_size=40))
@settings(max_examples=60)
def test_made_up_payloads(kind: int, noise: bytes, numbers: list[int]) -> None:
    counts = b"".join(pack("<I", number) for number in numbers)
    session = NatnetSession()
    for decoder in decoders():
        for payload in (noise, counts + noise):
            fed(decoder, session, pack("<HH", kind, len(payload)) + payload, 0.0)
        assert set(decoder.dropped.reasons) <= REASONS


@given(st.sampled_from(MADE), st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), max_size=6))
@settings(max_examples=80)
def test_changed_bytes_and_then_a_good_frame(whole: bytes, changes: list[tuple[int, int]]) -> None:
    changed = bytearray(whole)
    for at, value in changes:
        changed[at % len(changed)] = value
    for decoder in decoders():
        fed(decoder, NatnetSession(), bytes(changed), 0.0)
        (found,) = decoder.decode(GOOD)
        assert found.number == 99
        assert found.tracked.tolist() == [True]


def changed_and_random(sources: list[bytes], seed: int, count: int) -> Iterator[bytes]:
    """Some whole, some cut, most with a few bytes changed, some made up."""
    random = Random(seed)
    for _ in range(count):
        choice = random.random()
        if choice < 0.15:
            payload = random.randbytes(random.randrange(300))
            yield pack("<HH", random.choice(KINDS), len(payload)) + payload
            continue
        whole = bytearray(random.choice(sources))
        for _ in range(random.randrange(6)):
            at = random.randrange(len(whole))
            whole[at : at + 4] = random.choice((bytes(4), b"\xff" * 4, random.randbytes(4)))
        if choice < 0.3:
            del whole[random.randrange(len(whole)) :]
            if len(whole) >= 4:
                whole[2:4] = pack("<H", len(whole) - 4)
        yield bytes(whole)


class Storm:
    """Two decoders and two sessions that live as long as it does."""

    def __init__(self) -> None:
        self.sessions = [NatnetSession(), NatnetSession()]
        self.decoders = decoders()
        self.now = 0.0

    def blow(self, sources: list[bytes], *, seed: int, count: int) -> int:
        """Feeds datagrams; how many frames came out."""
        frames = 0
        for i, whole in enumerate(changed_and_random(sources, seed, count)):
            self.now += 1e-3
            which = i % 2
            frames += fed(self.decoders[which], self.sessions[which], whole, self.now)
            if i % 100 == 0:
                for problem in natnet_problems(self.sessions[which], self.now, host="lab"):
                    assert problem.render().isprintable()
        for decoder in self.decoders:
            assert set(decoder.dropped.reasons) <= REASONS
        return frames


def test_a_short_storm() -> None:
    assert Storm().blow(MADE, seed=5, count=400) > 25


@pytest.mark.long
def test_nothing_is_kept_of_what_passed() -> None:
    storm = Storm()
    storm.blow(MADE, seed=1, count=2000)
    tracemalloc.start()
    try:
        storm.blow(MADE, seed=2, count=1000)
        # A collection empties the interpreter's own free lists, which are no state of ours.
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        storm.blow(MADE, seed=3, count=8000)
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 50_000
    finally:
        tracemalloc.stop()
