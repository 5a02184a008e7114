"""Acclaim motion files (.amc) with their skeletons (.asf), y up.

Format: the Acclaim ASF/AMC description. A bone turns about its start; its end is where its children start. Limits are
ignored, because recorded data exceed them. The AMC states neither frame rate nor unit (CMU: mostly 120 Hz, and 0.0254 /
0.45 m if the ASF says length 0.45). The ground stays as in the file.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from retarget import rotations
from retarget.errors import InputError, suggest
from retarget.frames import SensorFrames
from retarget.sources.canonical import CMU_METRES, canonical_frames
from retarget.sources.files import (
    AS_WRITTEN,
    ReadOptions,
    assumed_rate,
    check_frame_count,
    cut_short,
    numbers,
    read_lines,
)
from retarget.sources.skeletons import JointPoses, JointTree, posed
from retarget.types import FloatArray

MAX_BONES = 1000
"""Most bones of a skeleton."""

ROOT = "root"
_ROOT_DOF = ("tx", "ty", "tz", "rx", "ry", "rz")
_DOF = ("rx", "ry", "rz")

_Line = tuple[str, list[str]]
"""File and line for messages, and the words of the line."""


@dataclass(frozen=True)
class AsfSkeleton:
    """A skeleton in file axes and units.

    tree: joint i is the start of bone i, joint 0 the root. dof (n): channels of each bone's AMC line, in order ("rx",
    for the root also "tx"). frames (n, 4): orientation C of the axes about which a bone turns. length_unit: `length` in
    :units.
    """

    tree: JointTree
    dof: tuple[tuple[str, ...], ...]
    frames: FloatArray
    length_unit: float
    degrees: bool
    path: Path


@dataclass(frozen=True)
class _Bone:
    """vector (3,): from its start to its end. frame (4,): of its axes. dof: as in `AsfSkeleton`."""

    vector: FloatArray
    frame: FloatArray
    dof: tuple[str, ...]


def read_asf(path: Path) -> AsfSkeleton:
    """Read a skeleton. Raises InputError with file and line."""
    sections, last = _sections(path)
    units = _keyed(sections.get("units", []))
    where, words = units.get("length", ("", []))
    length_unit = numbers(words[:1], where)[0] if words else 1.0
    where, words = units.get("angle", ("", ["deg"]))
    degrees = words[0].lower().startswith("deg")
    if not degrees and words[0].lower()[:3] != "rad":
        raise InputError("unknown angle unit", where=where, found=repr(words[0])[:80], allowed="deg, rad")
    root = _keyed(sections.get("root", []))
    where, words = root.get("order", ("", list(_ROOT_DOF)))
    dof = tuple(word.lower() for word in words)
    if sorted(dof) != sorted(_ROOT_DOF):
        allowed = "TX TY TZ RX RY RZ, each once, in any order"
        raise InputError("wrong root order", where=where, found=" ".join(words)[:80], allowed=allowed)
    bones = {ROOT: _Bone(np.zeros(3), _frame(root, "orientation", degrees=degrees), dof)}
    bones |= _bones(sections.get("bonedata", []), last, degrees=degrees)
    children = _children(sections.get("hierarchy", []), bones)
    if len(bones) == 1 or not children:
        missing = ":bonedata" if len(bones) == 1 else ":hierarchy"
        raise InputError(
            f"no {missing} section with content", where=last, next_step="The file is cut short: get it again"
        )
    order, parents = [ROOT], {ROOT: -1}
    for i, name in enumerate(order):  # grows in the loop: breadth first
        for child in children.get(name, ()):
            parents[child] = i
            order.append(child)
    lost = [name for name in bones if name not in parents]
    if lost:
        raise InputError(
            "bones that the hierarchy does not connect to the root", where=last, found=", ".join(lost[:8])[:80]
        )
    starts = [bones[order[parents[name]]].vector if name != ROOT else np.zeros(3) for name in order]
    tree = JointTree(
        names=tuple(order),
        parents=tuple(parents[name] for name in order),
        offsets=np.array(starts),
        ends=tuple(() if children.get(name) else (bones[name].vector,) for name in order),
    )
    channels, frames = tuple(bones[name].dof for name in order), np.stack([bones[name].frame for name in order])
    return AsfSkeleton(tree, channels, frames, length_unit, degrees, path)


def _sections(path: Path) -> tuple[dict[str, list[_Line]], str]:
    """Lines with content by section (`:name`, in lower case), and the end of the file."""
    sections: dict[str, list[_Line]] = {}
    section, lines = "", read_lines(path)
    for number, line in enumerate(lines, start=1):
        words, where = line.partition("#")[0].split(), f"{path}:{number}"
        if words and words[0].startswith(":"):
            section = words[0][1:].lower()
        elif words and not section:
            found = repr(line.strip()[:40])
            raise InputError("not an ASF file", where=where, found=found, allowed="sections such as :bonedata")
        elif words:
            sections.setdefault(section, []).append((where, words))
    return sections, f"{path}:{len(lines)}"


def _keyed(lines: list[_Line]) -> dict[str, _Line]:
    """Lines by their first word in lower case, without it."""
    return {words[0].lower(): (where, words[1:]) for where, words in lines if len(words) > 1}


def _bones(lines: list[_Line], last: str, *, degrees: bool) -> dict[str, _Bone]:
    bones: dict[str, _Bone] = {}
    content: list[_Line] | None = None
    began = ""
    for where, words in lines:
        key = words[0].lower()
        if key == "begin":
            if content is not None:
                step = f"Close the bone of line {began.rpartition(':')[2]} with 'end'"
                raise InputError("a bone begins inside another", where=where, next_step=step)
            began, content = where, []
        elif content is None:
            found = repr(" ".join(words)[:40])
            raise InputError("text outside of a bone", where=where, found=found, allowed="begin")
        elif key != "end":
            content.append((where, words))
        else:
            name, bone = _bone(content, began, degrees=degrees)
            if name in bones or name == ROOT:
                raise InputError("bone defined twice", where=began, found=repr(name)[:80])
            if len(bones) >= MAX_BONES:
                raise InputError("too many bones", where=where, allowed=f"up to {MAX_BONES}")
            bones[name], content = bone, None
    if content is not None:
        raise InputError("the file ends inside a bone", where=last, next_step="The file is cut short: get it again")
    return bones


def _bone(content: list[_Line], began: str, *, degrees: bool) -> tuple[str, _Bone]:
    keyed = {words[0].lower(): (where, words[1:]) for where, words in content}
    lacking = [key for key in ("name", "direction", "length") if key not in keyed]
    if lacking:
        found = f"no {' and no '.join(lacking)}"
        raise InputError("incomplete bone", where=began, found=found, allowed="name, direction, length")
    where, words = keyed["length"]
    if not words or not numbers(words[:1], where)[0] >= 0.0:
        found = repr(" ".join(words))[:80]
        raise InputError("a bone's length is needed", where=where, found=found, allowed="a number from 0")
    vector = np.array(_triple(*keyed["direction"])) * float(words[0])
    where, words = keyed.get("dof", ("", []))
    dof = tuple(word.lower() for word in words)
    if len(set(dof)) != len(dof) or not set(dof) <= set(_DOF):
        allowed = "rx ry rz, each at most once"
        raise InputError("unknown or repeated dof", where=where, found=" ".join(words)[:80], allowed=allowed)
    return " ".join(keyed["name"][1][:1]), _Bone(vector, _frame(keyed, "axis", degrees=degrees), dof)


def _frame(keyed: dict[str, _Line], key: str, *, degrees: bool) -> FloatArray:
    """Orientation (4,) of a bone's axes: the three angles at `key`, applied about fixed axes in the order after them,
    or at `axis` (of the root)."""
    where, words = keyed.get(key, ("", ["0", "0", "0"]))
    angles = np.array(_triple(where, words[:3]))
    where, words = keyed["axis"] if key != "axis" and "axis" in keyed else (where, words[3:])
    order = words[0].lower() if words else "xyz"
    if sorted(order) != ["x", "y", "z"]:
        raise InputError("unknown axis order", where=where, found=repr(words[0])[:80], allowed="XYZ in any order")
    return rotations.from_euler((np.radians(angles) if degrees else angles)[::-1], order[::-1])


def _children(lines: list[_Line], bones: dict[str, _Bone]) -> dict[str, list[str]]:
    children: dict[str, list[str]] = {}
    placed = {ROOT}
    for where, words in lines:
        if words[0].lower() in ("begin", "end"):
            continue
        for name in words:
            if name not in bones:
                step = suggest(name, bones)
                raise InputError("unknown bone in the hierarchy", where=where, found=repr(name)[:80], next_step=step)
        for child in words[1:]:
            if child in placed:
                raise InputError("a bone with two parents", where=where, found=repr(child)[:80])
            placed.add(child)
            children.setdefault(words[0], []).append(child)
    return children


def _triple(where: str, words: list[str]) -> list[float]:
    if len(words) != 3:
        raise InputError("three numbers are needed", where=where, found=repr(" ".join(words))[:80])
    return numbers(words, where)


DEFAULT_RATE_HZ = 120.0
"""Rate, Hz, of an AMC: that of nearly all of CMU's."""
CMU_LENGTH_UNIT = 0.45
"""`length` in CMU's ASF files, which identifies them: inches times 0.45."""


def read_amc(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read a motion and its skeleton, by default the ASF in the same folder by subject number (02_06.amc: 02.asf) or
    of the same name. Without a unit, `length 0.45` means CMU's; else it is guessed. Raises InputError with file
    and line."""
    lines = read_lines(path)
    asf = read_asf(options.skeleton or find_skeleton(path))
    values, degrees = read_values(lines, asf, path)
    is_cmu = abs(asf.length_unit - CMU_LENGTH_UNIT) < 1e-6
    rate, notes = assumed_rate(options.rate, DEFAULT_RATE_HZ)
    return canonical_frames(
        asf.tree,
        pose_of(asf, values, degrees=degrees),
        unit=CMU_METRES if is_cmu else None,
        rate=rate,
        source=str(path),
        options=options,
        notes=notes,
    )


def find_skeleton(path: Path) -> Path:
    """The ASF in an AMC's folder: by subject number, else by the same name, in any case. Raises InputError if none."""
    usual = [f"{path.stem.split('_')[0]}.asf", f"{path.stem}.asf"]
    try:
        candidates = sorted(entry for entry in path.parent.iterdir() if entry.suffix.lower() == ".asf")
    except OSError:
        candidates = []
    for name in usual:
        for entry in candidates:
            if entry.name.lower() == name.lower():
                return entry
    names = ", ".join(entry.name for entry in candidates[:5])
    raise InputError(
        "no skeleton (ASF) for this motion",
        where=str(path),
        found=f"{names} in the same folder" if names else "no ASF file in the same folder",
        allowed=" or ".join(dict.fromkeys(usual)),
        next_step="Put it into the folder of the AMC, or name it with --skeleton FILE.asf",
    )


def pose_of(asf: AsfSkeleton, values: FloatArray, *, degrees: bool) -> JointPoses:
    """Poses of all frames (file axes and units): R = R_parent C Rz Ry Rx C^-1, C the axes of the bone."""
    channels = [[(name[0], "xyz".index(name[1])) for name in dof] for dof in asf.dof]
    return posed(asf.tree, channels, values, degrees=degrees, frames=asf.frames)


def read_values(lines: list[str], asf: AsfSkeleton, path: Path) -> tuple[FloatArray, bool]:
    """Values (T, d) of all channels as in the file, in the order of the skeleton's bones, and True if angles are in
    degrees.

    A frame is a line with its number, then one line for each bone, in any order. Raises InputError with file and line.
    """
    degrees = asf.degrees
    for start, line in enumerate(lines):
        text = line.strip()
        if text.lower() in (":degrees", ":radians"):
            degrees = text.lower() == ":degrees"
        elif text and not text.startswith(("#", ":")):
            if not text.isdecimal():
                raise InputError(
                    "not an AMC file",
                    where=f"{path}:{start + 1}",
                    found=repr(text[:40]),
                    allowed="the number of the first frame",
                    next_step="Check that this is the recording, as text and unpacked",
                )
            break
    else:
        raise InputError("no frame of motion", where=str(path), next_step="The file is cut short: get it again")
    dof = dict(zip(asf.tree.names, asf.dof, strict=True))
    rows: list[list[float]] = []
    row: dict[str, tuple[int, list[str]]] = {}
    number, begun = -1, start + 1
    for at, words in _filled(lines, start):
        if len(words) > 1 or (words and not words[0].isdecimal()):
            if words[0] in row or len(dof.get(words[0], words)) != len(words) - 1:
                raise cut_short(_wrong_bone(words, dof, asf.path, f"{path}:{at}"), lines[at:])
            row[words[0]] = at, words[1:]
            continue
        if number >= 0:
            rows.append(_assembled(row, number, dof, f"{path}:{begun if words else at}", lines))
            check_frame_count(len(rows), f"{path}:{at}")
            if words and int(words[0][:12]) != number + 1:
                raise InputError(
                    "frames are missing or repeated",
                    where=f"{path}:{at}",
                    found=f"frame {words[0][:12]}",
                    allowed=f"frame {number + 1}",
                    next_step="Number the frames one by one, or get the file again",
                )
        if words:
            number, begun, row = int(words[0][:12]), at, {}
    return np.array(rows), degrees


def _filled(lines: list[str], start: int) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line with content from `start` on; at the end, a line without words."""
    for at in range(start, len(lines)):
        words = lines[at].partition("#")[0].split()
        if words:
            yield at + 1, words
    yield len(lines), []


def _wrong_bone(words: list[str], dof: dict[str, tuple[str, ...]], asf: Path, where: str) -> InputError:
    name = words[0]
    if name not in dof:
        allowed, step = f"a bone of {asf.name}", suggest(name, dof)
        return InputError("unknown bone", where=where, found=repr(name[:40]), allowed=allowed, next_step=step)
    channels = dof[name]
    if len(channels) == len(words) - 1:
        return InputError("a bone twice in one frame", where=where, found=repr(name))
    return InputError(
        f"wrong number of values for bone {name!r}",
        where=where,
        found=len(words) - 1,
        allowed=f"{len(channels)} ({' '.join(channels)})" if channels else "no line at all: the bone has no dof",
        next_step=f"Correct it or the dof in {asf.name}, or name another ASF with --skeleton",
    )


def _assembled(
    row: dict[str, tuple[int, list[str]]], number: int, dof: dict[str, tuple[str, ...]], where: str, lines: list[str]
) -> list[float]:
    needed = [name for name, channels in dof.items() if channels]
    lacking = [name for name in needed if name not in row]
    if not lacking:
        with suppress(InputError):
            return numbers([word for name in needed for word in row[name][1]], where)
    for at, words in row.values():  # a bad number is a better error
        try:
            numbers(words, f"{where.rpartition(':')[0]}:{at}")
        except InputError as error:
            raise cut_short(error, lines[at:]) from None
    more = f" and {len(lacking) - 5} more" if len(lacking) > 5 else ""
    raise InputError(
        f"frame {number} is incomplete",
        where=where,
        found=f"no line for {', '.join(lacking[:5])}{more}",
        next_step="The file is cut short or belongs to another skeleton",
    )
