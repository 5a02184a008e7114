"""What moves in a body, as lines of axes and geometry in the zero pose."""

import numpy as np
import pytest

from retarget.body import load_body
from retarget.body_file import compile_body_text
from retarget.catalogue import shipped_folder
from retarget.errors import InputError
from retarget.importing.tree import BASE, read_tree
from support.messages import refuses
from unknown_robots import ARM, HUMANOID, SHIPPED, humanoid, shipped_tree, table_arm, text_tree


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
