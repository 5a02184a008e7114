"""Recordings of markers (C3D, TRC) -> sensor frames.

A sensor is the mean of a group of markers (`skeletons.yaml`, or the user's own table), valid in a frame when all of
them were seen; a marker that is far from all others is lost. Positions only: markers know no joint and no orientation.
The body decides which axis is up; heading and ground stay where the file has them.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from retarget.arithmetic import matmul, norms
from retarget.errors import InputError, Problem, suggest
from retarget.frames import SENSORS, SensorFrames
from retarget.schema.strict_models import Name, Schema, Text, listed, read_model, unknown_name
from retarget.schema.strict_yaml import Document
from retarget.sources.axes import world_axes
from retarget.sources.canonical import UNITS, named_unit
from retarget.sources.files import ReadOptions, check_rate, frame_times, lost_notes
from retarget.sources.skeletons import TABLES, names_of_sides
from retarget.types import BoolArray, FloatArray

MAX_POINTS = 5000
"""Recordings with more markers are refused."""

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


@dataclass(frozen=True, eq=False)
class MarkerRecording:
    """Markers of a file, in its axes and its unit.

    labels (n): of all markers. points: from columns among them to positions (T, m, 3), NaN where lost, where they were
    seen (T, m), and notes. rate_hz: frames per second. units: names of the unit of length, none if not stated. up (3,):
    the axis that the file says is up, by `up_by`, None if it does not. usual_up (3,): what such files mostly have.
    notes: to the user about this file.
    """

    labels: tuple[str, ...]
    points: Callable[[list[int]], tuple[FloatArray, BoolArray, tuple[str, ...]]]
    rate_hz: float
    units: tuple[str, ...]
    up: FloatArray | None
    usual_up: FloatArray
    up_by: str = "the file"
    notes: tuple[str, ...] = ()


def marker_frames(recording: MarkerRecording, path: Path, options: ReadOptions) -> SensorFrames:
    """The sensors that the markers of a file allow. Raises InputError if there is no known marker, ConfigError for the
    user's table of markers."""
    markers, said = options.markers, options.rate
    groups = MARKER_GROUPS if markers is None else read_marker_table(markers)
    rate = check_rate(recording.rate_hz, str(path)) if said is None else check_rate(said, "--rate")
    labels = recording.labels
    columns, subject_note = _one_subject(labels, groups)
    if markers is not None:
        _refuse_missing(groups, columns, labels, markers)
    chosen = groups_in(columns, groups)
    if not chosen:
        raise _no_marker(labels, path)
    sensors = tuple(sensor for sensor in SENSORS if sensor in chosen)
    used = sorted({columns[name] for sensor in sensors for name in chosen[sensor]})
    metres, unit, unit_note = _metres(recording.units, options.unit, path)
    position, seen, count_note = recording.points(used)
    position *= metres
    far_note = _lose_far(position, seen, path, unit)
    rows = [[used.index(columns[name]) for name in chosen[sensor]] for sensor in sensors]
    valid = np.stack([seen[:, group].all(axis=1) for group in rows], axis=1)
    position = np.stack([position[:, group].mean(axis=1) for group in rows], axis=1)
    position[~valid] = np.nan
    axes, axes_note = world_axes(
        dict(zip(sensors, np.moveaxis(position, 1, 0), strict=True)),
        declared=recording.up,
        declared_by=recording.up_by,
        usual=recording.usual_up,
        said=options.up,
    )
    notes = [*recording.notes, *subject_note, *count_note, *unit_note, *axes_note, *far_note]
    without = [sensor for sensor in MARKER_GROUPS if sensor not in chosen]
    others = [label for column, label in enumerate(labels) if column not in used]
    if without and others:
        notes.append(f"no markers of {', '.join(without)}; the other labels are {_shown(others)} (see --markers)")
    notes += lost_notes(sensors, valid)
    return SensorFrames(
        time=frame_times(len(position), rate),
        names=sensors,
        position=matmul(position, axes.T),
        orientation=np.full((*valid.shape, 4), np.nan),
        valid=valid,
        source=str(path),
        rate_hz=rate,
        notes=(*notes, "sensors are means of skin markers, not joint centres"),
        stature=options.stature,
    )


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
