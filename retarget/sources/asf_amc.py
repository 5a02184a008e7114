"""Acclaim motion files (.amc) with their skeletons (.asf).

The AMC names no frame rate (most CMU trials have 120 Hz) and no unit (CMU: 0.0254 / 0.45 m where the ASF says length
0.45). World: the file's y is up; (x, y, z)_robot = (z, x, y)_file, so a performer in the rest pose faces x. Sensors and
joints as in `canonical`; the ground is where the file has it.
"""

from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from retarget import rotations
from retarget.errors import InputError, suggest
from retarget.frames import SensorFrames
from retarget.rotations import FloatArray
from retarget.sources.asf import AsfSkeleton, read_asf
from retarget.sources.canonical import canonical_frames
from retarget.sources.files import MAX_FRAMES, MAX_VALUE, check_frame_count, check_rate, cut_short, numbers, read_lines
from retarget.sources.tree import Pose, forward_kinematics
from retarget.sources.units import CMU_METRES, Unit, named_unit

__all__ = ["DEFAULT_RATE_HZ", "find_skeleton", "pose_of", "read_amc", "read_values"]

DEFAULT_RATE_HZ = 120.0
CMU_LENGTH_UNIT = 0.45


def read_amc(
    path: Path, *, skeleton: Path | None = None, unit: str | None = None, rate: float | None = None
) -> SensorFrames:
    """Read a motion and its skeleton.

    skeleton: the ASF; by default the one beside the AMC, by subject number (02_06.amc: 02.asf) or by the same name.
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
    """The ASF beside an AMC, in any case: by subject number, else by the same name. Raises InputError if none."""
    wanted = [f"{path.stem.split('_')[0]}.asf", f"{path.stem}.asf"]
    try:
        beside = sorted(entry for entry in path.parent.iterdir() if entry.suffix.lower() == ".asf")
    except OSError:
        beside = []
    for name in wanted:
        for entry in beside:
            if entry.name.lower() == name.lower():
                return entry
    names = ", ".join(entry.name for entry in beside[:5])
    raise InputError(
        "no skeleton (ASF) for this motion",
        where=str(path),
        found=f"beside it: {names}" if names else "no ASF file beside it",
        allowed=" or ".join(dict.fromkeys(wanted)),
        next_step="Put it beside the AMC or name it with --skeleton FILE.asf",
    )


def read_values(lines: list[str], asf: AsfSkeleton, path: Path) -> tuple[FloatArray, bool]:
    """Values (T, d) of all channels as in the file, in the order of the skeleton's bones; whether angles are degrees.

    Raises InputError with file and line.
    """
    start, degrees = _header(lines, asf, path)
    tokens = " ".join(lines[start:]).split()
    values = _regular_values(tokens, asf)
    if values is None:
        values = _checked_values(lines, start, asf, path)
    check_frame_count(len(values), str(path))
    return values, degrees


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


def _regular_values(tokens: list[str], asf: AsfSkeleton) -> FloatArray | None:
    """The values if every frame has the same bones at the same places and all is well; else None.

    A whole frame is compared and converted at once, which is what makes a long file fast.
    """
    width = {name: len(dof) for name, dof in zip(asf.tree.names, asf.dof, strict=True) if dof}
    position, places = 1, {}
    while position < len(tokens) and tokens[position] in width and tokens[position] not in places:
        places[tokens[position]] = position
        position += 1 + width[tokens[position]]
    frames, rest = divmod(len(tokens), position)
    if rest or len(places) != len(width) or not 1 <= frames <= MAX_FRAMES:
        return None
    names_of = itemgetter(*places.values())
    values_of = itemgetter(*(places[name] + 1 + i for name, count in width.items() for i in range(count)))
    rows, expected = [], names_of(tokens)
    try:
        for start in range(0, len(tokens), position):
            frame = tokens[start : start + position]
            if names_of(frame) != expected:
                return None
            rows.append([int(frame[0]), *map(float, values_of(frame))])
        table = np.array(rows, float)
    except (ValueError, OverflowError):
        return None
    values = np.ascontiguousarray(table[:, 1:])
    sound = np.all(np.abs(values) <= MAX_VALUE) and np.all(np.diff(table[:, 0]) == 1.0)
    return values if sound else None


def _checked_values(lines: list[str], start: int, asf: AsfSkeleton, path: Path) -> FloatArray:
    """The values line by line, in any order of bones, with an error that names the line."""
    columns, rows = _Columns(asf), []
    row: dict[str, list[float]] = {}
    number, number_line, line_number = -1, start + 1, start
    last = max(index for index, line in enumerate(lines, start=1) if line.split("#", 1)[0].strip())
    for line_number, line in enumerate(lines[start:], start=start + 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        where = f"{path}:{line_number}"
        if len(words) == 1 and words[0].isdecimal():
            if number >= 0:
                rows.append(columns.assemble(row, number, f"{path}:{number_line}"))
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
        else:
            try:
                columns.add(row, words, where)
            except InputError as error:
                raise (cut_short(error) if line_number == last else error) from None
    rows.append(columns.assemble(row, number, f"{path}:{line_number}"))
    return np.array(rows)


class _Columns:
    """Checks one bone line or one frame at a time against the skeleton."""

    def __init__(self, asf: AsfSkeleton) -> None:
        self._dof = dict(zip(asf.tree.names, asf.dof, strict=True))
        self._asf = asf.path

    def add(self, row: dict[str, list[float]], words: list[str], where: str) -> None:
        """Take one line of a frame."""
        name = words[0]
        if name not in self._dof:
            raise InputError(
                "unknown bone",
                where=where,
                found=repr(name[:40]),
                allowed=f"a bone of {self._asf.name}",
                next_step=suggest(name, self._dof),
            )
        if name in row:
            raise InputError("a bone twice in one frame", where=where, found=repr(name))
        dof = self._dof[name]
        if len(words) - 1 != len(dof):
            raise InputError(
                f"wrong number of values for bone {name!r}",
                where=where,
                found=len(words) - 1,
                allowed=f"{len(dof)} ({' '.join(dof)})" if dof else "no line at all: the bone has no dof",
                next_step=f"Correct it or the dof in {self._asf.name}, or name another ASF with --skeleton",
            )
        row[name] = numbers(words[1:], where)

    def assemble(self, row: dict[str, list[float]], number: int, where: str) -> list[float]:
        """All values of a frame in the order of the skeleton."""
        lacking = [name for name, dof in self._dof.items() if dof and name not in row]
        if lacking:
            raise InputError(
                f"frame {number} is incomplete",
                where=where,
                found=f"no line for {', '.join(lacking[:5])}"
                + (f" and {len(lacking) - 5} more" if len(lacking) > 5 else ""),
                next_step="The file is cut short or belongs to another skeleton",
            )
        return [value for name, dof in self._dof.items() if dof for value in row[name]]
