"""Joint names as data: every style is complete and finds itself."""

import numpy as np
import pytest

from retarget import rotations
from retarget.frames import JOINTS
from retarget.sources.skeletons import (
    REQUIRED,
    STYLES,
    JointTree,
    forward_kinematics,
    joints_by_name,
    plain_names,
)


def first_names(style: str) -> dict[str, str]:
    """Canonical joint -> the style's own first name."""
    return {joint: options[0] for joint, options in STYLES[style].items()}


@pytest.mark.parametrize("style", STYLES)
def test_each_style_finds_its_own_joints(style: str) -> None:
    names = first_names(style)
    assert set(REQUIRED) <= set(names) <= {*JOINTS, "head_top"}
    assert len(set(names.values())) == len(names), "a name stands for two joints"
    found = joints_by_name(tuple(names.values()))
    assert found == {joint: i for i, joint in enumerate(names)}


def test_name_spaces_prefixes_blanks_and_case_do_not_matter() -> None:
    assert plain_names(("mixamorig:Hips", "mixamorig:LeftUpLeg")) == ["hips", "leftupleg"]
    assert plain_names(("Bip01", "Bip01 L Thigh", "Bip01_Pelvis")) == ["", "lthigh", "pelvis"]
    assert plain_names(("left_up.leg", "Left Arm-2")) == ["upleg", "arm2"]
    assert plain_names(("Hips",)) == ["hips"]
    assert plain_names(()) == []


def test_names_that_lack_a_limb_are_not_enough() -> None:
    names = first_names("HumanIK (MotionBuilder, Mixamo, CMU BVH)")
    for joint in REQUIRED:
        rest = tuple(name for other, name in names.items() if other != joint)
        found = joints_by_name(rest)
        assert found is None or joint == "pelvis"  # the root stands in for a pelvis of another name
    assert joints_by_name(("tail", "fin")) is None


TREE = JointTree(
    names=("root", "arm", "hand", "leg"),
    parents=(-1, 0, 1, 0),
    offsets=np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, -1]]),
    ends=((), (), (np.array([0.0, 0, 3]),), ()),
)


def test_forward_kinematics_is_the_product_of_transforms() -> None:
    generator = np.random.default_rng(0)
    local = rotations.normalise(generator.normal(size=(5, 4, 4)))
    translation = np.broadcast_to(TREE.offsets, (5, 4, 3)).copy()
    translation[:, 0] = generator.normal(size=(5, 3))
    pose = forward_kinematics(TREE, local, translation)
    for frame in range(5):
        matrices = np.zeros((4, 4, 4))
        matrices[:, :3, :3] = rotations.to_matrix(local[frame])
        matrices[:, :3, 3] = translation[frame]
        matrices[:, 3, 3] = 1.0
        hand = matrices[0] @ matrices[1] @ matrices[2]
        np.testing.assert_allclose(pose.position[frame, 2], hand[:3, 3], atol=1e-12)
        np.testing.assert_allclose(rotations.to_matrix(pose.orientation[frame, 2]), hand[:3, :3], atol=1e-12)
        tip = pose.point(2, TREE.ends[2][0])[frame]
        np.testing.assert_allclose(tip, (hand @ [0, 0, 3, 1])[:3], atol=1e-12)
