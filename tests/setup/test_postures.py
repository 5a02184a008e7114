"""Postures that are found: soles flat, balanced, knees ahead, arms beside the trunk, clear of itself."""

from pathlib import Path

import numpy as np
import pytest

from retarget.model.body_file import compile_body_text
from retarget.model.observers import robot_observers
from retarget.model.robot import load_profile, load_robot
from retarget.setup.frames import Posed, find_frames
from retarget.setup.postures import LEGS, find_posture, find_postures, leg_length
from unknown_robots import SHIPPED, humanoid, imported, proposed_anatomy, shipped_posed, small_bust, text_tree


@pytest.mark.long
def test_what_touches_in_every_posture_is_ignored_and_marked(tmp_path: Path) -> None:
    """Forearms so wide that both meet in front of the chest, whatever shoulders and elbows do: a run may begin."""
    text = small_bust().replace('<box size="0.03 0.1 0.03"/>', '<box size="0.3 0.1 0.03"/>')
    folder = imported(text, tmp_path).folder
    (ignored,) = [entry for entry in load_profile(folder).ignore_pairs if set(entry.pair) == {"p2", "q2"}]
    assert "neutral" in ignored.reason and robot_observers(load_robot(folder)).names


def unknown() -> Posed:
    text = humanoid()
    tree = text_tree(text)
    anatomy = proposed_anatomy(tree)
    limits = {node.joint: (node.lower, node.upper) for node in tree.nodes[1:]}
    return Posed(compile_body_text(text, source="t").model, tree, anatomy, find_frames(tree, anatomy), limits)


POSED = {**{robot: shipped_posed(robot) for robot in SHIPPED}, "unknown": unknown()}


@pytest.mark.parametrize("robot", POSED)
@pytest.mark.parametrize("share", [0.97, 0.88])
def test_standing(robot: str, share: float) -> None:
    posed = POSED[robot]
    standing = find_posture(posed, spread=0.3, ahead=0.0, bend=0.6, share=share)
    assert standing.stands
    there, left, ahead = posed.place(standing.angles), posed.anatomy.left, posed.anatomy.forward
    for side in ("l", "r"):
        at = {name: there.positions[f"{side}_{name}"] for name in ("hip", "knee", "ankle", "sole")}
        assert there.axes[f"{side}_sole"][:, 2] == pytest.approx([0.0, 0.0, 1.0], abs=0.02)
        assert np.linalg.norm(at["hip"] - at["ankle"]) == pytest.approx(share * leg_length(posed), rel=0.01)
        assert (at["knee"] - 0.5 * (at["hip"] + at["ankle"])) @ ahead > 0.0
    middle = 0.5 * (there.positions["l_sole"] + there.positions["r_sole"])
    assert (there.centre_of_mass - middle) @ ahead == pytest.approx(0.0, abs=0.004)
    assert (there.centre_of_mass - middle) @ left == pytest.approx(0.0, abs=0.006)
    assert all(low <= standing.angles.get(joint, low) <= high for joint, (low, high) in posed.limits.items())


@pytest.mark.parametrize("robot", POSED)
def test_both_sides_are_mirror_images(robot: str) -> None:
    """Each side is found by itself; shells of two sides differ by a millimetre."""
    posed = POSED[robot]
    at = posed.place(find_posture(posed, spread=0.5, ahead=0.1, bend=0.9, share=0.9).angles).positions
    across = np.eye(3) - 2.0 * np.outer(posed.anatomy.left, posed.anatomy.left)
    for name in ("knee", "ankle", "sole", "toe", "elbow", "hand"):
        assert across @ at[f"l_{name}"] == pytest.approx(at[f"r_{name}"], abs=0.006), name


def test_all_four() -> None:
    posed = POSED["wolfgang"]
    postures = find_postures(posed, soles=True, touching=lambda angles, neutral: frozenset())
    assert set(postures) == {"neutral", "stand", "rest", "attractor"}
    placed = {name: posed.place(posture.angles).positions for name, posture in postures.items()}
    heights = {name: at["l_hip"] - at["l_ankle"] for name, at in placed.items()}
    length = leg_length(posed)
    for name, share in LEGS.items():
        assert np.linalg.norm(heights[name]) == pytest.approx(share * length, rel=0.01)
    assert np.linalg.norm(heights["rest"]) < 0.75 * length
    for posture in postures.values():
        assert posture.stands
        for joint, (low, high) in posed.limits.items():
            assert low <= posture.angles.get(joint, 0.0) <= high
