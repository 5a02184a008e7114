"""Opens a motion file of any known format: the content selects the reader, then the suffix.

A new format needs `retarget/sources/NAME.py` with `read_NAME(path, options) -> SensorFrames`, its row in READERS, and a
rule in `recognise`. A new layout of arrays needs its names in `npz_motion.py`.
"""

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from retarget.errors import InputError, UsageError
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import STATURE_M
from retarget.schema.pickles import NPY, refuse_pickle
from retarget.sources.asf_amc import read_amc
from retarget.sources.axes import named_axis
from retarget.sources.bvh import read_bvh
from retarget.sources.c3d import read_c3d
from retarget.sources.canonical import named_unit
from retarget.sources.files import HEAD_BYTES, SAVED_RUN, ReadOptions, check_rate, read_bytes
from retarget.sources.gltf import read_gltf
from retarget.sources.mvnx import read_mvnx
from retarget.sources.npz_motion import read_npz
from retarget.sources.streams.raw_record import is_recording
from retarget.sources.trc import read_trc

READERS: dict[str, Callable[[Path, ReadOptions], SensorFrames]] = {
    "amc": read_amc,
    "bvh": read_bvh,
    "c3d": read_c3d,
    "gltf": read_gltf,
    "mvnx": read_mvnx,
    "npz": read_npz,
    "trc": read_trc,
}
FORMATS = tuple(READERS)
SUFFIXES = {name: name for name in FORMATS} | {"glb": "gltf", "vrma": "gltf", "vrm": "gltf"}

SAMPLE = "sample"
"""Word for the recording in the package, a synthetic person who waves and crouches."""
_SAMPLE_FILE = Path(__file__).with_name("sample_recording.bvh")
_SAMPLE_UNIT = "cm"

_OF_SOME_FORMATS = {
    "skeleton": (("amc",), "a skeleton belongs to an AMC only"),
    "markers": (("c3d", "trc"), "a table of markers belongs to a C3D or TRC only"),
    "performer-root": (("bvh",), "only a BVH has a ROOT for each performer"),
}
"""Option -> the formats that have it, and the error for others."""
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
    """Read a motion file of any known format, or the recording in the package.

    path: the text SAMPLE is the recording in the package (a file of that name is `./sample`). skeleton: the ASF of an
    AMC, if it is not beside it. markers: the user's table of the markers of a C3D or TRC. unit: m, cm, mm, inch or cmu.
    rate: Hz. stature: of the performer, m; it scales a body. up: the file's up axis (x, -y, ...). performer_root: the
    ROOT of a BVH with several performers.

    Raises InputError with file, line and next step, ConfigError for the marker table, and UsageError for impossible
    values and for options of another format.
    """
    is_sample = path == SAMPLE
    if is_sample:
        path, unit = _SAMPLE_FILE, unit if unit or stature else _SAMPLE_UNIT
    _refuse_live(str(path))
    path = Path(path)
    kind = recognise(path)
    given = {"skeleton": skeleton, "markers": markers, "performer-root": performer_root}
    for option, (owners, what) in _OF_SOME_FORMATS.items():
        if given[option] is not None and kind not in owners:
            step = f"Leave --{option} out"
            raise UsageError(what, where=str(path), found=f"{kind.upper()}", next_step=step)
    refuse_values(stature=stature, unit=None if kind in ("c3d", "trc") else unit)
    options = ReadOptions(
        unit=unit,
        rate=rate,
        stature=stature,
        up=None if up is None else named_axis(up),
        skeleton=None if skeleton is None else Path(skeleton),
        markers=None if markers is None else Path(markers),
        performer_root=performer_root,
    )
    frames = READERS[kind](path, options)
    return replace(frames, source=SAMPLE) if is_sample else frames


def refuse_values(
    *,
    stature: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    markers: str | Path | None = None,
) -> None:
    """Raise UsageError or InputError for values that no file can take."""
    low, high = STATURE_M
    named_unit(unit)
    if rate is not None:
        check_rate(rate, "--rate")
    if up is not None:
        named_axis(up)
    for option, path in (("--skeleton", skeleton), ("--markers", markers)):
        if path is not None and not Path(path).is_file():
            raise InputError("no such file", where=option, found=str(path)[:200], next_step="Check the path")
    if stature is not None and not low <= stature <= high:  # False for NaN
        allowed = f"{low:g} to {high:g} m"
        raise UsageError("stature out of range", where="--stature", found=f"{stature:g}", allowed=allowed)
    if stature is not None and unit is not None:
        raise UsageError("both give the scale of the file", where="--stature, --unit", next_step="Leave one out")


def _refuse_live(address: str) -> None:
    """Raise InputError for the address of a stream, which in a `Path` has lost a slash."""
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", address) and not Path(address).exists():
        raise InputError(
            "a live stream is no motion file",
            where=re.sub(r":/+", "://", address, count=1)[:200],
            allowed=f"a motion file ({', '.join(FORMATS)}), or {SAMPLE}, which comes with the program",
            next_step="`retarget doctor ADDRESS` says what arrives, `retarget run --source ADDRESS` follows it",
        )


def recognise(path: Path) -> str:
    """Format of a motion file, one of FORMATS. Raises InputError if it cannot be read or is of none."""
    step = "Check the path; the word sample names a recording that comes with the program"
    head, suffix = read_bytes(path, HEAD_BYTES, missing=step), path.suffix.lower().lstrip(".")
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
    if head.startswith(b"glTF") or (first.startswith(b"{") and b'"asset"' in head):
        return "gltf"
    if first.startswith(b"PathFileType"):
        return "trc"
    if first.startswith(b"<") and b"<mvnx" in head:
        return "mvnx"
    _refuse_foreign(path, head, suffix)
    if head[:2] == b"PK":
        return "npz"
    if head[1:2] == bytes([_C3D_KEY]) and suffix not in ("bvh", "amc", "asf"):
        return "c3d"
    if suffix == "asf" or first.lower().startswith((b":version", b":name", b":units")):
        raise InputError(
            "a skeleton without motion", where=str(path), next_step="Open the AMC and give this with --skeleton"
        )
    if suffix in SUFFIXES:
        return SUFFIXES[suffix]  # its reader reports faults of the content
    if first.lower().startswith((b":fully-specified", b":degrees", b":radians")):
        return "amc"
    raise InputError(
        "unknown kind of motion file",
        where=str(path),
        found=f"suffix '{path.suffix}'" if suffix else "no suffix",
        allowed=", ".join(FORMATS),
    )


_CONVERSIONS = {
    "wham": 'p = next(iter(p.values())); r = p["pose_world"]\n'
    'numpy.savez({made!r}, global_orient=r[:, :3], body_pose=r[:, 3:], transl=p["trans_world"], fps=30.0)',
    "hmr4d": 'p = p["smpl_params_global"]\n'
    "numpy.savez({made!r}, **{{key: value.numpy() for key, value in p.items()}}, fps=30.0)",
    "": "print({{key: numpy.shape(value) for key, value in p.items()}})  # names and shapes: docs/motion-files.md\n"
    "p = {{key: numpy.asarray(value) for key, value in p.items()}}\n"
    'numpy.savez({made!r}, **{{key: value for key, value in p.items() if value.dtype.kind in "fiu"}})',
}
"""Part of a pickle's name -> Python that makes an NPZ of it: WHAM, GVHMR, any other dict."""


def _refuse_foreign(path: Path, head: bytes, suffix: str) -> None:
    """Raise InputError for a pickle (reading it runs code), FBX (no open specification), a single array and a run."""
    allowed, made = ", ".join(FORMATS), f"{path.stem}_motion.npz"
    if head.startswith(b"\x89MCAP"):
        raise InputError("a recorded run is no motion of a performer", where=str(path), next_step=SAVED_RUN)
    if head.startswith((b"Kaydara FBX", b"; FBX")) or suffix == "fbx":
        step = "Convert it to BVH or GLB, for example with Blender: import FBX, export glTF 2.0"
        raise InputError("FBX is not read", where=str(path), allowed=allowed, next_step=step)
    refuse_pickle(path, head, _CONVERSIONS, made=made, allowed=allowed)
    if head.startswith(NPY) or suffix == "npy":
        code = f"import numpy\nnumpy.savez({made!r}, global_joint_positions=numpy.load({path.name!r}))"
        step = f"If it is places of joints, name it in Python (docs/motion-files.md):\n{code}\nThen give {made!r}"
        raise InputError("a single array, of what is not known", where=str(path), allowed=allowed, next_step=step)
