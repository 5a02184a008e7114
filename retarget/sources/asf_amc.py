"""Acclaim motion files (.amc) with their skeletons (.asf).

The AMC names no frame rate (most CMU trials have 120 Hz) and no unit (CMU: 0.0254 / 0.45 m where the ASF says length
0.45). World: the file's y is up; (x, y, z)_robot = (z, x, y)_file, so a performer in the rest pose faces x. Sensors and
joints as in `canonical`; the ground is where the file has it.
"""

import math
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import numpy as np

from retarget import rotations
from retarget.errors import InputError, suggest
from retarget.frames import SensorFrames
from retarget.sources.canonical import CMU_METRES, Unit, canonical_frames, named_unit
from retarget.sources.files import check_frame_count, check_rate, cut_short, numbers, read_lines
from retarget.sources.skeletons import JointTree, Pose, forward_kinematics
from retarget.types import FloatArray

# Acclaim skeleton files (.asf): bones with their lengths, directions, axes and degrees of freedom.
#
# Format: the Acclaim ASF/AMC description (sections :units, :root, :bonedata, :hierarchy). A bone turns about the start
# of
# itself; its end is where its children start. Limits are read past: recorded data exceeds them.

MAX_BONES = 1000
"""Skeletons with more bones are refused."""

ROOT = "root"
_ROOT_DOF = ("tx", "ty", "tz", "rx", "ry", "rz")
_DOF = ("rx", "ry", "rz")


@dataclass(frozen=True)
class AsfSkeleton:
    """A skeleton in the file's axes (y up) and units.

    tree: joint i is the start of bone i, joint 0 the root. dof (n): per bone the channels that its AMC line holds, in
    order, "rx" "ry" "rz" and for the root "tx" "ty" "tz" too. frames (n, 4): orientation C of each bone's axes, about
    which it turns. length_unit: the number at `length` in :units. degrees: whether angles are in degrees. path: the
    file.
    """

    tree: JointTree
    dof: tuple[tuple[str, ...], ...]
    frames: FloatArray
    length_unit: float
    degrees: bool
    path: Path


@dataclass
class _Bone:
    """A bone as it is read."""

    line: int
    name: str = ""
    direction: list[float] | None = None
    length: float | None = None
    axis: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    axis_order: str = "xyz"
    dof: tuple[str, ...] = ()


@dataclass
class _Draft:
    """The sections of a file as they are read."""

    path: Path
    length_unit: float = 1.0
    degrees: bool = True
    root: _Bone = field(default_factory=lambda: _Bone(0, ROOT, [0.0, 0.0, 0.0], 0.0, dof=_ROOT_DOF))
    bones: dict[str, _Bone] = field(default_factory=dict)
    children: dict[str, list[str]] = field(default_factory=dict)
    placed: set[str] = field(default_factory=lambda: {ROOT})
    open_bone: _Bone | None = None

    def error(self, what: str, line: int, *, found: str = "", allowed: str = "", next_step: str = "") -> InputError:
        return InputError(what, where=f"{self.path}:{line}", found=found[:80], allowed=allowed, next_step=next_step)


def read_asf(path: Path) -> AsfSkeleton:
    """Read a skeleton. Raises InputError with file and line for anything that is wrong in it."""
    draft, section, line_number = _Draft(path), "", 0
    readers = {"units": _units_line, "root": _root_line, "bonedata": _bone_line, "hierarchy": _hierarchy_line}
    for line_number, line in enumerate(read_lines(path), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0].startswith(":"):
            section = words[0][1:].lower()
            continue
        if section in readers:
            readers[section](draft, words, line_number)
        elif not section:
            raise draft.error(
                "not an ASF file", line_number, found=repr(line.strip()[:40]), allowed="sections such as :bonedata"
            )
    if draft.open_bone is not None:
        raise draft.error("the file ends inside a bone", line_number, next_step="The file is cut short: get it again")
    if not draft.bones or not draft.children:
        missing = ":bonedata" if not draft.bones else ":hierarchy"
        raise draft.error(
            f"no {missing} section with content", line_number, next_step="The file is cut short: get it again"
        )
    return _assemble(draft, line_number)


def _units_line(draft: _Draft, words: list[str], line: int) -> None:
    if len(words) < 2:
        return
    if words[0].lower() == "length":
        draft.length_unit = numbers(words[1:2], f"{draft.path}:{line}")[0]
    elif words[0].lower() == "angle":
        draft.degrees = _is_degrees(draft, words[1], line)


def _is_degrees(draft: _Draft, word: str, line: int) -> bool:
    if word.lower()[:3] not in ("deg", "rad"):
        raise draft.error("unknown angle unit", line, found=repr(word), allowed="deg, rad")
    return word.lower().startswith("deg")


def _root_line(draft: _Draft, words: list[str], line: int) -> None:
    key, values = words[0].lower(), words[1:]
    if key == "order":
        order = tuple(word.lower() for word in values)
        if sorted(order) != sorted(_ROOT_DOF):
            raise draft.error(
                "wrong root order", line, found=" ".join(values), allowed="TX TY TZ RX RY RZ, each once, in any order"
            )
        draft.root.dof = order
    elif key == "axis" and values:
        draft.root.axis_order = _axis_order(draft, values[0], line)
    elif key == "orientation":
        draft.root.axis = _triple(draft, values, line)


def _bone_line(draft: _Draft, words: list[str], line: int) -> None:
    key, values = words[0].lower(), words[1:]
    bone = draft.open_bone
    if key == "begin":
        if bone is not None:
            raise draft.error(
                "a bone begins inside another", line, next_step=f"Close the bone of line {bone.line} with 'end'"
            )
        draft.open_bone = _Bone(line)
    elif bone is None:
        raise draft.error("text outside of a bone", line, found=repr(" ".join(words)[:40]), allowed="begin")
    elif key == "end":
        _close_bone(draft, bone, line)
    elif key == "name" and values:
        bone.name = values[0]
    elif key == "direction":
        bone.direction = _triple(draft, values, line)
    elif key == "length":
        bone.length = _single(draft, values, line)
    elif key == "axis":
        bone.axis = _triple(draft, values[:3], line)
        bone.axis_order = _axis_order(draft, values[3] if len(values) > 3 else "XYZ", line)
    elif key == "dof":
        bone.dof = _dof(draft, values, line)


def _close_bone(draft: _Draft, bone: _Bone, line: int) -> None:
    lacking = [key for key in ("name", "direction", "length") if getattr(bone, key) in ("", None)]
    if lacking:
        raise draft.error(
            "incomplete bone", bone.line, found=f"no {' and no '.join(lacking)}", allowed="name, direction, length"
        )
    if bone.name in draft.bones or bone.name == ROOT:
        raise draft.error("bone defined twice", bone.line, found=repr(bone.name))
    if len(draft.bones) >= MAX_BONES:
        raise draft.error("too many bones", line, allowed=f"up to {MAX_BONES}")
    draft.bones[bone.name] = bone
    draft.open_bone = None


def _hierarchy_line(draft: _Draft, words: list[str], line: int) -> None:
    if words[0].lower() in ("begin", "end"):
        return
    for name in words:
        if name not in draft.bones and name != ROOT:
            known = [ROOT, *draft.bones]
            raise draft.error("unknown bone in the hierarchy", line, found=repr(name), next_step=suggest(name, known))
    for child in words[1:]:
        if child in draft.placed:
            raise draft.error("a bone with two parents", line, found=repr(child))
        draft.placed.add(child)
        draft.children.setdefault(words[0], []).append(child)


def _assemble(draft: _Draft, last_line: int) -> AsfSkeleton:
    """Bones in an order of parents before children, as a tree."""
    order, parents = [ROOT], {ROOT: -1}
    for i, name in enumerate(order):  # grows while it is walked: breadth first, no recursion
        for child in draft.children.get(name, ()):
            parents[child] = i
            order.append(child)
    lost = [name for name in draft.bones if name not in parents]
    if lost:
        raise draft.error("bones that the hierarchy does not connect to the root", last_line, found=", ".join(lost[:8]))
    bones = [draft.root if name == ROOT else draft.bones[name] for name in order]
    vectors = np.array([bone.direction or [0.0] * 3 for bone in bones]) * np.array(
        [[bone.length or 0.0] for bone in bones]
    )
    starts = np.array([vectors[parents[name]] if parents[name] >= 0 else np.zeros(3) for name in order])
    tree = JointTree(
        names=tuple(order),
        parents=tuple(parents[name] for name in order),
        offsets=starts,
        ends=tuple(() if draft.children.get(name) else (vector,) for name, vector in zip(order, vectors, strict=True)),
    )
    return AsfSkeleton(
        tree=tree,
        dof=tuple(bone.dof for bone in bones),
        frames=np.stack([_frame(bone, degrees=draft.degrees) for bone in bones]),
        length_unit=draft.length_unit,
        degrees=draft.degrees,
        path=draft.path,
    )


def _frame(bone: _Bone, *, degrees: bool) -> FloatArray:
    """Orientation C (4,) of a bone's axes: its angles applied in the listed order about fixed axes."""
    angles = np.radians(bone.axis) if degrees else np.array(bone.axis)
    return rotations.from_euler(angles[::-1], bone.axis_order[::-1])


def _triple(draft: _Draft, values: list[str], line: int) -> list[float]:
    if len(values) != 3:
        raise draft.error("three numbers are needed", line, found=repr(" ".join(values)))
    return numbers(values, f"{draft.path}:{line}")


def _single(draft: _Draft, values: list[str], line: int) -> float:
    value = numbers(values[:1], f"{draft.path}:{line}")[0] if values else math.nan
    if not value >= 0.0:
        raise draft.error("a bone's length is needed", line, found=repr(" ".join(values)), allowed="a number from 0")
    return value


def _axis_order(draft: _Draft, word: str, line: int) -> str:
    if sorted(word.lower()) != ["x", "y", "z"]:
        raise draft.error("unknown axis order", line, found=repr(word), allowed="XYZ in any order")
    return word.lower()


def _dof(draft: _Draft, values: list[str], line: int) -> tuple[str, ...]:
    dof = tuple(word.lower() for word in values)
    if len(set(dof)) != len(dof) or not set(dof) <= set(_DOF):
        raise draft.error(
            "unknown or repeated dof", line, found=" ".join(values), allowed="rx ry rz, each at most once"
        )
    return dof


DEFAULT_RATE_HZ = 120.0
CMU_LENGTH_UNIT = 0.45


def read_amc(
    path: Path, *, skeleton: Path | None = None, unit: str | None = None, rate: float | None = None
) -> SensorFrames:
    """Read a motion and its skeleton.

    skeleton: the ASF; by default one in the AMC's folder, by subject number (02_06.amc: 02.asf) or by the same name.
    unit: a name of `units.UNITS`; by default CMU's for `length 0.45`, else guessed from the body's size. rate: frames
    per second, 120 by default. Raises InputError with file and line.
    """
    lines = read_lines(path)
    asf = read_asf(skeleton if skeleton is not None else find_skeleton(path))
    values, degrees = read_values(lines, asf, path)
    notes: tuple[str, ...] = ()
    if rate is None:
        rate, notes = (
            DEFAULT_RATE_HZ,
            (f"frame rate not stated: taken as {DEFAULT_RATE_HZ:g} Hz (change it with --rate)",),
        )
    return canonical_frames(
        asf.tree,
        pose_of(asf, values, degrees=degrees),
        unit=_unit(asf, unit),
        rate=check_rate(rate, str(path)),
        source=str(path),
        detect_up=False,
        notes=notes,
    )


def find_skeleton(path: Path) -> Path:
    """The ASF in an AMC's folder, in any case: by subject number, else by the same name. Raises InputError if none."""
    wanted = [f"{path.stem.split('_')[0]}.asf", f"{path.stem}.asf"]
    try:
        candidates = sorted(entry for entry in path.parent.iterdir() if entry.suffix.lower() == ".asf")
    except OSError:
        candidates = []
    for name in wanted:
        for entry in candidates:
            if entry.name.lower() == name.lower():
                return entry
    names = ", ".join(entry.name for entry in candidates[:5])
    raise InputError(
        "no skeleton (ASF) for this motion",
        where=str(path),
        found=f"{names} in the same folder" if names else "no ASF file in the same folder",
        allowed=" or ".join(dict.fromkeys(wanted)),
        next_step="Put it into the folder of the AMC, or name it with --skeleton FILE.asf",
    )


def read_values(lines: list[str], asf: AsfSkeleton, path: Path) -> tuple[FloatArray, bool]:
    """Values (T, d) of all channels as in the file, in the order of the skeleton's bones; whether angles are degrees.

    Raises InputError with file and line.
    """
    start, degrees = _header(lines, asf, path)
    return _frame_values(lines, start, asf, path), degrees


def pose_of(asf: AsfSkeleton, values: FloatArray, *, degrees: bool) -> Pose:
    """Forward kinematics of all frames (file axes and units): R = R_parent C Rz Ry Rx C^-1, C the axes of the bone."""
    frames, bones = len(values), len(asf.tree.names)
    local = np.broadcast_to(rotations.IDENTITY, (frames, bones, 4)).copy()
    translation = np.broadcast_to(asf.tree.offsets, (frames, bones, 3)).copy()
    starts = np.cumsum([0, *(len(dof) for dof in asf.dof)])
    for dof, group in groupby(sorted(range(bones), key=lambda bone: asf.dof[bone]), key=lambda bone: asf.dof[bone]):
        turns = [i for i, channel in enumerate(dof) if channel[0] == "r"]
        if not turns:
            continue
        members = list(group)
        # The first channel is applied first, about fixed axes: the product runs the other way.
        columns = starts[members][:, None] + np.array(turns[::-1])
        angles = np.radians(values[:, columns]) if degrees else values[:, columns]
        local[:, members] = rotations.from_euler(angles, "".join(dof[i][1] for i in turns[::-1]))
    # C q C^-1 has the vector part of q turned by C.
    local[..., 1:] = rotations.rotate(asf.frames, local[..., 1:])
    translation[:, 0] = values[:, [asf.dof[0].index(channel) for channel in ("tx", "ty", "tz")]]
    return forward_kinematics(asf.tree, local, translation)


def _unit(asf: AsfSkeleton, name: str | None) -> Unit | None:
    if name is not None:
        return named_unit(name)
    return Unit("cmu", CMU_METRES) if abs(asf.length_unit - CMU_LENGTH_UNIT) < 1e-6 else None


def _header(lines: list[str], asf: AsfSkeleton, path: Path) -> tuple[int, bool]:
    """Index of the first line of data, and whether angles are degrees. Comments and ':' words come before it."""
    degrees = asf.degrees
    for index, line in enumerate(lines):
        text = line.strip()
        if text.lower() in (":degrees", ":radians"):
            degrees = text.lower() == ":degrees"
        elif text and not text.startswith(("#", ":")):
            if not text.isdecimal():
                raise InputError(
                    "not an AMC file",
                    where=f"{path}:{index + 1}",
                    found=repr(text[:40]),
                    allowed="the number of the first frame",
                    next_step="Check that this is the recording, as text and unpacked",
                )
            return index, degrees
    raise InputError("no frame of motion", where=str(path), next_step="The file is cut short: get it again")


def _frame_values(lines: list[str], start: int, asf: AsfSkeleton, path: Path) -> FloatArray:
    """The values of all frames: each is a line with its number, then one line for each bone, in any order."""
    dof = dict(zip(asf.tree.names, asf.dof, strict=True))
    wanted = [name for name, channels in dof.items() if channels]
    rows: list[list[float]] = []
    row: dict[str, list[float]] = {}
    number, number_line, line_number = -1, start + 1, start
    source, last = str(path), next(at for at in range(len(lines), 0, -1) if lines[at - 1].split("#", 1)[0].strip())
    for line_number, line in enumerate(lines[start:], start=start + 1):
        words = (line.split("#", 1)[0] if "#" in line else line).split()
        if not words:
            continue
        where = f"{source}:{line_number}"
        if len(words) > 1 or not words[0].isdecimal():
            try:
                _take_bone(row, words, dof, asf, where)
            except InputError as error:
                raise (cut_short(error) if line_number == last else error) from None
            continue
        if number >= 0:
            rows.append(_assembled(row, number, wanted, f"{source}:{number_line}"))
            check_frame_count(len(rows), where)
            if int(words[0][:12]) != number + 1:
                raise InputError(
                    "frames are missing or repeated",
                    where=where,
                    found=f"frame {words[0][:12]}",
                    allowed=f"frame {number + 1}",
                    next_step="Number the frames one by one, or get the file again",
                )
        number, number_line, row = int(words[0][:12]), line_number, {}
    rows.append(_assembled(row, number, wanted, f"{source}:{line_number}"))
    check_frame_count(len(rows), str(path))
    return np.array(rows)


def _take_bone(
    row: dict[str, list[float]], words: list[str], dof: dict[str, tuple[str, ...]], asf: AsfSkeleton, where: str
) -> None:
    """Take one line of a frame."""
    name = words[0]
    if name not in dof:
        allowed, step = f"a bone of {asf.path.name}", suggest(name, dof)
        raise InputError("unknown bone", where=where, found=repr(name[:40]), allowed=allowed, next_step=step)
    if name in row:
        raise InputError("a bone twice in one frame", where=where, found=repr(name))
    channels = dof[name]
    if len(words) - 1 != len(channels):
        raise InputError(
            f"wrong number of values for bone {name!r}",
            where=where,
            found=len(words) - 1,
            allowed=f"{len(channels)} ({' '.join(channels)})" if channels else "no line at all: the bone has no dof",
            next_step=f"Correct it or the dof in {asf.path.name}, or name another ASF with --skeleton",
        )
    row[name] = numbers(words[1:], where)


def _assembled(row: dict[str, list[float]], number: int, wanted: list[str], where: str) -> list[float]:
    """All values of a frame in the order of the skeleton."""
    lacking = [name for name in wanted if name not in row]
    if lacking:
        more = f" and {len(lacking) - 5} more" if len(lacking) > 5 else ""
        raise InputError(
            f"frame {number} is incomplete",
            where=where,
            found=f"no line for {', '.join(lacking[:5])}{more}",
            next_step="The file is cut short or belongs to another skeleton",
        )
    return [value for name in wanted for value in row[name]]
