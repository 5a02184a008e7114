"""CSV (RFC 4180, UTF-8): one line of names with units, then a line per row; a number that is not known is empty."""

import csv
import io
from typing import IO

import numpy as np

from retarget.exporting.columns import Column, columns_of
from retarget.exporting.motion import Motion

__all__ = ["write_csv"]

DIGITS = 10
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
    return [f"{value:.{DIGITS}g}" if know else "" for value, know in zip(column.values.tolist(), known, strict=True)]
