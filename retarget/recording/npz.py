"""`--save FILE.npz`: a run as arrays, written and read back, for checks with any tool. Its keys are a contract."""

import sys
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from retarget.errors import InputError, UsageError
from retarget.model.body import BodyModel
from retarget.run.record import PHASE_NAMES, Record
from retarget.run.run_result import RunResult
from retarget.run.table import FIELDS, STAGES
from retarget.schema.files import check_place, write_atomic, write_stream
from retarget.types import FloatArray

AS_THEY_ARE = ("time", "gated", "human_joints", "human_q", "sensors", *STAGES)
"""Fields that are saved as they are in the record."""
NO_SERVO = -1
"""Goal, ticks, in the column of a joint without a servo."""
Arrays = dict[str, NDArray[Any]]


def save_path(text: str | Path) -> Path:
    """Path of a recording of a run. Raises UsageError unless it is an .npz file that can be written."""
    path = Path(text)
    if path.suffix.lower() != ".npz":
        name = path.with_suffix(".npz").name if path.name else "run.npz"
        raise UsageError(
            "a run is saved as NPZ", where="--save", found=str(path)[:200], allowed="FILE.npz", next_step=f"Give {name}"
        )
    check_place(path, option="--save")
    return path


def human_body_path(path: Path) -> Path:
    """Path of the body of a reconstructed human, beside the NPZ file at `path`."""
    return path.with_name(f"{path.stem}_human.xml")


def write_npz(run: RunResult, path: Path) -> None:
    """Write a run, whole or not at all. Of `--robot human` the body goes into an MJCF file beside it.

    Raises UsageError if a file cannot be written.
    """
    body = human_body_path(path) if run.robot is None else run.robot.profile.body_path
    if run.robot is None:
        write_atomic(body, run.human.mjcf.encode(), option="--save")
    arrays = run_arrays(run, body)
    write_stream(path, lambda stream: np.savez(stream, allow_pickle=False, **arrays), option="--save")


def run_arrays(run: RunResult, body: Path) -> Arrays:
    """The arrays of the file, one row per tick (T). `body`: path of the MJCF or URDF that the postures belong to.

    time (T,) s; joint_names (n,): all hinges and slides of the body; joint_positions (T, n) rad, sent; root_position
    (T, 3) m and root_quaternion (T, 4) wxyz; goal_ticks (T, n), -1: no servo; landmark_names (k,), landmarks_asked and
    landmarks_reached (T, k, 3) m (of a human: its sensors); gated (T,); human_joint_names (m,), human_joint_positions
    (T, m, 3) m; human_truth (T, m, 3) m, where the file knows it. Beyond the contract: phase (T,), `approach`, `follow`
    or `brake`; servo_positions (T, n) rad as the servos reported them, NaN without; human_q (T, nq) with human_mjcf,
    the text of its body; sensor_names (s,), sensor_positions (T, s, 3) m, as the human was made of them, NaN where not
    valid; dt s; motion_dt s; of a run in real time the times of its stages. Before and after following,
    landmarks_asked, human_truth and sensors stand still.
    """
    record, robot, sent = run.record, run.robot, run.record.robot
    names, asked, reached = run.followed
    kept = AS_THEY_ARE if run.setup.real_time else set(AS_THEY_ARE).difference(STAGES)
    arrays: Arrays = {FIELDS[name].npz: array for name, array in record.known.items() if name in kept}
    arrays["phase"] = np.array(PHASE_NAMES)[record.phase]
    if robot is None or sent is None:
        arrays |= _moved_body(run.human.body, record.human_q)
        arrays["goal_ticks"] = np.full(arrays["joint_positions"].shape, NO_SERVO, dtype=np.int64)
    else:
        arrays |= _moved_body(robot.body, sent.q)
        joints = tuple(arrays["joint_names"].tolist())
        arrays["goal_ticks"] = robot.joint_map.spread(joints, sent.goal_ticks)
        arrays["servo_positions"] = present = np.full((len(sent.q), len(joints)), np.nan)
        if run.setup.has_bus:
            present[:, [joints.index(joint) for joint in robot.joint_map.joints]] = sent.present
    arrays |= {
        "landmark_names": np.array(names),
        "landmarks_asked": _held(record, asked),
        "landmarks_reached": reached,
        "body": np.array(str(body.resolve())),
        "human_joint_names": np.array(record.human_joint_names),
        "human_mjcf": np.array(run.human.mjcf),
        "sensor_names": np.array(run.sensors),
        "dt": np.array(run.clip.dt),
        "motion_dt": np.array(run.clip.motion_dt),
    }
    truth = run.human_truth
    return arrays if truth is None else arrays | {"human_truth": _held(record, truth)}


def _moved_body(body: BodyModel, q: FloatArray) -> Arrays:
    """Joints and root of a body in postures (T, nq)."""
    names, joints, root = joints_and_root(body, q)
    return {
        "joint_names": np.array(names),
        "joint_positions": joints,
        "root_position": root[:, :3],
        "root_quaternion": root[:, 3:],
    }


def joints_and_root(body: BodyModel, q: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Split postures (T, nq): names and positions, rad or m, (T, n) of all hinges and slides of the body, and its root
    (T, 7), xyz and wxyz of the first link in the world."""
    single, address = body.scalar_joints()
    solver, q = body.solver_body(), np.ascontiguousarray(q)
    root = np.hstack([solver.points(q, [1], np.zeros((1, 3)))[:, 0], solver.orientations(q, [1])[:, 0]])
    return body.scalar_names, np.asarray(q[:, address[single]]), root


def _held(record: Record, tracks: FloatArray) -> FloatArray:
    """Tracks (T, k, 3) that are known while following; before it as at its first tick, after it as at its last."""
    following = record.following
    rows = np.clip(np.arange(len(record)), following.start, max(following.stop - 1, 0))
    return np.asarray(tracks[rows])


# The arrays of a foreign NPZ file: what is missing, cut short, of another shape or not a number is refused at once.

MAX_BYTES = 2**30
"""Largest content that is unpacked, of an NPZ or an MCAP file. `MAX_KEPT` ticks of a robot with 50 servos are less."""
NOT_A_RUN = "Give a file that `retarget run --save FILE.npz` wrote"
NO_RUN = "Give a file that `retarget run` wrote with --save FILE.npz or --record FILE.mcap"
BROKEN = (
    *(OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, MemoryError, OverflowError),
    *(tokenize.TokenError, SyntaxError, TypeError, zlib.error),
)


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """Arrays by key, and the file that they are from."""

    source: str
    arrays: dict[str, NDArray[Any]]

    def __contains__(self, key: str) -> bool:
        return key in self.arrays

    def floats(self, key: str, *shape: int | None, unknown: bool = False) -> NDArray[np.float64]:
        """Read an array of numbers of this shape (None: any size). unknown: NaN is allowed. Raises InputError."""
        values = np.asarray(self._checked(key, "fiu", "numbers", shape), dtype=np.float64)
        bad = ~np.isfinite(values) & ~(unknown & np.isnan(values))
        if bad.any():
            row = int(np.argwhere(bad)[0][0]) if values.ndim else 0
            found = f"{values[bad].flat[0]} in row {row + 1}, and in {np.count_nonzero(bad)} places in all"
            raise self._wrong(key, found, "finite numbers")
        return values

    def whole(self, key: str, *shape: int | None) -> NDArray[np.int64]:
        """Read an array of whole numbers of this shape. Raises InputError."""
        return np.asarray(self._checked(key, "iu", "whole numbers", shape), dtype=np.int64)

    def texts(self, key: str, *shape: int | None) -> NDArray[np.str_]:
        """Read an array of texts of this shape. Raises InputError."""
        values = np.ascontiguousarray(self._checked(key, "U", "texts", shape), dtype=np.str_).reshape(-1)
        if (values.view(np.uint32) > sys.maxunicode).any():
            raise self._wrong(key, "a code that is no letter's", "texts")
        return values.reshape(self.arrays[key].shape)

    def _checked(self, key: str, kinds: str, what: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
        """An array of one of these kinds of dtypes, and of a shape."""
        array = self.arrays[key]
        sizes = zip(shape, array.shape, strict=False)
        if array.ndim != len(shape) or any(wanted not in (None, size) for wanted, size in sizes):
            allowed = ", ".join("any" if size is None else str(size) for size in shape)
            raise self._wrong(key, f"shape {array.shape}", f"shape ({allowed})")
        if array.dtype.kind not in kinds:
            raise self._wrong(key, f"{array.dtype}", what)
        return array

    def _wrong(self, key: str, found: str, allowed: str) -> InputError:
        return InputError(
            "wrong content", where=f"{self.source}: {key}", found=found, allowed=allowed, next_step=NOT_A_RUN
        )


def refuse_no_file(path: Path) -> None:
    """Raise InputError for a folder, and for a pipe or device, which might be waited for without an end."""
    if path.is_dir():
        raise InputError("this is a folder, not a run", where=str(path), next_step=NOT_A_RUN)
    if path.exists() and not path.is_file():
        raise InputError("not a regular file", where=str(path)[:200], found="a pipe or a device", next_step=NO_RUN)


def read_arrays(path: Path, *, needed: frozenset[str], used: frozenset[str]) -> ArrayFile:
    """The arrays `needed`, and those `used` that are there. Raises InputError: no NPZ, cut short, a key missing."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            size = sum(entry.file_size for entry in archive.infolist())
            if size > MAX_BYTES:
                raise InputError("too large", where=str(path), found=f"{size} bytes", allowed=f"up to {MAX_BYTES}")
            missing = sorted(needed - set(names))
            if missing:
                found, allowed = f"no {', '.join(missing)}", "the keys of docs/results.md"
                raise InputError("not a saved run", where=str(path), found=found, allowed=allowed, next_step=NOT_A_RUN)
            return ArrayFile(
                str(path), {key: _read_array(archive, names[key]) for key in names if key in needed | used}
            )
    except zipfile.BadZipFile as error:
        step = f"If it was one, it is cut short: get it again. {NOT_A_RUN}"
        raise InputError("not an NPZ file", where=str(path), found=error, next_step=step) from error
    except BROKEN as error:
        found = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError("a damaged NPZ file", where=str(path), found=found, next_step="Get it again") from error


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of a .npy file, for which no room is made before its header agrees with the size of the file. Raises
    ValueError and what else is BROKEN."""
    with archive.open(entry) as stream:
        header = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = header(stream)
        if not dtype.itemsize or stream.tell() + dtype.itemsize * prod(shape) != entry.file_size:
            raise ValueError(f"{entry.filename} has another size than its header says")
    with archive.open(entry) as stream:
        return np.asarray(npy.read_array(stream, allow_pickle=False))
