"""One golden run by one version, in a process of its own, and what it left behind."""

import json
import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.golden.matrix import Run
from benchmarks.golden.tree import Tree

Arrays = dict[str, np.ndarray[Any, Any]]
LONGEST_S = 400.0
"""Of one run. A machine that is busy with other work takes its time."""
TAP = Path(__file__).with_name("wire_tap.py")
VERDICT = re.compile(r"^(ok|BAD)\s.*?(?:, after ([\d.]+) s)?$")
"""A line of `retarget faults`: verdict, the name of a case, and the time of its reaction."""


@dataclass(frozen=True)
class Outcome:
    """code: exit code. arrays: of --save. report: of --report, or the verdicts of `faults`. wire: see `Log.arrays`.

    problem: why there is nothing to compare; "" where there is.
    """

    code: int
    arrays: Arrays = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    wire: Arrays = field(default_factory=dict)
    problem: str = ""


def play(run: Run, tree: Tree, folder: Path, *, before: tuple[str, ...] = ()) -> Outcome:
    """Run it in an empty `folder`. before: words before `python`."""
    shutil.rmtree(folder, ignore_errors=True)
    config = folder / "config"
    config.mkdir(parents=True)
    saved = ["--save", "run.npz", "--report", "report.json"] if run.saves else []
    head = [str(TAP), "wire.npz"] if run.wire else ["-m", "retarget"]
    command = [*before, str(tree.python), "-P", *head, *run.words, *saved]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=tree.environment(config),
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Outcome(-1, problem=f"is not done after {LONGEST_S:.0f} s")
    (folder / "stdout.txt").write_text(done.stdout, encoding="utf-8")
    (folder / "stderr.txt").write_text(done.stderr, encoding="utf-8")
    return _left(run, tree, folder, done)


def _left(run: Run, tree: Tree, folder: Path, done: "subprocess.CompletedProcess[str]") -> Outcome:
    """Read what a run has written."""
    tail = " | ".join(done.stderr.strip().splitlines()[-3:])
    if done.returncode not in (0, 1):
        return Outcome(done.returncode, problem=f"exit code {done.returncode}: {tail}")
    arrays: Arrays = {}
    if run.saves:
        if not (folder / "run.npz").is_file() or not (folder / "report.json").is_file():
            return Outcome(done.returncode, problem=f"nothing was saved: {tail}")
        arrays, report = _arrays(folder / "run.npz"), json.loads((folder / "report.json").read_text(encoding="utf-8"))
        arrays = {name: values for name, values in arrays.items() if not name.startswith("time_")}  # no goals
        if "body" in arrays:  # a path below the folder of the run, or of the version
            path = str(arrays["body"]).replace(f"{folder}/", "").replace(f"{tree.folder}/", "")
            arrays["body"] = np.array(path)
        if np.ptp(arrays["joint_positions"], axis=0).max(initial=0.0) == 0.0:
            return Outcome(done.returncode, problem="nothing moved")
    else:
        found = [VERDICT.match(line) for line in done.stdout.splitlines()]
        report = {"verdicts": [[one[1], one[2]] for one in found if one]}
        if not report["verdicts"]:
            return Outcome(done.returncode, problem=f"no verdict: {tail}")
    wire = _arrays(folder / "wire.npz") if run.wire else {}
    if run.wire and not len(wire["size"]):
        return Outcome(done.returncode, problem="no byte was seen on the wire")
    return Outcome(done.returncode, arrays, report, wire)


def _arrays(path: Path) -> Arrays:
    with np.load(path, allow_pickle=False) as found:
        return dict(found.items())
