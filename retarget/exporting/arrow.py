"""Apache Arrow, which writes Parquet: an extra, imported only by the exports that need it."""

import importlib
from dataclasses import dataclass
from typing import Any

from retarget.errors import UsageError

__all__ = ["Arrow", "arrow"]


@dataclass(frozen=True)
class Arrow:
    """The modules `pyarrow` and `pyarrow.parquet`."""

    core: Any
    parquet: Any


def arrow() -> Arrow:
    """Arrow. Raises UsageError where it is missing or broken."""
    try:
        return Arrow(importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet"))
    except ImportError as error:
        raise UsageError(
            "pyarrow is missing, which writes Parquet and LeRobot datasets",
            where="--to",
            found=error,
            allowed="csv, npz and bvh without it",
            next_step="Install the extra: pip install 'retarget[record]'",
        ) from error
