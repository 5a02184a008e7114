"""Legs, arms, head and front of robots without a description."""

from dataclasses import replace

import pytest

from messages import shows
from retarget.setup.limbs import Anatomy, arm_roles, find_anatomy, leg_roles
from retarget.setup.tree import Tree
from unknown_robots import (
    HUMANOID,
    SHIPPED,
    TRUNK,
    Part,
    humanoid,
    scrambled,
    shipped_anatomy,
    shipped_tree,
    table_arm,
    text_tree,
)

ROLES = {
    "op3": ("l_hip_pitch", "l_knee", "l_ank_pitch", "l_sho_pitch", "l_el", None),
    "poppy": ("l_hip_y", "l_knee_y", "l_ankle_y", "l_shoulder_y", "l_elbow_y", None),
    "toddlerbot": (
        "left_hip_pitch",
        "left_knee",
        "left_ankle_pitch",
        "left_shoulder_pitch",
        "left_elbow_roll",
        "left_wrist_pitch",
    ),
    "wolfgang": ("LHipPitch", "LKnee", "LAnklePitch", "LShoulderPitch", "LElbow", None),
}
TRUNKS = {"op3": ("", ""), "poppy": ("", "bust_x"), "toddlerbot": ("waist_roll", ""), "wolfgang": ("", "")}
HEADS = {
    "op3": ["head_pan", "head_tilt"],
    "poppy": ["head_z", "head_y"],
    "toddlerbot": ["neck_yaw", "neck_pitch"],
    "wolfgang": ["HeadPan", "HeadTilt"],
}


def named(tree: Tree, anatomy: Anatomy) -> tuple[str | None, ...]:
    """Joints of the left limbs by what they do."""
    leg, arm = leg_roles(tree, anatomy.legs[0], anatomy.left), arm_roles(tree, anatomy.arms[0])
    nodes = (leg.hip, leg.knee, leg.ankle, anatomy.arms[0].nodes[0], arm.elbow, arm.wrist)
    return tuple(None if node is None else tree.nodes[node].joint for node in nodes)


@pytest.mark.parametrize("robot", SHIPPED)
def test_shipped_robots(robot: str) -> None:
    tree, anatomy = shipped_tree(robot), shipped_anatomy(robot)
    assert named(tree, anatomy) == ROLES[robot]
    assert (tree.nodes[anatomy.pelvis].joint, tree.nodes[anatomy.chest].joint) == TRUNKS[robot]
    assert [tree.nodes[node].joint for node in anatomy.head] == HEADS[robot]
    assert anatomy.forward.tolist() == [1.0, 0.0, 0.0] and not anatomy.odd


@pytest.mark.parametrize("robot", SHIPPED)
def test_the_same_without_their_names(robot: str) -> None:
    known, unknown = shipped_anatomy(robot), find_anatomy(text_tree(scrambled(robot)))
    assert unknown.legs == known.legs and unknown.arms == known.arms and unknown.head == known.head
    assert unknown.forward == pytest.approx(known.forward) and "names" not in unknown.facing


def test_a_stranger_that_faces_y() -> None:
    tree = text_tree(humanoid())
    anatomy = find_anatomy(tree)
    assert anatomy.forward == pytest.approx([0.0, 1.0, 0.0]) and anatomy.left == pytest.approx([-1.0, 0.0, 0.0])
    assert named(tree, anatomy) == ("j_p1", "j_p4", "j_p5", "j_p6", "j_p9", None)  # p is the left, as side_parts says
    assert [tree.nodes[node].joint for node in anatomy.head] == ["j_face"]
    assert tree.nodes[anatomy.pelvis].joint == "j_hips" and anatomy.chest == 0


def test_fingers_are_part_of_the_hand() -> None:
    fingers = [part for side in "pq" for part in (finger(side, 0.015), finger(side, -0.015))]
    tree = text_tree(humanoid([*HUMANOID, *fingers]))
    arm = find_anatomy(tree).arms[0]
    assert tree.nodes[arm.nodes[-1]].joint == "j_p9" and len(arm.ends) == 3


def finger(side: str, x: float) -> Part:
    name, at = f"{side}f{x > 0}", (x, 0.11, 0.0)
    return Part(name, f"{side}9", at, (0, 0, 1), (-0.5, 0.5), (0.01, 0.03, 0.02), (0, 0.015, 0), 0.01)


def test_without_legs_arms_or_a_second_side() -> None:
    arms = [part for part in HUMANOID if part.name[1:] in {"6", "7", "8", "9"}]
    bust = find_anatomy(text_tree(humanoid(arms)))
    assert len(bust.arms) == 2 and not bust.legs and not bust.head and "hands" in bust.facing
    legs = [part for part in HUMANOID if part.name not in {"face"} and part not in arms]
    walker = find_anatomy(text_tree(humanoid(legs)))
    assert len(walker.legs) == 2 and not walker.arms
    alone = find_anatomy(text_tree(table_arm()))
    assert len(alone.arms) == 1 and len(alone.arms[0].nodes) == 4 and alone.mirror is None
    trunk = find_anatomy(text_tree(humanoid(TRUNK)))
    assert (not trunk.legs and not trunk.head) or trunk.mirror is None


def test_arms_that_hang_below_the_trunk_are_no_legs() -> None:
    """They end at the lowest point of the robot, but begin high on its trunk."""
    size, middle = (0.03, 0.03, 0.2), (0.0, 0.0, -0.1)
    arms = [
        Part(f"{side}{number}", parent, at, (1, 0, 0), (-1.5, 1.5), size, middle)
        for side, x in (("p", -0.09), ("q", 0.09))
        for number, parent, at in ((1, "chest", (x, 0.0, 0.08)), (2, f"{side}1", (0.0, 0.0, -0.2)))
    ]
    anatomy = find_anatomy(text_tree(humanoid(arms)))
    assert len(anatomy.arms) == 2 and not anatomy.legs


def test_names_decide_where_shapes_do_not() -> None:
    """Feet and knees of a symmetric body say nothing; a name does."""
    two = "".join(
        f'<body name="{name}" pos="0 {y} -0.1"><joint name="{name}_a" axis="0 1 0"/><geom size="0.02"/>'
        f'<body name="{name}2" pos="0 0 -0.1"><joint name="{name}_b" axis="0 1 0"/><geom size="0.02"/></body></body>'
        for name, y in (("left", -0.1), ("right", 0.1))
    )
    text = f'<mujoco><worldbody><body name="b"><geom size="0.05"/>{two}</body></worldbody></mujoco>'
    anatomy = find_anatomy(text_tree(text))
    assert anatomy.forward == pytest.approx([-1.0, 0.0, 0.0]) and anatomy.facing == "names of left and right"


def test_names_show_limbs_and_neck_where_the_sides_differ() -> None:
    """One arm and the head are 4 and 6 cm off: no mirror image, but Left and Right, and Neck."""
    sides, moved = {"p": "Left", "q": "Right"}, {"Left6": 0.04, "Neck": 0.06}

    def named(name: str) -> str:
        return sides[name[0]] + name[1:] if name[0] in sides else "Neck" if name == "face" else name

    parts = [replace(part, name=named(part.name), parent=named(part.parent)) for part in HUMANOID]
    crooked = [replace(part, at=(part.at[0] + moved.get(part.name, 0.0), *part.at[1:]), extra="") for part in parts]
    whole, found = find_anatomy(text_tree(humanoid(parts))), find_anatomy(text_tree(humanoid(crooked)))
    assert not whole.named and not found.odd
    assert found.arms == whole.arms and found.legs == whole.legs and found.head == whole.head
    shows(found.named, "j_Left6", "j_Right6", "40 mm", "j_Neck", "120 mm")
    nameless = humanoid(crooked).replace("Neck", "n")
    assert not find_anatomy(text_tree(nameless)).head
