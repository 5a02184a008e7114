"""A motion as a table, CSV or Parquet. Names of columns end in the unit."""

import csv
import importlib
import io
import json
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, UsageError, install_step
from retarget.recording.motion import CONVENTIONS, Motion
from retarget.run.record import PHASE_NAMES
from retarget.run.table import FIELDS


@dataclass(frozen=True, eq=False)
class Column:
    """values (T,): numbers, integers or texts. unit: "" for none."""

    name: str
    unit: str
    values: NDArray[Any]


TIME_COLUMN = "time_s"
ROOT_COLUMNS = ("root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz")


def columns_of(motion: Motion) -> tuple[Column, ...]:
    """Time, root (position m, quaternion wxyz, of the first link in the world), and every joint as sent.

    Then the known ones of `servo_`, measured positions, `ticks_`, their goals, and `asked_`, desired landmarks. The
    phase is a column if rows differ in it. Raises InputError for two columns of one name.
    """
    columns = [Column(TIME_COLUMN, "s", motion.time)]
    root = np.hstack([motion.root_position, motion.root_quaternion])
    columns += [Column(name, "m" if i < 3 else "", root[:, i]) for i, name in enumerate(ROOT_COLUMNS)]
    named = list(zip(motion.joint_names, motion.joint_units, strict=True))
    columns += [_column(name, unit, motion.joints[:, i]) for i, (name, unit) in enumerate(named)]
    points = [(f"{name}_{axis}", "m") for name in motion.landmark_names for axis in "xyz"]
    for field, labels in (("present", named), ("goal_ticks", named), ("landmarks_asked", points)):
        if field in motion:
            values = motion.known[field].reshape(len(motion), -1)
            whole = values.dtype.kind == "i"
            known = values >= 0 if whole else np.isfinite(values) | (labels is points)
            columns += [
                _column(FIELDS[field].column + name, "" if whole else unit, values[:, i])
                for i, (name, unit) in enumerate(labels)
                if known[:, i].any()
            ]
    if len(set(motion.phase.tolist())) > 1:
        columns.append(_column("phase", "", np.array(PHASE_NAMES)[motion.phase]))
    names = [column.name for column in columns]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError("two columns of one name", where=motion.source, found=twice, next_step="Rename that joint")
    return tuple(columns)


def _column(name: str, unit: str, values: NDArray[Any]) -> Column:
    return Column(f"{name}_{unit}" if unit else name, unit, values)


CSV_DIGITS = 10
"""Significant digits of every number: a micrometre in ten kilometres."""


def write_csv(motion: Motion, stream: IO[bytes]) -> None:
    """Write the table of `columns_of`."""
    columns = columns_of(motion)
    text = io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=True)
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow([column.name for column in columns])
    lines.writerows(zip(*(_texts(column) for column in columns), strict=True))
    text.detach()


def _texts(column: Column) -> list[str]:
    if column.values.dtype.kind != "f":
        return [str(value) for value in column.values.tolist()]
    known = np.isfinite(column.values).tolist()
    return [
        f"{value:.{CSV_DIGITS}g}" if know else "" for value, know in zip(column.values.tolist(), known, strict=True)
    ]


def arrow() -> Any:
    """The module `pyarrow` with `pyarrow.parquet`, an optional dependency. Raises UsageError if it is missing or
    broken."""
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError as error:
        raise UsageError(
            "pyarrow is missing, which writes Parquet and LeRobot data sets",
            found=error,
            allowed="every other format without it",
            next_step=install_step("pyarrow"),
        ) from error


def write_parquet(motion: Motion, stream: IO[bytes]) -> None:
    """Write the table of `columns_of` in full precision. Raises UsageError without pyarrow.

    The metadata of a field has its `unit`; that of the schema has `retarget`, a JSON object.
    """
    pa = arrow()
    columns = columns_of(motion)
    about = {**CONVENTIONS, "root_link": motion.body.body_names[1], "rows": len(motion)}
    schema = pa.schema(
        [
            pa.field(
                column.name, pa.array(column.values[:0]).type, metadata={"unit": column.unit} if column.unit else None
            )
            for column in columns
        ],
        metadata={"retarget": json.dumps(about)},
    )
    # Arrow distinguishes "not known" from NaN; here both are one.
    arrays = [pa.array(column.values, from_pandas=True) for column in columns]
    pa.parquet.write_table(pa.table(arrays, schema=schema), stream)
