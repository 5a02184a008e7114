"""A LeRobot dataset, format v3.0: episodes of one task in a folder, without videos. A README has units and frames, for
which the format has no place."""

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, UsageError
from retarget.recording.exports.tables import arrow
from retarget.recording.motion import CONVENTIONS, Motion


@dataclass(frozen=True, eq=False)
class Feature:
    """One column of a dataset. values (T, d); a `vector` is stored as a list of d, others as one number. dtype:
    LeRobot's name. names: of the d values."""

    key: str
    dtype: str
    values: NDArray[Any]
    names: tuple[str, ...] | None = None

    @property
    def vector(self) -> bool:
        """True if a frame holds a list."""
        return self.names is not None


def features_of(
    motion: Motion, *, rate_hz: int, landmarks: tuple[str, ...] = (), episode: int = 0, first: int = 0
) -> tuple[Feature, ...]:
    """The features of a motion. `action`: joints as sent; `observation.state`: measured joints, read before that was
    sent.

    Joints are those with a servo; without servos all, as sent. `observation.root`: x y z (m) and qw qx qy qz of the
    first link, world; `observation.landmarks`: desired ones (m, world). LeRobot's indices follow. Raises InputError for
    a servo unknown in some frame.
    """
    # Without servo data all joints count as driven.
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
    if landmarks:
        columns = [motion.landmark_names.index(name) for name in landmarks]
        points = motion.landmarks_asked[:, columns].reshape(len(motion), -1)
        vectors += [("observation.landmarks", tuple(f"{name}.{axis}" for name in landmarks for axis in "xyz"), points)]
    frame, zero = np.arange(len(motion)), np.zeros(len(motion), dtype=np.int64)
    counted = {"frame_index": frame, "episode_index": zero + episode, "index": first + frame, "task_index": zero}
    return (
        *(Feature(key, "float32", values.astype(np.float32), names) for key, names, values in vectors if names),
        Feature("timestamp", "float32", (frame / rate_hz).astype(np.float32)[:, None]),
        *(Feature(key, "int64", values.astype(np.int64)[:, None]) for key, values in counted.items()),
    )


def known_landmarks(motions: Sequence[Motion]) -> tuple[str, ...]:
    """The landmarks that are known in every frame of all motions, in the order of the first."""
    known = [_known_landmarks(motion) for motion in motions]
    return tuple(name for name in known[0] if all(name in others for others in known[1:]))


def _known_landmarks(motion: Motion) -> list[str]:
    if "landmarks_asked" not in motion:
        return []
    always = np.asarray(np.isfinite(motion.landmarks_asked).all(axis=(0, 2)))
    return [name for name, kept in zip(motion.landmark_names, always, strict=True) if kept]


def _joined(episodes: Sequence[tuple[Feature, ...]], motions: Sequence[Motion]) -> tuple[Feature, ...]:
    """The features of all episodes in a row. Raises InputError if they differ in kind."""
    first = [(item.key, item.names) for item in episodes[0]]
    for features, motion in zip(episodes[1:], motions[1:], strict=True):
        kind = [(item.key, item.names) for item in features]
        if kind != first or motion.robot != motions[0].robot:
            other = next((ours[0] for ours, theirs in zip(kind, first, strict=False) if ours != theirs), "")
            raise InputError(
                "runs of different robots, or read differently, are no one data set",
                where=motion.source,
                found=f"{motion.robot}{f', with other joints in {other}' if other else ''}",
                allowed=f"{motions[0].robot}, as in {motions[0].source}",
                next_step="Export each kind to a data set of its own",
            )
    return tuple(
        replace(same[0], values=np.concatenate([item.values for item in same])) for same in zip(*episodes, strict=True)
    )


QUANTILES = (1, 10, 50, 90, 99)
"""Percentiles of the statistics: keys q01, q10, q50, q90 and q99."""


def statistics_of(values: NDArray[np.generic]) -> dict[str, list[float] | list[int]]:
    """Statistics of values (T, d), in their unit, by LeRobot's names; the deviation is that of a population."""
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
"""Compression of format v3.0. Its files are numbered, and everything fits into the first."""


def lerobot_files(*motions: Motion, task: str = DEFAULT_TASK) -> dict[str, bytes]:
    """The files of a dataset by path; each motion is an episode.

    Raises UsageError without pyarrow, or for a rate that is no integer, which LeRobot needs; InputError for unevenly
    spaced rows, an unknown servo, or motions of different robots or rates.
    """
    pa, rate = arrow(), _rate_of(motions)
    first, landmarks = np.cumsum([0, *map(len, motions)]).tolist(), known_landmarks(motions)
    episodes = [
        features_of(motion, rate_hz=rate, landmarks=landmarks, episode=episode, first=first[episode])
        for episode, motion in enumerate(motions)
    ]
    features, frames = _joined(episodes, motions), {}
    for item in features:
        flat = pa.array(item.values.ravel())
        frames[item.key] = pa.FixedSizeListArray.from_arrays(flat, item.values.shape[1]) if item.vector else flat
    statistics = {item.key: statistics_of(item.values) for item in features}
    tables = {
        f"data/{FIRST}": pa.table(frames),
        "meta/tasks.parquet": _tasks(pa, task),
        f"meta/episodes/{FIRST}": _episodes(pa, episodes, first, task),
    }
    files = {"README.md": _readme(motions, features).encode()}
    for name, content in (("info", _info(motions, features, rate)), ("stats", statistics)):
        text = json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False) + "\n"
        files[f"meta/{name}.json"] = text.encode()
    for name, table in tables.items():
        stream = io.BytesIO()
        pa.parquet.write_table(table, stream, compression=COMPRESSION)
        files[name] = stream.getvalue()
    return files


def _rate_of(motions: Sequence[Motion]) -> int:
    rates = [motion.rate_hz for motion in motions]
    rate = rates[0]
    if not rate.is_integer():
        step = f"Have it resampled: --fps {max(round(rate), 1)}"
        raise UsageError(
            "LeRobot counts whole frames per second", where="--to lerobot", found=f"{rate:g}", next_step=step
        )
    for motion, other in zip(motions, rates, strict=True):
        if other != rate:
            step = f"Have all resampled: --fps {round(rate)}"
            raise InputError("episodes of different rates", where=motion.source, found=f"{other:g} Hz", next_step=step)
    return int(rate)


def _info(motions: Sequence[Motion], features: tuple[Feature, ...], rate: int) -> dict[str, Any]:
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
        "robot_type": motions[0].robot,
        "total_episodes": len(motions),
        "total_frames": sum(map(len, motions)),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": f"0:{len(motions)}"},
        "data_path": f"data/{PLACE}",
        "video_path": None,
        "features": described,
    }


def _tasks(pa: Any, task: str) -> Any:
    """The tasks as the index of a pandas data frame, which LeRobot reads."""

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


def _episodes(pa: Any, episodes: Sequence[tuple[Feature, ...]], first: Sequence[int], task: str) -> Any:
    """One row per episode. first: first frame of each episode in the dataset, and the total."""
    rows = list[dict[str, Any]]()
    for episode, features in enumerate(episodes):
        begin, end = first[episode], first[episode + 1]
        row: dict[str, Any] = {
            "episode_index": episode,
            "tasks": [task],
            "length": end - begin,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": begin,
            "dataset_to_index": end,
        }
        for item in features:
            row |= {f"stats/{item.key}/{name}": value for name, value in statistics_of(item.values).items()}
        rows.append(row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
    return pa.table({key: [row[key] for row in rows] for key in rows[0]})


def _readme(motions: Sequence[Motion], features: tuple[Feature, ...]) -> str:
    head = "---\ntask_categories:\n- robotics\ntags:\n- LeRobot\nconfigs:\n- config_name: default\n"
    head += "  data_files: data/*/*.parquet\n---\n\n"
    said = {
        **CONVENTIONS,
        "action": "joints as they were sent",
        "observation.state": "where the servos were, read before the action of that frame was sent"
        if all("present" in motion for motion in motions)
        else "the same as action: no servo answered",
        "observation.root": "x y z (m) and qw qx qy qz (wxyz) of the root",
        "observation.landmarks": "desired landmarks, m, world",
    }
    keys = {item.key for item in features}
    kept = {what: how for what, how in said.items() if "." not in what or what in keys}
    return head + "Motion of a body that followed a performer.\n\n" + "".join(f"* {a}: {b}\n" for a, b in kept.items())
