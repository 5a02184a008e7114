"""Arrays of an NPZ file from outside. Pickles are never read; missing, truncated or misshapen arrays are errors."""

import sys
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from math import fsum, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from retarget.errors import InputError

BROKEN = (
    *(OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, MemoryError, OverflowError),
    *(tokenize.TokenError, SyntaxError, TypeError, zlib.error),
)


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """Arrays by key. advice: the next step for another kind of file. notes: about skipped arrays."""

    source: str
    arrays: dict[str, NDArray[Any]]
    advice: str
    notes: tuple[str, ...] = ()

    def __contains__(self, key: str) -> bool:
        return key in self.arrays

    def floats(self, key: str, *shape: int | None, unknown: bool = False) -> NDArray[np.float64]:
        """Read numbers of this shape (None: any size). unknown: allows NaN. Raises InputError."""
        values = np.asarray(self._checked(key, "fiu", "numbers", shape), dtype=np.float64)
        bad = ~np.isfinite(values) & ~(unknown & np.isnan(values))
        if bad.any():
            row = int(np.argwhere(bad)[0][0]) if values.ndim else 0
            found = f"{values[bad].flat[0]} in row {row + 1}, and in {np.count_nonzero(bad)} places in all"
            raise self._wrong(key, found, "finite numbers")
        return values

    def whole(self, key: str, *shape: int | None) -> NDArray[np.int64]:
        """Read whole numbers of this shape. Raises InputError."""
        return np.asarray(self._checked(key, "iu", "whole numbers", shape), dtype=np.int64)

    def texts(self, key: str, *shape: int | None) -> NDArray[np.str_]:
        """Read texts of this shape. Raises InputError."""
        values = np.ascontiguousarray(self._checked(key, "U", "texts", shape), dtype=np.str_).reshape(-1)
        if (values.view(np.uint32) > sys.maxunicode).any():
            raise self._wrong(key, "a code that is no letter's", "texts")
        return values.reshape(self.arrays[key].shape)

    def _checked(self, key: str, kinds: str, what: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
        array = self.arrays[key]
        sizes = zip(shape, array.shape, strict=False)
        if array.ndim != len(shape) or any(expected not in (None, size) for expected, size in sizes):
            allowed = ", ".join("any" if size is None else str(size) for size in shape)
            raise self._wrong(key, f"shape {array.shape}", f"shape ({allowed})")
        if array.dtype.kind not in kinds:
            raise self._wrong(key, f"{array.dtype}", what)
        return array

    def _wrong(self, key: str, found: str, allowed: str) -> InputError:
        return InputError(
            "wrong content", where=f"{self.source}: {key}", found=found, allowed=allowed, next_step=self.advice
        )


Select = Callable[[Collection[str]], Collection[str]]
"""Chooses from the names in a file; may raise InputError."""


def open_arrays(
    path: Path, select: Select, *, max_bytes: int, advice: str, optional: Collection[str] = ()
) -> ArrayFile:
    """The selected arrays of a file. max_bytes: of all these, unpacked. advice: the next step for another kind of file.
    optional: skipped, with a note, if they hold Python objects. Raises InputError."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            read = set(select(entries.keys()))
            size = int(fsum(entry.file_size for name, entry in entries.items() if name in read))
            if size > max_bytes:
                raise InputError("too large", where=str(path), found=f"{size} bytes", allowed=f"up to {max_bytes}")
            found = {name: _read_array(archive, entries[name]) for name in entries if name in read}
            arrays = {name: array for name, array in found.items() if array is not None}
            objects = sorted(found.keys() - arrays.keys())
            for name in objects:
                if name not in optional:
                    raise InputError(
                        "an array of Python objects, which is a pickle and never read",
                        where=f"{path}: {name}",
                        next_step="Save it as numbers: numpy.asarray(values, float)",
                    )
            notes = tuple(f"{name} is an array of Python objects: it is passed over" for name in objects)
            return ArrayFile(str(path), arrays, advice, notes)
    except zipfile.BadZipFile as error:
        step = f"If it was one, it is cut short: get it again. {advice}"
        raise InputError("not an NPZ file", where=str(path), found=error, next_step=step) from error
    except BROKEN as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError("a damaged NPZ file", where=str(path), found=reason, next_step="Get it again") from error


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any] | None:
    """An array of a .npy file, allocated only if its header agrees with the file's size; None for Python objects."""
    with archive.open(entry) as stream:
        header = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = header(stream)
        if dtype.hasobject:
            return None
        if not dtype.itemsize or stream.tell() + dtype.itemsize * prod(shape) != entry.file_size:
            raise ValueError(f"{entry.filename} has another size than its header says")
    with archive.open(entry) as stream:
        return np.asarray(npy.read_array(stream, allow_pickle=False))
