"""A LeRobot dataset, format v3.0: one episode of one task in a folder, without videos.

`meta/info.json`, `meta/stats.json`, `meta/tasks.parquet`, `meta/episodes/chunk-000/file-000.parquet`,
`data/chunk-000/file-000.parquet`; and a README with units and frames, for which the format has no place.
"""

import io
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, UsageError
from retarget.recording.exports.tables import arrow
from retarget.recording.motion import CONVENTIONS, Motion

# A motion as the features of a LeRobot dataset: observations and actions, frame by frame.


@dataclass(frozen=True, eq=False)
class Feature:
    """One column of a dataset. values (T, d); a `vector` is stored as a list of d, anything else as one number.

    dtype: as LeRobot names it. names: of the d values, None where there is nothing to name.
    """

    key: str
    dtype: str
    values: NDArray[Any]
    names: tuple[str, ...] | None = None

    @property
    def vector(self) -> bool:
        """Whether a frame holds a list."""
        return self.names is not None


def features_of(motion: Motion, *, rate_hz: int) -> tuple[Feature, ...]:
    """`action`: joints as sent; `observation.state`: where the servos were, read before that was sent.

    Joints of a robot with servos are those that have one; without servos, all of the body, seen where they were sent.
    `observation.root`: x y z (m) and qw qx qy qz of the first link, world; `observation.landmarks`: the landmarks asked
    for (m, world), those that are known in every frame. Then what LeRobot asks of every dataset, for one episode of one
    task. Raises InputError where a servo is not known in some frame.
    """
    # Where no servo answered, all joints count as driven.
    known = motion.present if "present" in motion else motion.joints
    driven = np.asarray(np.isfinite(known).any(axis=0))
    joints = tuple(f"{name}.pos" for name, kept in zip(motion.joint_names, driven, strict=True) if kept)
    sent, seen = motion.joints[:, driven], known[:, driven]
    missing = np.argwhere(~np.isfinite(seen))
    if missing.size:
        row, column = missing[0].tolist()
        found = f"nothing of {joints[column]} in row {row + 1}"
        step = "Export csv or parquet, which can leave numbers out"
        raise InputError("a servo that was not read", where=motion.source, found=found, next_step=step)
    vectors = [("action", joints, sent), ("observation.state", joints, seen)]
    vectors.append(("observation.root", ("x", "y", "z", "qw", "qx", "qy", "qz"), motion.q[:, :7]))
    if "landmarks_asked" in motion:
        always = np.asarray(np.isfinite(motion.landmarks_asked).all(axis=(0, 2)))
        names = [name for name, kept in zip(motion.landmark_names, always, strict=True) if kept]
        points = motion.landmarks_asked[:, always].reshape(len(motion), -1)
        vectors += [("observation.landmarks", tuple(f"{name}.{axis}" for name in names for axis in "xyz"), points)]
    frame, zero = np.arange(len(motion)), np.zeros(len(motion), dtype=np.int64)
    counted = {"frame_index": frame, "episode_index": zero, "index": frame, "task_index": zero}
    return (
        *(Feature(key, "float32", values.astype(np.float32), names) for key, names, values in vectors if names),
        Feature("timestamp", "float32", (frame / rate_hz).astype(np.float32)[:, None]),
        *(Feature(key, "int64", values.astype(np.int64)[:, None]) for key, values in counted.items()),
    )


# Statistics of one feature over the frames of a dataset, by which trainers normalise.

QUANTILES = (1, 10, 50, 90, 99)
"""Percentiles in the statistics of a LeRobot v3.0 dataset: its keys q01, q10, q50, q90 and q99."""


def statistics_of(values: NDArray[np.generic]) -> dict[str, list[float] | list[int]]:
    """Compute statistics of values (T, d), in their unit, by the names that LeRobot gives them; the deviation is that
    of a population."""
    numbers = np.asarray(values, dtype=np.float64)
    made = {name: getattr(numbers, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    quantiles = np.percentile(numbers, QUANTILES, axis=0).tolist()
    made |= {f"q{percent:02d}": row for percent, row in zip(QUANTILES, quantiles, strict=True)}
    return {**made, "count": [len(numbers)]}


VERSION = "v3.0"
DEFAULT_TASK = "Follow the performer."
PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FIRST = PLACE.format(chunk_index=0, file_index=0)
COMPRESSION = "snappy"
"""Of the format v3.0: places of files are numbered from 0, and all that is written fits into the first."""


def lerobot_files(motion: Motion, *, task: str = DEFAULT_TASK) -> dict[str, bytes]:
    """The files of a dataset, by their paths in its folder.

    Raises UsageError without pyarrow or where the rate is no whole number, which LeRobot cannot say; InputError where
    rows are not evenly spaced or a servo is not known.
    """
    pa, rate = arrow(), motion.rate_hz
    if not rate.is_integer():
        step = f"Have it resampled: --fps {max(round(rate), 1)}"
        raise UsageError(
            "LeRobot counts whole frames per second", where="--to lerobot", found=f"{rate:g}", next_step=step
        )
    features, frames = features_of(motion, rate_hz=int(rate)), {}
    for item in features:
        flat = pa.array(item.values.ravel())
        frames[item.key] = pa.FixedSizeListArray.from_arrays(flat, item.values.shape[1]) if item.vector else flat
    statistics = {item.key: statistics_of(item.values) for item in features}
    tables = {
        f"data/{FIRST}": pa.table(frames),
        "meta/tasks.parquet": _tasks(pa, task),
        f"meta/episodes/{FIRST}": _episode(pa, len(motion), statistics, task),
    }
    files = {"README.md": _readme(motion, features).encode()}
    for name, content in (("info", _info(motion, features, int(rate))), ("stats", statistics)):
        text = json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False) + "\n"
        files[f"meta/{name}.json"] = text.encode()
    for name, table in tables.items():
        stream = io.BytesIO()
        pa.parquet.write_table(table, stream, compression=COMPRESSION)
        files[name] = stream.getvalue()
    return files


def _info(motion: Motion, features: tuple[Feature, ...], rate: int) -> dict[str, Any]:
    described = {
        item.key: {
            "dtype": item.dtype,
            "shape": [item.values.shape[1]],
            "names": None if item.names is None else list(item.names),
        }
        for item in features
    }
    return {
        "codebase_version": VERSION,
        "robot_type": motion.robot,
        "total_episodes": 1,
        "total_frames": len(motion),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": "0:1"},
        "data_path": f"data/{PLACE}",
        "video_path": None,
        "features": described,
    }


def _tasks(pa: Any, task: str) -> Any:
    """The tasks, as the index of a data frame; the schema's metadata say so to pandas, with which LeRobot reads it."""

    def column(name: str, kind: str, stored: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored, "metadata": None}

    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    schema = pa.schema([("task_index", pa.int64()), ("task", pa.string())], metadata={"pandas": json.dumps(about)})
    return pa.table([pa.array([0]), pa.array([task])], schema=schema)


def _episode(pa: Any, frames: int, statistics: dict[str, dict[str, Any]], task: str) -> Any:
    row: dict[str, Any] = {
        "episode_index": 0,
        "tasks": [task],
        "length": frames,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": 0,
        "dataset_to_index": frames,
    }
    for key, values in statistics.items():
        row |= {f"stats/{key}/{name}": value for name, value in values.items()}
    row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
    return pa.table({key: [value] for key, value in row.items()})


def _readme(motion: Motion, features: tuple[Feature, ...]) -> str:
    """A dataset card: its head is read by the Hub, the rest by people."""
    head = "---\ntask_categories:\n- robotics\ntags:\n- LeRobot\nconfigs:\n- config_name: default\n"
    head += "  data_files: data/*/*.parquet\n---\n\n"
    said = {
        **CONVENTIONS,
        "action": "joints as they were sent",
        "observation.state": "where the servos were, read before the action of that frame was sent"
        if "present" in motion
        else "the same as action: no servo answered",
        "observation.root": "x y z (m) and qw qx qy qz (wxyz) of the root",
        "observation.landmarks": "where landmarks were asked to be, m, world",
    }
    keys = {item.key for item in features}
    kept = {what: how for what, how in said.items() if "." not in what or what in keys}
    return head + "Motion of a body that followed a performer.\n\n" + "".join(f"* {a}: {b}\n" for a, b in kept.items())
