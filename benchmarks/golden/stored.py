"""Hashes of the goals of a few runs, kept in the repository: `make test` finds the same on every machine.

All that decides a goal is computed with `retarget.arithmetic` and the crate, whose bits no processor, C library or BLAS
decides. Runs on physics are left out: MuJoCo's bits are those of one kind of processor.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.golden.matrix import small_matrix
from benchmarks.golden.play import Outcome, play
from benchmarks.golden.tree import Tree, TreeError

STORED = Path(__file__).resolve().parent.parent.parent / "tests" / "golden" / "stored.json"
C_LIBRARY = frozenset({"imu_orientation"})
"""Measured numbers whose last bits are those of the C library's sine. No goal follows from them."""


def hashes(outcome: Outcome) -> dict[str, str]:
    """A hash of every saved array of numbers but those of C_LIBRARY, and of the bytes on the wire."""
    numbers = {name: values for name, values in outcome.arrays.items() if values.dtype.kind != "U"}
    found = {name: _array_hash(values) for name, values in numbers.items() if name not in C_LIBRARY}
    if outcome.wire:
        found["wire"] = _hash(b"".join(_bytes(outcome.wire[name]) for name in sorted(outcome.wire)))
    return found


def hashes_of_runs(tree: Tree, folder: Path) -> dict[str, dict[str, str]]:
    """Hashes by run. Raises TreeError for a run that fails."""
    found = {}
    for run in small_matrix(folder / "sources"):
        outcome = play(run, tree, folder / run.name)
        if outcome.problem:
            raise TreeError(f"{run.name}: {outcome.problem}")
        found[run.name] = hashes(outcome)
    return found


def store(tree: Tree, folder: Path) -> None:
    """Renew the stored values. Raises TreeError."""
    STORED.parent.mkdir(parents=True, exist_ok=True)
    STORED.write_text(json.dumps(hashes_of_runs(tree, folder), indent=1) + "\n", encoding="utf-8")


def _array_hash(values: np.ndarray[Any, Any]) -> str:
    return _hash(f"{values.dtype.str} {values.shape} ".encode() + _bytes(values))


def _bytes(values: np.ndarray[Any, Any]) -> bytes:
    return np.ascontiguousarray(values).tobytes()


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
