"""Joint names of the skeletons that motion files hold, as data, and finding the canonical joints by them.

A name is compared in lower case, without its name space (`mixamorig:`), blanks, points, dashes and underscores, and
without a prefix that all joints share (`Bip01`). In a side's entry `{s}` stands for the style's word of that side.
Where several names are given, the first that occurs counts.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["STYLES", "NamingStyle", "joints_by_name", "plain_names"]

REQUIRED = (
    "pelvis",
    "head",
    *(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in "lr"),
)
"""Joints that a style must find before it counts."""


@dataclass(frozen=True)
class NamingStyle:
    """One family of joint names. words: what stands for left and right. middle, sided: canonical joint -> names."""

    name: str
    words: tuple[str, str]
    middle: Mapping[str, tuple[str, ...]]
    sided: Mapping[str, tuple[str, ...]]


def _style(name: str, *, words: tuple[str, str], middle: dict[str, str], **sided: str) -> NamingStyle:
    """A row of the table below; names that mean the same are separated by blanks."""
    return NamingStyle(
        name,
        words,
        {joint: tuple(names.split()) for joint, names in middle.items()},
        {part: tuple(names.split()) for part, names in sided.items()},
    )


STYLES: tuple[NamingStyle, ...] = (
    _style(
        "CMU ASF",
        words=("l", "r"),
        middle={"pelvis": "root", "neck": "lowerneck", "head": "head"},
        collar="{s}clavicle",
        shoulder="{s}humerus",
        elbow="{s}radius",
        wrist="{s}hand",
        hand="{s}fingers",
        hip="{s}femur",
        knee="{s}tibia",
        ankle="{s}foot",
        toe="{s}toes",
    ),
    _style(
        "HumanIK (MotionBuilder, Mixamo, CMU BVH)",
        words=("left", "right"),
        middle={"pelvis": "hips", "neck": "neck", "head": "head", "head_top": "headtopend headend headtop"},
        collar="{s}shoulder",
        shoulder="{s}arm",
        elbow="{s}forearm",
        wrist="{s}hand",
        hand="{s}handmiddle1 {s}handindex1",
        hip="{s}upleg",
        knee="{s}leg",
        ankle="{s}foot",
        toe="{s}toebase",
    ),
    _style(
        "joints by anatomy (Biovision, Mocapbank, SMPL)",
        words=("left", "right"),
        middle={"pelvis": "hips pelvis", "neck": "neck neck1", "head": "head"},
        collar="{s}collar",
        shoulder="{s}shoulder",
        elbow="{s}elbow",
        wrist="{s}wrist",
        hand="{s}middle1 {s}index1",
        hip="{s}hip",
        knee="{s}knee",
        ankle="{s}ankle",
        toe="{s}toe {s}foot",
    ),
    _style(
        "Xsens MVN",
        words=("left", "right"),
        middle={"pelvis": "hips pelvis", "neck": "neck", "head": "head"},
        collar="{s}shoulder",
        shoulder="{s}upperarm",
        elbow="{s}forearm",
        wrist="{s}hand",
        hip="{s}upperleg",
        knee="{s}lowerleg",
        ankle="{s}foot",
        toe="{s}toe",
    ),
    _style(
        "Daz / Poser",
        words=("l", "r"),
        middle={"pelvis": "hip", "neck": "neck necklower", "head": "head"},
        collar="{s}collar",
        shoulder="{s}shldr {s}shldrbend",
        elbow="{s}forearm {s}forearmbend",
        wrist="{s}hand",
        hand="{s}mid1",
        hip="{s}thigh {s}thighbend",
        knee="{s}shin",
        ankle="{s}foot",
        toe="{s}toe",
    ),
    _style(
        "OptiTrack Motive",
        words=("l", "r"),
        middle={"pelvis": "hip", "neck": "neck", "head": "head"},
        collar="{s}shoulder",
        shoulder="{s}uarm",
        elbow="{s}farm",
        wrist="{s}hand",
        hip="{s}thigh",
        knee="{s}shin",
        ankle="{s}foot",
        toe="{s}toe",
    ),
    _style(
        "3ds Max Biped",
        words=("l", "r"),
        middle={"pelvis": "pelvis", "neck": "neck", "head": "head"},
        collar="{s}clavicle",
        shoulder="{s}upperarm",
        elbow="{s}forearm",
        wrist="{s}hand",
        hand="{s}finger2 {s}finger1",
        hip="{s}thigh",
        knee="{s}calf",
        ankle="{s}foot",
        toe="{s}toe0",
    ),
    _style(
        "Unreal",
        words=("l", "r"),
        middle={"pelvis": "pelvis", "neck": "neck01", "head": "head"},
        collar="clavicle{s}",
        shoulder="upperarm{s}",
        elbow="lowerarm{s}",
        wrist="hand{s}",
        hand="middle01{s}",
        hip="thigh{s}",
        knee="calf{s}",
        ankle="foot{s}",
        toe="ball{s}",
    ),
    _style(
        "endorphin",
        words=("left", "right"),
        middle={"pelvis": "root", "neck": "lowerneckjoint", "head": "upperneckjoint"},
        collar="{s}claviclejoint",
        shoulder="{s}shoulderjoint",
        elbow="{s}elbowjoint",
        wrist="{s}wristjoint",
        hand="{s}fingersjoint",
        hip="{s}hipjoint",
        knee="{s}kneejoint",
        ankle="{s}anklejoint",
        toe="{s}toesjoint",
    ),
)


def plain_names(names: tuple[str, ...]) -> list[str]:
    """Joint names as they are compared with the tables."""
    plain = [re.sub(r"[\s._\-]", "", name.rsplit(":", 1)[-1]).lower() for name in names]
    shared = _shared_start([name for name in plain if name])
    if len(shared) < 3 or len(plain) < 2:
        return plain
    return [name.removeprefix(shared) for name in plain]


def _shared_start(names: list[str]) -> str:
    """The longest start that all names share."""
    first, last = min(names, default=""), max(names, default="")
    length = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:length]


def joints_by_name(names: tuple[str, ...]) -> dict[str, int] | None:
    """Canonical joint (and `head_top`) -> index in `names`, by the style that knows the most; None if none fits."""
    plain = plain_names(names)
    index: dict[str, int] = {}
    for i, name in enumerate(plain):
        index.setdefault(name, i)
    found = [joints for style in STYLES if set(REQUIRED) <= set(joints := _apply(style, index))]
    return max(found, key=len, default=None)


def _apply(style: NamingStyle, index: Mapping[str, int]) -> dict[str, int]:
    """The joints of one style that occur."""
    wanted = dict(style.middle)
    for side, word in zip("lr", style.words, strict=True):
        wanted |= {
            f"{side}_{part}": tuple(name.format(s=word) for name in names) for part, names in style.sided.items()
        }
    joints = {}
    for joint, candidates in wanted.items():
        match = next((index[name] for name in candidates if name in index), None)
        if match is not None:
            joints[joint] = match
    # The pelvis is the root whatever it is called (a Biped's own root carries no name of its own).
    joints.setdefault("pelvis", 0)
    return joints
