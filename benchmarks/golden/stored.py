"""Hashes of a few runs, kept in the repository: what `make test` can hold a change against on one kind of machine.

They are no judge: the solver picks its instructions by processor, and NumPy, MuJoCo and the C library change. So they
count only where the machine's fingerprint is the stored one.
"""

import hashlib
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.golden.compare import compared_report
from benchmarks.golden.matrix import small_matrix
from benchmarks.golden.play import Outcome, play
from benchmarks.golden.tree import Tree, TreeError

STORED = Path(__file__).resolve().parent.parent.parent / "tests" / "golden" / "stored.json"
CPU = Path("/proc/cpuinfo")
PACKAGES = ("numpy", "scipy", "mujoco")


def fingerprint() -> dict[str, str]:
    """What decides the last bits of a run beside the code."""
    libc = " ".join(platform.libc_ver())
    return {
        "machine": platform.machine(),
        "processor": _cpu("model name") or platform.processor(),
        "processor_flags": hashlib.sha256(" ".join(sorted(_cpu("flags").split())).encode()).hexdigest()[:16],
        "python": platform.python_version(),
        "libc": libc,
        **{name: version(name) for name in PACKAGES},
    }


def _cpu(key: str) -> str:
    """The first value of a key of /proc/cpuinfo; "" where there is none."""
    if not CPU.is_file():
        return ""
    lines = (line.partition(":") for line in CPU.read_text(encoding="utf-8", errors="replace").splitlines())
    return next((value.strip() for name, _, value in lines if name.strip() == key), "")


def hashes(outcome: Outcome) -> dict[str, str]:
    """A hash of every saved array, of the report and of the bytes on the wire."""
    found = {name: _array_hash(values) for name, values in outcome.arrays.items() if name != "body"}
    found["report"] = _hash(json.dumps(_portable(compared_report(outcome.report)), sort_keys=True).encode())
    if outcome.wire:
        found["wire"] = _hash(b"".join(_bytes(outcome.wire[name]) for name in sorted(outcome.wire)))
    return found


def _portable(report: dict[str, Any]) -> dict[str, Any]:
    """Without the paths of this machine."""
    return {key: value for key, value in report.items() if key not in ("source", "live.address")}


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
    """Renew the stored values, on this machine's fingerprint. Raises TreeError."""
    STORED.parent.mkdir(parents=True, exist_ok=True)
    made = {"fingerprint": fingerprint(), "runs": hashes_of_runs(tree, folder)}
    STORED.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def _array_hash(values: np.ndarray[Any, Any]) -> str:
    return _hash(f"{values.dtype.str} {values.shape} ".encode() + _bytes(values))


def _bytes(values: np.ndarray[Any, Any]) -> bytes:
    return np.ascontiguousarray(values).tobytes()


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
