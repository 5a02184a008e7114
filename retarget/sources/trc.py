"""Marker tables (.trc, OpenSim and Motion Analysis): tab separated, five header lines, usually y up.

A marker is lost if its cells are empty or NaN, or it lies at the exact origin.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.sources.axes import UP_AXES
from retarget.sources.files import (
    AS_WRITTEN,
    ReadOptions,
    check_frame_count,
    cut_short,
    frames_held,
    no_frame_rate,
    numbers,
    read_lines,
)
from retarget.sources.markers import MAX_POINTS, MarkerRecording, marker_frames
from retarget.types import BoolArray, FloatArray

HEADER_LINES = 5
"""Lines before the data: the file, names and values of its properties, names of markers, names of columns."""
MAX_POSITIONS = 5_000_000
"""Most marker positions in all frames: more than the largest file holds at 8 characters a number."""
LOST = ("", "nan")
"""Cells, in lower case, of a marker that was not seen."""


def read_trc(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read the sensors that the markers allow. Raises InputError with file and line, ConfigError for the marker
    table."""
    lines = read_lines(path)
    about = _about(lines, path)
    labels = _labels(lines, path)
    position = _positions(lines, len(labels), path)
    notes: tuple[str, ...] = ()
    if declared := about.get("numframes", ""):
        if not (declared.isascii() and declared.isdecimal() and len(declared) <= 12):
            raise InputError(
                "wrong number of frames", where=f"{path}:3", found=repr(declared[:40]), allowed="a whole number"
            )
        notes = frames_held(len(position), int(declared), f"{path}:3")
    if (rate := options.rate) is None:
        if "datarate" not in about:
            raise no_frame_rate(f"{path}:2", allowed="DataRate")
        rate = numbers([about["datarate"]], f"{path}:3")[0]

    def points(columns: list[int]) -> tuple[FloatArray, BoolArray, tuple[str, ...]]:
        chosen = position[:, columns]
        seen = np.isfinite(chosen).all(axis=-1) & (chosen != 0.0).any(axis=-1)
        return np.where(seen[..., None], chosen, np.nan), seen, ()

    recording = MarkerRecording(
        labels=labels,
        points=points,
        rate_hz=rate,
        units=tuple(filter(None, (about.get("units", ""),))),
        up=None,
        default_up=UP_AXES["y"],
        notes=notes,
    )
    return marker_frames(recording, path, options)


def _about(lines: Sequence[str], path: Path) -> dict[str, str]:
    if not lines[0].startswith("PathFileType") or len(lines) <= HEADER_LINES:
        raise InputError(
            "not a TRC file",
            where=f"{path}:1",
            found=repr(lines[0][:40]),
            allowed=f"PathFileType, and {HEADER_LINES} lines of a header",
            next_step="Check that this is the recording, as text and whole",
        )
    names, values = (line.split("\t") for line in lines[1:3])
    return {name.strip().lower(): value.strip() for name, value in zip(names, values, strict=False)}


def _labels(lines: Sequence[str], path: Path) -> tuple[str, ...]:
    """Names of the markers: each stands over three columns, after Frame# and Time."""
    cells = [cell.strip() for cell in lines[3].split("\t")]
    named = [cell for cell in cells[2:] if cell]
    if cells[:1] != ["Frame#"] or not named:
        raise InputError(
            "no names of markers", where=f"{path}:4", found=repr(lines[3][:40]), allowed="Frame#, Time, then the names"
        )
    if len(named) > MAX_POINTS:
        raise InputError("too many markers", where=f"{path}:4", found=len(named), allowed=f"up to {MAX_POINTS}")
    return tuple(named)


def _positions(lines: Sequence[str], count: int, path: Path) -> FloatArray:
    """Positions (T, count, 3), NaN where lost; the size is checked before the memory is taken."""
    rows = [index for index in range(HEADER_LINES, len(lines)) if lines[index].strip()]
    check_frame_count(len(rows), str(path))
    if len(rows) * count > MAX_POSITIONS:
        raise InputError(
            "too many positions",
            where=str(path),
            found=f"{len(rows)} frames of {count} markers",
            allowed=f"up to {MAX_POSITIONS} positions",
            next_step="Cut the recording into parts, or export fewer markers",
        )
    width, position = 2 + 3 * count, np.full((len(rows), 3 * count), np.nan)
    for row, index in enumerate(rows):
        where, cells = f"{path}:{index + 1}", [cell.strip() for cell in lines[index].split("\t")]
        try:
            if len(cells) < 2 or any(cells[width:]):
                raise InputError(
                    "wrong number of values in a frame",
                    where=where,
                    found=len(cells),
                    allowed=f"up to {width}: number, time and {count} markers, with tabs between them",
                )
            cells = (cells + [""] * width)[2:width]
            there = np.array([cell.lower() not in LOST for cell in cells])
            seen = there.reshape(count, 3)
            if (seen.any(axis=1) != seen.all(axis=1)).any():
                raise InputError(
                    "a marker with a part of its position",
                    where=where,
                    allowed="three numbers, or three empty cells where it was not seen",
                    next_step="Check that tabs stand between the values, or export the file again",
                )
            position[row, there] = numbers([cell for cell in cells if cell.lower() not in LOST], where)
        except InputError as error:
            raise cut_short(error, lines[index + 1 :]) from None
    return position.reshape(len(rows), count, 3)
