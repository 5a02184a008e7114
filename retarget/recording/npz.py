"""`--save FILE.npz`: a run as arrays, written and read back. The keys are a contract."""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, UsageError
from retarget.model.body import BodyModel
from retarget.run.record import PHASE_NAMES, Record
from retarget.run.run_result import RunResult
from retarget.run.table import FIELDS, OF_IMU, STAGES
from retarget.schema.arrays import ArrayFile, open_arrays
from retarget.schema.files import check_place, write_atomic, write_stream
from retarget.types import FloatArray

AS_THEY_ARE = ("time", "gated", "human_joints", "human_q", "sensors", *STAGES, *OF_IMU)
"""Fields that are saved as in the record."""
NO_SERVO = -1
"""Goal, ticks, of a joint without a servo."""
Arrays = dict[str, NDArray[Any]]


def save_path(text: str | Path) -> Path:
    """Path of a saved run. Raises UsageError unless it is an .npz file that can be written."""
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
    """Write a run, whole or not at all. The body of `--robot human` goes into an MJCF file beside it. Raises
    UsageError."""
    body = human_body_path(path) if run.robot is None else run.robot.profile.body_path
    if run.robot is None:
        write_atomic(body, run.human.mjcf.encode(), option="--save")
    arrays = run_arrays(run, body.name if run.robot is None else str(body.resolve()))
    write_stream(path, lambda stream: np.savez(stream, allow_pickle=False, **arrays), option="--save")


def run_arrays(run: RunResult, body: str) -> Arrays:
    """The arrays of the file, one row per tick (T). body: path of the MJCF or URDF, seen from the file's folder.

    time (T,) s; joint_names (n,): all hinges and slides; joint_positions (T, n) rad, sent; root_position (T, 3) m and
    root_quaternion (T, 4) wxyz; goal_ticks (T, n), -1: no servo; landmark_names (k,), landmarks_asked and
    landmarks_reached (T, k, 3) m (of a human: its sensors); gated (T,); human_joint_names (m,), human_joint_positions
    (T, m, 3) m; human_truth (T, m, 3) m, if known. Beyond the contract: phase (T,), `approach`, `follow` or `brake`;
    servo_positions (T, n) rad, measured; human_q (T, nq) with human_mjcf, its body; sensor_names (s,), sensor_positions
    (T, s, 3) m; dt s; motion_dt s; in real time the times of the stages; measurements of an IMU. Unknown values are
    NaN. Before and after following, landmarks_asked, human_truth and sensors keep their nearest value.
    """
    record, robot, sent = run.record, run.robot, run.record.robot
    names, desired, actual = run.followed
    left_out = set() if run.setup.real_time else set(STAGES)
    if robot is None or np.isnan(record.imu_time).all():
        left_out |= set(OF_IMU)
    kept = set(AS_THEY_ARE) - left_out
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
        "landmarks_asked": _held(record, desired),
        "landmarks_reached": actual,
        "body": np.array(body),
        "human_joint_names": np.array(record.human_joint_names),
        "human_mjcf": np.array(run.human.mjcf),
        "sensor_names": np.array(run.sensors),
        "dt": np.array(run.clip.dt),
        "motion_dt": np.array(run.clip.motion_dt),
    }
    truth = run.human_truth
    return arrays if truth is None else arrays | {"human_truth": _held(record, truth)}


def _moved_body(body: BodyModel, q: FloatArray) -> Arrays:
    names, joints, root = joints_and_root(body, q)
    return {
        "joint_names": np.array(names),
        "joint_positions": joints,
        "root_position": root[:, :3],
        "root_quaternion": root[:, 3:],
    }


def joints_and_root(body: BodyModel, q: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names and positions (T, n), rad or m, of all hinges and slides in postures (T, nq), and the root (T, 7), xyz and
    wxyz."""
    single, address = body.scalar_joints()
    solver, q = body.solver_body(), np.ascontiguousarray(q)
    root = np.hstack([solver.points(q, [1], np.zeros((1, 3)))[:, 0], solver.orientations(q, [1])[:, 0]])
    return body.scalar_names, np.asarray(q[:, address[single]]), root


def _held(record: Record, tracks: FloatArray) -> FloatArray:
    """Tracks (T, k, 3) with their first and last values of following before and after it."""
    following = record.following
    rows = np.clip(np.arange(len(record)), following.start, max(following.stop - 1, 0))
    return np.asarray(tracks[rows])


MAX_BYTES = 2**30
"""Largest unpacked content of an NPZ or MCAP file. `MAX_KEPT` ticks of a robot with 50 servos are less."""
NOT_A_RUN = "Give a file that `retarget run --save FILE.npz` wrote"
NO_RUN = "Give a file that `retarget run` wrote with --save FILE.npz or --record FILE.mcap"


def refuse_no_file(path: Path) -> None:
    """Raise InputError for a folder, and for a pipe or device, on which a read could block for ever."""
    if path.is_dir():
        raise InputError("this is a folder, not a run", where=str(path), next_step=NOT_A_RUN)
    if path.exists() and not path.is_file():
        raise InputError("not a regular file", where=str(path)[:200], found="a pipe or a device", next_step=NO_RUN)


def read_arrays(path: Path, *, needed: frozenset[str], used: frozenset[str]) -> ArrayFile:
    """The arrays `needed`, and the present ones of `used`. Raises InputError for a damaged file, or a missing key."""

    def keys(names: Collection[str]) -> Collection[str]:
        if missing := sorted(needed - set(names)):
            found, allowed = f"no {', '.join(missing)}", "the keys of docs/results.md"
            raise InputError("not a saved run", where=str(path), found=found, allowed=allowed, next_step=NOT_A_RUN)
        return needed | used

    return open_arrays(path, keys, max_bytes=MAX_BYTES, advice=NOT_A_RUN)
