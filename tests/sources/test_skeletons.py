"""Joint names as data: every style is complete and finds itself."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_texts import bvh_text
from retarget.frames import JOINTS
from retarget.sources.asf_amc import read_asf
from retarget.sources.bvh import read_motion
from retarget.sources.skeletons import (
    REQUIRED,
    STYLES,
    JointTree,
    joints_by_name,
    joints_by_shape,
    named_in_part,
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


@pytest.mark.parametrize("prefix", ["Character1_", "Bip01 ", "Ann:"])
@pytest.mark.parametrize("style", STYLES)
def test_a_prefix_of_the_skeleton_alone_is_left_out(style: str, prefix: str) -> None:
    """Beside it stand joints that have none, or another one."""
    names = first_names(style)
    extras = ("Reference", "Camera", "Solver_Head", *(f"prop_{name}" for name in ("head", "tip")))
    found = joints_by_name((*extras, *(prefix + name for name in names.values())))
    assert found == {joint: len(extras) + i for i, joint in enumerate(names)}
    lacking = tuple(prefix + name for joint, name in names.items() if joint != "l_knee")
    assert set(named_in_part((*extras, *lacking))[1]) == {"l_knee"}


LIMBS = [f"{side}_{part}" for side in "lr" for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")]


TURNS = (np.eye(3), np.diag([-1.0, 1.0, -1.0]), np.roll(np.eye(3), 1, axis=0), np.diag([1.0, -1.0, -1.0]))
MIRRORS = (np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, 1.0, -1.0]))
SIDES = {"numbers": None, "de": ("_links", "_rechts"), "jp": ("左", "右"), "camel": ("L", "R"), "it": (".Sx", ".Dx")}


@pytest.mark.parametrize("language", SIDES)
@pytest.mark.parametrize("z_up", [False, True])
def test_shape_finds_the_limbs_however_the_figure_stands(language: str, z_up: bool, tmp_path: Path) -> None:
    """Sides by names where those say them, also of a mirrored figure; else by the toes, which tell no mirrored one."""
    (tmp_path / "a.bvh").write_text(bvh_text(z_up=z_up))
    tree, words = read_motion(tmp_path / "a.bvh").tree, SIDES[language]
    by_name = joints_by_name(tree.names)
    assert by_name is not None
    sides = {"Left": 0, "Right": 1}
    marks = [next((words[k] for side, k in sides.items() if words and side in name), "") for name in tree.names]
    names = tuple(f"q{place}{mark}" for place, mark in enumerate(marks))
    for matrix in (*TURNS, *(MIRRORS if words else ())):
        ends = tuple(tuple(matrix @ end for end in ends) for ends in tree.ends)
        by_shape = joints_by_shape(JointTree(names, tree.parents, tree.offsets @ matrix.T, ends))
        assert by_shape is not None
        for name in ("head", *LIMBS):
            assert by_shape[name] == by_name[name], name


def test_recordings_are_recognised_without_their_names(shared: Path) -> None:
    trees = [read_motion(path).tree for path in sorted((shared / "mocap").rglob("*.bvh"))]
    trees += [read_asf(path).tree for path in sorted((shared / "mocap").rglob("*.asf"))]
    right = 0
    for tree in trees:
        by_name, by_shape = joints_by_name(tree.names), joints_by_shape(tree)
        assert by_name is not None
        if by_shape is None:
            continue  # refused with a clear error, not mistaken
        wrong = [name for name in LIMBS if not _same_place(tree, by_name[name], by_shape[name])]
        # A forearm in two pieces ends the shape's forearm too early.
        assert {name[2:] for name in wrong} <= {"wrist"}, (tree.names, wrong)
        right += not wrong
    assert right >= 13


def _same_place(tree: JointTree, a: int, b: int) -> bool:
    """Whether two joints coincide up to joints without length between them."""
    rest = tree.rest_positions()
    return bool(np.linalg.norm(rest[a] - rest[b]) < 0.05 * np.abs(rest).max())


@given(count=st.integers(1, 25), seed=st.integers(0, 10_000))
def test_any_tree_gives_an_answer(count: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    parents = (-1, *(int(generator.integers(0, i)) for i in range(1, count)))
    offsets = generator.integers(-3, 4, size=(count, 3)).astype(float)
    ends = tuple((generator.normal(size=3),) if generator.random() < 0.5 else () for _ in range(count))
    found = joints_by_shape(JointTree(tuple(map(str, range(count))), parents, offsets, ends))
    assert found is None or all(0 <= joint < count for joint in found.values())
