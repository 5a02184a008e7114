"""C3D marker recordings (c3d.org, user guide 2008): header, parameters and 3D points; analog channels are passed over.

A sensor is the mean of a group of markers (`skeletons.yaml`, or the user's own table), valid in a frame when all of
them were seen: a point is lost where its residual is negative, it lies at the exact origin, it is not finite, or it is
far from all others. Positions only: markers know no joint and no orientation. Unit and rate are the file's own; the
body decides which axis is up; heading and ground stay where the file has them.
"""

import re
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from math import isfinite, prod
from pathlib import Path
from struct import Struct
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from retarget.arithmetic import matmul, norms
from retarget.errors import InputError, Problem, suggest
from retarget.frames import SENSORS, SensorFrames
from retarget.schema.strict_models import Name, Schema, Text, listed, read_model, unknown_name
from retarget.schema.strict_yaml import Document
from retarget.sources.axes import UP_AXES, world_axes
from retarget.sources.canonical import UNITS, named_unit
from retarget.sources.files import MAX_VALUE, check_frame_count, check_rate, frame_times, frames_held, read_bytes
from retarget.sources.skeletons import TABLES, names_of_sides
from retarget.types import BoolArray, FloatArray

# Bytes of a C3D file: blocks of 512, the header, the parameters, then the frames, in the byte order of the processor
# that the parameters name.

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
"""Processors: of little-endian IEEE floats, of little-endian words with VAX floats, and of big-endian IEEE floats."""
CHARACTERS, BYTES, INTEGERS, FLOATS = -1, 1, 2, 4
"""Types of parameters; their magnitude is the size of one element."""
FULL = 0xFFFF
"""A counter of 16 bits at its end: the file holds at least so many frames."""
MAX_PARAMETERS = 10_000
MAX_POINTS = 5000
"""Files with more parameters are read up to these, recordings with more points are refused."""


@dataclass(frozen=True)
class Parameter:
    """kind: CHARACTERS, BYTES, INTEGERS or FLOATS. dimensions: of the array, the fastest first. data: of the file."""

    kind: int
    dimensions: tuple[int, ...]
    data: bytes
    processor: int

    def numbers(self) -> list[float]:
        """Values in the order of the file, whatever the dimensions; integers as unsigned."""
        if self.kind == CHARACTERS:
            return []
        if self.kind == FLOATS:
            return [*map(float, _floats(self.data, self.processor))]
        return [*map(float, np.frombuffer(self.data, f"{_order(self.processor)}u{self.kind}"))]

    def texts(self) -> tuple[str, ...]:
        """Texts without blanks and NUL at their ends; one for each of the dimensions behind the first."""
        if self.kind != CHARACTERS:
            return ()
        length = self.dimensions[0] if self.dimensions else 1
        rows = [self.data[at : at + length] for at in range(0, len(self.data), max(length, 1))]
        return tuple(_decoded(row).strip(" \0\t\r\n") for row in rows)


@dataclass(frozen=True)
class C3dFile:
    """content: all bytes. points: per frame. analog: values per frame that are passed over. first, last: frames by the
    header. scale: length of one step of whole numbers; 0 or less where points are floats. start: byte of the first
    frame. rate_hz: by the header. parameters: by GROUP:NAME in upper case. notes: to the user."""

    content: bytes
    processor: int
    points: int
    analog: int
    first: int
    last: int
    scale: float
    start: int
    rate_hz: float
    parameters: Mapping[str, Parameter]
    notes: tuple[str, ...] = ()

    def numbers(self, key: str) -> list[float]:
        """Values of a parameter, none without it."""
        return self.parameters[key].numbers() if key in self.parameters else []

    def texts(self, key: str) -> tuple[str, ...]:
        """Texts of a parameter, none without it."""
        return self.parameters[key].texts() if key in self.parameters else ()


def _order(processor: int) -> str:
    return ">" if processor == MIPS else "<"


def _floats(data: bytes, processor: int) -> NDArray[np.float32]:
    """Floats of 4 bytes."""
    if processor == DEC:  # the first word is the upper one, and the exponent is 2 higher
        words = np.frombuffer(data, "<u2").astype(np.uint32).reshape(-1, 2)
        return np.asarray((words[:, 0] << 16 | words[:, 1]).view(np.float32) / np.float32(4.0))
    return np.frombuffer(data, f"{_order(processor)}f4")


def _decoded(data: bytes) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_c3d_file(path: Path) -> C3dFile:
    """Header and parameters. Raises InputError where it is damaged."""
    content = read_bytes(path)
    at = (max(content[0], 1) - 1) * BLOCK
    if len(content) < BLOCK or content[1] != 0x50 or len(content) < at + 4:
        found = f"{len(content)} bytes without a header and parameters"
        step = "See that it is a C3D, and export or copy it again"
        raise InputError("damaged C3D file", where=str(path), found=found, next_step=step)
    processor = content[at + 3]
    notes: tuple[str, ...] = ()
    if processor not in (INTEL, DEC, MIPS):
        notes = (f"the file names no known processor ({processor}): it is read as of {INTEL}, little-endian IEEE",)
        processor = INTEL
    order = _order(processor)
    points, analog, first, last = Struct(f"{order}4H").unpack_from(content, 2)
    (block,) = Struct(f"{order}H").unpack_from(content, 16)
    (scale,), (rate,) = (_floats(content[place : place + 4], processor).tolist() for place in (12, 20))
    parameters = _parameters(content, at + 4, processor)
    known = {key: parameters[key].numbers() for key in _OF_THE_HEADER if key in parameters}
    value = {key: numbers[0] for key, numbers in known.items() if numbers and isfinite(numbers[0])}
    return C3dFile(
        content,
        processor,
        points=int(value.get("POINT:USED", points)),
        analog=analog,
        first=first,
        last=last,
        scale=value.get("POINT:SCALE", scale),
        start=(max(block or int(value.get("POINT:DATA_START", 1)), 1) - 1) * BLOCK,
        rate_hz=value.get("POINT:RATE", rate),
        parameters=parameters,
        notes=notes,
    )


_OF_THE_HEADER = ("POINT:USED", "POINT:SCALE", "POINT:RATE", "POINT:DATA_START")
"""Parameters that say what the header says, and say it more widely."""


def _parameters(content: bytes, at: int, processor: int) -> dict[str, Parameter]:
    """Parameters by GROUP:NAME, as far as they can be read. Groups may come after their parameters. The data of one end
    where the next record begins, so all together are no longer than the file."""
    offset = Struct(f"{_order(processor)}H")
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Parameter]] = []
    for _ in range(MAX_PARAMETERS):
        if at + 2 > len(content):
            break
        length, group = abs(int.from_bytes(content[at : at + 1], signed=True)), content[at + 1]
        name, place = _decoded(content[at + 2 : at + 2 + length]).strip().upper(), at + 2 + length
        if not length or not group or place + 4 > len(content):
            break
        (step,) = offset.unpack_from(content, place)
        end = place + step if step else len(content)
        if group >= 0x80:
            groups[0x100 - group] = name
        else:
            kind = int.from_bytes(content[place + 2 : place + 3], signed=True)
            data = place + 4 + content[place + 3]
            dimensions = tuple(content[place + 4 : data])
            size = abs(kind) * prod(dimensions)
            if kind in (CHARACTERS, BYTES, INTEGERS, FLOATS) and data + size <= min(end, len(content)):
                found.append((group, name, Parameter(kind, dimensions, content[data : data + size], processor)))
        if not step:
            break
        at = end
    return {f"{groups.get(group, group)}:{name}": parameter for group, name, parameter in found}


def _points(file: C3dFile, columns: list[int], path: Path) -> tuple[FloatArray, BoolArray, tuple[str, ...]]:
    """Positions (T, m, 3) of these points in the file's unit, where they were seen (T, m), and notes. Raises InputError
    where frames are missing."""
    size = 4 if file.scale <= 0.0 else 2
    width = 4 * file.points + file.analog
    held = max(len(file.content) - file.start, 0) // (size * width)
    count, notes = _frame_count(file, held, size * width, str(path))
    data = file.content[file.start : file.start + count * width * size]
    values: NDArray[Any] = np.frombuffer(data, f"{_order(file.processor)}i2")
    with np.errstate(invalid="ignore"):  # signalling NaNs from outside
        if size == 4:
            values = _floats(data, file.processor)
        whole = values.reshape(count, width)[:, : 4 * file.points].reshape(count, file.points, 4)
        points = whole[:, columns].astype(float)
    position = points[..., :3] * (1.0 if size == 4 else file.scale)
    seen = (points[..., 3] >= 0.0) & np.all(np.abs(position) <= MAX_VALUE, axis=-1) & np.any(position != 0.0, axis=-1)
    return np.where(seen[..., None], position, np.nan), seen, notes


def _frame_count(file: C3dFile, held: int, frame_bytes: int, where: str) -> tuple[int, tuple[str, ...]]:
    """Frames of the recording, and a note. held: as many as the bytes of the file make, padding of its last block
    included.

    Header, TRIAL and POINT say it, in 16 bits, which wrap or stay at their end, in two words of 16 bits, or as a float.
    The largest that fills the file counts; where none does, the file may hold a few more or fewer than the largest.
    """
    ends = [file.numbers(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END")]
    said = [file.last - file.first + 1.0]
    if all(ends):
        first, last = (words[0] + (FULL + 1.0) * (words[1] if len(words) > 1 else 0.0) for words in ends)
        said.append(last - first + 1.0)
    said += [value for key in ("FRAMES", "LONG_FRAMES") for value in file.numbers(f"POINT:{key}")[:1]]
    declared = [int(count) for count in said if isfinite(count)]
    longest = max(declared)
    possible = [held - (held - count) % (FULL + 1) for count in declared if count <= held]
    if filling := [count for count in possible if count > 0 and (held - count) * frame_bytes < BLOCK]:
        count = max(filling)
        wrapped = f"the file declares {longest} frames, a count that wrapped, and holds {count}: all of these are read"
        notes: tuple[str, ...] = () if count in declared else (wrapped,)
    elif FULL <= longest <= FULL + 1:  # the counter is at its end
        count, notes = held, frames_held(min(held, FULL), FULL, where)
    else:
        check_frame_count(longest, where)
        count, notes = held, frames_held(held, longest, where)
    check_frame_count(count, where)
    return count, notes


# The markers, and which of them make a sensor.

_GROUPS = names_of_sides(TABLES["markers"])
Groups = Mapping[str, tuple[tuple[str, ...], ...]]
"""Sensor -> groups of markers, best first; names in upper case."""
MARKER_GROUPS: Groups = {name: _GROUPS[name] for name in SENSORS if name in _GROUPS}
"""The usual ones."""
LABEL_CHARACTERS = 64
"""Characters of the longest label that is shown, and of one in a table of the user."""

Label = Annotated[Text, Field(max_length=LABEL_CHARACTERS)] | Annotated[int, Field(ge=1, le=MAX_POINTS)]


class MarkerTable(Schema):
    """The user's own table of markers."""

    markers: Annotated[
        dict[Name, Annotated[tuple[Label, ...], Field(min_length=1, max_length=32)]], Field(min_length=1, max_length=64)
    ]
    """Sensor -> the labels of its markers; a point without a label has its number, from 1."""


def read_marker_table(path: Path) -> Groups:
    """Groups of markers by sensor: those of the user's table, and the usual ones of sensors that it leaves out. Raises
    ConfigError with all its problems."""

    def check(table: MarkerTable, document: Document) -> list[Problem]:
        unknown = [sensor for sensor in table.markers if sensor not in SENSORS]
        return [unknown_name(document, ("markers", sensor), "sensor", sensor, SENSORS) for sensor in unknown]

    table, _ = read_model(MarkerTable, path, check=check)
    own = {sensor: (tuple(str(label).upper() for label in labels),) for sensor, labels in table.markers.items()}
    return {**MARKER_GROUPS, **own}


def split_label(label: str, known: Set[str]) -> tuple[str, str] | None:
    """The subject ("" for none) and the known marker that a label names: the longest known end behind any sign that is
    no letter and no digit, as in `Anna:LFHD` and `Anna_LFHD`. None where no end of it is known."""
    upper = label.upper()
    for start in [0, *(match.end() for match in re.finditer(r"[\W_]", upper))]:
        if upper[start:] in known:
            return label[: max(start - 1, 0)], upper[start:]
    return None


def groups_in(labels: Iterable[str], groups: Groups = MARKER_GROUPS) -> dict[str, tuple[str, ...]]:
    """Sensor -> the group of markers that stands for it, for the sensors that these labels allow."""
    known = set(labels)
    whole = {sensor: [one for one in options if known.issuperset(one)] for sensor, options in groups.items()}
    return {sensor: found[0] for sensor, found in whole.items() if found}


NEAR_M, FAR_M = 0.03, 5.0
"""A marker farther than the second from the median of the performer's markers is lost, whatever its residual. Where
most are farther, or nearer than the first, the unit is another one."""


def read_c3d(
    path: Path,
    *,
    unit: str | None = None,
    rate: float | None = None,
    up: FloatArray | None = None,
    markers: Path | None = None,
) -> SensorFrames:
    """Read the sensors that the markers of a file allow.

    unit, rate, up (3,): instead of the file's. markers: the user's own table of markers. Raises InputError if the file
    is damaged, or holds no known marker, ConfigError for the table.
    """
    groups = MARKER_GROUPS if markers is None else read_marker_table(markers)
    file = read_c3d_file(path)
    rate = check_rate(file.rate_hz, str(path)) if rate is None else check_rate(rate, "--rate")
    labels = _labels(file, path)
    columns, subject_note = _one_subject(labels, groups)
    if markers is not None:
        _refuse_missing(groups, columns, labels, markers)
    chosen = groups_in(columns, groups)
    if not chosen:
        raise _no_marker(labels, path)
    sensors = tuple(sensor for sensor in SENSORS if sensor in chosen)
    used = sorted({columns[name] for sensor in sensors for name in chosen[sensor]})
    metres, unit, unit_note = _metres(file.texts("POINT:UNITS"), unit, path)
    position, seen, count_note = _points(file, used, path)
    position *= metres
    far_note = _lose_far(position, seen, path, unit)
    rows = [[used.index(columns[name]) for name in chosen[sensor]] for sensor in sensors]
    valid = np.stack([seen[:, group].all(axis=1) for group in rows], axis=1)
    position = np.stack([position[:, group].mean(axis=1) for group in rows], axis=1)
    position[~valid] = np.nan
    axes, axes_note = world_axes(
        dict(zip(sensors, np.moveaxis(position, 1, 0), strict=True)),
        declared=UP_AXES.get(next(iter(file.texts("POINT:Y_SCREEN")), "").lower().removeprefix("+")),
        declared_by="its Y_SCREEN",
        usual=UP_AXES["z"],
        asked=up,
    )
    notes = [*file.notes, *subject_note, *count_note, *unit_note, *axes_note, *far_note]
    without = [sensor for sensor in MARKER_GROUPS if sensor not in chosen]
    others = [label for column, label in enumerate(labels) if column not in used]
    if without and others:
        notes.append(f"no markers of {', '.join(without)}; the other labels are {_shown(others)} (see --markers)")
    counts = zip(sensors, (~valid).sum(axis=0).tolist(), strict=True)
    notes += [f"{sensor} lost in {count} of {len(valid)} frames" for sensor, count in counts if count]
    return SensorFrames(
        time=frame_times(len(position), rate),
        names=sensors,
        position=matmul(position, axes.T),
        orientation=np.full((*valid.shape, 4), np.nan),
        valid=valid,
        source=str(path),
        rate_hz=rate,
        notes=(*notes, "sensors are means of skin markers, not joint centres"),
    )


def _labels(file: C3dFile, path: Path) -> tuple[str, ...]:
    """Labels of the points, which go on in LABELS2, LABELS3 and so on beyond 255; the number of one that has none."""
    if file.points < 1:
        step = "Export the recording with its labelled 3D markers (trajectories)"
        raise InputError("the file holds no markers", where=str(path), found=f"{file.points} points", next_step=step)
    if file.points > MAX_POINTS:
        raise InputError(
            "impossible number of points", where=str(path), found=file.points, allowed=f"1 to {MAX_POINTS}"
        )
    named = [label for more in ("", *range(2, 2 + file.points // 255)) for label in file.texts(f"POINT:LABELS{more}")]
    named += [""] * (file.points - len(named))
    return tuple(label or str(number) for number, label in enumerate(named[: file.points], start=1))


def _no_marker(labels: tuple[str, ...], path: Path) -> InputError:
    return InputError(
        "no known marker",
        where=str(path),
        found=_shown(labels),
        allowed="Vicon names such as LFHD, LWRA, LANK (docs/motion-files.md)",
        next_step="Name the markers of each sensor in a table, and give it with --markers FILE.yaml",
    )


def _shown(labels: Iterable[str]) -> str:
    return listed((label[:LABEL_CHARACTERS] for label in labels), limit=40)


def _refuse_missing(groups: Groups, columns: Mapping[str, int], labels: tuple[str, ...], table: Path) -> None:
    """Raise InputError for labels of the user's table that the file does not have."""
    own = {sensor: group for sensor, (group, *_) in groups.items() if groups[sensor] is not MARKER_GROUPS.get(sensor)}
    problems = [
        Problem(
            f"no marker {label!r} in the file",
            f"{table}: markers.{sensor}",
            allowed=_shown(labels),
            next_step=suggest(label, [one.upper() for one in labels]) or "Write it as the file does",
        )
        for sensor, group in own.items()
        for label in group
        if label not in columns
    ]
    if problems:
        raise InputError.from_problems(problems)


def _one_subject(labels: tuple[str, ...], groups: Groups) -> tuple[dict[str, int], tuple[str, ...]]:
    """Marker name -> column, of the subject with the most sensors; a note where there are more subjects."""
    known = frozenset(name for options in groups.values() for group in options for name in group)
    subjects: dict[str, dict[str, int]] = {"": {}}
    for column, label in enumerate(labels):
        if split := split_label(label, known):
            subjects.setdefault(split[0], {}).setdefault(split[1], column)
    sensors = {subject: len(groups_in(columns, groups)) for subject, columns in subjects.items()}
    best = max(subjects, key=sensors.__getitem__)
    people = [subject for subject in subjects if sensors[subject]]
    note = f"{len(people)} performers in the file ({_shown(people)}): only {best[:LABEL_CHARACTERS]!r} is read"
    return subjects[best], (note,) if len(people) > 1 else ()


_UNIT_NAMES = {
    **{
        f"{prefix}met{end}": unit
        for prefix, unit in (("", "m"), ("centi", "cm"), ("milli", "mm"))
        for end in ("er", "re")
    },
    "in": "inch",
    "inche": "inch",
}
"""Unit names in lower case without a plural s -> ours."""


def _metres(texts: tuple[str, ...], unit: str | None, path: Path) -> tuple[float, str, tuple[str, ...]]:
    """Metres per unit, its name, and a note where the file states none. texts: of POINT:UNITS, one for all points or
    one each."""
    if unit is not None and (named := named_unit(unit)) is not None:
        return named, unit, ()
    words = [word for text in texts for word in re.findall(r"\w+", text.lower())]
    if not words:
        return UNITS["mm"], "mm", ("unit not stated: taken as mm (change it with --unit)",)
    name = words[0].rstrip("s")
    name = _UNIT_NAMES.get(name, name)
    if name in UNITS:
        return UNITS[name], name, ()
    raise InputError(
        "unknown unit in the file",
        where=str(path),
        found=repr(" ".join(texts)[:20]),
        allowed=", ".join(UNITS),
        next_step="Say it with --unit",
    )


def _lose_far(position: FloatArray, seen: BoolArray, path: Path, unit: str) -> tuple[str, ...]:
    """Take markers (T, m, 3), m, that are far from all others as lost, in place, with a note. Raises InputError where
    all lie as no body's do."""
    with np.errstate(invalid="ignore"):
        filled = np.where(seen[..., None], position, np.nan)
        rows = np.flatnonzero(seen.any(axis=1))
        away = np.full(seen.shape, np.nan)
        away[rows] = norms(filled[rows] - np.nanmedian(filled[rows], axis=1, keepdims=True))
    usual = float(np.nanmedian(away)) if len(rows) else NEAR_M
    if len(position[0]) > 2 and not NEAR_M <= usual <= FAR_M:
        raise InputError(
            "the markers lie as those of no human body do",
            where=str(path),
            found=f"{usual:.3g} m from their middle, with {unit} as the unit of length",
            allowed=f"{NEAR_M:g} to {FAR_M:g} m",
            next_step="Give the unit of the file with --unit",
        )
    far = np.asarray(away > FAR_M)
    position[far], seen[far] = np.nan, False
    count = int(np.count_nonzero(far))
    return (f"{count} marker positions more than {FAR_M:g} m from the others: taken as lost",) if count else ()
