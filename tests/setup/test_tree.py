"""Left and right are found by geometry, and mirrored postures are mirror images."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from retarget.errors import InputError
from retarget.model.body import load_body
from retarget.model.body_file import compile_body_text
from retarget.schema.catalogue import shipped_folder
from retarget.setup.tree import BASE, find_mirror, read_tree
from unknown_robots import (
    ARM,
    HUMANOID,
    SHIPPED,
    humanoid,
    scrambled,
    shipped_posed,
    shipped_tree,
    table_arm,
    text_tree,
)

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


@pytest.mark.parametrize("robot", SHIPPED)
def test_axes_are_where_a_turn_leaves_points_alone(robot: str) -> None:
    """Oracle: the solver's kinematics. A point on a joint's axis does not move with the joint."""
    body, tree = load_body(shipped_folder() / "robots" / robot / "body.xml"), shipped_tree(robot)
    solver = body.solver_body()
    for node in tree.nodes[1:]:
        joint = body.joint_index(node.joint)
        link = int(body.joint_body[joint])
        origin = solver.points(body.qpos0[None], [link], np.zeros((1, 3)))[0, 0]
        turned = body.qpos0.copy()
        turned[body.joint_qpos[joint]] += 0.7
        moved = solver.points(turned[None], [link], np.zeros((1, 3)))[0, 0]
        way = origin - node.anchor
        along = (way @ node.axis) * node.axis
        across = way - along
        expected = node.anchor + along + np.cos(0.7) * across + np.sin(0.7) * np.cross(node.axis, across)
        assert moved == pytest.approx(expected, abs=1e-9), node.joint


def test_the_tree_is_that_of_the_file() -> None:
    tree = text_tree(humanoid())
    assert [node.joint for node in tree.nodes[1:]] != [] and len(tree.nodes) == len(HUMANOID) + 1
    parents = {f"j_{part.name}": "" if part.parent == "chest" else f"j_{part.parent}" for part in HUMANOID}
    assert {node.joint: tree.nodes[node.parent].joint for node in tree.nodes[1:]} == parents
    assert tree.nodes[BASE].points.shape == (8, 3)  # corners of a box


def test_ways_and_branches() -> None:
    tree = text_tree(table_arm())
    assert tree.way(len(ARM)) == list(range(len(ARM) + 1)) and tree.below(2) == [2, 3, 4] and tree.children(4) == []


def test_what_slides_is_refused() -> None:
    slide = (
        '<mujoco><worldbody><body name="a"><joint name="s" type="slide"/><geom size="1"/></body></worldbody></mujoco>'
    )
    with refuses(InputError):
        text_tree(slide)


def test_what_has_no_joint_that_turns_is_refused_by_its_file() -> None:
    model = compile_body_text(humanoid(), source="body.urdf", root="free").model
    model.jnt_type[:] = 0  # free
    with refuses(InputError, where="a.urdf", found=0):
        read_tree(model, source="a.urdf")
