"""Biovision hierarchy files (.bvh).

Rotations multiply in the order in which a joint lists its channels; orders may differ inside one file. The root's
position channels are absolute, and position channels of any other joint replace its OFFSET too. Neither unit nor axes
are stated: the unit is guessed from the size of the body, and the body decides which way is up. A file may hold several
performers, each with a ROOT. Sensors and joints as in `canonical`; heading and ground stay where the file has them.
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

# The HIERARCHY section of a BVH file: joints, offsets and channels.
#
# Names may hold blanks, End Sites have neither name nor channels, keywords and channel names come in any case, and
# braces may stand on a line of their own or behind a statement.

MAX_JOINTS = 1000
MAX_DEPTH = 200
"""Skeletons with more joints, or more deeply nested ones, are refused."""

_CHANNELS: dict[str, Channel] = {
    f"{axis}{word}": (kind, "xyz".index(axis))
    for axis in "xyz"
    for word, kind in (("position", "t"), ("rotation", "r"))
}
"""Channel name in lower case -> "t" or "r", and its axis."""


@dataclass(eq=False)
class _Joint:
    """A joint, or an End Site (no name), as it is read. parent: index, -1 for the root. where: file and line."""

    name: str
    parent: int
    where: str
    offset: list[float] | None = None
    channels: tuple[Channel, ...] = ()
    ends: list[FloatArray] = field(default_factory=list)


@dataclass(frozen=True)
class BvhHierarchy:
    """tree: the skeleton, file axes and units. channels (n): per joint its channels in order. places (n): per joint its
    file and line."""

    tree: JointTree
    channels: tuple[tuple[Channel, ...], ...]
    places: tuple[str, ...]


def read_hierarchy(lines: list[str], path: Path) -> tuple[BvhHierarchy, int]:
    """The skeleton, and the index of the line after MOTION. Raises InputError with file and line."""
    joints: list[_Joint] = []
    blocks: list[_Joint] = []  # that are open
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
            return _assembled(joints), number
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
    """Braces and statements, each with the number of its line."""
    for number, line in enumerate(lines, start=1):
        for part in re.split(r"([{}])", line):
            if part.strip():
                yield number, part.strip()


def _assembled(joints: list[_Joint]) -> BvhHierarchy:
    tree = JointTree(
        names=tuple(joint.name for joint in joints),
        parents=tuple(joint.parent for joint in joints),
        offsets=np.array([joint.offset for joint in joints]),
        ends=tuple(tuple(joint.ends) for joint in joints),
    )
    return BvhHierarchy(tree, tuple(joint.channels for joint in joints), tuple(joint.where for joint in joints))


def _announced(keyword: str, name: str, joints: list[_Joint], blocks: list[_Joint], where: str) -> _Joint:
    """The joint whose block comes next, kept in `joints`; or an End Site."""
    if (keyword == "ROOT") != (not blocks) or (blocks and not blocks[-1].name):
        allowed = "a ROOT for each performer, with JOINTs and End Sites inside"
        raise InputError(f"{keyword} at the wrong place", where=where, allowed=allowed)
    if len(blocks) >= MAX_DEPTH or len(joints) >= MAX_JOINTS:
        allowed = f"up to {MAX_JOINTS} joints, nested up to {MAX_DEPTH} deep"
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
    """What a file holds, in its own axes and units, angles in degrees.

    hierarchy: skeleton and channels. values (T, d): all channels of every frame. rate_hz: frames per second. notes:
    to the user about this file.
    """

    hierarchy: BvhHierarchy
    values: FloatArray
    rate_hz: float
    notes: tuple[str, ...] = ()


def read_bvh(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read a motion; its unit is guessed where none is said. Raises InputError with file and line."""
    motion = read_motion(path, root=options.performer_root, rate=options.rate)
    stated, channels, lost = motion.hierarchy.tree, motion.hierarchy.channels, list[str]()
    # The conversion of the CMU database by B. Hahne is known by its joints without length.
    converted = {"LHipJoint", "LowerBack", "LeftFingerBase", "Neck"} <= set(stated.names)
    if converted and not stated.offsets[stated.names.index("Neck")].any():
        lost.append(LOST_LENGTHS)
    tree, values, notes = true_offsets(stated, channels, motion.values)
    return canonical_frames(
        tree,
        posed(tree, channels, values),
        unit=None,
        rate=motion.rate_hz,
        source=str(path),
        options=options,
        notes=(*motion.notes, *lost, *notes),
    )


def read_motion(path: Path, *, root: str | None = None, rate: float | None = None) -> BvhMotion:
    """Read and check a whole file. root: the name of the ROOT of which the motion is taken; it may be left out where
    there is one. rate: Hz, instead of the file's. Raises InputError with file and line, and UsageError for a root that
    the file does not have."""
    lines = read_lines(path)
    hierarchy, motion_line = read_hierarchy(lines, path)
    declared, place, stated, first = _read_motion_header(lines, motion_line, path)
    rate = _stated_rate(*stated) if rate is None else check_rate(rate, "--rate")
    values = _read_values(lines[first:], sum(map(len, hierarchy.channels)), path, first)
    check_frame_count(len(values), str(path))
    notes = frames_held(len(values), declared, place)
    return _of_root(BvhMotion(hierarchy, values, rate, notes), root)


def _of_root(motion: BvhMotion, root: str | None) -> BvhMotion:
    """The joints below one ROOT of a motion, and their columns."""
    tree, channels, places = motion.hierarchy.tree, motion.hierarchy.channels, motion.hierarchy.places
    roots: dict[str, int] = {}
    for joint in (joint for joint, parent in enumerate(tree.parents) if parent < 0):
        name = tree.names[joint]
        roots[name if name not in roots else f"{name} ({len(roots) + 1})"] = joint
    if root is not None and root not in roots:
        raise UsageError(
            "no such ROOT in the file",
            where=f"{places[0]}, --performer-root",
            found=repr(root)[:80],
            allowed=", ".join(roots),
            next_step=suggest(root, roots),
        )
    if root is None and len(roots) > 1:
        raise InputError(
            f"{len(roots)} performers in the file",
            where=places[[*roots.values()][1]],
            found=f"ROOT {', ROOT '.join(roots)}",
            next_step=f"Say whom to follow, for example --performer-root {shlex.quote(next(iter(roots)))}",
        )
    if len(roots) == 1:
        return motion
    own = [joint for joint in range(len(tree.names)) if tree.path(joint)[0] == roots[str(root)]]
    part = JointTree(
        names=tuple(tree.names[joint] for joint in own),
        parents=tuple(own.index(tree.parents[joint]) if tree.parents[joint] in own else -1 for joint in own),
        offsets=tree.offsets[own],
        ends=tuple(tree.ends[joint] for joint in own),
    )
    starts = np.cumsum([0, *map(len, channels)])
    columns = [column for joint in own for column in range(starts[joint], starts[joint + 1])]
    hierarchy = BvhHierarchy(part, tuple(channels[joint] for joint in own), tuple(places[joint] for joint in own))
    return BvhMotion(hierarchy, motion.values[:, columns], motion.rate_hz, motion.notes)


def _read_motion_header(lines: list[str], start: int, path: Path) -> tuple[int, str, tuple[str, str], int]:
    """Number of frames and the line that declares it, frame time as text with its line, and the index of the first line
    of data."""
    filled = [index for index in range(start, min(start + 100, len(lines))) if lines[index].strip()][:2]
    pairs = [lines[index].partition(":") for index in filled]
    keys = [" ".join(key.lower().split()) for key, _, _ in pairs]
    for place, wanted in enumerate(("frames", "frame time")):
        if keys[place : place + 1] != [wanted]:
            where = f"{path}:{filled[place] + 1 if place < len(filled) else len(lines)}"
            raise InputError(
                "incomplete MOTION section", where=where, allowed="'Frames: N', then 'Frame Time: seconds'"
            )
    count, interval = (value.strip() for _, _, value in pairs)
    count_place, interval_place = (f"{path}:{index + 1}" for index in filled)
    if not (count.isascii() and count.isdecimal() and len(count) <= 12):
        raise InputError("wrong number of frames", where=count_place, found=repr(count[:40]), allowed="a whole number")
    check_frame_count(int(count), count_place)
    return int(count), count_place, (interval, interval_place), filled[1] + 1


def _stated_rate(interval: str, place: str) -> float:
    """The rate (Hz) of a frame time. It is written with few digits (0.008333): a rate within 0.02 % of a whole number
    is that number."""
    seconds = numbers([interval], place)[0]
    if seconds <= 0.0:
        raise InputError(
            "impossible frame time",
            where=place,
            found=interval,
            allowed="seconds above 0",
            next_step="Correct it, for 120 Hz to 0.008333, or say the frames per second with --rate",
        )
    rate = check_rate(1.0 / seconds, place)
    return float(round(rate)) if abs(rate - round(rate)) < 2e-4 * rate else rate


def _read_values(lines: list[str], width: int, path: Path, before: int) -> FloatArray:
    """All channel values (T, d), one frame per line. before: number of lines that precede these in the file."""
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
