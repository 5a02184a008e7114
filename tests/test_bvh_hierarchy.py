"""Skeletons of BVH files: legal variety is read, every fault has its line."""

from pathlib import Path

import numpy as np
import pytest

from motion_texts import bvh_text
from retarget.errors import InputError
from retarget.sources.bvh import read_bvh
from retarget.sources.bvh_hierarchy import MAX_DEPTH, MAX_JOINTS
from support.messages import Facts, refuses, shows


def write(folder: Path, text: str) -> Path:
    path = folder / "motion.bvh"
    path.write_text(text)
    return path


def test_braces_blanks_in_names_tabs_and_case(tmp_path: Path) -> None:
    text = bvh_text(names={"LeftArm": "Left Arm", "Hips": "rig:Hips"}).replace("\n{", " {").replace("JOINT", "joint")
    text = text.replace("    ", "\t").replace("Frames: 3", "FRAMES:\t3").replace("Frame Time: ", "Frame Time:\t")
    plain, other = read_bvh(write(tmp_path, bvh_text())), read_bvh(write(tmp_path, text.replace("\n", "\r\n")))
    np.testing.assert_array_equal(plain.position, other.position)


@pytest.mark.parametrize(
    ("old", "new", "facts"),
    [
        ("HIERARCHY", "ANARCHY", "BVH"),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 4 Zrotation Xrotation Yrotation", ()),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS three", ()),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS", ()),
        ("CHANNELS 3 Zrotation Xrotation", "CHANNELS 3 Zrotation Xrotatoin", ("xrotatoin", "xrotation")),
        ("CHANNELS 3 Zrotation Xrotation", "CHANNELS 3 Zrotation Zrotation", ()),
        ("JOINT LeftLeg", "JOINT LeftUpLeg", "LeftUpLeg"),
        ("JOINT LeftLeg", "JOINT", ()),
        ("JOINT LeftLeg", "ROOT LeftLeg", "ROOT"),
        ("OFFSET 9 -9 0", "OFFSET 9 -9", "OFFSET"),
        ("OFFSET 9 -9 0", "OFFSET 9 nan 0", ()),
        ("OFFSET 9 -9 0", "OFFSET 9 x 0", ()),
        ("OFFSET 9 -9 0", "OFSET 9 -9 0", ()),
        ("MOTION", "}\nMOTION", "'}'"),
        ("MOTION", "ROOT second\n{\nOFFSET 0 0 0\n}\nMOTION", "ROOT"),
    ],
)
def test_each_fault_has_its_line(tmp_path: Path, old: str, new: str, facts: Facts) -> None:
    text = bvh_text()
    assert old in text
    path = write(tmp_path, text.replace(old, new, 1))
    with refuses(InputError, facts) as caught:
        read_bvh(path)
    place, _, number = caught.value.problems[0].where.rpartition(":")
    assert place == str(path)
    assert int(number) == text[: text.index(old)].count("\n") + 1


def test_absurd_skeletons_are_refused_without_recursion(tmp_path: Path) -> None:
    deep = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n" + "".join(
        f"JOINT j{i}\n{{\nOFFSET 0 1 0\n" for i in range(5 * MAX_DEPTH)
    )
    with refuses(InputError, MAX_DEPTH):
        read_bvh(write(tmp_path, deep))
    wide = "".join(f"JOINT j{i}\n{{\nOFFSET 0 1 0\n}}\n" for i in range(MAX_JOINTS + 1))
    with refuses(InputError, MAX_JOINTS):
        read_bvh(write(tmp_path, f"HIERARCHY\nROOT a\n{{\nOFFSET 0 0 0\n{wide}}}\nMOTION\n"))


def test_a_skeleton_that_is_no_human_is_refused(tmp_path: Path) -> None:
    text = "HIERARCHY\nROOT tail\n{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Yrotation Zrotation\n"
    text += "End Site\n{\nOFFSET 0 1 0\n}\n}\n"
    with refuses(InputError):
        read_bvh(write(tmp_path, text + "MOTION\nFrames: 1\nFrame Time: 0.01\n0 0 0\n"))
    # The right names on the wrong tree: the knee is no descendant of the hip.
    swapped = bvh_text(names={"LeftLeg": "LeftForeArm", "LeftForeArm": "LeftLeg"})
    shows(read_bvh(write(tmp_path, swapped)).notes)
