"""A motion as the features of a LeRobot dataset: what was seen and what was done, frame by frame."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError
from retarget.exporting.motion import Motion
from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["Feature", "features_of"]


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
    driven = _driven(motion)
    joints = tuple(f"{name}.pos" for name, kept in zip(motion.joint_names, driven, strict=True) if kept)
    sent = motion.joints[:, driven]
    seen = sent if motion.servos is None else motion.servos[:, driven]
    _check_known(seen, joints, motion.source)
    features = [_vector("action", joints, sent), _vector("observation.state", joints, seen)]
    features.append(_vector("observation.root", ("x", "y", "z", "qw", "qx", "qy", "qz"), motion.q[:, :7]))
    features += _landmarks(motion)
    frame, zero = np.arange(len(motion)), np.zeros(len(motion), dtype=np.int64)
    features.append(Feature("timestamp", "float32", (frame / rate_hz).astype(np.float32)[:, None]))
    counted = {"frame_index": frame, "episode_index": zero, "index": frame, "task_index": zero}
    features += [Feature(key, "int64", values.astype(np.int64)[:, None]) for key, values in counted.items()]
    return tuple(features)


def _driven(motion: Motion) -> BoolArray:
    """Which joints (n,) have a servo; all of them, where no servo answered."""
    if motion.servos is None:
        return np.ones(len(motion.joint_names), dtype=np.bool_)
    return np.asarray(np.isfinite(motion.servos).any(axis=0))


def _vector(key: str, names: tuple[str, ...], values: FloatArray) -> Feature:
    return Feature(key, "float32", values.astype(np.float32), names)


def _landmarks(motion: Motion) -> list[Feature]:
    if motion.asked is None:
        return []
    known = np.asarray(np.isfinite(motion.asked.position).all(axis=(0, 2)))
    names = tuple(
        f"{name}.{axis}" for name, kept in zip(motion.asked.names, known, strict=True) if kept for axis in "xyz"
    )
    values = motion.asked.position[:, known].reshape(len(motion), -1)
    return [_vector("observation.landmarks", names, values)] if names else []


def _check_known(seen: FloatArray, joints: tuple[str, ...], source: str) -> None:
    missing = np.argwhere(~np.isfinite(seen))
    if missing.size:
        row, column = missing[0].tolist()
        found = f"nothing of {joints[column]} in row {row + 1}"
        step = "Export csv or parquet, which can leave numbers out"
        raise InputError("a servo that was not read", where=source, found=found, next_step=step)
