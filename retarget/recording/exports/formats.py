"""Write a motion in one of the formats that others read: whole or not at all, and never over something."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import UsageError, suggest
from retarget.recording.exports.bvh_writer import write_bvh
from retarget.recording.exports.lerobot_dataset import DEFAULT_TASK, lerobot_files
from retarget.recording.exports.tables import write_csv, write_parquet
from retarget.recording.motion import Motion, angular_velocity, links_of, rate_of_change
from retarget.schema.files import check_folder, check_path, check_place, write_folder, write_stream

# NPZ for trainers of motion tracking: the keys that whole_body_tracking (BeyondMimic) and mjlab load, and GMR's.

Arrays = dict[str, NDArray[Any]]


def write_trainer_npz(motion: Motion, stream: IO[bytes]) -> None:
    """Write the arrays of `trainer_arrays`. Raises InputError where rows are not evenly spaced."""
    np.savez(stream, allow_pickle=False, **trainer_arrays(motion))


def trainer_arrays(motion: Motion) -> Arrays:
    """Evenly spaced rows (T), float32, SI units.

    fps (1,); joint_names (n,), joint_pos and joint_vel (T, n); body_names (b,), body_pos_w (T, b, 3), body_quat_w
    (T, b, 4) **wxyz**, body_lin_vel_w and body_ang_vel_w (T, b, 3) of every link's origin, world. As GMR names them:
    root_pos (T, 3), root_rot (T, 4) **xyzw**, dof_pos (T, n). Velocities are central differences. Raises InputError
    where rows are not evenly spaced.
    """
    rate, links, joints = motion.rate_hz, links_of(motion), motion.joints
    arrays = {
        "joint_pos": joints,
        "joint_vel": rate_of_change(joints, rate),
        "body_pos_w": links.position,
        "body_quat_w": links.orientation,
        "body_lin_vel_w": rate_of_change(links.position, rate),
        "body_ang_vel_w": angular_velocity(links.orientation, rate),
        "root_pos": motion.root_position,
        "root_rot": motion.root_quaternion[:, [1, 2, 3, 0]],
        "dof_pos": joints,
    }
    return {
        "fps": np.array([int(rate) if rate.is_integer() else rate]),
        "joint_names": np.array(motion.joint_names),
        "body_names": np.array(links.names),
        **{key: values.astype(np.float32) for key, values in arrays.items()},
    }


@dataclass(frozen=True)
class Format:
    """A format. ending: what its files end in, after the name of the run. write: into a stream; None: a folder."""

    name: str
    ending: str
    write: Callable[[Motion, IO[bytes]], None] | None


FORMATS = {
    found.name: found
    for found in (
        Format("csv", ".csv", write_csv),
        Format("npz", "_motion.npz", write_trainer_npz),
        Format("parquet", ".parquet", write_parquet),
        Format("bvh", ".bvh", write_bvh),
        Format("lerobot", "_lerobot", None),
    )
}
"""By the name that `--to` takes."""


def format_named(name: str) -> Format:
    """A format. Raises UsageError with the nearest names."""
    if name not in FORMATS:
        step = suggest(name, FORMATS)
        raise UsageError("unknown format", where="--to", found=name[:80], allowed=", ".join(FORMATS), next_step=step)
    return FORMATS[name]


def export_place(form: Format, run: Path, out: Path | None, *, of_human: bool = False) -> Path:
    """Path of an export: `out`, or beside the run under its name. Raises UsageError where nothing can be written, where
    something is, and for the suffix of another format."""
    place = run.with_name(f"{run.stem}{'_human' if of_human else ''}{form.ending}") if out is None else out
    check_path(place, option="--out")
    suffix = place.suffix.lower()
    for other in FORMATS.values() if suffix else ():
        if other is not form and other.ending.endswith(suffix):
            raise UsageError(
                f"this is the suffix of {other.name}, not of {form.name}",
                where="--out",
                found=str(place)[:200],
                next_step=f"Give {place.stem[:200]}{form.ending}, or --to {other.name}",
            )
    _refuse_existing(place)
    if form.write is None:
        check_folder(place, option="--out")
    else:
        check_place(place, option="--out")
    return place


def export_motion(motion: Motion, form: Format, place: Path, *, task: str = DEFAULT_TASK) -> None:
    """Write a motion to a place of `export_place`. task: what is done in it, in words, for a LeRobot dataset.

    Raises UsageError and InputError where the format cannot hold it, or something is there; then nothing is written.
    """
    _refuse_existing(place)
    write = form.write
    if write is None:
        write_folder(place, lerobot_files(motion, task=task), option="--out")
    else:
        write_stream(place, lambda stream: write(motion, stream), option="--out")


def _refuse_existing(place: Path) -> None:
    if place.is_symlink() or place.exists():
        step = "Give another --out, or remove it"
        raise UsageError("something is there already", where="--out", found=str(place)[:200], next_step=step)
