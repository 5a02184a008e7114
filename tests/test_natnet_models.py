"""NatNet model definitions of every version, made by an independent builder."""

from struct import pack

import pytest

from natnet_packets import SIZED_VERSIONS, VERSIONS, Body, Catalogue, definitions
from retarget.sources.natnet_models import BodyDefinition, Definitions, GroupDefinition, read_definitions
from retarget.sources.natnet_wire import Version

BONES = [Body("Hip", 1, 0, (0, 1, 0)), Body("Spine", 2, 1, (0, 0.5, 0), markers=0)]
CATALOGUE = Catalogue(
    bodies=[Body("Quad", 2), Body("Held", -3, markers=0)],
    skeletons=[("Ann", 5, BONES), ("Nobody", 6, [])],
    assets=[("Cloth", 8, [Body("Patch", 1)])],
)


def known(version: Version) -> Definitions:
    bones = (BodyDefinition("Hip", 1, 0, (0, 1, 0)), BodyDefinition("Spine", 2, 1, (0, 0.5, 0)))
    return Definitions(
        (BodyDefinition("Quad", 2, -1, (0, 0, 0)), BodyDefinition("Held", -3, -1, (0, 0, 0))),
        (GroupDefinition("Ann", 5, bones), GroupDefinition("Nobody", 6, ())),
        (GroupDefinition("Cloth", 8, (BodyDefinition("Patch", 1, -1, (0, 0, 0)),)),) if version >= (4, 1) else (),
    )


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_names_numbers_and_parents(version: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:], version) == known(version)


@pytest.mark.parametrize("told", VERSIONS, ids=str)
@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_they_are_read_whatever_version_was_told(version: Version, told: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:], told) == known(version)


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
def test_absurd_counts_are_refused(version: Version) -> None:
    assert read_definitions(pack("<I", 2**32 - 1), version) is None
    assert read_definitions(pack("<II", 1, 2) + b"A\0" + pack("<iI", 1, 2**32 - 1), version) is None


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_bytes_behind_the_last_set_are_refused(version: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:] + b"\0", version) is None


def test_no_definitions() -> None:
    assert read_definitions(pack("<I", 0), Version(4, 1)) == Definitions()
