"""Left and right are found by geometry, and mirrored postures are mirror images."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.importing.mirror import find_mirror
from unknown_robots import SHIPPED, humanoid, scrambled, shipped_posed, shipped_tree, table_arm, text_tree

NAMES = {
    "op3": ("l_", "r_"),
    "poppy": ("l_", "r_"),
    "toddlerbot": ("left_", "right_"),
    "wolfgang": ("L", "R"),
}


@pytest.mark.parametrize("robot", SHIPPED)
def test_partners_are_those_of_the_names(robot: str) -> None:
    tree, (left, right) = shipped_tree(robot), NAMES[robot]
    mirror = find_mirror(tree)
    assert mirror is not None and len(mirror.partner) == len(tree.nodes)
    for node, other in mirror.partner.items():
        name = tree.nodes[node].joint
        expected = right + name[len(left) :] if name.startswith(left) else name
        if not name.startswith(right):
            assert tree.nodes[other].joint == expected


@pytest.mark.parametrize("robot", SHIPPED)
def test_names_do_not_matter(robot: str) -> None:
    known, unknown = find_mirror(shipped_tree(robot)), find_mirror(text_tree(scrambled(robot)))
    assert known is not None and unknown is not None
    assert known.partner == unknown.partner and known.sign == unknown.sign


@pytest.mark.parametrize("robot", SHIPPED)
@given(st.lists(st.floats(0.0, 1.0), min_size=30, max_size=30))
def test_a_mirrored_posture_is_a_mirror_image(robot: str, shares: list[float]) -> None:
    posed = POSED[robot]
    limbs = (*posed.anatomy.legs[:1], *posed.anatomy.arms[:1])
    joints = [posed.tree.nodes[node].joint for limb in limbs for node in limb.nodes]
    angles = {}
    for joint, share in zip(joints, shares, strict=False):
        low, high = posed.limits[joint]
        angles[joint] = 0.4 * (low + share * (high - low))
    both = posed.mirrored(angles)
    assert len(both) == 2 * len(angles)
    at = posed.place(both).positions
    for name in ("knee", "ankle", "sole", "toe", "elbow", "hand"):
        image = at[f"l_{name}"] * np.array([1.0, -1.0, 1.0])
        assert image == pytest.approx(at[f"r_{name}"], abs=0.004)  # shells of two sides differ by a millimetre


def test_a_robot_that_faces_sideways() -> None:
    mirror = find_mirror(text_tree(humanoid()))
    assert mirror is not None and mirror.normal.tolist() == [1.0, 0.0, 0.0] and len(mirror.partner) == 22


def test_an_arm_has_no_sides() -> None:
    assert find_mirror(text_tree(table_arm())) is None


POSED = {robot: shipped_posed(robot) for robot in SHIPPED}
