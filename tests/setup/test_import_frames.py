"""Frames and soles that are found, against those that were written by hand."""

import numpy as np
import pytest

from retarget.model.robot import load_robot
from retarget.schema.profile_checks import is_convex
from retarget.setup.frames import find_frames
from retarget.setup.limbs import find_anatomy
from retarget.setup.tree import MAX_CORNERS, flat_underside, outline
from unknown_robots import SHIPPED, humanoid, shipped_anatomy, shipped_tree, table_arm, text_tree

LOOSE = {"head": 0.01, "l_hand": 0.03, "r_hand": 0.03}  # [m]; drawn by eye in the shipped profiles
EXACT = 0.002


@pytest.mark.parametrize("robot", SHIPPED)
def test_frames_are_where_people_put_them(robot: str) -> None:
    known = load_robot(robot)
    found = find_frames(shipped_tree(robot), shipped_anatomy(robot))
    names = tuple(known.profile.frames)
    assert set(found.frames) == set(names) and not found.missing
    at = known.points(known.body.qpos0[None], names)[0]
    for name, place in zip(names, at, strict=True):
        frame = found.frames[name]
        off = float(np.linalg.norm(frame.position - place))
        assert off <= LOOSE.get(name, EXACT), f"{name} is {1e3 * off:.1f} mm off"
        assert known.body.body_names[shipped_tree(robot).nodes[frame.node].links[0]] == known.profile.frames[name].link


@pytest.mark.parametrize("robot", SHIPPED)
def test_soles_are_those_of_the_profiles(robot: str) -> None:
    known = load_robot(robot)
    for sole, foot in zip(
        find_frames(shipped_tree(robot), shipped_anatomy(robot)).feet.values(), known.profile.feet.values(), strict=True
    ):
        assert is_convex(sole.polygon)
        assert np.ptp(sole.polygon, axis=0) == pytest.approx(np.ptp(np.array(foot.polygon), axis=0), abs=5e-4)


def test_a_sole_that_is_tilted_in_the_zero_pose() -> None:
    tree, anatomy = shipped_tree("wolfgang"), shipped_anatomy("wolfgang")
    sole = flat_underside(tree, anatomy.legs[0].ends)
    assert sole is not None
    assert np.degrees(np.arctan2(-sole.up[0], sole.up[2])) == pytest.approx(15.0, abs=0.1)  # it says so in its body


def test_a_foot_that_is_a_ball_has_no_sole() -> None:
    text = humanoid().replace('<box size="0.07 0.14 0.02"/>', '<sphere radius="0.03"/>')
    tree = text_tree(text)
    found = find_frames(tree, find_anatomy(tree))
    assert not found.feet and any(text.startswith("l_sole: the foot has no flat") for text in found.missing)


def test_outlines_are_thinned() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    corners = outline(np.stack([0.05 * np.cos(angles), 0.1 * np.sin(angles)], axis=1))
    assert len(corners) == MAX_CORNERS and is_convex(tuple(map(tuple, corners.tolist())))
    x, y = corners.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    assert area == pytest.approx(np.pi * 0.05 * 0.1, rel=0.05)  # inside the round one


def test_a_foot_that_is_an_edge_has_no_sole() -> None:
    text = humanoid().replace('<box size="0.07 0.14 0.02"/>', '<box size="0.0002 0.14 0.02"/>')
    tree = text_tree(text)
    assert not find_frames(tree, find_anatomy(tree)).feet


def test_an_arm_has_a_hand_and_a_list_of_missing_parts() -> None:
    tree = text_tree(table_arm())
    found = find_frames(tree, find_anatomy(tree))
    assert set(found.frames) == {"neck", "head", "r_shoulder", "r_elbow", "r_hand"}
    assert [text.split(":")[0] for text in found.missing] == ["head", "legs", "l_hand"]
    assert found.frames["r_hand"].position[2] > found.frames["r_elbow"].position[2]
