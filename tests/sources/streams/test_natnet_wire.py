"""NatNet messages: golden bytes of what is sent, and what is read of a server's answers."""

from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from natnet_packets import (
    PLAIN_VERSIONS,
    SIZED_VERSIONS,
    VERSIONS,
    Body,
    Catalogue,
    Motion,
    Pose,
    definitions,
    frame,
    server_info,
)
from retarget.sources.streams.natnet_wire import (
    BodyDefinition,
    Definitions,
    GroupDefinition,
    MessageId,
    ServerInfo,
    Version,
    connect_message,
    read_definitions,
    read_frame,
    read_server_info,
    split,
    text_until_zero,
)


def test_connect_has_the_size_and_version_of_the_real_one() -> None:
    sent = connect_message()
    assert len(sent) == 268
    assert sent[:4] == b"\x00\x00\x08\x01"
    assert sent[4:13] == b"retarget\0"
    assert sent[260:] == b"\x03\0\0\0\x03\0\0\0"


def test_a_server_is_read() -> None:
    parts = split(server_info(Version(4, 2), clock_hz=10_000_000, multicast=True, port=1600))
    assert parts is not None and parts[0] == MessageId.SERVER_INFO
    assert read_server_info(parts[1]) == ServerInfo(
        "Motive", (3, 1, 0, 0), Version(4, 2), 10_000_000, 1600, True, "239.255.42.99"
    )
    assert read_server_info(parts[1][:-1]) is None
    assert read_server_info(parts[1] + b"later") == read_server_info(parts[1])


@given(st.integers(0, 2**16 - 1), st.binary(max_size=40), st.binary(max_size=8))
def test_split_gives_what_the_header_says_and_refuses_less(kind: int, payload: bytes, more: bytes) -> None:
    whole = pack("<HH", kind, len(payload)) + payload
    assert split(whole + more) == (kind, payload)
    for end in range(len(whole)):
        assert split(whole[:end]) is None


@given(st.binary(max_size=700))
def test_text_from_outside_can_be_shown(raw: bytes) -> None:
    text = text_until_zero(raw)
    assert len(text) <= 128
    assert text.isprintable()


BONE = 5 << 16
BODIES = [Pose(1, (1, 2, 3), (0, 0, 0.6, 0.8)), Pose(-9, (4, 5, 6), flags=0)]
BONES = [Pose(BONE | 1, (7, 8, 9)), Pose(BONE | 2, (-1, -2, -3))]
MOTION = Motion(bodies=BODIES, skeletons=[(5, BONES), (6, [])], assets=[(8, [Pose(8 << 16 | 1, (1, 1, 1))])])


@pytest.mark.parametrize("version", SIZED_VERSIONS, ids=str)
def test_a_size_that_is_less_than_its_block_is_refused(version: Version) -> None:
    payload = bytearray(frame(Motion(bodies=BODIES, crowd=False), version)[4:])
    at = 4 + 2 * 8 + 4
    assert payload[at : at + 4] == pack("<I", 76)
    payload[at : at + 4] = pack("<I", 75)
    assert read_frame(bytes(payload), version) is None


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_the_other_layout_never_fits_exactly(version: Version) -> None:
    other = PLAIN_VERSIONS[0] if version in SIZED_VERSIONS else SIZED_VERSIONS[0]
    for motion in (MOTION, Motion(), Motion(crowd=False), Motion(bodies=BODIES, crowd=False)):
        found = read_frame(frame(motion, version)[4:], other)
        assert found is None or found.surplus != 0


@pytest.mark.parametrize("count", [2**32 - 1, 2**31, 1_000_000])
@pytest.mark.parametrize("version", [Version(3, 0), Version(4, 1)], ids=str)
@pytest.mark.parametrize("block", range(7))
def test_absurd_counts_are_refused(block: int, version: Version, count: int) -> None:
    payload = bytearray(frame(Motion(crowd=False), version)[4:])
    at = 4 + block * (8 if version in SIZED_VERSIONS else 4)
    payload[at : at + 4] = pack("<I", count)
    found = read_frame(bytes(payload), version)
    # Blocks that are skipped by their sizes are not counted at all.
    assert found is None or (version in SIZED_VERSIONS and block not in (2, 3, 4, 5))


DEFINED_BONES = [Body("Hip", 1, 0, (0, 1, 0)), Body("Spine", 2, 1, (0, 0.5, 0), markers=0)]
CATALOGUE = Catalogue(
    bodies=[Body("Quad", 2), Body("Held", -3, markers=0)],
    skeletons=[("Ann", 5, DEFINED_BONES), ("Empty", 6, [])],
    assets=[("Cloth", 8, [Body("Patch", 1)])],
)


def known(version: Version) -> Definitions:
    bones = (BodyDefinition("Hip", 1, 0, (0, 1, 0)), BodyDefinition("Spine", 2, 1, (0, 0.5, 0)))
    return Definitions(
        (BodyDefinition("Quad", 2, -1, (0, 0, 0)), BodyDefinition("Held", -3, -1, (0, 0, 0))),
        (GroupDefinition("Ann", 5, bones), GroupDefinition("Empty", 6, ())),
        (GroupDefinition("Cloth", 8, (BodyDefinition("Patch", 1, -1, (0, 0, 0)),)),) if version >= (4, 1) else (),
    )


@pytest.mark.parametrize("announced", VERSIONS, ids=str)
@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_they_are_read_whatever_version_was_announced(version: Version, announced: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:], announced) == known(version)
