"""NatNet datagrams to frames: names, axes, bones, stamps, damage."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from natnet_packets import (
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
from people import at_rest
from retarget.human.calibration import dimensions_from_skeleton
from retarget.model.human_dimensions import proportional_dimensions
from retarget.rotations import angle_between, multiply, normalise, rotate
from retarget.sources.streams.natnet_decoder import (
    NatnetDecoder,
    PosePlan,
    compose_bones,
    plan_poses,
)
from retarget.sources.streams.natnet_wire import BodyDefinition, Definitions, GroupDefinition, Owner, PoseGroup, Version
from retarget.sources.streams.stream_frame import MAX_POSES, StreamFrame
from retarget.types import FloatArray

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


@pytest.mark.parametrize("announced", VERSIONS, ids=str)
@pytest.mark.parametrize("sent", VERSIONS, ids=str)
def test_a_pinned_bitstream_is_read_though_the_server_is_newer(sent: Version, announced: Version) -> None:
    decoder = NatnetDecoder()
    decoder.decode(server_info(announced))
    decoder.decode(definitions(CATALOGUE, sent))
    for _ in range(3):
        assert only(decoder.decode(frame(MOTION, sent))).names[0] == "rigid://Quad"
    assert decoder.dropped.count == 0


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


def body(name: str, number: int, parent: int = -1) -> BodyDefinition:
    return BodyDefinition(name, number, parent, (0.0, 0.0, 0.0))


BODIES = PoseGroup(Owner.RIGID_BODIES, 0, 1)
TABLE = Definitions(
    (body("Quad", 2), body("Quad", 3), body("", 4)),
    (GroupDefinition("Ann", 5, (body("Hip", 1, 0), body("Spine", 2, 1), body("Loose", 3, 9), body("Own", 4, 4))),),
    (GroupDefinition("Cloth", 8, (body("Patch", 1),)),),
)


def name(definitions: Definitions, group: PoseGroup, number: int) -> str:
    (only,) = plan_poses(definitions, [group], [number]).names
    return only


def test_a_name_that_is_doubled_or_empty_becomes_a_number() -> None:
    assert name(TABLE, BODIES, 3) == "rigid://#3"
    assert name(TABLE, BODIES, 4) == "rigid://#4"
    twins = Definitions(skeletons=(GroupDefinition("A", 1, ()), GroupDefinition("A", 2, ())))
    assert name(twins, PoseGroup(Owner.SKELETON, 2, 1), 2 << 16 | 3) == "bone://#2/#3"


def table(*parents: int) -> Definitions:
    """A skeleton whose bone i + 1 has the parent given."""
    bones = tuple(BodyDefinition(f"b{i + 1}", i + 1, parent, (0.0, 0.0, 0.0)) for i, parent in enumerate(parents))
    return Definitions(skeletons=(GroupDefinition("Ann", 5, bones),))


def plan(definitions: Definitions, *bones: int, limit: int = 256) -> PosePlan:
    groups = (PoseGroup(Owner.SKELETON, 5, len(bones)),)
    return plan_poses(definitions, groups, [ANN | bone for bone in bones], limit=limit)


@given(st.lists(st.integers(0, 99), min_size=1, max_size=12), st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_composed_bones_are_what_matrices_say(choices: list[int], seed: int) -> None:
    """Any tree, any order: each bone stands in its parent as it was sent."""
    count = len(choices)
    parents = [choice % (i + 1) for i, choice in enumerate(choices)]
    rng = np.random.default_rng(seed)
    order = rng.permutation(count) + 1
    found = plan(table(*parents), *order.tolist())
    points, turns = rng.normal(size=(count, 3)), normalise(rng.normal(size=(count, 4)))
    world_points, world_turns, tracked = points.copy(), turns.copy(), np.ones(count, bool)
    compose_bones(found, world_points, world_turns, tracked)
    places = {bone: row for row, bone in enumerate(order.tolist())}
    for bone, parent in enumerate(parents, start=1):
        row = places[bone]
        expected: tuple[FloatArray, FloatArray] = (points[row], turns[row])
        if parent:
            above = places[parent]
            expected = (
                world_points[above] + rotate(world_turns[above], points[row]),
                multiply(world_turns[above], turns[row]),
            )
        np.testing.assert_allclose(world_points[row], expected[0], atol=1e-12)
        np.testing.assert_allclose(world_turns[row], expected[1], atol=1e-12)


PERSON = proportional_dimensions(1.83)
SIDED = {"collar": "Shoulder", "shoulder": "UArm", "elbow": "FArm", "wrist": "Hand"}
SIDED |= {"hip": "Thigh", "knee": "Shin", "ankle": "Foot", "toe": "Toe"}
BONE_NAMES = {"pelvis": "Hip", "spine": "Ab", "chest": "Chest", "neck": "Neck", "head": "Head"}
BONE_NAMES |= {f"{side}_{part}": side.upper() + name for part, name in SIDED.items() for side in "lr"}
V41 = Version(4, 1)
LIMBS = ("knee", "ankle", "elbow", "wrist")


def bones(names: dict[str, str], *, up: str = "y", parents: dict[str, str] | None = None) -> list[Body]:
    """The definition of a person who stands in a T-pose and faces Motive's z, or, where z is up, minus y."""
    points = at_rest(PERSON, np.pi / 2, splay=0.0)
    above = {"pelvis": ""} | (parents or {})
    numbers = {joint: number for number, joint in enumerate(names, start=1)}
    found = []
    for joint, name in names.items():
        parent = above.get(joint, "pelvis")
        offset = points[joint] - points[parent] if parent else np.zeros(3)
        forward, left, height = offset.tolist()
        at = (left, height, forward) if up == "y" else (left, -forward, height)
        found.append(Body(name, numbers[joint], numbers.get(parent, -1), at))
    return found


CHAIN = {"elbow": "shoulder", "wrist": "elbow", "knee": "hip", "ankle": "knee", "toe": "ankle"}
PARENTS = {f"{side}_{part}": f"{side}_{parent}" for part, parent in CHAIN.items() for side in "lr"}


def defined(owner: str, body: list[Body], *, version: Version = V41, up: str = "y") -> NatnetDecoder:
    decoder = NatnetDecoder(up="z" if up == "z" else "y")
    decoder.decode(server_info(version))
    decoder.decode(definitions(Catalogue(skeletons=[(owner, 3, body)]), version))
    return decoder


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("version", [Version(3, 0), V41, Version(4, 4)])
@pytest.mark.parametrize("prefix", ["", "Al_"])
def test_limbs_have_the_lengths_of_the_definitions(up: str, version: Version, prefix: str) -> None:
    names = {joint: prefix + bone for joint, bone in BONE_NAMES.items()}
    decoder = defined("Al", bones(names, up=up, parents=PARENTS), version=version, up=up)
    skeleton = decoder.rest_of(["rigid://hat", "bone://Al/Head", "bone://Al/LHand"])
    assert skeleton is not None
    size = dimensions_from_skeleton(skeleton)
    for limb in LIMBS:
        for side in "lr":
            assert size.length(f"{side}_{limb}") == pytest.approx(PERSON.length(f"{side}_{limb}"), abs=1e-5)


def _circle(body: list[Body]) -> list[Body]:
    number = {bone.name: bone.number for bone in body}
    after = {"LUArm": "LFArm", "LFArm": "LHand", "LHand": "LUArm"}
    return [Body(b.name, b.number, number[after[b.name]] if b.name in after else b.parent, b.offset) for b in body]


def test_what_is_no_human_is_no_skeleton_and_no_error() -> None:
    assert defined("Al", bones(BONE_NAMES)[:4]).rest_of(["bone://Al/Head"]) is None
    odd = defined("Al", _circle(bones(BONE_NAMES, parents=PARENTS))).rest_of(["bone://Al/Head"])
    assert odd is not None and "l_wrist" not in odd.names and "r_wrist" in odd.names
    assert defined("Al", [Body(bone.name, 1, 1) for bone in bones(BONE_NAMES)]).rest_of(["bone://Al/Head"]) is None
