"""C3D marker recordings (c3d.org, user guide 2008): header, parameters and 3D points; analog channels are skipped.

A point is lost if its residual is negative, it lies at the exact origin, or it is not finite. Blocks have 512 bytes:
header, parameters, then frames, in the byte order of the processor that the parameters name.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite, prod
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.sources.axes import UP_AXES
from retarget.sources.files import AS_WRITTEN, MAX_VALUE, ReadOptions, check_frame_count, frames_held, read_bytes
from retarget.sources.markers import MAX_POINTS, MarkerRecording, marker_frames
from retarget.types import BoolArray, FloatArray

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
"""Processors: little-endian IEEE floats, little-endian words with VAX floats, big-endian IEEE floats."""
CHARACTERS, BYTES, INTEGERS, FLOATS = -1, 1, 2, 4
"""Types of parameters; the magnitude is the size of one element in bytes."""
FULL_COUNTER = 0xFFFF
"""A frame counter of 16 bits at its end: the file holds at least so many frames."""
MAX_PARAMETERS = 10_000
"""Most parameters that are read; further ones are left."""


@dataclass(frozen=True)
class C3dParameter:
    """kind: CHARACTERS, BYTES, INTEGERS or FLOATS. dimensions: of the array, the fastest first."""

    kind: int
    dimensions: tuple[int, ...]
    data: bytes
    processor: int

    def numbers(self) -> list[float]:
        """Values in file order; integers as unsigned; none of texts."""
        if self.kind == CHARACTERS:
            return []
        if self.kind == FLOATS:
            return [*map(float, _floats(self.data, self.processor))]
        return [*map(float, np.frombuffer(self.data, f"{_order(self.processor)}u{self.kind}"))]

    def texts(self) -> tuple[str, ...]:
        """Texts without blanks and NUL at their ends, one for each of the dimensions after the first."""
        if self.kind != CHARACTERS:
            return ()
        length = self.dimensions[0] if self.dimensions else 1
        rows = [self.data[at : at + length] for at in range(0, len(self.data), max(length, 1))]
        return tuple(_decoded(row).strip(" \0\t\r\n") for row in rows)


@dataclass(frozen=True)
class C3dFile:
    """content: all bytes. points: per frame. analog: values per frame to skip. first, last: frames by the header.
    scale: length of one integer step; 0 or less if points are floats. start: byte of the first frame. rate_hz: by the
    header. parameters: by GROUP:NAME in upper case. notes: for the user."""

    content: bytes
    processor: int
    points: int
    analog: int
    first: int
    last: int
    scale: float
    start: int
    rate_hz: float
    parameters: Mapping[str, C3dParameter]
    notes: tuple[str, ...] = ()

    def numbers(self, key: str) -> list[float]:
        """Values of a parameter."""
        return self.parameters[key].numbers() if key in self.parameters else []

    def texts(self, key: str) -> tuple[str, ...]:
        """Texts of a parameter."""
        return self.parameters[key].texts() if key in self.parameters else ()


def _order(processor: int) -> str:
    return ">" if processor == MIPS else "<"


def _floats(data: bytes, processor: int) -> NDArray[np.float32]:
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
    """Header and parameters. Raises InputError if they are damaged."""
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
"""Parameters that overrule the header, which has fewer bits for them."""


def _parameters(content: bytes, at: int, processor: int) -> dict[str, C3dParameter]:
    """Parameters by GROUP:NAME, as far as they can be read. The data of one end where the next begins, so all are no
    longer than the file."""
    offset = Struct(f"{_order(processor)}H")
    groups: dict[int, str] = {}
    found: list[tuple[int, str, C3dParameter]] = []
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
                found.append((group, name, C3dParameter(kind, dimensions, content[data : data + size], processor)))
        if not step:
            break
        at = end
    return {f"{groups.get(group, group)}:{name}": parameter for group, name, parameter in found}


def _points(file: C3dFile, columns: list[int], *, path: Path) -> tuple[FloatArray, BoolArray, tuple[str, ...]]:
    """Positions (T, m, 3) of these points in the file's unit, where they were seen (T, m), and notes. Raises InputError
    if frames are missing."""
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
    """Frames of the recording, and a note. held: frames in the bytes of the file, with the padding of its last block.

    Header, TRIAL and POINT declare the count in 16 bits, which wrap or saturate, in two words of 16 bits, or as a
    float. The largest count that fills the file is used, else the file may hold a few frames more or fewer than the
    largest.
    """
    ends = [file.numbers(f"TRIAL:ACTUAL_{end}_FIELD") for end in ("START", "END")]
    said = [file.last - file.first + 1.0]
    if all(ends):
        first, last = (words[0] + (FULL_COUNTER + 1.0) * (words[1] if len(words) > 1 else 0.0) for words in ends)
        said.append(last - first + 1.0)
    said += [value for key in ("FRAMES", "LONG_FRAMES") for value in file.numbers(f"POINT:{key}")[:1]]
    declared = [int(count) for count in said if isfinite(count)]
    longest = max(declared)
    possible = [held - (held - count) % (FULL_COUNTER + 1) for count in declared if count <= held]
    if filling := [count for count in possible if count > 0 and (held - count) * frame_bytes < BLOCK]:
        count = max(filling)
        wrapped = f"the file declares {longest} frames, a count that wrapped, and holds {count}: all of these are read"
        notes: tuple[str, ...] = () if count in declared else (wrapped,)
    elif FULL_COUNTER <= longest <= FULL_COUNTER + 1:
        count, notes = held, frames_held(min(held, FULL_COUNTER), FULL_COUNTER, where)
    else:
        check_frame_count(longest, where)
        count, notes = held, frames_held(held, longest, where)
    check_frame_count(count, where)
    return count, notes


def read_c3d(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read the sensors that the markers allow. Raises InputError for damage or unknown markers, ConfigError for the
    marker table."""
    file = read_c3d_file(path)
    recording = MarkerRecording(
        labels=_labels(file, path),
        points=partial(_points, file, path=path),
        rate_hz=file.rate_hz,
        units=file.texts("POINT:UNITS"),
        up=UP_AXES.get(next(iter(file.texts("POINT:Y_SCREEN")), "").lower().removeprefix("+")),
        up_by="its Y_SCREEN",
        default_up=UP_AXES["z"],
        notes=file.notes,
    )
    return marker_frames(recording, path, options)


def _labels(file: C3dFile, path: Path) -> tuple[str, ...]:
    """Labels of the points, continued in LABELS2, LABELS3, ...; the number of a point without one."""
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
