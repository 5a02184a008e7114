"""The arrays of a foreign NPZ file: what is missing, cut short, of another shape or not a number is told at once."""

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError

__all__ = ["ArrayFile", "read_arrays"]

MAX_BYTES = 8 * 1024**3
"""Largest content that is unpacked; an hour of a robot at 125 Hz takes a tenth of it."""
NOT_A_RUN = "Give a file that `retarget run --save FILE.npz` wrote"
BROKEN = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, MemoryError, OverflowError)


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """Arrays by key, and the file that they are from."""

    source: str
    arrays: dict[str, NDArray[Any]]

    def __contains__(self, key: str) -> bool:
        return key in self.arrays

    def floats(self, key: str, *shape: int | None, unknown: bool = False) -> NDArray[np.float64]:
        """Numbers of this shape (None: any size). unknown: NaN is allowed. Raises InputError."""
        array = self._of_shape(key, shape)
        if array.dtype.kind not in "fiu":
            raise self._wrong(key, f"{array.dtype}", "numbers")
        values = np.asarray(array, dtype=np.float64)
        bad = ~np.isfinite(values) & ~(unknown & np.isnan(values))
        if bad.any():
            row = int(np.argwhere(bad)[0][0]) if values.ndim else 0
            found = f"{values[bad].flat[0]} in row {row + 1}, and in {np.count_nonzero(bad)} places in all"
            raise self._wrong(key, found, "finite numbers")
        return values

    def whole(self, key: str, *shape: int | None) -> NDArray[np.int64]:
        """Whole numbers of this shape. Raises InputError."""
        array = self._of_shape(key, shape)
        if array.dtype.kind not in "iu":
            raise self._wrong(key, f"{array.dtype}", "whole numbers")
        return np.asarray(array, dtype=np.int64)

    def texts(self, key: str, *shape: int | None) -> NDArray[np.str_]:
        """Texts of this shape. Raises InputError."""
        array = self._of_shape(key, shape)
        if array.dtype.kind != "U":
            raise self._wrong(key, f"{array.dtype}", "texts")
        return np.asarray(array, dtype=np.str_)

    def _of_shape(self, key: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
        array = self.arrays[key]
        fits = array.ndim == len(shape) and all(
            wanted in (None, size) for wanted, size in zip(shape, array.shape, strict=True)
        )
        if not fits:
            allowed = "(" + ", ".join("any" if size is None else str(size) for size in shape) + ")"
            raise self._wrong(key, f"shape {array.shape}", f"shape {allowed}")
        return array

    def _wrong(self, key: str, found: str, allowed: str) -> InputError:
        return InputError(
            "wrong content", where=f"{self.source}: {key}", found=found, allowed=allowed, next_step=NOT_A_RUN
        )


def read_arrays(path: Path, *, needed: frozenset[str], used: frozenset[str]) -> ArrayFile:
    """The arrays `needed`, and those `used` that are there. Raises InputError: no NPZ, cut short, a key missing."""
    try:
        if path.is_dir():
            raise InputError("this is a folder, not a run", where=str(path), next_step=NOT_A_RUN)
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_BYTES:
            raise InputError("too large", where=str(path), found=f"{size} bytes", allowed=f"up to {MAX_BYTES}")
        with np.load(path, allow_pickle=False) as file:
            missing = sorted(needed - set(file.files))
            if missing:
                found, allowed = f"no {', '.join(missing)}", "the keys of docs/report.md"
                raise InputError("not a saved run", where=str(path), found=found, allowed=allowed, next_step=NOT_A_RUN)
            return ArrayFile(str(path), {key: np.asarray(file[key]) for key in file.files if key in needed | used})
    except (FileNotFoundError, PermissionError) as error:
        raise InputError("cannot read a run", where=str(path), found=error.strerror, next_step=NOT_A_RUN) from error
    except zipfile.BadZipFile as error:
        step = f"If it was one, it is cut short: get it again. {NOT_A_RUN}"
        raise InputError("not an NPZ file", where=str(path), found=error, next_step=step) from error
    except (*BROKEN, zlib.error) as error:
        found = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError("a damaged NPZ file", where=str(path), found=found, next_step="Get it again") from error
