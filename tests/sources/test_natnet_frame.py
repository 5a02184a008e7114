"""NatNet frames of every version, made by an independent builder."""

from struct import pack

import numpy as np
import pytest

from natnet_packets import PLAIN_VERSIONS, SIZED_VERSIONS, VERSIONS, Body, Catalogue, Motion, Pose, definitions, frame
from retarget.sources.natnet_wire import (
    BODY,
    BodyDefinition,
    Definitions,
    FrameFlags,
    GroupDefinition,
    Owner,
    PoseGroup,
    Version,
    read_definitions,
    read_flags,
    read_frame,
)

BONE = 5 << 16
BODIES = [Pose(1, (1, 2, 3), (0, 0, 0.6, 0.8)), Pose(-9, (4, 5, 6), flags=0)]
BONES = [Pose(BONE | 1, (7, 8, 9)), Pose(BONE | 2, (-1, -2, -3))]
MOTION = Motion(bodies=BODIES, skeletons=[(5, BONES), (6, [])], assets=[(8, [Pose(8 << 16 | 1, (1, 1, 1))])])


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_poses_stamps_and_groups(version: Version) -> None:
    found = read_frame(frame(MOTION, version)[4:], version)
    assert found is not None
    assert (found.number, found.timestamp, found.surplus) == (7, 12.5, 0)
    assert found.mid_exposure == 3_000_000
    asset = (PoseGroup(Owner.ASSET, 8, 1),) if version in SIZED_VERSIONS else ()
    assert found.groups == (PoseGroup(Owner.RIGID_BODIES, 0, 2), PoseGroup(Owner.SKELETON, 5, 2), *asset)
    records = np.frombuffer(found.poses, BODY)
    assert records["id"].tolist()[:4] == [1, -9, BONE | 1, BONE | 2]
    np.testing.assert_array_equal(records["pose"][0], np.array([1, 2, 3, 0, 0, 0.6, 0.8], np.float32))
    np.testing.assert_array_equal(records["pose"][3], np.array([-1, -2, -3, 0, 0, 0, 1], np.float32))
    assert records["flags"].tolist()[:2] == [1, 0]
    assert records["error"][0] == 0.25


@pytest.mark.parametrize("surplus", [b"\xff", b"\xff" * 37], ids=len)
@pytest.mark.parametrize("version", SIZED_VERSIONS, ids=str)
def test_sizes_skip_what_blocks_hold_beyond_what_is_known(version: Version, surplus: bytes) -> None:
    plain, longer = (
        Motion(bodies=BODIES, skeletons=MOTION.skeletons, assets=MOTION.assets, surplus=more, flags=2)
        for more in (b"", surplus)
    )
    first, second = (read_frame(frame(motion, version)[4:], version) for motion in (plain, longer))
    assert first is not None and second is not None
    assert second.surplus == 0
    assert (first.groups, first.poses, first.flags) == (second.groups, second.poses, second.flags)


@pytest.mark.parametrize("version", SIZED_VERSIONS, ids=str)
def test_a_size_that_is_less_than_its_block_is_refused(version: Version) -> None:
    payload = bytearray(frame(Motion(bodies=BODIES, crowd=False), version)[4:])
    at = 4 + 2 * 8 + 4
    assert payload[at : at + 4] == pack("<I", 76)
    payload[at : at + 4] = pack("<I", 75)
    assert read_frame(bytes(payload), version) is None


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_nothing_is_read_of_a_frame_cut_anywhere(version: Version) -> None:
    payload = frame(MOTION, version)[4:]
    assert all(read_frame(payload[:end], version) is None for end in range(len(payload)))


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


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_flags(version: Version) -> None:
    for bit in FrameFlags:
        payload = frame(Motion(flags=int(bit)), version)[4:]
        found = read_frame(payload, version)
        assert found is not None
        assert found.flags == read_flags(payload) == bit
    assert read_flags(bytes(77)) is None
    assert read_flags(bytes(78)) == FrameFlags(0)


def test_a_longer_suffix_leaves_a_surplus() -> None:
    found = read_frame(frame(Motion(bodies=BODIES, tail=bytes(6)), Version(4, 4))[4:], Version(4, 5))
    assert found is not None
    assert found.surplus == 6


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


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_names_numbers_and_parents(version: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:], version) == known(version)


@pytest.mark.parametrize("announced", VERSIONS, ids=str)
@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_they_are_read_whatever_version_was_announced(version: Version, announced: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:], announced) == known(version)


@pytest.mark.parametrize("version", SIZED_VERSIONS, ids=str)
def test_sizes_skip_what_sets_hold_beyond_what_is_known(version: Version) -> None:
    longer = Catalogue(CATALOGUE.bodies, CATALOGUE.skeletons, CATALOGUE.assets, surplus=b"\xff" * 11)
    assert read_definitions(definitions(longer, version)[4:], version) == known(version)


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_nothing_is_read_of_definitions_cut_anywhere(version: Version) -> None:
    small = Catalogue(CATALOGUE.bodies, CATALOGUE.skeletons, CATALOGUE.assets, crowd=version == (4, 0))
    payload = definitions(small, version)[4:]
    assert all(read_definitions(payload[:end], version) is None for end in range(len(payload)))


def test_an_unknown_kind_without_a_size_is_refused() -> None:
    assert read_definitions(pack("<II", 1, 7), Version(3, 0)) is None


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_natnet_models_absurd_counts_are_refused(version: Version) -> None:
    assert read_definitions(pack("<I", 2**32 - 1), version) is None
    assert read_definitions(pack("<II", 1, 2) + b"A\0" + pack("<iI", 1, 2**32 - 1), version) is None


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_bytes_behind_the_last_set_are_refused(version: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:] + b"\0", version) is None


def test_no_definitions() -> None:
    assert read_definitions(pack("<I", 0), Version(4, 1)) == Definitions()
