"""Left, right, limbs, frames and soles: of shipped robots, with and without their names, and of unknown ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses
from retarget.errors import ConfigError, InputError
from retarget.model.body import load_body
from retarget.model.body_file import compile_body_text
from retarget.model.robot import load_robot
from retarget.schema.catalogue import shipped_folder
from retarget.schema.profile_checks import is_convex
from retarget.setup.frames import Anatomy, find_anatomy, find_frames, wrist_of
from retarget.setup.links import PartLinks, completed, pitch_joints, propose_links, read_links
from retarget.setup.tree import Tree, flat_underside, read_tree
from unknown_robots import (
    HUMANOID,
    SHIPPED,
    TRUNK,
    Part,
    humanoid,
    proposed_anatomy,
    scrambled,
    shipped_anatomy,
    shipped_tree,
    table_arm,
    text_tree,
    urdf,
)


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


def test_what_has_no_joint_that_turns_is_refused_by_its_file() -> None:
    model = compile_body_text(humanoid(), source="body.urdf", root="free").model
    model.jnt_type[:] = 0  # free
    with refuses(InputError, where="a.urdf", found=0):
        read_tree(model, source="a.urdf")


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
    leg, arm = anatomy.legs["l"], anatomy.arms["l"]
    pitches = pitch_joints(tree, leg.nodes, anatomy.left)
    nodes = (pitches[0], leg.bend, pitches[-1], arm.nodes[0], arm.bend, wrist_of(tree, arm))
    return tuple(None if node is None else tree.nodes[node].joint for node in nodes)


@pytest.mark.parametrize("robot", SHIPPED)
def test_shipped_robots_with_their_names_and_without(robot: str) -> None:
    tree, anatomy = shipped_tree(robot), shipped_anatomy(robot)
    assert named(tree, anatomy) == ROLES[robot] and anatomy.head is not None
    assert (tree.nodes[anatomy.pelvis].joint, tree.nodes[anatomy.chest].joint) == TRUNKS[robot]
    assert tree.nodes[anatomy.head].joint == HEADS[robot][-1]
    assert anatomy.forward.tolist() == [1.0, 0.0, 0.0]
    nameless = proposed_anatomy(text_tree(scrambled(robot)))
    assert nameless.legs == anatomy.legs and nameless.arms == anatomy.arms and nameless.head == anatomy.head
    assert nameless.forward == pytest.approx(anatomy.forward)


def test_fingers_are_part_of_the_hand() -> None:
    fingers = [part for side in "pq" for part in (finger(side, 0.015), finger(side, -0.015))]
    tree = text_tree(humanoid([*HUMANOID, *fingers]))
    arm = proposed_anatomy(tree).arms["l"]
    assert tree.nodes[arm.nodes[-1]].joint == "j_p9" and len(arm.ends) == 3


def finger(side: str, x: float) -> Part:
    name, at = f"{side}f{x > 0}", (x, 0.11, 0.0)
    return Part(name, f"{side}9", at, (0, 0, 1), (-0.5, 0.5), (0.01, 0.03, 0.02), (0, 0.015, 0), 0.01)


def test_without_legs_arms_or_a_second_side() -> None:
    arms = [part for part in HUMANOID if part.name[1:] in {"6", "7", "8", "9"}]
    bust = proposed_anatomy(text_tree(humanoid(arms)))
    assert len(bust.arms) == 2 and not bust.legs and bust.head is None
    legs = [part for part in HUMANOID if part.name not in {"face"} and part not in arms]
    walker = proposed_anatomy(text_tree(humanoid(legs)))
    assert len(walker.legs) == 2 and not walker.arms
    arm = text_tree(table_arm())
    alone = proposed_anatomy(arm)
    assert list(alone.arms) == ["r"] and len(alone.arms["r"].nodes) == 4
    found = find_frames(arm, alone)
    assert set(found.frames) == {"neck", "head", "r_shoulder", "r_elbow", "r_hand"}
    assert [text.split(":")[0] for text in found.missing] == ["head", "legs", "l_hand"]
    assert found.frames["r_hand"].position[2] > found.frames["r_elbow"].position[2]
    assert not proposed_anatomy(text_tree(humanoid(TRUNK))).legs


@pytest.mark.parametrize("welded", [True, False])
@pytest.mark.parametrize("words", [("", ""), ("sho", "elbow"), ("hip", "knee")])
def test_two_hanging_limbs_are_arms_by_their_names_or_as_nothing_else_stands(
    words: tuple[str, str], *, welded: bool
) -> None:
    """Limbs that hang to the lowest point look like legs; names decide, and else a torso that is fixed to the world."""
    parts = [
        Part(f"{side}_{word or number}", parent.format(side), at, (0, 1, 0), (-1, 1), (0.03, 0.03, 0.1), (0, 0, -0.06))
        for side, y in (("l", 0.06), ("r", -0.06))
        for number, word, parent, at in (
            ("1", words[0], "torso", (0, y, 0.0)),
            ("2", words[1], f"{side}_{words[0] or '1'}", (0, 0, -0.12)),
        )
    ]
    links = propose_links(text_tree(urdf(parts, base="torso", size=(0.08, 0.08, 0.3))), welded=welded)
    assert (links.l_hand is not None) == (words[0] == "sho" or (welded and not words[0]))


def test_names_decide_where_shapes_do_not() -> None:
    """Feet and knees of a symmetric body say nothing; a name does."""
    two = "".join(
        f'<body name="{name}" pos="0 {y} -0.1"><joint name="{name}_a" axis="0 1 0"/><geom size="0.02"/>'
        f'<body name="{name}2" pos="0 0 -0.1"><joint name="{name}_b" axis="0 1 0"/><geom size="0.02"/></body></body>'
        for name, y in (("left", -0.1), ("right", 0.1))
    )
    text = f'<mujoco><worldbody><body name="b"><geom size="0.05"/>{two}</body></worldbody></mujoco>'
    assert proposed_anatomy(text_tree(text)).forward == pytest.approx([-1.0, 0.0, 0.0])


def test_names_show_limbs_and_neck_where_the_sides_differ() -> None:
    """One arm and the head are 4 and 6 cm off: no mirror image, but Left and Right, and Neck."""
    sides, moved = {"p": "Left", "q": "Right"}, {"Left6": 0.04, "Neck": 0.06}

    def named(name: str) -> str:
        return sides[name[0]] + name[1:] if name[0] in sides else "Neck" if name == "face" else name

    parts = [replace(part, name=named(part.name), parent=named(part.parent)) for part in HUMANOID]
    crooked = [replace(part, at=(part.at[0] + moved.get(part.name, 0.0), *part.at[1:]), extra="") for part in parts]
    whole, found = (proposed_anatomy(text_tree(humanoid(one))) for one in (parts, crooked))
    assert found.arms == whole.arms and found.legs == whole.legs and found.head == whole.head is not None
    nameless = humanoid(crooked).replace("Neck", "n")
    assert proposed_anatomy(text_tree(nameless)).head is None


# Links that are given in place of the proposal.


@given(part=st.sampled_from(["elbow", "hand", "knee", "sole"]), place=st.integers(0, 2))
def test_a_link_on_the_left_gives_its_counterpart_on_the_right(part: str, place: int) -> None:
    """Whatever link of a limb is named, by name or by its place on a limb whose names do not tell."""
    for robot, (left, right) in {"op3": ("l_", "r_"), "unknown": ("p", "q")}.items():
        tree = shipped_tree(robot) if robot == "op3" else text_tree(humanoid())
        proposed = propose_links(tree)
        limb = find_anatomy(tree, proposed).arms if part in ("elbow", "hand") else find_anatomy(tree, proposed).legs
        nodes = limb["l"].nodes[1:]
        link = tree.nodes[nodes[min(place, len(nodes) - 1)]].names[0]
        end = {"hand": "elbow", "sole": "knee"}.get(part)
        given_links = PartLinks.model_validate(
            {f"l_{part}": link, **({f"{s}_{end}": None for s in "lr"} if end else {})}
        )
        links = completed(proposed, given_links, tree)
        assert getattr(links, f"r_{part}") == link.replace(left, right, 1), (robot, link)


def test_what_is_derived_from_a_limb_is_derived_again_where_its_end_is_given() -> None:
    """The elbow and the knee that were proposed lie beyond a hand or a sole that is nearer to the trunk."""
    tree = shipped_tree("op3")
    proposed = propose_links(tree)
    assert proposed.l_elbow is not None and proposed.l_knee is not None
    links = completed(proposed, PartLinks(l_hand="l_sho_roll_link", l_sole="l_hip_pitch_link"), tree)
    assert (links.r_hand, links.r_sole) == ("r_sho_roll_link", "r_hip_pitch_link")
    assert links.l_elbow == "l_sho_roll_link" and links.r_knee is None
    ankle = completed(proposed, PartLinks(l_sole="l_ank_pitch_link"), tree)
    assert (ankle.l_knee, ankle.r_knee) == (proposed.l_knee, proposed.r_knee)
    handless = completed(proposed, PartLinks(l_hand=None), tree)
    assert handless.l_elbow is handless.r_elbow is None and handless.l_knee is not None


def test_links_are_read_strictly(tmp_path: Path) -> None:
    tree, path = shipped_tree("op3"), tmp_path / "links.yaml"
    path.write_text("l_hand: l_elbo\nhat: head\n")
    with refuses(ConfigError, 2, "l_elbo", "hat") as caught:
        read_links(path, tree)
    assert len(caught.value.problems) == 2
    path.write_text("head: null\n")
    links = completed(propose_links(tree), read_links(path, tree), tree)
    assert links.head is None and links.l_hand is not None
    with refuses(ConfigError, "l_elbow"):
        completed(propose_links(tree), PartLinks(l_elbow=links.l_sole), tree)


WRONG = {
    "unknown": ({"l_hand": "nope"}, ("l_hand", "nope")),
    "same soles": ({"l_sole": "r_ank_roll_link", "r_sole": "r_ank_roll_link"}, ("l_sole", "r_sole")),
    "the shin as sole": ({"l_sole": "l_knee_link"}, ("l_sole", "l_knee")),
    "base": ({"l_hand": "body_link"}, ("l_hand", "l_hand: null")),
    "hand on the other arm": ({"l_hand": "r_el_link", "r_hand": "r_sho_roll_link"}, ("l_hand", "r_hand")),
}


@pytest.mark.parametrize("case", WRONG)
def test_links_that_cannot_be_those_parts_are_refused(case: str) -> None:
    parts, facts = WRONG[case]
    tree = shipped_tree("op3")
    with refuses(ConfigError, facts):
        completed(propose_links(tree), PartLinks(**parts), tree)


LOOSE = {"head": 0.01, "l_hand": 0.03, "r_hand": 0.03}  # [m]; drawn by eye in the shipped profiles
EXACT = 0.002


@pytest.mark.parametrize("robot", SHIPPED)
def test_frames_and_soles_are_where_people_put_them(robot: str) -> None:
    known = load_robot(robot)
    found = find_frames(shipped_tree(robot), shipped_anatomy(robot))
    names = tuple(known.profile.frames)
    assert set(found.frames) == set(names) and not found.missing
    at = known.points(known.body.qpos0[None], names)[0]
    for name, place in zip(names, at, strict=True):
        frame = found.frames[name]
        off = float(np.linalg.norm(frame.position - place))
        assert off <= LOOSE.get(name, EXACT), f"{name} is {1e3 * off:.1f} mm off"
        assert shipped_tree(robot).nodes[frame.node].names[0] == known.profile.frames[name].link
    for sole, foot in zip(found.feet.values(), known.profile.feet.values(), strict=True):
        assert is_convex(sole.polygon)
        assert np.ptp(sole.polygon, axis=0) == pytest.approx(np.ptp(np.array(foot.polygon), axis=0), abs=5e-4)


def test_a_sole_that_is_tilted_in_the_zero_pose() -> None:
    tree, anatomy = shipped_tree("wolfgang"), shipped_anatomy("wolfgang")
    sole = flat_underside(tree, anatomy.legs["l"].ends)
    assert sole is not None
    assert np.degrees(np.arctan2(-sole.up[0], sole.up[2])) == pytest.approx(15.0, abs=0.1)  # it says so in its body


def test_a_foot_that_is_a_ball_has_no_sole() -> None:
    text = humanoid().replace('<box size="0.07 0.14 0.02"/>', '<sphere radius="0.03"/>')
    tree = text_tree(text)
    found = find_frames(tree, proposed_anatomy(tree))
    assert not found.feet and any(text.startswith("l_sole: the foot has no flat") for text in found.missing)
