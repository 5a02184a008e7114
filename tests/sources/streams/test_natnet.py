"""NatNet: real bytes of Motive 2.1 and made ones of every version to frames, and what is wrong with a datagram."""

from dataclasses import replace
from pathlib import Path
from struct import pack, unpack

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from natnet_packets import (
    ANN,
    CATALOGUE,
    MOTION,
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
from people import at_rest
from retarget.human.calibration import dimensions_from_skeleton
from retarget.live.stream_report import natnet_problems
from retarget.model.human_dimensions import proportional_dimensions
from retarget.rotations import angle_between, multiply, normalise, rotate
from retarget.sources.streams.natnet_decoder import NatnetDecoder, compose_bones, plan_poses
from retarget.sources.streams.natnet_session import NatnetSession
from retarget.sources.streams.natnet_wire import (
    BodyDefinition,
    Definitions,
    GroupDefinition,
    MessageId,
    Owner,
    PoseGroup,
    ServerInfo,
    Version,
    connect_message,
    message,
    read_definitions,
    read_flags,
    read_frame,
    read_server_info,
    split,
    text_until_zero,
)
from retarget.sources.streams.stream_frame import MAX_POSES, StreamFrame

HALF = float(np.sqrt(0.5))
V3, V41 = Version(3, 0), Version(4, 1)


def only(frames: list[StreamFrame]) -> StreamFrame:
    assert len(frames) == 1
    return frames[0]


def met(version: Version, decoder: NatnetDecoder | None = None) -> NatnetDecoder:
    """A decoder that knows the server and the definitions."""
    decoder = decoder or NatnetDecoder()
    assert decoder.decode(server_info(version)) == []
    assert decoder.decode(definitions(CATALOGUE, version)) == []
    return decoder


# Recorded bytes, with numbers read off by hand.


@pytest.fixture(scope="module")
def recorded(shared: Path) -> Path:
    folder = shared / "streams" / "natnet"
    if not folder.is_dir():
        pytest.skip(f"no recorded streams at {folder}")
    return folder


def test_a_recorded_frame_is_read_as_its_bytes_say(recorded: Path) -> None:
    decoder = NatnetDecoder()
    for name in ("serverinfo", "modeldef"):
        assert decoder.decode((recorded / f"{name}_packet_v3.bin").read_bytes()) == []
    found = only(decoder.decode((recorded / "mocapframe_packet_v3.bin").read_bytes()))
    assert (found.names, found.number, found.tracked.tolist()) == (("rigid://RaceQuad",), 0x27BAE, [True])
    assert found.stamp == 0x149CDD813D6 / 0x328C93  # ticks, Hz
    x, y, z = unpack("<3f", bytes.fromhex("24a2323e 9a3bb93f 59fb3bbf"))
    np.testing.assert_array_equal(found.position, [[z, x, y]])
    qx, qy, qz, qw = unpack("<4f", bytes.fromhex("349e5fbd f78b023f 8402333d cb7b5bbf"))
    np.testing.assert_allclose(found.orientation, [[qw, qz, qx, qy]], atol=2e-7)
    assert np.linalg.norm(found.orientation) == pytest.approx(1.0, abs=1e-12)
    assert decoder.dropped.count == 0 and not decoder.names_missing


@pytest.mark.parametrize(("name", "size"), [("mocapframe_packet", 336), ("mocapframe_packet_occluded", 365)])
def test_every_byte_of_a_frame_is_used(recorded: Path, name: str, size: int) -> None:
    whole = (recorded / f"{name}_v3.bin").read_bytes()
    found = read_frame(whole[4:], V3)
    assert len(whole) == size and found is not None and found.surplus == 0
    assert found.mid_exposure > 0 and read_flags(whole[4:]) == 0
    assert read_flags(whole[4:30]) is None


def test_questions_are_as_the_real_client_asks_them(recorded: Path) -> None:
    real, ours = (recorded / "connect_packet_v3.bin").read_bytes(), connect_message()
    assert len(real) == len(ours)
    assert (real[:4], real[260:]) == (ours[:4], ours[260:])
    assert (recorded / "requestmodeldef_packet_v3.bin").read_bytes() == message(MessageId.DEFINITIONS_REQUEST)


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_a_frame_of_each_version(version: Version) -> None:
    decoder = met(version)
    found = only(decoder.decode(frame(replace(MOTION, surplus=b"\xff" * 5), version)))
    names = ("rigid://Quad", "rigid://#3", "bone://Ann/Head", "bone://Ann/Hip", "bone://Ann/Spine")
    assert found.names == names + ("asset://Cloth/Patch",) * (version in SIZED_VERSIONS)
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
    found = only(decoder.decode(frame(Motion(bodies=[Pose(1, upward, turn)]), V3)))
    np.testing.assert_allclose(found.position[0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(rotate(found.orientation[0], [1.0, 0, 0]), [0, 1, 0], atol=1e-6)


def test_local_bones_are_composed_and_global_ones_are_left() -> None:
    """Each bone one metre up its parent's y and a quarter turn about its x further: a staircase of quarter turns."""
    left = only(met(V41).decode(frame(MOTION, V41)))
    np.testing.assert_array_equal(left.position[2:5], np.tile([0, 0, 1], (3, 1)))
    found = only(met(V41, NatnetDecoder(bones="local")).decode(frame(MOTION, V41)))
    assert found.names[2:5] == ("bone://Ann/Head", "bone://Ann/Hip", "bone://Ann/Spine")
    # In the wire's axes: hip (0, 1, 0), spine + (0, 0, 1), head + (0, -1, 0); REP-103 is (z, x, y).
    np.testing.assert_allclose(found.position[2:5], [[1, 0, 0], [0, 0, 1], [1, 0, 1]], atol=1e-6)
    turned = angle_between(found.orientation[3], found.orientation[2])
    assert float(turned) == pytest.approx(np.pi, abs=1e-5)
    np.testing.assert_array_equal(found.position[:2], left.position[:2])


def test_local_bones_without_definitions_have_no_pose() -> None:
    decoder = NatnetDecoder(bones="local")
    found = only(decoder.decode(frame(MOTION, V3)))
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
    found = only(decoder.decode(frame(Motion(bodies=[pose, Pose(2, (1, 2, 3))]), V3)))
    assert np.isnan(found.position[0]).all() and np.isnan(found.orientation[0]).all()
    np.testing.assert_array_equal(found.position[1], [3, 1, 2])
    np.testing.assert_array_equal(found.orientation[1], [1, 0, 0, 0])
    assert found.tracked.tolist() == [False, True]
    assert decoder.dropped.count == 1


def test_doubled_and_too_many_poses() -> None:
    decoder = NatnetDecoder()
    found = only(decoder.decode(frame(Motion(bodies=[Pose(n % 300) for n in range(301)]), V3)))
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


def body(name: str, number: int, parent: int = -1, offset: tuple[float, float, float] = (0, 0, 0)) -> BodyDefinition:
    return BodyDefinition(name, number, parent, offset)


def test_a_name_that_is_doubled_or_empty_becomes_a_number() -> None:
    bodies = Definitions((body("Quad", 2), body("Quad", 3), body("", 4)))
    twins = Definitions(skeletons=(GroupDefinition("A", 1, ()), GroupDefinition("A", 2, ())))
    for known, group, number, name in (
        (bodies, PoseGroup(Owner.RIGID_BODIES, 0, 1), 3, "rigid://#3"),
        (bodies, PoseGroup(Owner.RIGID_BODIES, 0, 1), 4, "rigid://#4"),
        (twins, PoseGroup(Owner.SKELETON, 2, 1), 2 << 16 | 3, "bone://#2/#3"),
    ):
        assert plan_poses(known, [group], [number]).names == (name,)


@given(st.lists(st.integers(0, 99), min_size=1, max_size=12), st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_composed_bones_are_what_matrices_say(choices: list[int], seed: int) -> None:
    """Any tree, any order: each bone stands in its parent as it was sent."""
    count, rng = len(choices), np.random.default_rng(seed)
    parents = [choice % (i + 1) for i, choice in enumerate(choices)]
    order = (rng.permutation(count) + 1).tolist()
    bones = tuple(body(f"b{i}", i, parent) for i, parent in enumerate(parents, start=1))
    tree = Definitions(skeletons=(GroupDefinition("Ann", 5, bones),))
    found = plan_poses(tree, (PoseGroup(Owner.SKELETON, 5, count),), [ANN | bone for bone in order])
    points, turns = rng.normal(size=(count, 3)), normalise(rng.normal(size=(count, 4)))
    world_points, world_turns = points.copy(), turns.copy()
    compose_bones(found, world_points, world_turns, np.ones(count, bool))
    for row, bone in enumerate(order):
        point, turn = points[row], turns[row]
        if parent := parents[bone - 1]:
            above = order.index(parent)
            point = world_points[above] + rotate(world_turns[above], point)
            turn = multiply(world_turns[above], turn)
        np.testing.assert_allclose(world_points[row], point, atol=1e-12)
        np.testing.assert_allclose(world_turns[row], turn, atol=1e-12)


PERSON = proportional_dimensions(1.83)
SIDED = {"collar": "Shoulder", "shoulder": "UArm", "elbow": "FArm", "wrist": "Hand"}
SIDED |= {"hip": "Thigh", "knee": "Shin", "ankle": "Foot", "toe": "Toe"}
BONE_NAMES = {"pelvis": "Hip", "spine": "Ab", "chest": "Chest", "neck": "Neck", "head": "Head"}
BONE_NAMES |= {f"{side}_{part}": side.upper() + name for part, name in SIDED.items() for side in "lr"}
CHAIN = {"elbow": "shoulder", "wrist": "elbow", "knee": "hip", "ankle": "knee", "toe": "ankle"}
PARENTS = {f"{side}_{part}": f"{side}_{parent}" for part, parent in CHAIN.items() for side in "lr"}


def bones(*, prefix: str = "", up: str = "y", parents: dict[str, str] = PARENTS) -> list[Body]:
    """The definition of a person who stands in a T-pose and faces Motive's z, or, where z is up, minus y."""
    points, found = at_rest(PERSON, np.pi / 2, splay=0.0), list[Body]()
    numbers = {joint: number for number, joint in enumerate(BONE_NAMES, start=1)}
    for joint, name in BONE_NAMES.items():
        parent = parents.get(joint, "pelvis") if joint != "pelvis" else ""
        forward, left, height = (points[joint] - points[parent] if parent else np.zeros(3)).tolist()
        at = (left, height, forward) if up == "y" else (left, -forward, height)
        found.append(Body(prefix + name, numbers[joint], numbers.get(parent, -1), at))
    return found


def defined(body: list[Body], *, version: Version = V41, up: str = "y") -> NatnetDecoder:
    decoder = NatnetDecoder(up="z" if up == "z" else "y")
    decoder.decode(server_info(version))
    decoder.decode(definitions(Catalogue(skeletons=[("Al", 3, body)]), version))
    return decoder


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("version", [V3, V41, Version(4, 4)])
@pytest.mark.parametrize("prefix", ["", "Al_"])
def test_limbs_have_the_lengths_of_the_definitions(up: str, version: Version, prefix: str) -> None:
    decoder = defined(bones(prefix=prefix, up=up), version=version, up=up)
    skeleton = decoder.rest_of(["rigid://hat", "bone://Al/Head", "bone://Al/LHand"])
    assert skeleton is not None
    size = dimensions_from_skeleton(skeleton)
    for limb in ("knee", "ankle", "elbow", "wrist"):
        for side in "lr":
            assert size.length(f"{side}_{limb}") == pytest.approx(PERSON.length(f"{side}_{limb}"), abs=1e-5)


def test_what_is_no_human_is_no_skeleton_and_no_error() -> None:
    head = ["bone://Al/Head"]
    assert defined(bones(parents={})[:4]).rest_of(head) is None
    assert defined([Body(bone.name, 1, 1) for bone in bones()]).rest_of(head) is None
    number = {bone.name: bone.number for bone in bones()}
    circle = {"LUArm": "LFArm", "LFArm": "LHand", "LHand": "LUArm"}
    odd = defined(
        [replace(b, parent=number[circle[b.name]] if b.name in circle else b.parent) for b in bones()]
    ).rest_of(head)
    assert odd is not None and "l_wrist" not in odd.names and "r_wrist" in odd.names


# The wire.


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


@pytest.mark.parametrize("version", SIZED_VERSIONS, ids=str)
def test_a_size_that_is_less_than_its_block_is_refused(version: Version) -> None:
    payload = bytearray(frame(Motion(bodies=MOTION.bodies, crowd=False), version)[4:])
    at = 4 + 2 * 8 + 4
    assert payload[at : at + 4] == pack("<I", 76)
    payload[at : at + 4] = pack("<I", 75)
    assert read_frame(bytes(payload), version) is None


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_the_other_layout_never_fits_exactly(version: Version) -> None:
    other = PLAIN_VERSIONS[0] if version in SIZED_VERSIONS else SIZED_VERSIONS[0]
    for motion in (MOTION, Motion(), Motion(crowd=False), Motion(bodies=MOTION.bodies, crowd=False)):
        found = read_frame(frame(motion, version)[4:], other)
        assert found is None or found.surplus != 0


@pytest.mark.parametrize("count", [2**32 - 1, 2**31, 1_000_000])
@pytest.mark.parametrize("version", [V3, V41], ids=str)
@pytest.mark.parametrize("block", range(7))
def test_absurd_counts_are_refused(block: int, version: Version, count: int) -> None:
    payload = bytearray(frame(Motion(crowd=False), version)[4:])
    at = 4 + block * (8 if version in SIZED_VERSIONS else 4)
    payload[at : at + 4] = pack("<I", count)
    found = read_frame(bytes(payload), version)
    # Blocks that are skipped by their sizes are not counted at all.
    assert found is None or (version in SIZED_VERSIONS and block not in (2, 3, 4, 5))


def known(version: Version) -> Definitions:
    bones = (body("Hip", 1, 0, (0, 1, 0)), body("Spine", 2, 1, (0, 0.5, 0)), body("Head", 3, 2))
    assets = (GroupDefinition("Cloth", 8, (body("Patch", 1),)),) if version >= (4, 1) else ()
    groups = (GroupDefinition("Ann", 5, bones), GroupDefinition("Empty", 6, ()))
    return Definitions((body("Quad", 2), body("Held", -3)), groups, assets)


@pytest.mark.parametrize("announced", VERSIONS, ids=str)
@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_they_are_read_whatever_version_was_announced(version: Version, announced: Version) -> None:
    assert read_definitions(definitions(CATALOGUE, version)[4:], announced) == known(version)


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


GOOD = frame(Motion(number=99, bodies=[Pose(2, (1, 2, 3))]), V3)
MADE = [one for v in VERSIONS for one in (frame(MOTION, v), definitions(CATALOGUE, v), server_info(v))]
KINDS = st.builds(datagram, st.sampled_from((0, 1, 2, 3, 4, 5, 7, 8, 10, 12, 13, 14, 100)), st.binary(max_size=400))


@given(st.sampled_from(MADE) | KINDS, st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), max_size=6))
@settings(max_examples=120)
def test_changed_bytes_harm_neither_the_next_frame_nor_the_session(
    whole: bytes, changes: list[tuple[int, int]]
) -> None:
    changed, session = bytearray(whole), NatnetSession()
    for at, value in changes:
        changed[at % len(changed)] = value
    session.receive(0.0, bytes(changed))
    assert len(session.poll(0.0)) <= 5
    assert all(problem.render().isprintable() for problem in natnet_problems(session, 5.0, host="lab"))
    for decoder in (NatnetDecoder(), NatnetDecoder(bones="local", up="z")):
        decoder.decode(bytes(changed))
        found = only(decoder.decode(GOOD))
        assert (found.number, found.tracked.tolist()) == (99, [True])
