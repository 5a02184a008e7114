"""Biovision hierarchy files (.bvh).

Channels are read per joint in their listed order and rotations multiply in that order. The root's position channels are
absolute, and position channels of any other joint replace its OFFSET too. Names may hold blanks, End Sites have neither name
nor channels. Neither unit nor axes are stated: the unit is guessed from the size of the body, and y is up unless the rest
pose or the frames say otherwise. Sensors and joints as in `canonical`; heading and ground stay where the file has them.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from retarget import rotations
from retarget.errors import InputError, suggest
from retarget.frames import SensorFrames
from retarget.rotations import FloatArray
from retarget.sources.canonical import canonical_frames
from retarget.sources.files import check_frame_count, check_rate, numbers, read_lines
from retarget.sources.tree import JointTree, Pose, forward_kinematics
from retarget.sources.units import named_unit

__all__ = ["MAX_DEPTH", "MAX_JOINTS", "BvhMotion", "pose_of", "read_bvh", "read_motion"]

MAX_JOINTS = 1000
MAX_DEPTH = 200
"""Skeletons with more joints, or more deeply nested ones, are refused."""

_CHANNELS = {f"{axis}{kind}": (kind[0], "xyz".index(axis)) for axis in "xyz" for kind in ("position", "rotation")}
"""Channel name in lower case -> ("p" or "r", axis)."""


@dataclass(frozen=True)
class BvhMotion:
    """What a file holds, in its own axes and units, angles in degrees.

    tree: the skeleton. channels (n): per joint its channels in order, each ("p" or "r", axis). values (T, d): all channels.
    rate_hz: frames per second.
    """

    tree: JointTree
    channels: tuple[tuple[tuple[str, int], ...], ...]
    values: FloatArray
    rate_hz: float


@dataclass
class _Draft:
    """The hierarchy as it is read. open: indices of open blocks, None for an End Site."""

    path: Path
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float] | None] = field(default_factory=list)
    channels: list[tuple[tuple[str, int], ...]] = field(default_factory=list)
    ends: list[list[FloatArray]] = field(default_factory=list)
    open: list[int | None] = field(default_factory=list)
    announced: str = ""

    def error(
        self, what: str, line: int, *, found: object = "", allowed: object = "", next_step: str = ""
    ) -> InputError:
        return InputError(
            what, where=f"{self.path}:{line}", found=str(found)[:80], allowed=allowed, next_step=next_step
        )


def read_bvh(path: Path, *, unit: str | None = None, rate: float | None = None) -> SensorFrames:
    """Read a motion. unit: a name of `units.UNITS` instead of the guess. rate: frames per second instead of the file's.

    Raises InputError with file and line.
    """
    motion = read_motion(path)
    pose = pose_of(motion)
    return canonical_frames(
        motion.tree,
        pose,
        unit=None if unit is None else named_unit(unit),
        rate=motion.rate_hz if rate is None else check_rate(rate, str(path)),
        source=str(path),
        detect_up=True,
        notes=_notes(motion, pose),
    )


def read_motion(path: Path) -> BvhMotion:
    """Read and check a whole file. Raises InputError with file and line."""
    lines = read_lines(path)
    draft, motion_line = _read_hierarchy(lines, path)
    frames, rate, first = _read_motion_header(lines, motion_line, draft)
    tree = JointTree(
        names=tuple(draft.names),
        parents=tuple(draft.parents),
        offsets=np.array([offset or [0.0] * 3 for offset in draft.offsets]),
        ends=tuple(tuple(ends) for ends in draft.ends),
    )
    return BvhMotion(tree, tuple(draft.channels), _read_values(lines, first, frames, draft), rate)


def pose_of(motion: BvhMotion) -> Pose:
    """Forward kinematics of all frames (file axes and units)."""
    frames, joints = len(motion.values), len(motion.tree.names)
    local = np.broadcast_to(rotations.IDENTITY, (frames, joints, 4)).copy()
    translation = np.broadcast_to(motion.tree.offsets, (frames, joints, 3)).copy()
    start = 0
    for joint, channels in enumerate(motion.channels):
        values = motion.values[:, start : start + len(channels)]
        start += len(channels)
        turns = [i for i, (kind, _) in enumerate(channels) if kind == "r"]
        if turns:
            local[:, joint] = rotations.from_euler(np.radians(values[:, turns]), [channels[i][1] for i in turns])
        for i, (kind, axis) in enumerate(channels):
            if kind == "p":
                translation[:, joint, axis] = values[:, i]
    return forward_kinematics(motion.tree, local, translation)


def _read_hierarchy(lines: list[str], path: Path) -> tuple[_Draft, int]:
    """The skeleton, and the index of the line after MOTION."""
    draft, begun = _Draft(path), False
    for index, line in enumerate(lines):
        # Braces may stand on a line of their own or at the end of another.
        for part in re.split(r"([{}])", line):
            text = part.strip()
            if not text:
                continue
            if not begun:
                if text.upper() != "HIERARCHY":
                    raise draft.error("not a BVH file", index + 1, found=repr(text[:40]), allowed="HIERARCHY")
                begun = True
            elif text.upper() == "MOTION":
                if draft.open or not draft.names:
                    raise draft.error("MOTION before the skeleton is complete", index + 1, next_step="Count the braces")
                return draft, index + 1
            else:
                _hierarchy_part(draft, text, index + 1)
    raise draft.error("no MOTION section", len(lines), next_step="The file is cut short: get it again")


def _hierarchy_part(draft: _Draft, text: str, line: int) -> None:
    """One brace or statement of the hierarchy."""
    words = text.split()
    keyword = words[0].upper()
    if draft.announced and text != "{":
        raise draft.error("a block is missing its '{'", line, found=repr(text[:40]))
    if text == "{":
        _open_block(draft, line)
    elif text == "}":
        if not draft.open:
            raise draft.error("a '}' too many", line)
        _close_block(draft, line)
    elif keyword in ("ROOT", "JOINT") and len(words) > 1 or keyword == "END":
        _announce(draft, keyword, " ".join(words[1:]), line)
    elif keyword == "OFFSET" and draft.open:
        offset = _offset(draft, words[1:], line)
        if draft.open[-1] is None:
            draft.ends[next(i for i in reversed(draft.open) if i is not None)].append(np.array(offset))
        else:
            draft.offsets[draft.open[-1]] = offset
    elif keyword == "CHANNELS" and draft.open and draft.open[-1] is not None:
        draft.channels[draft.open[-1]] = _channels(draft, words[1:], line)
    else:
        raise draft.error(
            "unknown statement", line, found=repr(text[:40]), allowed="ROOT, JOINT, End Site, OFFSET, CHANNELS, { and }"
        )


def _announce(draft: _Draft, keyword: str, name: str, line: int) -> None:
    """The head of a block."""
    if (keyword == "ROOT") != (not draft.open) or (draft.open and draft.open[-1] is None):
        raise draft.error(f"{keyword} at the wrong place", line, allowed="one ROOT, with JOINTs and End Sites inside")
    if keyword == "ROOT" and draft.names:
        raise draft.error("a second ROOT", line, found=repr(name), next_step="Split the file: one performer per file")
    if keyword != "END" and name in draft.names:
        raise draft.error("joint defined twice", line, found=repr(name))
    draft.announced = "End Site" if keyword == "END" else f"{keyword} {name}"


def _open_block(draft: _Draft, line: int) -> None:
    if not draft.announced:
        raise draft.error("a '{' without ROOT, JOINT or End Site", line)
    if len(draft.open) >= MAX_DEPTH or len(draft.names) >= MAX_JOINTS:
        raise draft.error(
            "skeleton too large", line, allowed=f"up to {MAX_JOINTS} joints, nested up to {MAX_DEPTH} deep"
        )
    if draft.announced == "End Site":
        draft.open.append(None)
    else:
        draft.parents.append(draft.open[-1] if draft.open and draft.open[-1] is not None else -1)
        draft.names.append(draft.announced.split(" ", 1)[1])
        draft.offsets.append(None)
        draft.channels.append(())
        draft.ends.append([])
        draft.open.append(len(draft.names) - 1)
    draft.announced = ""


def _close_block(draft: _Draft, line: int) -> None:
    joint = draft.open.pop()
    if joint is not None and draft.offsets[joint] is None:
        raise draft.error("joint without OFFSET", line, found=repr(draft.names[joint]))


def _offset(draft: _Draft, words: list[str], line: int) -> list[float]:
    if len(words) != 3:
        raise draft.error("OFFSET needs three numbers", line, found=repr(" ".join(words)))
    return numbers(words, f"{draft.path}:{line}")


def _channels(draft: _Draft, words: list[str], line: int) -> tuple[tuple[str, int], ...]:
    names = [word.lower() for word in words[1:]]
    if not words or not words[0].isdecimal() or words[0].lstrip("0") != str(len(names)).lstrip("0"):
        raise draft.error(
            "wrong channel count", line, found=" ".join(words), allowed=f"{len(names)}, then as many channel names"
        )
    for name in names:
        if name not in _CHANNELS:
            raise draft.error(
                "unknown channel",
                line,
                found=repr(name),
                allowed=", ".join(_CHANNELS),
                next_step=suggest(name, _CHANNELS),
            )
    if len(set(names)) != len(names):
        raise draft.error("a channel twice in one joint", line, found=" ".join(names))
    return tuple(_CHANNELS[name] for name in names)


def _read_motion_header(lines: list[str], start: int, draft: _Draft) -> tuple[int, float, int]:
    """Number of frames, rate (Hz), and the index of the first line of data."""
    found: list[tuple[str, str, int]] = []
    for index in range(start, len(lines)):
        text = lines[index].strip()
        if text:
            key, _, value = text.partition(":")
            found.append((" ".join(key.lower().split()), value.strip(), index))
        if len(found) == 2:
            break
    where = f"{draft.path}:{found[-1][2] + 1 if found else len(lines)}"
    if [key for key, _, _ in found] != ["frames", "frame time"]:
        raise InputError("incomplete MOTION section", where=where, allowed="'Frames: N', then 'Frame Time: seconds'")
    (_, count, count_line), (_, interval, interval_line) = found
    if not count.isdecimal() or len(count) > 12:
        raise draft.error("wrong number of frames", count_line + 1, found=repr(count), allowed="a whole number")
    check_frame_count(int(count), f"{draft.path}:{count_line + 1}")
    seconds = numbers([interval], f"{draft.path}:{interval_line + 1}")[0]
    if seconds <= 0.0:
        raise draft.error(
            "impossible frame time",
            interval_line + 1,
            found=interval,
            allowed="seconds above 0",
            next_step="Correct it, e.g. 0.008333",
        )
    return int(count), check_rate(_tidy_rate(1.0 / seconds), f"{draft.path}:{interval_line + 1}"), interval_line + 1


def _tidy_rate(rate: float) -> float:
    """Frame times are written with few digits (0.008333): a rate within 0.02 % of a whole number is that number."""
    whole = round(rate)
    return float(whole) if abs(rate - whole) < 2e-4 * rate else rate


def _read_values(lines: list[str], first: int, frames: int, draft: _Draft) -> FloatArray:
    """All channel values (T, d), one frame per line."""
    width = sum(len(channels) for channels in draft.channels)
    if width == 0:
        raise draft.error("a skeleton without channels", first)
    rows: list[list[float]] = []
    for index in range(first, len(lines)):
        words = lines[index].split()
        if not words:
            continue
        if len(rows) == frames:
            raise draft.error(
                "more frames than declared",
                index + 1,
                allowed=f"{frames} as 'Frames:' says",
                next_step="Correct 'Frames:'",
            )
        if len(words) != width:
            raise draft.error(
                "wrong number of values in a frame",
                index + 1,
                found=len(words),
                allowed=f"{width}, one for each channel",
            )
        rows.append(_row(words, f"{draft.path}:{index + 1}"))
    if len(rows) < frames:
        raise draft.error(
            "fewer frames than declared",
            len(lines),
            found=len(rows),
            allowed=f"{frames} as 'Frames:' says",
            next_step="The file is cut short: get it again",
        )
    return np.array(rows)


def _row(words: list[str], where: str) -> list[float]:
    """One frame. Only a line that does not convert is looked at number by number."""
    try:
        row = list(map(float, words))
    except ValueError:
        return numbers(words, where)
    # A NaN fails every comparison, so the sum of magnitudes is small only if all are finite.
    return row if sum(map(abs, row)) < 1e9 else numbers(words, where)


def _notes(motion: BvhMotion, pose: Pose) -> tuple[str, ...]:
    """What the user should know about this export."""
    notes = []
    names = motion.tree.names
    if {"LHipJoint", "LowerBack", "LeftFingerBase"} <= set(names) and not motion.tree.offsets[
        names.index("Neck")
    ].any():
        notes.append(
            "this conversion of a CMU trial lost the lengths of thorax and wrist: about 0.12 m of trunk and 0.09 m of each forearm are missing"
        )
    if len(motion.values) > 2:
        step = np.linalg.norm(np.diff(pose.position[:3], axis=0), axis=-1).max(axis=-1)
        size = float(np.ptp(pose.position[0], axis=0).max())
        if step[0] > 0.1 * size and step[0] > 10.0 * step[1]:
            notes.append("frame 1 is a calibration pose: the motion starts at frame 2 (leave it out with --start)")
    return tuple(notes)
