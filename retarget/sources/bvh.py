"""Biovision hierarchy files (.bvh).

Rotations multiply in the order of a joint's channels, which may differ inside one file. Position channels of the root
are absolute; those of other joints replace their OFFSET. Unit and axes are not stated: the recorded body decides. A
file may hold several performers, each with a ROOT. Heading and ground stay as in the file.

Names may hold blanks, End Sites have neither name nor channels, keywords come in any case, and braces may stand behind
a statement.
"""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from retarget.errors import InputError, UsageError, suggest
from retarget.frames import SensorFrames
from retarget.sources.canonical import canonical_frames
from retarget.sources.files import (
    AS_WRITTEN,
    ReadOptions,
    check_frame_count,
    check_rate,
    cut_short,
    frames_held,
    numbers,
    read_lines,
)
from retarget.sources.rest_skeleton import true_offsets
from retarget.sources.skeletons import Channel, JointTree, posed
from retarget.types import FloatArray

MAX_JOINTS = 1000
MAX_SKELETON_DEPTH = 200
"""Most joints of a skeleton, and most levels of nesting."""

_CHANNELS: dict[str, Channel] = {
    f"{axis}{word}": (kind, "xyz".index(axis))
    for axis in "xyz"
    for word, kind in (("position", "t"), ("rotation", "r"))
}
"""Channel name in lower case -> "t" or "r", and its axis."""


@dataclass(eq=False)
class _Joint:
    """A joint, or an End Site (no name). parent: index, -1 for a root."""

    name: str
    parent: int
    where: str
    offset: list[float] | None = None
    channels: tuple[Channel, ...] = ()
    ends: list[FloatArray] = field(default_factory=list)


def _read_hierarchy(lines: list[str], path: Path) -> tuple[list[_Joint], int]:
    """The joints, parents first, and the index of the line after MOTION. Raises InputError with file and line."""
    joints: list[_Joint] = []
    blocks: list[_Joint] = []  # open ones
    announced: _Joint | None = None
    number, begun = 0, False
    for number, text in _parts(lines):
        where, words = f"{path}:{number}", text.split()
        keyword = words[0].upper()
        if not begun:
            if text.upper() != "HIERARCHY":
                step = "Check that this is the recording, as text and unpacked"
                raise InputError(
                    "not a BVH file", where=where, found=repr(text[:40]), allowed="HIERARCHY", next_step=step
                )
            begun = True
        elif announced is not None and text != "{":
            raise InputError("a block is missing its '{'", where=where, found=repr(text[:40]))
        elif text == "{":
            if announced is None:
                raise InputError("a '{' without ROOT, JOINT or End Site", where=where)
            blocks.append(announced)
            announced = None
        elif text == "}":
            if not blocks:
                raise InputError("a '}' too many", where=where)
            joint = blocks.pop()
            if joint.name and joint.offset is None:
                raise InputError("joint without OFFSET", where=where, found=repr(joint.name)[:80])
        elif text.upper() == "MOTION":
            if blocks or not joints:
                raise InputError("MOTION before the skeleton is complete", where=where, next_step="Count the braces")
            return joints, number
        elif keyword == "END" or (keyword in ("ROOT", "JOINT") and len(words) > 1):
            announced = _announced(keyword, " ".join(words[1:]), joints, blocks, where)
        elif keyword == "OFFSET" and blocks:
            if len(words) != 4:
                raise InputError("OFFSET needs three numbers", where=where, found=repr(" ".join(words[1:]))[:80])
            blocks[-1].offset = numbers(words[1:], where)
            if not blocks[-1].name:
                joints[blocks[-1].parent].ends.append(np.array(blocks[-1].offset))
        elif keyword == "CHANNELS" and blocks and blocks[-1].name:
            blocks[-1].channels = _channels(words[1:], where)
        else:
            allowed = "ROOT, JOINT, End Site, OFFSET, CHANNELS, { and }"
            raise InputError("unknown statement", where=where, found=repr(text[:40]), allowed=allowed)
    raise InputError("no MOTION section", where=f"{path}:{len(lines)}", next_step="The file is cut short: get it again")


def _parts(lines: list[str]) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(lines, start=1):
        for part in re.split(r"([{}])", line):
            if part.strip():
                yield number, part.strip()


def _announced(keyword: str, name: str, joints: list[_Joint], blocks: list[_Joint], where: str) -> _Joint:
    """The joint whose block comes next, added to `joints`; or an End Site."""
    if (keyword == "ROOT") != (not blocks) or (blocks and not blocks[-1].name):
        allowed = "a ROOT for each performer, with JOINTs and End Sites inside"
        raise InputError(f"{keyword} at the wrong place", where=where, allowed=allowed)
    if len(blocks) >= MAX_SKELETON_DEPTH or len(joints) >= MAX_JOINTS:
        allowed = f"up to {MAX_JOINTS} joints, nested up to {MAX_SKELETON_DEPTH} deep"
        raise InputError("skeleton too large", where=where, allowed=allowed)
    parent = joints.index(blocks[-1]) if blocks else -1
    if keyword == "END":
        return _Joint("", parent, where)
    own = joints[joints.index(blocks[0]) :] if blocks else []  # performers may have joints of the same names
    if name in [joint.name for joint in own]:
        raise InputError("joint defined twice", where=where, found=repr(name)[:80])
    joints.append(_Joint(name, parent, where))
    return joints[-1]


def _channels(words: list[str], where: str) -> tuple[Channel, ...]:
    names = [word.lower() for word in words[1:]]
    if not words or not words[0].isdecimal() or words[0].lstrip("0") != str(len(names)).lstrip("0"):
        raise InputError(
            "wrong channel count",
            where=where,
            found=" ".join(words)[:80],
            allowed=f"{len(names)}, then as many channel names",
            next_step="Correct the number before the names, or add the names that are missing",
        )
    for name in names:
        if name not in _CHANNELS:
            allowed, step = ", ".join(_CHANNELS), suggest(name, _CHANNELS)
            raise InputError("unknown channel", where=where, found=repr(name)[:80], allowed=allowed, next_step=step)
    if len(set(names)) != len(names):
        raise InputError("a channel twice in one joint", where=where, found=" ".join(names)[:80])
    return tuple(_CHANNELS[name] for name in names)


LOST_LENGTHS = (
    "this conversion of a CMU trial lost the lengths of thorax and wrist:"
    " about 0.12 m of the trunk and 0.09 m of each forearm are missing"
)


@dataclass(frozen=True)
class BvhMotion:
    """Motion of a file in its axes and units, angles in degrees. channels (n): of each joint, in the order of values
    (T, d). notes: for the user."""

    tree: JointTree
    channels: tuple[tuple[Channel, ...], ...]
    values: FloatArray
    rate_hz: float
    notes: tuple[str, ...] = ()


def read_bvh(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read a motion; its unit is guessed if the user gives none. Raises InputError with file and line."""
    motion = read_motion(path, root=options.performer_root, rate=options.rate)
    stated, lost = motion.tree, list[str]()
    # The conversion of the CMU database by B. Hahne has these joints, without lengths.
    converted = {"LHipJoint", "LowerBack", "LeftFingerBase", "Neck"} <= set(stated.names)
    if converted and not stated.offsets[stated.names.index("Neck")].any():
        lost.append(LOST_LENGTHS)
    tree, values, notes = true_offsets(stated, motion.channels, motion.values)
    return canonical_frames(
        tree,
        posed(tree, motion.channels, values),
        unit=None,
        rate=motion.rate_hz,
        source=str(path),
        options=options,
        notes=(*motion.notes, *lost, *notes),
    )


def read_motion(path: Path, *, root: str | None = None, rate: float | None = None) -> BvhMotion:
    """Read and check a whole file. root: name of the ROOT to read, needed if there are several. rate: Hz, instead of
    that in the file. Raises InputError with file and line, and UsageError for an unknown root."""
    lines = read_lines(path)
    joints, motion_line = _read_hierarchy(lines, path)
    declared, place, rate, first = _read_motion_header(lines, motion_line, path, rate)
    starts = np.cumsum([0, *(len(joint.channels) for joint in joints)])
    values = _read_values(lines[first:], int(starts[-1]), path, first)
    check_frame_count(len(values), str(path))
    notes = frames_held(len(values), declared, place)
    kept = _below_root(joints, root)
    if len(kept) < len(joints):
        values = values[:, [column for joint in kept for column in range(starts[joint], starts[joint + 1])]]
    own = [joints[joint] for joint in kept]
    tree = JointTree(
        names=tuple(joint.name for joint in own),
        parents=tuple(kept.index(joint.parent) if joint.parent >= 0 else -1 for joint in own),
        offsets=np.array([joint.offset for joint in own]),
        ends=tuple(tuple(joint.ends) for joint in own),
    )
    return BvhMotion(tree, tuple(joint.channels for joint in own), values, rate, notes)


def _below_root(joints: list[_Joint], root: str | None) -> list[int]:
    """Indices of a ROOT and the joints below it. Raises UsageError or InputError."""
    roots: dict[str, int] = {}
    for index, joint in enumerate(joints):
        if joint.parent < 0:
            roots[joint.name if joint.name not in roots else f"{joint.name} ({len(roots) + 1})"] = index
    if root is not None and root not in roots:
        raise UsageError(
            "no such ROOT in the file",
            where=f"{joints[0].where}, --performer-root",
            found=repr(root)[:80],
            allowed=", ".join(roots),
            next_step=suggest(root, roots),
        )
    if root is None and len(roots) > 1:
        raise InputError(
            f"{len(roots)} performers in the file",
            where=joints[[*roots.values()][1]].where,
            found=f"ROOT {', ROOT '.join(roots)}",
            next_step=f"Say whom to follow, for example --performer-root {shlex.quote(next(iter(roots)))}",
        )
    below = {roots[root or next(iter(roots))]}
    for index, joint in enumerate(joints):  # parents come first
        if joint.parent in below:
            below.add(index)
    return sorted(below)


def _read_motion_header(lines: list[str], start: int, path: Path, rate: float | None) -> tuple[int, str, float, int]:
    """Number of frames and its line, rate (Hz, the user's if given), and the index of the first line of data."""
    filled = [index for index in range(start, min(start + 100, len(lines))) if lines[index].strip()][:2]
    pairs = [lines[index].partition(":") for index in filled]
    keys = [" ".join(key.lower().split()) for key, _, _ in pairs]
    for place, expected in enumerate(("frames", "frame time")):
        if keys[place : place + 1] != [expected]:
            where = f"{path}:{filled[place] + 1 if place < len(filled) else len(lines)}"
            raise InputError(
                "incomplete MOTION section", where=where, allowed="'Frames: N', then 'Frame Time: seconds'"
            )
    count, interval = (value.strip() for _, _, value in pairs)
    count_place, interval_place = (f"{path}:{index + 1}" for index in filled)
    if not (count.isascii() and count.isdecimal() and len(count) <= 12):
        raise InputError("wrong number of frames", where=count_place, found=repr(count[:40]), allowed="a whole number")
    check_frame_count(int(count), count_place)
    if rate is not None:
        return int(count), count_place, check_rate(rate, "--rate"), filled[1] + 1
    seconds = numbers([interval], interval_place)[0]
    if seconds <= 0.0:
        raise InputError(
            "impossible frame time",
            where=interval_place,
            found=interval,
            allowed="seconds above 0",
            next_step="Correct it, for 120 Hz to 0.008333, or say the frames per second with --rate",
        )
    rate = check_rate(1.0 / seconds, interval_place)
    if abs(rate - round(rate)) < 2e-4 * rate:  # frame times have few digits (0.008333)
        rate = float(round(rate))
    return int(count), count_place, rate, filled[1] + 1


def _read_values(lines: list[str], width: int, path: Path, before: int) -> FloatArray:
    """All channel values (T, d), one frame per line. before: number of lines before these in the file."""
    if width == 0:
        raise InputError("a skeleton without channels", where=f"{path}:{before}", next_step="Export it with motion")
    rows: list[list[float]] = []
    for index, line in enumerate(lines):
        if not (words := line.split()):
            continue
        where = f"{path}:{before + index + 1}"
        try:
            if len(words) != width:
                raise InputError(
                    "wrong number of values in a frame",
                    where=where,
                    found=len(words),
                    allowed=f"{width}, one for each channel",
                    next_step="Correct the frame or the CHANNELS of the skeleton, or export the file again",
                )
            rows.append(numbers(words, where))
        except InputError as error:
            raise cut_short(error, lines[index + 1 :]) from None
    return np.array(rows)
