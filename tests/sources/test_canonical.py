"""Canonical joints and sensors of joint trees that lack, split or double some of them."""

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
from retarget.types import FloatArray
from rigs import tree_of

LIMBS = ((1.0, "Left"), (-1.0, "Right"))


def build(*, twist: bool = False, neck: bool = True, toes: bool = True, top: bool = True, spines: int = 2) -> JointTree:
    """A body in metres, y up, z forward; twist: forearms in two pieces."""
    rows: list[tuple[str, str, tuple[float, float, float]]] = [("Hips", "", (0.0, 0.0, 0.0))]
    ends: dict[str, FloatArray] = {"Head": np.array([0.0, 0.2, 0.0])} if top else {}
    below = "Hips"
    for i in range(spines):
        rows.append((f"Spine{i}", below, (0.0, 0.24 / spines, 0.0)))
        below = f"Spine{i}"
    if neck:
        rows.append(("Neck", below, (0.0, 0.12, 0.0)))
    rows.append(("Head", "Neck" if neck else below, (0.0, 0.1, 0.0)))
    for sign, side in LIMBS:
        rows += [
            (f"{side}Arm", below, (0.18 * sign, 0.12, 0.0)),
            (f"{side}ForeArm", f"{side}Arm", (0.29 * sign, 0.0, 0.0)),
        ]
        elbow = f"{side}ForeArm"
        if twist:
            rows.append((f"{side}ForeArmRoll", elbow, (0.13 * sign, 0.0, 0.0)))
            elbow = f"{side}ForeArmRoll"
        rows.append((f"{side}Hand", elbow, ((0.13 if twist else 0.26) * sign, 0.0, 0.0)))
        rows += [(f"{side}UpLeg", "Hips", (0.09 * sign, -0.09, 0.0)), (f"{side}Leg", f"{side}UpLeg", (0.0, -0.42, 0.0))]
        rows.append((f"{side}Foot", f"{side}Leg", (0.0, -0.41, 0.0)))
        ends[f"{side}Foot"] = np.array([0.0, -0.06, 0.15])
        if toes:
            rows.append((f"{side}ToeBase", f"{side}Foot", (0.0, -0.06, 0.13)))
    return tree_of(rows, ends)


def joints_of(tree: JointTree) -> dict[str, str]:
    return {name: tree.names[at.joint] for name, at in canonical_joints(tree, where="here")[0].items()}


def test_the_chest_is_where_neck_and_arms_part_and_the_spine_half_way() -> None:
    assert joints_of(build())["chest"] == "Spine1" and joints_of(build())["spine"] == "Spine0"
    four = joints_of(build(spines=4))
    assert four["chest"] == "Spine3" and four["spine"] == "Spine1"
    one = joints_of(build(spines=1))
    assert one["chest"] == "Spine0" and "spine" not in one
    none = joints_of(build(spines=0))
    assert "chest" not in none and "spine" not in none and none["neck"] == "Neck"


def test_without_the_top_of_the_head_the_joint_or_a_usual_head_stands_in_and_a_note_says_so() -> None:
    tree = build(top=False)
    joints, notes = canonical_joints(tree, where="here")
    assert not joints["head"].local.any()
    shows_lines(notes, "head")
    head = tree.names.index("Head")
    ends = tuple((np.zeros(3),) if joint == head else own for joint, own in enumerate(tree.ends))
    joints, notes = canonical_joints(JointTree(tree.names, tree.parents, tree.offsets, ends), where="here")
    np.testing.assert_allclose(joints["head"].local, [0.0, 0.08, 0.0], atol=0.01)
    shows_lines(notes, "head")


def test_orientation_of_a_split_forearm_is_that_next_to_the_hand() -> None:
    tree = build(twist=True)
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
    tree = build()
    with refuses(InputError):
        canonical_joints(JointTree(tree.names[:3], tree.parents[:3], tree.offsets[:3], tree.ends[:3]), where="here")
    for name, lacks in (("LeftForeArm", ("l_elbow", "leftforearm")), ("Head", ("head",))):
        names = tuple("Other" if joint == name else joint for joint in tree.names)
        with refuses(InputError, lacks):
            missing = JointTree(names, tree.parents, 0.0 * tree.offsets, tree.ends)
            canonical_joints(missing, where="here")
    flat = JointTree(tree.names, tree.parents, 0.0 * tree.offsets, tree.ends)
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
