"""Forward kinematics over Unity's bones: chains, what is missing, positions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from people import place
from retarget.human import build_human
from retarget.human_dimensions import POINTS, proportional_dimensions
from retarget.rotations import FloatArray, angle_between, from_axis_angle, from_rotation_vector, multiply, rotate
from retarget.sources.stream_frame import StreamFrame
from retarget.sources.vmc_bones import (
    OPTIONAL,
    LocalBones,
    local_bones,
    merged,
    t_pose_offsets,
    world_positions,
    world_rotations,
)
from retarget.sources.vmc_names import BODY_BONES

REQUIRED = tuple(bone for bone in BODY_BONES if bone not in OPTIONAL)
ROW = {bone: row for row, bone in enumerate(BODY_BONES)}
X, Y, Z = np.eye(3)
QUARTER = 0.5 * np.pi


def frame_of(turns: dict[str, FloatArray], *, tracked: bool = True, position: FloatArray | None = None) -> StreamFrame:
    """Bones (and "root") with these rotations; positions not told unless one is given for all."""
    names = tuple("root://root" if bone == "root" else f"bone://{bone}" for bone in turns)
    count = len(names)
    places = np.full((count, 3), np.nan) if position is None else np.tile(position, (count, 1))
    return StreamFrame(names, places, np.array(list(turns.values())).reshape(count, 4), np.full(count, tracked))


def still(*bones: str) -> dict[str, FloatArray]:
    return {bone: np.array([1.0, 0.0, 0.0, 0.0]) for bone in bones or BODY_BONES}


def test_identity_in_the_t_pose() -> None:
    assert_allclose(world_rotations(local_bones(frame_of(still()))), [[1.0, 0.0, 0.0, 0.0]] * 22)


def test_a_turn_reaches_all_that_hangs_from_a_bone_and_nothing_else() -> None:
    turn = from_axis_angle(Z, 0.5)
    for bone, below in (
        ("Hips", BODY_BONES),
        ("LeftShoulder", ("LeftShoulder", "LeftUpperArm", "LeftLowerArm", "LeftHand")),
        ("RightUpperLeg", ("RightUpperLeg", "RightLowerLeg", "RightFoot", "RightToes")),
        ("Neck", ("Neck", "Head")),
        ("Head", ("Head",)),
        (
            "UpperChest",
            tuple(b for b in BODY_BONES if b[-3:] in ("est", "eck", "ead", "der", "Arm", "and") and b != "Chest"),
        ),
    ):
        world = world_rotations(local_bones(frame_of({**still(), bone: turn})))
        turned = {name for name in BODY_BONES if angle_between(world[ROW[name]], turn) < 1e-9}
        assert turned == set(below), bone


vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


@settings(max_examples=30)
@given(st.lists(vectors, min_size=8, max_size=8))
def test_a_chain_is_the_product_of_its_bones(turns: list[FloatArray]) -> None:
    chain = ("root", "Hips", "Spine", "Chest", "RightShoulder", "RightUpperArm", "RightLowerArm", "RightHand")
    told = dict(zip(chain, from_rotation_vector(turns), strict=True))
    world = world_rotations(local_bones(frame_of({**still(*REQUIRED), **told})))
    product = np.array([1.0, 0.0, 0.0, 0.0])
    for bone in chain:
        product = multiply(product, told[bone])
    assert angle_between(world[ROW["RightHand"]], product) < 1e-6


def test_optional_bones_may_be_missing() -> None:
    turn = from_axis_angle(Y, 0.3)
    world = world_rotations(local_bones(frame_of({**still(*REQUIRED), "Spine": turn})))
    for bone in ("UpperChest", "Neck", "Head", "LeftHand", "RightShoulder"):
        assert_allclose(world[ROW[bone]], turn)


@pytest.mark.parametrize("bone", REQUIRED)
def test_a_missing_required_bone_is_unknown_and_so_is_all_below(bone: str) -> None:
    rest = still()
    del rest[bone]
    world = world_rotations(local_bones(frame_of(rest)))
    unknown = {name for name in BODY_BONES if np.isnan(world[ROW[name]]).any()}
    assert bone in unknown
    if bone in ("Hips", "LeftUpperArm", "RightFoot"):
        arm = {"LeftUpperArm", "LeftLowerArm", "LeftHand"}
        assert unknown == {"Hips": set(BODY_BONES), "LeftUpperArm": arm, "RightFoot": {"RightFoot", "RightToes"}}[bone]


def test_bones_that_are_not_vouched_for_are_not_told() -> None:
    bones = local_bones(frame_of(still("Hips", "root"), tracked=False))
    assert np.isnan(bones.rotation).all() and np.isnan(bones.root_rotation).all()


def test_an_avatar_split_over_two_datagrams() -> None:
    turn = from_axis_angle(X, 1.0)
    first = local_bones(frame_of({**still(*BODY_BONES[:11]), "root": turn}))
    second = local_bones(frame_of(still(*BODY_BONES[11:])))
    assert np.isnan(world_rotations(second)[ROW["LeftHand"]]).all()
    assert_allclose(world_rotations(merged(second, first)), np.tile(turn, (22, 1)))
    newer = local_bones(frame_of({"Hips": turn}, position=X))
    both = merged(newer, first)
    assert_allclose(both.rotation[0], turn)
    assert_allclose(both.position[0], X)


def test_positions_of_the_t_pose_are_those_of_our_human() -> None:
    person = proportional_dimensions(1.7)
    bones = local_bones(frame_of(still()))
    ours = dict(zip(BODY_BONES, world_positions(bones, world_rotations(bones), t_pose_offsets(person)), strict=True))
    human = build_human(person)
    theirs = dict(zip(POINTS, place(human, human.posture("t_pose"), POINTS), strict=True))
    pairs = {
        "LeftHand": "l_wrist",
        "RightLowerArm": "r_elbow",
        "Head": "head",
        "LeftToes": "l_toe",
        "RightUpperLeg": "r_hip",
    }
    for bone, point in pairs.items():
        assert_allclose(ours[bone] - ours["Hips"], theirs[point] - theirs["pelvis"], atol=1e-9, err_msg=bone)


def test_told_positions_go_before_lengths() -> None:
    bones = local_bones(frame_of({**still(), "root": from_axis_angle(Z, QUARTER)}, position=X))
    world = world_positions(bones, world_rotations(bones), np.full((22, 3), 9.0))
    assert_allclose(world[ROW["Hips"]], X + Y, atol=1e-12)  # the root's position, and then one step turned
    assert_allclose(world[ROW["Spine"]], X + 2.0 * Y, atol=1e-12)


def test_positions_without_lengths_are_unknown_and_absent_bones_take_no_room() -> None:
    bones = local_bones(frame_of(still()))
    assert np.isnan(world_positions(bones, world_rotations(bones))).all()
    present = local_bones(frame_of(still(*REQUIRED), position=Z))
    world = world_positions(present, world_rotations(present))
    assert_allclose(world[ROW["Hips"]], Z)
    assert_allclose(world[ROW["UpperChest"]], world[ROW["Spine"]])
    assert_allclose(world[ROW["LeftUpperArm"]], 3.0 * Z)
    assert_allclose(world[ROW["LeftHand"]], 5.0 * Z)


def test_a_bone_that_is_known_in_part_has_no_place() -> None:
    turns = still(*REQUIRED, "LeftShoulder")
    del turns["RightUpperLeg"]
    frame = frame_of(turns, position=Z)
    frame.position[frame.names.index("bone://LeftShoulder")] = np.nan
    bones = local_bones(frame)
    world = world_positions(bones, world_rotations(bones))
    for bone in ("LeftShoulder", "LeftHand", "RightUpperLeg", "RightFoot"):
        assert np.isnan(world[ROW[bone]]).all(), bone
    for bone in ("RightShoulder", "RightHand", "LeftFoot", "Head"):
        assert np.isfinite(world[ROW[bone]]).all(), bone


def test_a_bent_elbow_moves_the_hand() -> None:
    offsets = t_pose_offsets(proportional_dimensions(1.7))
    bend = from_axis_angle(Z, -QUARTER)  # the left forearm to the front
    bones = local_bones(frame_of({**still(), "LeftLowerArm": bend}))
    world = world_positions(bones, world_rotations(bones), offsets)
    forearm = world[ROW["LeftHand"]] - world[ROW["LeftLowerArm"]]
    assert_allclose(forearm, rotate(bend, offsets[ROW["LeftHand"]]), atol=1e-12)
    assert forearm[0] > 0.2


def test_told_nothing() -> None:
    bones = local_bones(frame_of({}))
    assert isinstance(bones, LocalBones) and np.isnan(world_rotations(bones)[0]).all()
