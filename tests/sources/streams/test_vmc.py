"""VMC and the trackers of VRChat: names, poses, states, and what is dropped."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from osc_bytes import bundle, message, pose
from people import place
from retarget.model.human import build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.rotations import angle_between, from_rotation_vector, multiply
from retarget.sources.streams import vrchat
from retarget.sources.streams.osc import UNKNOWN_ADDRESS
from retarget.sources.streams.stream_frame import StreamFrame
from retarget.sources.streams.vmc import (
    BAD_POSE,
    BAD_SERIAL,
    BAD_STAMP,
    BODY_BONES,
    OPTIONAL,
    UNKNOWN_BONE,
    WRONG_ARGUMENTS,
    VmcBodyDecoder,
    VmcDecoder,
    bone_poses,
    t_pose_offsets,
    world_poses,
)
from retarget.sources.streams.vrchat import NOT_A_TRACKER, VrchatDecoder
from retarget.types import FloatArray

ROOT, BONE, HMD, CON, TRA = (f"/VMC/Ext/{part}/Pos" for part in ("Root", "Bone", "Hmd", "Con", "Tra"))
TRACKER = "/tracking/trackers/1/position"
TURNED = (0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5)
NAN, INF = float("nan"), float("inf")


def decode(*messages: bytes) -> tuple[list[StreamFrame], VmcDecoder]:
    decoder = VmcDecoder()
    return decoder.decode(bundle(*messages)), decoder


def one(*messages: bytes) -> StreamFrame:
    (frame,), decoder = decode(*messages)
    assert not decoder.dropped.reasons
    return frame


VMC_BYTES = (
    b"/VMC/Ext/Tra/Pos\0\0\0\0,sfffffff\0\0\0LHR-1\0\0\0"
    b"\x3f\x80\0\0\x40\0\0\0\x40\x40\0\0"  # 1 2 3
    b"\xbf\0\0\0\x3f\0\0\0\xbf\0\0\0\x3f\0\0\0"  # -0.5 0.5 -0.5 0.5
)
VRCHAT_BYTES = b"/tracking/trackers/1/position\0\0\0,fff\0\0\0\0\x3f\x80\0\0\x40\0\0\0\x40\x40\0\0"


@pytest.mark.parametrize(
    ("decoder", "golden", "built", "name", "turn"),
    [
        (VmcDecoder, VMC_BYTES, pose(TRA, "LHR-1", 1, 2, 3, -0.5, 0.5, -0.5, 0.5), "LHR-1", [0.5, 0.5, -0.5, -0.5]),
        (VrchatDecoder, VRCHAT_BYTES, message(TRACKER, "fff", 1.0, 2.0, 3.0), "tracker://1", [NAN] * 4),
    ],
    ids=["VMC", "VRChat"],
)
def test_golden_bytes(
    decoder: type[VmcDecoder | VrchatDecoder], golden: bytes, built: bytes, name: str, turn: list[float]
) -> None:
    assert golden == built
    (frame,) = decoder().decode(golden)
    assert frame.names == (name,) and frame.stamp is None and frame.number is None
    assert_allclose(frame.position, [[3.0, -1.0, 2.0]])
    assert_allclose(frame.orientation, [turn])
    assert frame.tracked.tolist() == [True]


def test_names_by_serial_bone_and_root() -> None:
    frame = one(
        message("/VMC/Ext/T", "f", 7.5),
        pose(ROOT, "root"),
        pose(BONE, "leftupperarm"),
        pose(HMD, "human://HEAD"),
        pose(TRA, "human://WAIST"),
        pose(CON, "human://LEFT_HAND"),
    )
    devices = ("human://HEAD", "human://WAIST", "human://LEFT_HAND")
    assert frame.names == ("root://root", "bone://LeftUpperArm", *devices)
    assert frame.stamp == 7.5


def test_a_zero_position_is_untold_for_bones_only() -> None:
    frame = one(
        pose(ROOT, "root"), pose(BONE, "Hips", -0.0, 0.0, 0.0, 0, 0, 0, 1), pose(TRA, "a"), pose(BONE, "Neck", *TURNED)
    )
    assert_array_equal(np.isnan(frame.position).all(axis=1), [False, True, False, False])
    assert not np.isnan(frame.orientation).any() and frame.tracked.all()


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (message(TRA, "sffffff", "a", *[0.0] * 6), WRONG_ARGUMENTS),
        (message(TRA, "ifffffff", 1, *[0.0] * 7), WRONG_ARGUMENTS),
        (message(TRA, "sNffffff", "a", *[0.0] * 6), WRONG_ARGUMENTS),
        (message(TRA, "sfffbfff", "a", 0.0, 0.0, 0.0, b"", 0.0, 0.0, 0.0), WRONG_ARGUMENTS),
        (message("/VMC/Ext/T", "s", "1"), WRONG_ARGUMENTS),
        (message("/VMC/Ext/OK", "N"), WRONG_ARGUMENTS),
        (message("/VMC/Ext/T", "d", 1e300), BAD_STAMP),
        (message("/other", ""), UNKNOWN_ADDRESS),
        (message("/VMC/Extra", ""), UNKNOWN_ADDRESS),
        (pose(BONE, "Tail"), UNKNOWN_BONE),
        (pose(TRA, ""), BAD_SERIAL),
        (pose(TRA, "bone://Hips"), BAD_SERIAL),
        (pose(TRA, "x" * 129), BAD_SERIAL),
        (message("/VMC/Ext/T", "f", NAN), BAD_STAMP),
        (message("/VMC/Ext/T", "f", INF), BAD_STAMP),
        *((message(TRACKER.replace("1", n), "fff", 1.0, 2.0, 3.0), NOT_A_TRACKER) for n in ("0", "9", "-1", "01")),
        (message("/tracking/trackers/1/velocity", "fff", 0.0, 0.0, 0.0), UNKNOWN_ADDRESS),
        (message("/tracking/eye/CenterPitchYaw", "ff", 0.0, 0.0), UNKNOWN_ADDRESS),
        (message(TRACKER, "ff", 0.0, 0.0), vrchat.WRONG_ARGUMENTS),
        (message(TRACKER, "sff", "0", 0.0, 0.0), vrchat.WRONG_ARGUMENTS),
    ],
)
def test_what_is_dropped_by_reason_leaves_the_rest(bad: bytes, reason: str) -> None:
    good = [pose(TRA, name) for name in "wxyz"]
    decoder: VmcDecoder | VrchatDecoder = VmcDecoder()
    names: tuple[str, ...] = ("w", "x", "y", "z")
    if bad.startswith(b"/tracking"):
        good, decoder, names = (
            [message(TRACKER.replace("1", "2"), "fff", 1.0, 2.0, 3.0)],
            VrchatDecoder(),
            ("tracker://2",),
        )
    for _ in range(2):  # the second time from the remembered layout
        (frame,) = decoder.decode(bundle(bad, *good))
        assert frame.names == names and frame.stamp is None
    assert decoder.dropped.reasons == {reason: 2}
    assert decoder.decode(bad) == []


@pytest.mark.parametrize("tags", ["iff", "fid", "hhh", "ddd", "FTi"])
def test_numbers_of_every_type_are_numbers_of_a_tracker(tags: str) -> None:
    typed = [(int if tag in "ih" else float)(x) for tag, x in zip(tags, (0, 1, 2), strict=True) if tag not in "TF"]
    (found,) = VrchatDecoder().decode(message(TRACKER, tags, *typed))
    assert_allclose(found.position, [[2.0, 0.0, 1.0]])


SENT = (0, 1, 1, 0, 0, 0, 1, 1, 1)
"""Seven numbers of a pose, the time, and the state of the model."""


@given(tags=st.tuples(*(st.sampled_from("fidhT" if x else "fidhF") for x in SENT)))
def test_numbers_of_every_type_are_numbers(tags: tuple[str, ...]) -> None:
    """Libraries without types send whole numbers as integers, truths or doubles."""
    values = [[] if tag in "TF" else [x if tag in "ih" else float(x)] for x, tag in zip(SENT, tags, strict=True)]
    frames, decoder = decode(
        message(TRA, "s" + "".join(tags[:7]), "a", *[x for one in values[:7] for x in one]),
        message("/VMC/Ext/T", tags[7], *values[7]),
        message("/VMC/Ext/OK", tags[8], *values[8]),
    )
    plain = one(pose(TRA, "a", *map(float, SENT[:7])))
    assert_array_equal(frames[0].position, plain.position)
    assert_array_equal(frames[0].orientation, plain.orientation)
    assert frames[0].stamp == 1.0 and decoder.loaded and decoder.dropped.count == 0


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


def test_states_are_kept_until_the_next_one() -> None:
    decoder = VmcDecoder()
    tracker = pose(TRA, "a")
    assert (decoder.loaded, decoder.tracking) == (None, None)
    assert decoder.decode(tracker)[0].tracked.all()
    assert decoder.decode(message("/VMC/Ext/OK", "iiii", 1, 3, 2, 1)) == []
    assert (decoder.loaded, decoder.tracking) == (True, True)
    decoder.decode(message("/VMC/Ext/OK", "iiii", 1, 2, 0, 0))
    assert not decoder.decode(tracker)[0].tracked.any() and decoder.tracking is False
    decoder.decode(message("/VMC/Ext/OK", "iii", 1, 1, 0))
    assert decoder.tracking is False
    decoder.decode(message("/VMC/Ext/OK", "iiii", 0, 3, 0, 1))
    assert not decoder.decode(tracker)[0].tracked.any() and decoder.loaded is False
    decoder.decode(message("/VMC/Ext/OK", "ii", 1, 0))  # no form of the protocol: the first argument counts
    assert decoder.decode(tracker)[0].tracked.all()


def avatar(*names: str, turned: float = 0.0) -> list[bytes]:
    """The root, turned about Unity's y, which is up, and bones."""
    half = (0.0, np.sin(0.5 * turned), 0.0, np.cos(0.5 * turned))
    return [pose(ROOT, "root", 0.0, 0.0, 0.0, *half), *(pose(BONE, name) for name in names)]


def one_by_one(decoder: VmcBodyDecoder, *names: str, turned: float = 0.0) -> list[StreamFrame]:
    """What the bones give when each comes in a datagram of its own, as python-osc's `send_message` sends them."""
    return [frame for datagram in avatar(*names, turned=turned) for frame in decoder.decode(datagram)]


def test_an_avatar_sent_bone_by_bone_is_whole_once_in_each_round() -> None:
    decoder = VmcBodyDecoder()
    one_by_one(decoder, *BODY_BONES)
    for turned in (0.0, 0.5, 1.0):
        (frame,) = one_by_one(decoder, *BODY_BONES, turned=turned)
        assert frame.tracked.all()
        (whole,) = VmcBodyDecoder().decode(bundle(*avatar(*BODY_BONES, turned=turned)))
        assert_array_equal(frame.position, whole.position)
        assert_array_equal(frame.orientation, whole.orientation)


def test_a_bone_that_is_not_sent_any_more_is_kept_for_a_while_and_then_lost() -> None:
    decoder = VmcBodyDecoder()
    for _ in range(3):
        one_by_one(decoder, *BODY_BONES)
    others = [name for name in BODY_BONES if name != "LeftHand"]
    known = ["bone://LeftHand" in frame.names for _ in range(20) for frame in one_by_one(decoder, *others)]
    assert 18 <= len(known) <= 20 and 1 <= sum(known) <= 3 and not any(known[3:])
    assert decoder.dropped.reasons == {"LeftHand, a bone that an avatar needs, is not sent": len(known) - sum(known)}


REQUIRED = tuple(bone for bone in BODY_BONES if bone not in OPTIONAL)
LENGTHS = t_pose_offsets(proportional_dimensions(1.7))


def frame_of(turns: dict[str, FloatArray]) -> StreamFrame:
    """Bones (and "root") with these rotations; positions are NaN."""
    names = tuple("root://root" if bone == "root" else f"bone://{bone}" for bone in turns)
    count = len(names)
    turned = np.array(list(turns.values())).reshape(count, 4)
    return StreamFrame(names, np.full((count, 3), np.nan), turned, np.full(count, True))


def world(frame: StreamFrame) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Position (3,) and orientation (4,) of each bone in the world."""
    poses = world_poses(bone_poses(frame), LENGTHS)
    return {bone: (np.array(poses[f"bone://{bone}"][0]), np.array(poses[f"bone://{bone}"][1])) for bone in BODY_BONES}


def still(*bones: str) -> dict[str, FloatArray]:
    return {bone: np.array([1.0, 0.0, 0.0, 0.0]) for bone in bones or BODY_BONES}


vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


@settings(max_examples=30)
@given(st.lists(vectors, min_size=8, max_size=8))
def test_a_chain_is_the_product_of_its_bones(turns: list[FloatArray]) -> None:
    chain = ("root", "Hips", "Spine", "Chest", "RightShoulder", "RightUpperArm", "RightLowerArm", "RightHand")
    turned = dict(zip(chain, from_rotation_vector(turns), strict=True))
    found = world(frame_of({**still(*REQUIRED), **turned}))
    product = np.array([1.0, 0.0, 0.0, 0.0])
    for bone in chain:
        product = multiply(product, turned[bone])
    assert angle_between(found["RightHand"][1], product) < 1e-6


@pytest.mark.parametrize("bone", REQUIRED)
def test_a_missing_required_bone_is_unknown_and_so_is_all_below(bone: str) -> None:
    rest = still()
    del rest[bone]
    unknown = {name for name, (_, turn) in world(frame_of(rest)).items() if np.isnan(turn).any()}
    assert bone in unknown
    if bone in ("Hips", "LeftUpperArm", "RightFoot"):
        arm = {"LeftUpperArm", "LeftLowerArm", "LeftHand"}
        assert unknown == {"Hips": set(BODY_BONES), "LeftUpperArm": arm, "RightFoot": {"RightFoot", "RightToes"}}[bone]


def test_positions_of_the_t_pose_are_those_of_our_human() -> None:
    person = proportional_dimensions(1.7)
    ours = world(frame_of(still()))
    human = build_human(person)
    theirs = dict(zip(POINTS, place(human, human.posture("t_pose"), POINTS), strict=True))
    pairs = {"LeftHand": "l_wrist", "RightLowerArm": "r_elbow", "Head": "head", "LeftToes": "l_toe"}
    pairs["RightUpperLeg"] = "r_hip"
    for bone, point in pairs.items():
        from_hips = ours[bone][0] - ours["Hips"][0]
        assert_allclose(from_hips, theirs[point] - theirs["pelvis"], atol=1e-9, err_msg=bone)
