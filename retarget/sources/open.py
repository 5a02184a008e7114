"""Opening any motion file: the reader is chosen by what the file holds, and by its suffix where that says nothing.

The word `sample` names the recording that comes with the package; a file of that name is `./sample`.
A new format needs `retarget/sources/NAME.py` with `read_NAME(path, *, unit, rate) -> SensorFrames`, and its row here.
"""

import re
import shlex
from dataclasses import replace
from pathlib import Path

from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import STATURE_M
from retarget.sources.asf_amc import read_amc
from retarget.sources.axes import named_axis
from retarget.sources.bvh import read_bvh
from retarget.sources.c3d import read_c3d
from retarget.sources.files import read_head
from retarget.sources.streams.raw_record import is_recording

FORMATS = ("amc", "bvh", "c3d")
SUFFIXES = FORMATS
"""Suffixes of the motion files that a folder is searched for."""

SAMPLE = "sample"
"""In place of a path: the recording that comes with the package, a synthetic person who waves and crouches."""
_SAMPLE_FILE = Path(__file__).with_name("sample_recording.bvh")
_SAMPLE_UNIT = "cm"

_OF_ONE_FORMAT = {
    "skeleton": ("amc", "a skeleton belongs to an AMC only"),
    "markers": ("c3d", "a table of markers belongs to a C3D only"),
    "performer-root": ("bvh", "only a BVH has a ROOT for each performer"),
}
"""Option -> the format that has it, and what is wrong elsewhere."""
_C3D_KEY = 0x50
"""Second byte of every C3D file."""


def open_source(
    path: str | Path,
    *,
    skeleton: str | Path | None = None,
    markers: str | Path | None = None,
    unit: str | None = None,
    rate: float | None = None,
    stature: float | None = None,
    up: str | None = None,
    performer_root: str | None = None,
) -> SensorFrames:
    """Read a motion file of any known format, or the recording that comes with the package.

    path: the word SAMPLE as text is that recording, also where a file of this name is there; any other text, and every
    `Path`, is a file. skeleton: the ASF of an AMC, where it does not lie beside it. markers: the user's own table of
    the markers of a C3D. unit: m, cm, mm, inch or cmu, where the file does not state it and the guess is wrong. rate:
    frames per second instead of the file's. stature: m, of the performer: it scales the body of a file with joints, and
    is not measured in one without. up: the file's up axis (x, -y, ...), where body and file do not show it.
    performer_root: the ROOT of a BVH with several performers. Raises InputError with file, line and what to do;
    ConfigError for the table of markers; UsageError for values that cannot be, and for what belongs to another format.
    """
    is_sample = path == SAMPLE
    if is_sample:
        path, unit = _SAMPLE_FILE, unit if unit or stature else _SAMPLE_UNIT
    _refuse_live(str(path))
    path = Path(path)
    kind = recognise(path)
    given = {"skeleton": skeleton, "markers": markers, "performer-root": performer_root}
    for option, (owner, what) in _OF_ONE_FORMAT.items():
        if given[option] is not None and kind != owner:
            step = f"Leave --{option} out"
            raise UsageError(what, where=str(path), found=f"a {kind.upper()} file", next_step=step)
    _refuse_scales(stature, unit if kind in ("amc", "bvh") else None)
    axis = None if up is None else named_axis(up)
    if kind == "c3d":
        table = None if markers is None else Path(markers)
        frames = replace(read_c3d(path, unit=unit, rate=rate, up=axis, markers=table), stature=stature)
    elif kind == "amc":
        asf = None if skeleton is None else Path(skeleton)
        frames = read_amc(path, skeleton=asf, unit=unit, rate=rate, stature=stature, up=axis)
    else:
        frames = read_bvh(path, unit=unit, rate=rate, stature=stature, up=axis, performer_root=performer_root)
    return replace(frames, source=SAMPLE) if is_sample else frames


def _refuse_scales(stature: float | None, unit: str | None) -> None:
    """Raise UsageError for a stature that no human has, and for a second scale beside it."""
    low, high = STATURE_M
    if stature is not None and not low <= stature <= high:  # nor NaN
        allowed = f"{low:g} to {high:g} m"
        raise UsageError("stature out of range", where="--stature", found=f"{stature:g}", allowed=allowed)
    if stature is not None and unit is not None:
        raise UsageError("both give the scale of the file", where="--stature, --unit", next_step="Leave one out")


def _refuse_live(address: str) -> None:
    """Raise InputError for the address of a stream. A `Path` has lost one of its two slashes already."""
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", address) and not Path(address).exists():
        raise InputError(
            "a live stream is no motion file",
            where=re.sub(r":/+", "://", address, count=1)[:200],
            allowed=f"a motion file ({', '.join(FORMATS)}), or {SAMPLE}, which comes with the program",
            next_step="`retarget doctor ADDRESS` says what arrives, `retarget run --source ADDRESS` follows it",
        )


def recognise(path: Path) -> str:
    """Format of a motion file, one of FORMATS. Raises InputError if it cannot be read or is none of them."""
    head, suffix = read_head(path), path.suffix.lower().lstrip(".")
    first = next((word for line in head.splitlines() if (word := line.strip()) and not word.startswith(b"#")), b"")
    if first.upper().startswith(b"HIERARCHY"):
        return "bvh"
    if is_recording(head):
        address = shlex.quote(f"replay://{path}")
        raise InputError(
            "a recording of a live stream's datagrams, no motion file",
            where=str(path),
            next_step=f"`retarget doctor {address}` says what is in it, `retarget run --source {address}` "
            "plays it; with ?kind=vmc, for example, where it does not say what it holds",
        )
    if head[1:2] == bytes([_C3D_KEY]) and suffix not in ("bvh", "amc", "asf"):
        return "c3d"
    if suffix == "asf" or first.lower().startswith((b":version", b":name", b":units")):
        raise InputError(
            "a skeleton without motion", where=str(path), next_step="Open the AMC and give this with --skeleton"
        )
    if suffix in FORMATS:
        return suffix  # its reader says what is wrong with the content
    if first.lower().startswith((b":fully-specified", b":degrees", b":radians")):
        return "amc"
    raise InputError(
        "unknown kind of motion file",
        where=str(path),
        found=f"suffix '{path.suffix}'" if suffix else "no suffix",
        allowed=", ".join(FORMATS),
    )
