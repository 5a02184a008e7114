"""`python -m benchmarks.golden --against COMMIT`: the same runs by a commit and by this checkout, compared to the bit.

It compares exit codes, saved arrays, keys of the report and every byte on the emulator's wire.
Exit code 0: all is the same, but for timings and wording; 1: something differs; 2: a version cannot be run.
`--store` renews what `make test` holds this checkout against.
"""

import argparse
import resource
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.golden.compare import COUNTED_MESSAGES, MESSAGES, TIMINGS, differences
from benchmarks.golden.matrix import Run, found_sources, full_matrix
from benchmarks.golden.play import Outcome, play
from benchmarks.golden.stored import STORED, store
from benchmarks.golden.tree import Tree, TreeError, other_tree, resolved, this_tree

ROOT = Path(__file__).resolve().parent.parent.parent
OUT = ROOT / "out" / "golden"
MOST_SHOWN = 8
"""Differences of one run."""


def main() -> int:
    """The command. Returns its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.golden", description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--against", metavar="COMMIT", help="the commit to compare with")
    what.add_argument("--store", action="store_true", help=f"renew {STORED.name}")
    parser.add_argument("--only", default="", metavar="TEXT", help="only runs with this in their name")
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    asked = parser.parse_args()
    try:
        if asked.store:
            store(this_tree(ROOT), OUT / "store")
            print(f"stored in {STORED.relative_to(ROOT)}")
            return 0
        return compare(asked.against, only=asked.only, jobs=asked.jobs)
    except TreeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def compare(commit: str, *, only: str, jobs: int) -> int:
    """Play everything with both versions and print what differs."""
    begin = time.monotonic()
    sha = resolved(ROOT, commit)
    here, there = this_tree(ROOT), other_tree(ROOT, sha, cache=OUT)
    config = OUT / "config"
    config.mkdir(parents=True, exist_ok=True)
    for tree in (here, there):
        tree.verify(config)
    sources = found_sources(OUT / "sources", ROOT)
    runs = [run for run in full_matrix(sources) if only in run.name]
    if not runs:
        raise TreeError(f"no run has {only!r} in its name")
    print(f"{here.name} against {there.name}: {len(runs)} runs by each, {jobs} at a time", flush=True)
    for note in sources.notes:
        print(f"note: {note}")
    built = time.monotonic()
    bad = _play_all(runs, here, there, jobs)
    end = time.monotonic()
    worded = ", ".join([*MESSAGES, *COUNTED_MESSAGES])
    print(f"not compared: {', '.join(TIMINGS)} (timings); the wording of {worded}")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime
    print(f"{end - begin:.0f} s, of them {built - begin:.0f} s to build; {cpu:.0f} s of CPU")
    print(f"{bad} of {len(runs)} runs differ" if bad else f"all {len(runs)} runs are equal to the bit")
    return 1 if bad else 0


def _play_all(runs: list[Run], here: Tree, there: Tree, jobs: int) -> int:
    """How many runs differ. Both versions of a run are played at about the same time."""
    bad = 0
    with ThreadPoolExecutor(jobs) as pool:
        both = [
            (
                run,
                pool.submit(play, run, here, OUT / "runs" / run.name / "here"),
                pool.submit(play, run, there, OUT / "runs" / run.name / "there"),
            )
            for run in runs
        ]
        for run, ours, theirs in both:
            bad += _print_comparison(run, ours.result(), theirs.result())
    return bad


def _print_comparison(run: Run, ours: Outcome, theirs: Outcome) -> bool:
    """Print how a run compares. Returns whether it differs."""
    found = differences(ours, theirs)
    wire = f", {len(ours.wire['data'])} bytes on the wire" if ours.wire else ""
    ticks = f"{len(ours.arrays['joint_positions'])} ticks, {len(ours.arrays)} arrays" if ours.arrays else ""
    ticks = ticks or f"{len(ours.report.get('verdicts', ()))} verdicts"
    print(f"{'DIFFERENT' if found else 'equal    '} {run.name}: {ticks}{wire}")
    for one in found[:MOST_SHOWN]:
        first = "" if one.first is None else f" from tick {one.first} on:"
        print(f"    {one.what}:{first} {one.text}")
    if len(found) > MOST_SHOWN:
        print(f"    and {len(found) - MOST_SHOWN} more")
    sys.stdout.flush()
    return bool(found)


if __name__ == "__main__":
    raise SystemExit(main())
