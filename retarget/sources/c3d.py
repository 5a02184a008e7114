"""C3D marker recordings, parsed by the `c3d` package (an extra).

A sensor is the mean of a group of markers (`markers`), valid in a frame when all of them were seen: a point is lost
where its residual is negative, it lies at the exact origin, or it is not finite. Positions only: markers know no joint
and no orientation. Unit, rate and up axis are the file's own; heading and ground stay where the file has them.
"""

import io
import struct
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from retarget.arithmetic import matmul
from retarget.errors import InputError
from retarget.frames import SENSORS, SensorFrames
from retarget.sources.axes import axes_with_up
from retarget.sources.canonical import UNITS, named_unit
from retarget.sources.files import MAX_VALUE, check_frame_count, check_rate, frame_times, read_bytes
from retarget.sources.skeletons import TABLES, names_of_sides
from retarget.types import BoolArray, FloatArray

_GROUPS = names_of_sides(TABLES["markers"])
MARKER_GROUPS: dict[str, tuple[tuple[str, ...], ...]] = {name: _GROUPS[name] for name in SENSORS if name in _GROUPS}
"""Sensor -> groups of markers, best first."""
KNOWN_MARKERS: frozenset[str] = frozenset(
    name for groups in MARKER_GROUPS.values() for group in groups for name in group
)
"""Every marker name that some group uses."""


def marker_name(label: str) -> str:
    """Name of a marker without its subject's prefix, in upper case."""
    return label.rpartition(":")[2].strip().upper()


def groups_in(labels: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Sensor -> the group of markers that stands for it, for the sensors that these labels allow."""
    known = set(labels)
    chosen = {}
    for sensor, groups in MARKER_GROUPS.items():
        whole = next((group for group in groups if known.issuperset(group)), None)
        if whole is not None:
            chosen[sensor] = whole
    return chosen


MAX_POINTS = 5000
"""Recordings with more points are refused."""

_UNIT_NAMES = {"in": "inch", "inches": "inch", "meters": "m", "metres": "m", "millimeters": "mm", "millimetres": "mm"}


@dataclass(frozen=True)
class MarkerTracks:
    """The markers that some sensor can use, over time, in the file's axes and unit.

    labels (m): as in the file, without blanks at the ends. position (T, m, 3), NaN where lost. seen (T, m). rate_hz.
    unit: its name, "" if not stated. up (3,): unit vector.
    """

    labels: tuple[str, ...]
    position: FloatArray
    seen: BoolArray
    rate_hz: float
    unit: str
    up: FloatArray


def read_c3d(
    path: Path, *, unit: str | None = None, rate: float | None = None, up: FloatArray | None = None
) -> SensorFrames:
    """Read the sensors that the markers of a file allow.

    unit, rate: instead of the file's. up (3,): the up axis. Raises InputError if the `c3d` package is missing, the file
    is damaged, or it holds no known marker.
    """
    markers = read_markers(path)
    columns, notes = _one_subject(markers.labels)
    groups = groups_in(columns)
    if not groups:
        raise _no_marker(markers.labels, path)
    sensors = tuple(sensor for sensor in SENSORS if sensor in groups)
    position, valid = _sensor_tracks(markers, [[columns[label] for label in groups[sensor]] for sensor in sensors])
    scale, unit_note = _metres(markers, unit, path)
    position = matmul(position, axes_with_up(markers.up if up is None else up).T) * scale
    counts = zip(sensors, (~valid).sum(axis=0).tolist(), strict=True)
    lost = [f"{sensor} lost in {count} of {len(valid)} frames" for sensor, count in counts if count]
    rate = markers.rate_hz if rate is None else check_rate(rate, "--rate")
    return SensorFrames(
        time=frame_times(len(position), rate),
        names=sensors,
        position=position,
        orientation=np.full((*valid.shape, 4), np.nan),
        valid=valid,
        source=str(path),
        rate_hz=rate,
        notes=(*notes, *unit_note, *lost, "sensors are means of skin markers, not joint centres"),
    )


def read_markers(path: Path) -> MarkerTracks:
    """The markers of a file that some sensor can use. Raises InputError as `read_c3d`."""
    reader_class = _reader_class()
    content = read_bytes(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader = reader_class(io.BytesIO(content))
            return _tracks(reader, path)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - the package raises whatever a damaged file leads it to
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise InputError(
            "damaged C3D file", where=str(path), found=reason, next_step="Export or download it again"
        ) from None


def _reader_class() -> Any:
    """The package's reader, without its self-check: it refuses files that only their analog part contradicts."""
    try:
        import c3d
    except ImportError:
        raise InputError(
            "C3D files need an extra package",
            found="no module 'c3d'",
            next_step="Install it with: pip install 'retarget[c3d]'",
        ) from None

    class Reader(c3d.Reader):  # type: ignore[misc, unused-ignore]
        def _check_metadata(self) -> None:
            """Points are checked by `_tracks`; analog channels are not read."""

    return Reader


def _tracks(reader: Any, path: Path) -> MarkerTracks:
    where = str(path)
    declared, points = int(reader.last_frame) - int(reader.first_frame) + 1, int(reader.point_used)
    check_frame_count(declared, where)
    if not 1 <= points <= MAX_POINTS:
        raise InputError("impossible number of points", where=where, found=points, allowed=f"1 to {MAX_POINTS}")
    labels = _labels(reader, points)
    columns = [column for column, label in enumerate(labels) if marker_name(label) in KNOWN_MARKERS]
    if not columns:
        raise _no_marker(labels, path)
    frames = []
    for _, block, _ in reader.read_frames(copy=True, analog_transform=False):
        frames.append(block[columns, :4])
    if len(frames) < declared:
        raise InputError(
            "fewer frames than declared",
            where=where,
            found=len(frames),
            allowed=declared,
            next_step="The file is cut short: get it again",
        )
    data = np.array(frames, float)
    position = data[..., :3]
    seen = (data[..., 3] >= 0.0) & np.all(np.abs(position) <= MAX_VALUE, axis=-1) & np.any(position != 0.0, axis=-1)
    return MarkerTracks(
        labels=tuple(labels[column] for column in columns),
        position=np.where(seen[..., None], position, np.nan),
        seen=seen,
        rate_hz=check_rate(float(reader.point_rate), where),
        unit=_text(reader, "POINT:UNITS"),
        up=_up_axis(_text(reader, "POINT:Y_SCREEN")),
    )


def _no_marker(labels: tuple[str, ...], path: Path) -> InputError:
    allowed = "Vicon names such as LFHD, LWRA, LANK (docs/motion-files.md)"
    found = ", ".join(labels[:12]) or "no labels"
    return InputError("no known marker", where=str(path), found=found, allowed=allowed)


def _labels(reader: Any, points: int) -> tuple[str, ...]:
    """Names of the points; beyond 255 they go on in LABELS2, LABELS3 and so on."""
    labels: list[str] = []
    for suffix in ("", *range(2, 2 + points // 255)):
        parameter = reader.get(f"POINT:LABELS{suffix}")
        if parameter is not None:
            labels += [str(label).strip() for label in parameter.string_array]
    return tuple(labels[:points])


def _text(reader: Any, key: str) -> str:
    parameter = reader.get(key)
    try:
        return "" if parameter is None else str(parameter.string_value).strip()
    except (UnicodeDecodeError, struct.error, IndexError):
        return ""


def _up_axis(text: str) -> FloatArray:
    """Up as the file's screen has it (Y_SCREEN, such as +Z); z where it says nothing."""
    axis = "XYZ".find(text[-1:].upper()) if text else 2
    up = np.zeros(3)
    up[axis if axis >= 0 else 2] = -1.0 if text.startswith("-") else 1.0
    return up


def _one_subject(labels: tuple[str, ...]) -> tuple[dict[str, int], tuple[str, ...]]:
    """Marker name -> column, of the subject with the most sensors; a note where there are more subjects."""
    subjects: dict[str, dict[str, int]] = {}
    for column, label in enumerate(labels):
        subject = label.rpartition(":")[0]
        subjects.setdefault(subject, {}).setdefault(marker_name(label), column)
    best = max(subjects, key=lambda subject: len(groups_in(subjects[subject])))
    people = [subject for subject in subjects if groups_in(subjects[subject])]
    note = (
        (f"{len(people)} performers in the file ({', '.join(people)}): only {best!r} is read",)
        if len(people) > 1
        else ()
    )
    return subjects[best], note


def _sensor_tracks(markers: MarkerTracks, groups: list[list[int]]) -> tuple[FloatArray, BoolArray]:
    """Sensor positions (T, k, 3), NaN where lost, and validity (T, k)."""
    valid = np.stack([markers.seen[:, group].all(axis=1) for group in groups], axis=1)
    position = np.stack([markers.position[:, group].mean(axis=1) for group in groups], axis=1)
    return np.where(valid[..., None], position, np.nan), valid


def _metres(markers: MarkerTracks, unit: str | None, path: Path) -> tuple[float, tuple[str, ...]]:
    """Metres per unit, and a note where the file states none."""
    if (named := named_unit(unit)) is not None:
        return named, ()
    name = markers.unit.lower()
    name = _UNIT_NAMES.get(name, name)
    if name in UNITS:
        return UNITS[name], ()
    if name:
        raise InputError(
            "unknown unit in the file",
            where=str(path),
            found=repr(markers.unit[:20]),
            allowed=", ".join(UNITS),
            next_step="Say it with --unit",
        )
    return UNITS["mm"], ("unit not stated: taken as mm (change it with --unit)",)
