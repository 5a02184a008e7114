"""`--save FILE.npz`: everything that a stranger needs to check a run with their own tools. The keys are a contract."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.body import BodyModel
from retarget.errors import UsageError
from retarget.outputs import check_place, write_atomic, write_stream
from retarget.record import Phase, Record
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["human_body_path", "run_arrays", "save_path", "write_npz"]

NO_SERVO = -1
PHASES = np.array([phase.name.lower() for phase in Phase])
Arrays = dict[str, NDArray[Any]]


def save_path(text: str | Path) -> Path:
    """Where a recording of a run goes. Raises UsageError unless it is an .npz file that can be written."""
    path = Path(text)
    if path.suffix.lower() != ".npz":
        name = path.with_suffix(".npz").name if path.name else "run.npz"
        raise UsageError(
            "a run is saved as NPZ", where="--save", found=str(path)[:200], allowed="FILE.npz", next_step=f"Give {name}"
        )
    check_place(path, option="--save")
    return path


def human_body_path(path: Path) -> Path:
    """Where the body of a reconstructed human goes, beside the NPZ file at `path`."""
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
    or `brake`; servo_positions (T, n) rad as the servos said them, NaN without; human_q (T, nq) with human_mjcf, the
    text of its body; sensor_names (s,), sensor_positions (T, s, 3) m, as the human was made of them, NaN where not
    believed; dt s; motion_dt s. Before and after following, landmarks_asked, human_truth and sensors stand still.
    """
    record, human, mjcf = run.record, run.record.human, run.human.mjcf
    arrays = {
        "time": record.time,
        "phase": PHASES[record.phase],
        **(_human_body(run) if record.robot is None else _robot_body(run)),
    }
    arrays |= {
        "body": np.array(str(body.resolve())),
        "human_joint_names": np.array(human.joint_names),
        "human_joint_positions": human.joints,
        "human_q": human.q,
        "human_mjcf": np.array(mjcf),
        "sensor_names": np.array(run.sensors),
        "sensor_positions": human.sensors,
        "dt": np.array(run.clip.dt),
        "motion_dt": np.array(run.clip.motion_dt),
    }
    truth = run.human_truth
    return arrays if truth is None else arrays | {"human_truth": _held(record, truth)}


def _robot_body(run: RunResult) -> Arrays:
    robot, sent, reached = run.robot, run.record.robot, run.landmarks_reached
    assert robot is not None and sent is not None and reached is not None
    single, address = robot.body.scalar_joints()
    names = tuple(name for name, is_single in zip(robot.body.dof_names, single, strict=True) if is_single)
    present = np.full((len(sent.q), len(names)), np.nan)
    if run.has_bus:
        present[:, [names.index(joint) for joint in robot.joint_map.joints]] = sent.present
    root, turn = _root(robot.body, sent.q)
    return {
        "joint_names": np.array(names),
        "joint_positions": sent.q[:, address[single]],
        "root_position": root,
        "root_quaternion": turn,
        "goal_ticks": robot.joint_map.spread(names, sent.goal_ticks),
        "landmark_names": np.array(sent.landmark_names),
        "landmarks_asked": _held(run.record, sent.landmarks_asked),
        "landmarks_reached": reached,
        "gated": sent.gated,
        "servo_positions": present,
    }


def _human_body(run: RunResult) -> Arrays:
    q = run.record.human.q
    single, address = run.human.body.scalar_joints()
    names = [name for name, is_single in zip(run.human.body.dof_names, single, strict=True) if is_single]
    root, turn = _root(run.human.body, q)
    return {
        "joint_names": np.array(names),
        "joint_positions": q[:, address[single]],
        "root_position": root,
        "root_quaternion": turn,
        "goal_ticks": np.full((len(q), len(names)), NO_SERVO, dtype=np.int64),
        "landmark_names": np.array(run.sensors),
        "landmarks_asked": run.sensors_asked,
        "landmarks_reached": run.sensors_reached,
        "gated": np.zeros(len(q), dtype=np.bool_),
    }


def _held(record: Record, tracks: FloatArray) -> FloatArray:
    """Tracks (T, k, 3) that are known while following; before it as at its first tick, after it as at its last."""
    following = record.following
    rows = np.clip(np.arange(len(record)), following.start, max(following.stop - 1, 0))
    return np.asarray(tracks[rows])


def _root(body: BodyModel, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """World position (T, 3) and orientation (T, 4) of the first link."""
    solver_body = body.solver_body()
    q = np.ascontiguousarray(q)
    return solver_body.points(q, [1], np.zeros((1, 3)))[:, 0], solver_body.orientations(q, [1])[:, 0]
