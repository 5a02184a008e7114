"""Recordings of markers (C3D, TRC) -> sensor frames.

A sensor is the mean of a group of markers (`skeletons.yaml`, or the user's table), valid in a frame if all of them were
seen. Markers give positions only. The body decides which axis is up; heading and ground stay as in the file.
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
from retarget.sources.files import ReadOptions, check_rate, lost_notes
from retarget.sources.skeletons import TABLES, names_of_sides
from retarget.types import BoolArray, FloatArray

MAX_POINTS = 5000
"""Most markers of a recording."""

_GROUPS = names_of_sides(TABLES["markers"])
Groups = Mapping[str, tuple[tuple[str, ...], ...]]
"""Sensor -> groups of marker names in upper case, best first."""
MARKER_GROUPS: Groups = {name: _GROUPS[name] for name in SENSORS if name in _GROUPS}
LABEL_CHARACTERS = 64
"""Characters of the longest label."""

Label = Annotated[Text, Field(max_length=LABEL_CHARACTERS)] | Annotated[int, Field(ge=1, le=MAX_POINTS)]


class MarkerTable(Schema):
    """The user's own table of markers."""

    markers: Annotated[
        dict[Name, Annotated[tuple[Label, ...], Field(min_length=1, max_length=32)]], Field(min_length=1, max_length=64)
    ]
    """Sensor -> the labels of its markers; a point without a label has its number, from 1."""


def read_marker_table(path: Path) -> Groups:
    """Groups of markers by sensor: the user's table, completed by the usual groups. Raises ConfigError with all its
    problems."""

    def check(table: MarkerTable, document: Document) -> list[Problem]:
        unknown = [sensor for sensor in table.markers if sensor not in SENSORS]
        return [unknown_name(document, ("markers", sensor), "sensor", sensor, SENSORS) for sensor in unknown]

    table = read_model(MarkerTable, path, check=check)
    own = {sensor: (tuple(str(label).upper() for label in labels),) for sensor, labels in table.markers.items()}
    return {**MARKER_GROUPS, **own}


def split_label(label: str, known: Set[str]) -> tuple[str, str] | None:
    """Subject ("" for none) and known marker of a label: its longest known end after a sign, as in `Anna:LFHD` and
    `Anna_LFHD`; None if none is known."""
    upper = label.upper()
    for start in [0, *(match.end() for match in re.finditer(r"[\W_]", upper))]:
        if upper[start:] in known:
            return label[: max(start - 1, 0)], upper[start:]
    return None


def groups_in(labels: Iterable[str], groups: Groups = MARKER_GROUPS) -> dict[str, tuple[str, ...]]:
    """Sensor -> its best group of markers among these labels."""
    known = set(labels)
    whole = {sensor: [one for one in options if known.issuperset(one)] for sensor, options in groups.items()}
    return {sensor: found[0] for sensor, found in whole.items() if found}


NEAR_M, FAR_M = 0.03, 5.0
"""Bounds of the usual distance, m, of the performer's markers from their median: beyond, the unit is wrong. A single
marker beyond the second is lost."""


@dataclass(frozen=True, eq=False)
class MarkerRecording:
    """Markers of a file, in its axes and its unit.

    labels (n): of all markers. points: columns -> positions (T, m, 3), NaN where lost, where they were seen (T, m), and
    notes. units: names of the unit of length. up (3,): the up axis by `up_by`, None if not stated. default_up (3,): the
    usual one of the format.
    """

    labels: tuple[str, ...]
    points: Callable[[list[int]], tuple[FloatArray, BoolArray, tuple[str, ...]]]
    rate_hz: float
    units: tuple[str, ...]
    up: FloatArray | None
    default_up: FloatArray
    up_by: str = "the file"
    notes: tuple[str, ...] = ()


def marker_frames(recording: MarkerRecording, path: Path, options: ReadOptions) -> SensorFrames:
    """The sensors that the markers allow. Raises InputError if no marker is known, ConfigError for the marker table."""
    markers = options.markers
    groups = MARKER_GROUPS if markers is None else read_marker_table(markers)
    rate = check_rate(recording.rate_hz, str(path)) if options.rate is None else check_rate(options.rate, "--rate")
    labels = recording.labels
    columns, subject_note = _one_subject(labels, groups)
    if markers is not None:
        _refuse_missing(groups, columns, labels, markers)
    chosen = groups_in(columns, groups)
    if not chosen:
        raise InputError(
            "no known marker",
            where=str(path),
            found=_shown(labels),
            allowed="Vicon names such as LFHD, LWRA, LANK (docs/motion-files.md)",
            next_step="Name the markers of each sensor in a table, and give it with --markers FILE.yaml",
        )
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
        default=recording.default_up,
        chosen=options.up,
    )
    notes = [*recording.notes, *subject_note, *count_note, *unit_note, *axes_note, *far_note]
    without = [sensor for sensor in MARKER_GROUPS if sensor not in chosen]
    others = [label for column, label in enumerate(labels) if column not in used]
    if without and others:
        notes.append(f"no markers of {', '.join(without)}; the other labels are {_shown(others)} (see --markers)")
    notes += lost_notes(sensors, valid)
    return SensorFrames(
        time=np.arange(len(position)) / rate,
        names=sensors,
        position=matmul(position, axes.T),
        orientation=np.full((*valid.shape, 4), np.nan),
        valid=valid,
        source=str(path),
        rate_hz=rate,
        notes=(*notes, "sensors are means of skin markers, not joint centres"),
        stature=options.stature,
    )


def _shown(labels: Iterable[str]) -> str:
    return listed((label[:LABEL_CHARACTERS] for label in labels), limit=40)


def _refuse_missing(groups: Groups, columns: Mapping[str, int], labels: tuple[str, ...], table: Path) -> None:
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
    """Marker name -> column, of the subject with the most sensors, and a note if there are more."""
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
    "meter": "m",
    "metre": "m",
    "centimeter": "cm",
    "centimetre": "cm",
    "millimeter": "mm",
    "millimetre": "mm",
    "in": "inch",
    "inche": "inch",
}
"""Unit names in lower case, without a plural s -> names of `UNITS`."""


def _metres(texts: tuple[str, ...], unit: str | None, path: Path) -> tuple[float, str, tuple[str, ...]]:
    """Metres per unit, its name, and a note if it is not stated. texts: the file's, one for all points or one each."""
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
    """Mark markers (T, m, 3), m, far from the others as lost, in place, with a note. Raises InputError if they fit no
    human body."""
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
