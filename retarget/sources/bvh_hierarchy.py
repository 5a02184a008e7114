"""The HIERARCHY section of a BVH file: joints, offsets and channels.

Names may hold blanks, End Sites have neither name nor channels, keywords and channel names come in any case, and braces
may stand on a line of their own or behind a statement.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from retarget.errors import InputError, suggest
from retarget.rotations import FloatArray
from retarget.sources.files import numbers
from retarget.sources.tree import JointTree

__all__ = ["MAX_DEPTH", "MAX_JOINTS", "BvhHierarchy", "Channel", "read_hierarchy"]

Channel = tuple[str, int]
"""A channel: "p" (position) or "r" (rotation), and its axis 0, 1 or 2."""

MAX_JOINTS = 1000
MAX_DEPTH = 200
"""Skeletons with more joints, or more deeply nested ones, are refused."""

_CHANNELS: dict[str, Channel] = {
    f"{axis}{kind}": (kind[0], "xyz".index(axis)) for axis in "xyz" for kind in ("position", "rotation")
}
"""Channel name in lower case -> ("p" or "r", axis)."""


@dataclass(frozen=True)
class BvhHierarchy:
    """tree: the skeleton, file axes and units. channels (n): per joint its channels in order."""

    tree: JointTree
    channels: tuple[tuple[Channel, ...], ...]

    @property
    def width(self) -> int:
        """Number of values in a frame."""
        return sum(len(channels) for channels in self.channels)


@dataclass
class _Draft:
    """The hierarchy as it is read. open: indices of open blocks, None for an End Site."""

    path: Path
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float] | None] = field(default_factory=list)
    channels: list[tuple[Channel, ...]] = field(default_factory=list)
    ends: list[list[FloatArray]] = field(default_factory=list)
    open: list[int | None] = field(default_factory=list)
    announced: str = ""

    def error(
        self, what: str, line: int, *, found: object = "", allowed: object = "", next_step: str = ""
    ) -> InputError:
        return InputError(
            what, where=f"{self.path}:{line}", found=str(found)[:80], allowed=allowed, next_step=next_step
        )


def read_hierarchy(lines: list[str], path: Path) -> tuple[BvhHierarchy, int]:
    """The skeleton, and the index of the line after MOTION. Raises InputError with file and line."""
    draft, begun = _Draft(path), False
    for index, line in enumerate(lines):
        # Braces may stand on a line of their own or at the end of another.
        for part in re.split(r"([{}])", line):
            text = part.strip()
            if not text:
                continue
            if not begun:
                if text.upper() != "HIERARCHY":
                    step = "Check that this is the recording, as text and unpacked"
                    found = repr(text[:40])
                    raise draft.error("not a BVH file", index + 1, found=found, allowed="HIERARCHY", next_step=step)
                begun = True
            elif text.upper() == "MOTION":
                if draft.open or not draft.names:
                    raise draft.error("MOTION before the skeleton is complete", index + 1, next_step="Count the braces")
                return _assemble(draft), index + 1
            else:
                _hierarchy_part(draft, text, index + 1)
    raise draft.error("no MOTION section", len(lines), next_step="The file is cut short: get it again")


def _assemble(draft: _Draft) -> BvhHierarchy:
    tree = JointTree(
        names=tuple(draft.names),
        parents=tuple(draft.parents),
        offsets=np.array([offset or [0.0] * 3 for offset in draft.offsets]),
        ends=tuple(tuple(ends) for ends in draft.ends),
    )
    return BvhHierarchy(tree, tuple(draft.channels))


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
    elif keyword == "END" or (keyword in ("ROOT", "JOINT") and len(words) > 1):
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


def _channels(draft: _Draft, words: list[str], line: int) -> tuple[Channel, ...]:
    names = [word.lower() for word in words[1:]]
    if not words or not words[0].isdecimal() or words[0].lstrip("0") != str(len(names)).lstrip("0"):
        raise draft.error(
            "wrong channel count",
            line,
            found=" ".join(words),
            allowed=f"{len(names)}, then as many channel names",
            next_step="Correct the number before the names, or add the names that are missing",
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
