"""Export of a motion to another program. `FORMATS` is the one table of formats, for the help, the site and `retarget
export`."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from retarget.errors import UsageError, suggest
from retarget.recording.exports.bvh_writer import write_bvh
from retarget.recording.exports.lerobot_dataset import DEFAULT_TASK, lerobot_files
from retarget.recording.exports.tables import write_csv, write_parquet
from retarget.recording.exports.trainers import (
    sonic_files,
    write_beyondmimic,
    write_bones,
    write_gmr,
    write_gmr_npz,
    write_holosoma,
    write_mjlab,
    write_unitree,
)
from retarget.recording.motion import Motion
from retarget.schema.files import check_folder, check_path, check_place, refuse_existing, write_folder, write_stream

Write = Callable[[Motion, IO[bytes]], None]
"""Writes a motion into a stream."""
Files = Callable[[Motion, str], dict[str, bytes]]
"""The files of a folder, for a motion and its task in words."""
NAMED, IN_ORDER, BREADTH_FIRST = "by name", "as in the body file", "breadth first"
"""Orders of joints and links. Isaac numbers them breadth first."""
COLUMNS = "in named columns"
"""Order of a quaternion in named columns."""


@dataclass(frozen=True)
class Conventions:
    """quaternion: its order, "" without any. joints: their order. root: its place. fps: rows per second that readers
    expect; None for those of the run."""

    quaternion: str
    joints: str
    root: str
    units: str = "m, rad, s"
    fps: float | None = None

    def __str__(self) -> str:
        turned = f"quaternions {self.quaternion}" if self.quaternion else "no quaternions"
        return f"{turned}; joints {self.joints}; root {self.root}; {self.units}"


@dataclass(frozen=True)
class Format:
    """A format. ending: suffix of its files. summary: readers and content, in words. write: into a stream, or files: of
    a folder. mark: the file that identifies such a folder."""

    name: str
    ending: str
    summary: str
    conventions: Conventions
    write: Write | None = None
    files: Files | None = None
    mark: str = ""


_TABLE = Conventions(COLUMNS, NAMED, "in separate columns")
_GMR = Conventions("xyzw", IN_ORDER, "in separate arrays", fps=30.0)
_FORMATS = (
    Format("csv", ".csv", "a table with named columns", _TABLE, write_csv),
    Format("parquet", ".parquet", "the same table, in full precision", _TABLE, write_parquet),
    Format(
        "npz",
        "_motion.npz",
        "mjlab trains on it",
        Conventions("wxyz", IN_ORDER, "as body 0", fps=50.0),
        write_mjlab,
    ),
    Format(
        "beyondmimic",
        "_beyondmimic.npz",
        "whole_body_tracking trains on it: npz in Isaac's order",
        Conventions("wxyz", BREADTH_FIRST, "as body 0", fps=50.0),
        write_beyondmimic,
    ),
    Format(
        "holosoma",
        "_holosoma.npz",
        "holosoma trains on it; the world is body 0, linear velocities are of centres of mass",
        Conventions("wxyz", IN_ORDER, "before the joints", fps=50.0),
        write_holosoma,
    ),
    Format(
        "unitree",
        "_unitree.csv",
        "converters of mjlab and BeyondMimic read it, as LAFAN1's of Unitree: no header",
        Conventions("xyzw", IN_ORDER, "before the joints", fps=30.0),
        write_unitree,
    ),
    Format("gmr", "_gmr.pkl", "GMR's pickle, written for its readers, never read here", _GMR, write_gmr),
    Format("gmr-npz", "_gmr.npz", "the same keys, safe to read", _GMR, write_gmr_npz),
    Format(
        "bones",
        "_bones.csv",
        "CSV of BONES-SEED and soma-retargeter; the root turns about fixed axes x, then y, then z",
        Conventions("", NAMED, "before the joints", "cm, degrees", 120.0),
        write_bones,
    ),
    Format(
        "sonic",
        "_sonic",
        "the folder of one motion that SONIC's deployment plays",
        Conventions("wxyz", BREADTH_FIRST, "as body 0", fps=50.0),
        files=lambda motion, task: sonic_files(motion),
        mark="metadata.txt",
    ),
    Format(
        "bvh",
        ".bvh",
        "an animated skeleton, y up, z forward; the human's joints have HumanIK's names, so it can be followed again",
        Conventions("", NAMED, "as joint 0", "cm, degrees ZXY"),
        write_bvh,
    ),
    Format(
        "lerobot",
        "_lerobot",
        "a LeRobot dataset v3.0: an episode for each FILE, no videos (tried with LeRobot 0.6.1)",
        Conventions(COLUMNS, NAMED, "in observation.root"),
        files=lambda motion, task: lerobot_files(motion, task=task),
        mark="meta/info.json",
    ),
)
FORMATS = {one.name: one for one in _FORMATS}
"""Formats by the name in `--to`."""


def format_help() -> str:
    """The formats in a line, for the help of `--to`."""
    return " ".join(f"{one.name}: {one.summary}." for one in FORMATS.values())


def format_table() -> str:
    """The formats as a Markdown table."""
    rows = ["| format | file | for whom, and what | quaternion | joints | root | units | Hz |", "|---" * 8 + "|"]
    for one in FORMATS.values():
        its = one.conventions
        rate = "the run's" if its.fps is None else f"{its.fps:g}"
        cells = (f"`{one.name}`", f"`{one.ending}`", one.summary, its.quaternion or "none")
        rows.append(f"| {' | '.join((*cells, its.joints, its.root, its.units, rate))} |")
    return "\n".join(rows)


def format_named(name: str) -> Format:
    """A format. Raises UsageError with the nearest names."""
    if name not in FORMATS:
        step = suggest(name, FORMATS)
        raise UsageError("unknown format", where="--to", found=name[:80], allowed=", ".join(FORMATS), next_step=step)
    return FORMATS[name]


def export_place(
    form: Format, run: Path, out: Path | None, *, of_human: bool = False, inputs: Sequence[Path] = ()
) -> Path:
    """Path of an export: `out`, or beside the run with its name. inputs: other files that are read.

    Raises UsageError for an invalid path, the suffix of another format, and a place that is or holds an input.
    """
    place = run.with_name(f"{run.stem}{'_human' if of_human else ''}{form.ending}") if out is None else out
    check_path(place, option="--out")
    suffix = place.suffix.lower()
    others = [other for other in FORMATS.values() if suffix and other.ending.endswith(suffix)]
    if others and form not in others:
        raise UsageError(
            f"this is the suffix of {others[0].name}, not of {form.name}",
            where="--out",
            found=str(place)[:200],
            next_step=f"Give {place.stem[:200]}{form.ending}, or --to {others[0].name}",
        )
    for path in (run, *inputs):
        whole = path.resolve()
        if place.exists() and whole.exists() and any(map(place.samefile, (whole, *whole.parents))):
            what = f"the folder of {path.name[:100]}, which is read" if place.is_dir() else "a file that is read"
            raise UsageError(f"this is {what}", where="--out", found=str(place)[:200], next_step="Give another name")
    return place


def export_motion(
    motion: Motion, form: Format, place: Path, *, task: str = DEFAULT_TASK, overwrite: bool = False
) -> None:
    """Write a motion to a place of `export_place`. task: in words, for a LeRobot dataset.

    Raises UsageError and InputError if the format cannot hold it, or the place is unusable. `overwrite` replaces a
    folder only if it has the same layout.
    """
    write, files = form.write, form.files
    if files is not None:
        _write_folder(place, files(motion, task), form, overwrite=overwrite)
    elif write is not None:
        check_place(place, option="--out")
        if not overwrite:
            refuse_existing(place, option="--out")
        write_stream(place, lambda stream: write(motion, stream), option="--out")


def export_episodes(
    motions: Sequence[Motion], place: Path, *, task: str = DEFAULT_TASK, overwrite: bool = False
) -> None:
    """Write motions of one robot to a LeRobot dataset, each as an episode. Raises as `export_motion` does."""
    _write_folder(place, lerobot_files(*motions, task=task), FORMATS["lerobot"], overwrite=overwrite)


def _write_folder(place: Path, contents: Mapping[str, bytes], form: Format, *, overwrite: bool) -> None:
    if not overwrite:
        refuse_existing(place, option="--out")
    check_folder(place, option="--out")
    foreign = next((name for name in _names(place) if name not in contents), "")
    unmarked = "" if (place / form.mark).is_file() else next(_names(place), "")
    if foreign or unmarked:
        lacks = "" if foreign else f", without {form.mark}"
        raise UsageError(
            f"a folder that is not of {form.name} alone is not replaced",
            where="--out",
            found=f"{str(place)[:200]} with {(foreign or unmarked)[:200]}{lacks}",
            next_step="Give another name, or move it away",
        )
    write_folder(place, contents, option="--out")


def _names(folder: Path) -> Iterator[str]:
    """Yield every file below a folder, and every empty, linked or unreadable folder, by its path in it."""
    for path, folders, files in os.walk(folder):
        for name in files:
            yield Path(path, name).relative_to(folder).as_posix()
        for below in (Path(path, name) for name in folders):
            if below.is_symlink() or not os.access(below, os.R_OK | os.X_OK) or not any(below.iterdir()):
                yield below.relative_to(folder).as_posix()
