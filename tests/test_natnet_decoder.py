"""NatNet datagrams to frames: names, axes, bones, stamps, damage."""

from dataclasses import replace

import numpy as np
import pytest

from natnet_packets import (
    PLAIN_VERSIONS,
    SIZED_VERSIONS,
    VERSIONS,
    Body,
    Catalogue,
    Motion,
    Pose,
    datagram,
    definitions,
    frame,
    server_info,
)
from retarget.errors import UsageError
from retarget.rotations import angle_between, rotate
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.natnet_wire import Version
from retarget.sources.stream_frame import MAX_POSES, StreamFrame
from support.messages import refuses

HALF = float(np.sqrt(0.5))
ANN = 5 << 16
BONES = [Body("Hip", 1, 0), Body("Spine", 2, 1), Body("Head", 3, 2)]
CATALOGUE = Catalogue(
    bodies=[Body("Quad", 2)], skeletons=[("Ann", 5, BONES)], assets=[("Cloth", 8, [Body("Patch", 1)])]
)
MOTION = Motion(
    bodies=[Pose(2, (1, 2, 3), (0.1, 0.7, 0.1, 0.7)), Pose(3, (4, 5, 6), flags=0)],
    skeletons=[(5, [Pose(ANN | bone, (0, 1, 0), (HALF, 0, 0, HALF)) for bone in (3, 1, 2)])],
)


def only(frames: list[StreamFrame]) -> StreamFrame:
    assert len(frames) == 1
    return frames[0]


def met(version: Version, decoder: NatnetDecoder | None = None) -> NatnetDecoder:
    """A decoder that knows the server and the definitions."""
    decoder = decoder or NatnetDecoder()
    assert decoder.decode(server_info(version)) == []
    assert decoder.decode(definitions(CATALOGUE, version)) == []
    return decoder


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_a_frame_of_each_version(version: Version) -> None:
    motion = replace(MOTION, assets=[(8, [Pose(8 << 16 | 1, (9, 9, 9))])], surplus=b"\xff" * 5)
    decoder = met(version)
    found = only(decoder.decode(frame(motion, version)))
    names = ("rigid://Quad", "rigid://#3", "bone://Ann/Head", "bone://Ann/Hip", "bone://Ann/Spine")
    assert found.names == (*names, "asset://Cloth/Patch") if version in SIZED_VERSIONS else names
    assert found.tracked.tolist()[:3] == [True, False, True]
    assert (found.number, found.stamp) == (7, 3.0)
    np.testing.assert_array_equal(found.position[:2], [[3, 1, 2], [6, 4, 5]])
    np.testing.assert_allclose(found.orientation[0], [0.7, 0.1, 0.1, 0.7], atol=1e-6)
    assert decoder.dropped.count == 0
    assert decoder.names_missing


def test_the_same_tuple_of_names_while_they_do_not_change() -> None:
    decoder = met(Version(3, 0))
    first, second = (only(decoder.decode(frame(MOTION, Version(3, 0)))) for _ in range(2))
    assert first.names is second.names
    decoder.decode(definitions(Catalogue(bodies=[Body("New", 2)]), Version(3, 0)))
    assert only(decoder.decode(frame(MOTION, Version(3, 0)))).names[0] == "rigid://New"


def test_before_anything_is_known_bodies_have_numbers_and_the_stamp_is_the_timestamp() -> None:
    decoder = NatnetDecoder()
    found = only(decoder.decode(frame(MOTION, Version(3, 0))))
    assert found.names == ("rigid://#2", "rigid://#3", "bone://#5/#3", "bone://#5/#1", "bone://#5/#2")
    assert found.stamp == 12.5
    assert decoder.names_missing


def test_stamps_without_ticks_or_without_sense() -> None:
    decoder = met(Version(3, 0))
    assert only(decoder.decode(frame(Motion(ticks=(0, 1, 2)), Version(3, 0)))).stamp == 12.5
    assert only(decoder.decode(frame(Motion(ticks=(0, 1, 2), timestamp=float("nan")), Version(3, 0)))).stamp is None
    decoder.decode(server_info(Version(3, 0), clock_hz=3_000))
    assert only(decoder.decode(frame(Motion(), Version(3, 0)))).stamp == 1000.0


@pytest.mark.parametrize("told", VERSIONS, ids=str)
@pytest.mark.parametrize("sent", VERSIONS, ids=str)
def test_a_pinned_bitstream_is_read_though_the_server_is_newer(sent: Version, told: Version) -> None:
    decoder = NatnetDecoder()
    decoder.decode(server_info(told))
    decoder.decode(definitions(CATALOGUE, sent))
    for _ in range(3):
        assert only(decoder.decode(frame(MOTION, sent))).names[0] == "rigid://Quad"
    assert decoder.dropped.count == 0


def test_a_later_suffix_may_be_longer() -> None:
    decoder = met(Version(4, 4))
    found = only(decoder.decode(frame(replace(MOTION, tail=bytes(8)), Version(4, 4))))
    np.testing.assert_array_equal(found.position[0], [3, 1, 2])
    plain = met(Version(3, 0))
    assert plain.decode(frame(replace(MOTION, tail=bytes(8)), Version(3, 0))) == []
    assert plain.dropped.reasons == {"frame that fits no known version": 1}


def test_the_layout_of_a_server_that_said_nothing_is_kept() -> None:
    decoder = NatnetDecoder()
    assert decoder.decode(frame(replace(MOTION, tail=bytes(8)), Version(4, 1))) == []
    only(decoder.decode(frame(MOTION, Version(4, 1))))
    only(decoder.decode(frame(replace(MOTION, tail=bytes(8)), Version(4, 1))))


@pytest.mark.parametrize(("up", "upward"), [("y", (0, 1, 0)), ("z", (0, 0, 1))])
def test_up_is_up_and_turns_stay_turns(up: str, upward: tuple[float, float, float]) -> None:
    """A turn of 90 degrees about the wire's up axis is one about z; a body that leans stays a right-handed one."""
    turn = (HALF * upward[0], HALF * upward[1], HALF * upward[2], HALF)
    decoder = NatnetDecoder(up="y" if up == "y" else "z")
    found = only(decoder.decode(frame(Motion(bodies=[Pose(1, upward, turn)]), Version(3, 0))))
    np.testing.assert_allclose(found.position[0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(rotate(found.orientation[0], [1.0, 0, 0]), [0, 1, 0], atol=1e-6)


def test_local_bones_are_composed_and_global_ones_are_left() -> None:
    """Each bone one metre up its parent's y and a quarter turn about its x further: a staircase of quarter turns."""
    version = Version(4, 1)
    left = only(met(version).decode(frame(MOTION, version)))
    np.testing.assert_array_equal(left.position[2:], np.tile([0, 0, 1], (3, 1)))
    found = only(met(version, NatnetDecoder(bones="local")).decode(frame(MOTION, version)))
    assert found.names[2:] == ("bone://Ann/Head", "bone://Ann/Hip", "bone://Ann/Spine")
    # In the wire's axes: hip (0, 1, 0), spine + (0, 0, 1), head + (0, -1, 0); REP-103 is (z, x, y).
    np.testing.assert_allclose(found.position[2:], [[1, 0, 0], [0, 0, 1], [1, 0, 1]], atol=1e-6)
    turned = angle_between(found.orientation[3], found.orientation[2])
    assert float(turned) == pytest.approx(np.pi, abs=1e-5)
    np.testing.assert_array_equal(found.position[:2], left.position[:2])


def test_local_bones_without_definitions_have_no_pose() -> None:
    decoder = NatnetDecoder(bones="local")
    found = only(decoder.decode(frame(MOTION, Version(3, 0))))
    assert np.isnan(found.position[2:]).all() and not found.tracked[2:].any()
    assert np.isfinite(found.position[:2]).all()
    assert decoder.dropped.reasons == {"bone whose parents are not known": 3}


@pytest.mark.parametrize(
    "pose",
    [
        Pose(1, (float("nan"), 0, 0)),
        Pose(1, (0, float("inf"), 0)),
        Pose(1, (0, 0, 3e38)),
        Pose(1, turn=(0, 0, 0, 0)),
        Pose(1, turn=(float("nan"), 0, 0, 1)),
        Pose(1, turn=(3e38, 0, 0, 1)),
        Pose(1, turn=(0, 0, 0, 1.5)),
    ],
    ids=repr,
)
def test_a_damaged_pose_is_none_and_the_others_stay(pose: Pose) -> None:
    decoder = NatnetDecoder()
    found = only(decoder.decode(frame(Motion(bodies=[pose, Pose(2, (1, 2, 3))]), Version(3, 0))))
    assert np.isnan(found.position[0]).all() and np.isnan(found.orientation[0]).all()
    np.testing.assert_array_equal(found.position[1], [3, 1, 2])
    np.testing.assert_array_equal(found.orientation[1], [1, 0, 0, 0])
    assert found.tracked.tolist() == [False, True]
    assert decoder.dropped.count == 1


def test_an_untracked_body_without_a_pose_is_no_damage() -> None:
    decoder = NatnetDecoder()
    found = only(decoder.decode(frame(Motion(bodies=[Pose(1, turn=(0, 0, 0, 0), flags=0)]), Version(3, 0))))
    assert np.isnan(found.position).all() and not found.tracked.any()
    assert decoder.dropped.reasons == {}


def test_signalling_nan_makes_no_warning() -> None:
    whole = bytearray(frame(Motion(bodies=[Pose(1)], crowd=False), Version(3, 0)))
    whole[24:28] = bytes.fromhex("0100807f")
    assert np.isnan(only(NatnetDecoder().decode(bytes(whole))).position).all()


def test_doubled_and_too_many_poses() -> None:
    decoder = NatnetDecoder()
    found = only(decoder.decode(frame(Motion(bodies=[Pose(n % 300) for n in range(301)]), Version(3, 0))))
    assert len(found.names) == len(set(found.names)) == MAX_POSES
    assert decoder.dropped.reasons == {
        "pose of a name that the frame had already": 1,
        "pose beyond the most that are taken": 300 - MAX_POSES,
    }


def test_what_is_no_frame_is_counted_by_its_reason() -> None:
    decoder = NatnetDecoder()
    for other in (bytes(65_537), b"", b"\x07\0", datagram(7, b"")[:-1], datagram(77, b""), datagram(0, bytes(264))):
        assert decoder.decode(other) == []
    for other in (datagram(7, b"short"), datagram(5, b"short"), datagram(1, b"short")):
        assert decoder.decode(other) == []
    assert decoder.dropped.reasons == {
        "datagram longer than 64 KiB": 1,
        "shorter than its header says": 3,
        "not a message of a NatNet server": 2,
        "frame that fits no known version": 1,
        "model definitions that fit no known version": 1,
        "ServerInfo too short": 1,
    }
    for silent in (3, 8, 9, 10, 13, 100):
        assert decoder.decode(datagram(silent, b"1234")) == []
    assert decoder.dropped.count == 9


def test_an_empty_frame_is_a_frame() -> None:
    found = only(NatnetDecoder().decode(frame(Motion(), PLAIN_VERSIONS[0])))
    assert found.names == () and found.position.shape == (0, 3)


def test_options() -> None:
    with refuses(UsageError):
        NatnetDecoder(bones="both")  # type: ignore[arg-type]
    with refuses(UsageError):
        NatnetDecoder(up="x")  # type: ignore[arg-type]
