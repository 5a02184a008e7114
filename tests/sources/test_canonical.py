"""Canonical joints and sensors of joint trees that lack, split or double some of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from messages import refuses, shows, shows_lines
from people import TRIALS, limbs_lie_along_their_bones, trial
from retarget import rotations
from retarget.errors import InputError
from retarget.frames import SENSORS
from retarget.sources.canonical import UNITS, canonical_frames, choose_unit, named_unit
from retarget.sources.rest_skeleton import canonical_joints
from retarget.sources.skeletons import JointTree, forward_kinematics
from rigs import SIDES, body, tree_of


def without(tree: JointTree, name: str) -> JointTree:
    """The tree whose joint of this name has another one."""
    return replace(tree, names=tuple("Other" if joint == name else joint for joint in tree.names))


def spined(spines: int, *, twist: bool = False) -> JointTree:
    """The person of the rigs with so many joints between hips and neck, without collars and ends of hands. twist:
    forearms in two pieces."""
    rows: list[tuple[str, str, tuple[float, float, float]]] = [("Hips", "", (0.0, 0.0, 0.0))]
    rows += [(f"Spine{i}", f"Spine{i - 1}" if i else "Hips", (0.0, 0.24 / spines, 0.0)) for i in range(spines)]
    chest = rows[-1][0]
    rows += [("Neck", chest, (0.0, 0.12, 0.0)), ("Head", "Neck", (0.0, 0.1, 0.0))]
    for sign, side in SIDES:
        arm, fore, roll = (f"{side}{part}" for part in ("Arm", "ForeArm", "ForeArmRoll"))
        rows += [(arm, chest, (0.18 * sign, 0.12, 0.0)), (fore, arm, (0.29 * sign, 0.0, 0.0))]
        rows += [(roll, fore, (0.13 * sign, 0.0, 0.0))] * twist
        rows += [(f"{side}Hand", roll if twist else fore, ((0.13 if twist else 0.26) * sign, 0.0, 0.0))]
        rows += [(f"{side}UpLeg", "Hips", (0.09 * sign, -0.09, 0.0)), (f"{side}Leg", f"{side}UpLeg", (0.0, -0.42, 0.0))]
        rows += [
            (f"{side}Foot", f"{side}Leg", (0.0, -0.41, 0.0)),
            (f"{side}ToeBase", f"{side}Foot", (0.0, -0.06, 0.13)),
        ]
    return tree_of(rows, {})


def joints_of(tree: JointTree) -> dict[str, str]:
    return {name: tree.names[at.joint] for name, at in canonical_joints(tree, where="here")[0].items()}


def test_the_chest_is_where_neck_and_arms_part_and_the_spine_half_way() -> None:
    for spines, chest, spine in (
        (4, "Spine3", "Spine1"),
        (2, "Spine1", "Spine0"),
        (1, "Spine0", None),
        (0, None, None),
    ):
        joints = joints_of(spined(spines))
        assert (joints.get("chest"), joints.get("spine"), joints["neck"]) == (chest, spine, "Neck")


def test_without_the_top_of_the_head_the_joint_or_a_usual_head_stands_in_and_a_note_says_so() -> None:
    tree = spined(2)
    joints, notes = canonical_joints(tree, where="here")
    assert not joints["head"].local.any()
    shows_lines(notes, "head")
    head = tree.names.index("Head")
    ends = tuple((np.zeros(3),) if joint == head else own for joint, own in enumerate(tree.ends))
    joints, notes = canonical_joints(replace(tree, ends=ends), where="here")
    np.testing.assert_allclose(joints["head"].local, [0.0, 0.08, 0.0], atol=0.01)
    shows_lines(notes, "head")


def test_orientation_of_a_split_forearm_is_that_next_to_the_hand() -> None:
    tree = spined(2, twist=True)
    local = np.broadcast_to(rotations.IDENTITY, (2, len(tree.names), 4)).copy()
    local[:, tree.names.index("LeftForeArmRoll")] = rotations.from_axis_angle([1.0, 0.0, 0.0], 0.5)
    pose = forward_kinematics(tree, local, tree.offsets)
    frames = canonical_frames(tree, pose, unit=named_unit("m"), rate=100.0, source="here")
    assert set(frames.names) == set(SENSORS)
    limbs_lie_along_their_bones(frames)
    upper, fore = frames.orientation[0, frames.index("l_shoulder")], frames.orientation[0, frames.index("l_elbow")]
    turn = rotations.log(rotations.multiply(fore, rotations.conjugate(upper)))
    np.testing.assert_allclose(turn, [0.0, 0.5, 0.0], atol=1e-12)  # x of the file is left: y of the world
    assert frames.joints is not None and "l_hand" not in frames.joints.names


def test_a_tree_that_is_no_body_is_refused() -> None:
    tree = body()
    few = JointTree(tree.names[:3], tree.parents[:3], tree.offsets[:3], tree.ends[:3])
    flat = replace(tree, offsets=0.0 * tree.offsets)
    for wrong, lacks in (
        (few, ()),
        (without(flat, "LeftForeArm"), ("l_elbow", "leftforearm")),
        (without(flat, "Head"), "head"),
    ):
        with refuses(InputError, lacks):
            canonical_joints(wrong, where="here")
    pose = forward_kinematics(flat, np.broadcast_to(rotations.IDENTITY, (1, len(tree.names), 4)), flat.offsets)
    for unit in (None, named_unit("m")):
        with refuses(InputError):
            canonical_frames(flat, pose, unit=unit, rate=100.0, source="here")


@pytest.mark.parametrize("name", UNITS)
def test_every_human_height_finds_its_unit(name: str) -> None:
    for height in (1.4, 1.55, 1.7, 1.9, 2.1):
        metres, note = choose_unit(height / UNITS[name], where="here")
        assert metres == UNITS[name] and f"{height:.2f} m" in note and "unusual" not in note
    shows(choose_unit(1.2 / UNITS[name], where="here")[1])


@pytest.mark.parametrize("name", TRIALS)
def test_limbs_of_recordings_lie_along_their_bones_in_every_frame(shared: Path, name: str) -> None:
    limbs_lie_along_their_bones(trial(shared, name))
