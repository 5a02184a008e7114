"""A motion as a table: what CSV and Parquet have in common. The unit is the end of a column's name."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError
from retarget.exporting.motion import Motion

__all__ = ["Column", "columns_of"]


@dataclass(frozen=True, eq=False)
class Column:
    """values (T,): numbers, whole numbers or texts. unit: "" where there is none."""

    name: str
    unit: str
    values: NDArray[Any]


def columns_of(motion: Motion) -> tuple[Column, ...]:
    """Time, the root (position m, quaternion wxyz, of the first link in the world), every joint as it was sent.

    Then, where they are known: `servo_` where the servo was, `ticks_` its goal, `asked_` the landmarks asked for. The
    phase only where rows differ in it. Raises InputError where two columns would have one name.
    """
    columns = [_column("time", "s", motion.time)]
    columns += [_column(f"root_{axis}", "m", motion.root_position[:, i]) for i, axis in enumerate("xyz")]
    columns += [_column(f"root_q{axis}", "", motion.root_quaternion[:, i]) for i, axis in enumerate("wxyz")]
    named = list(zip(motion.joint_names, motion.joint_units, strict=True))
    columns += [_column(name, unit, motion.joints[:, i]) for i, (name, unit) in enumerate(named)]
    if motion.servos is not None:
        known = np.asarray(np.isfinite(motion.servos).any(axis=0))
        columns += [
            _column(f"servo_{name}", unit, motion.servos[:, i]) for i, (name, unit) in enumerate(named) if known[i]
        ]
    if motion.goal_ticks is not None:
        driven = np.asarray((motion.goal_ticks >= 0).any(axis=0))
        columns += [
            _column(f"ticks_{name}", "", motion.goal_ticks[:, i]) for i, (name, _) in enumerate(named) if driven[i]
        ]
    if motion.asked is not None:
        columns += [
            _column(f"asked_{name}_{axis}", "m", motion.asked.position[:, i, j])
            for i, name in enumerate(motion.asked.names)
            for j, axis in enumerate("xyz")
        ]
    if len(set(motion.phase.tolist())) > 1:
        columns.append(_column("phase", "", motion.phase))
    _check_names(columns, motion.source)
    return tuple(columns)


def _column(name: str, unit: str, values: NDArray[Any]) -> Column:
    return Column(f"{name}_{unit}" if unit else name, unit, values)


def _check_names(columns: list[Column], source: str) -> None:
    names = [column.name for column in columns]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError("two columns of one name", where=source, found=twice, next_step="Rename that joint")
