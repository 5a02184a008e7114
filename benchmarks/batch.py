"""`python -m benchmarks.batch`: thousands of clips of a second with four planted faults, killed half way and resumed.

Each part prints what it measured beside what was asked for, and leaves its folder when something is wrong:

* clips: on processes, and a part of them on Ray. The driver is killed with SIGKILL half way and called again: every
  good clip is there once, every fault has its row, and the first clips have the bytes of a plain loop of the same work;
* rate: clips a second beside that loop, in turns with it, at least 0.9 times the number of workers;
* memory: the driver's peak with all clips beside that with a tenth of them, at most 1.2 times, with clips that are
  only copied.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.batch_driver import FAULTS
from hardware.clock import MonotonicClock

sys.path.insert(0, str(Path(__file__).parent.parent / "tests/support"))
from made_layouts import Made, made, named_rig, write_amass, write_bvh, write_glb, write_kimodo, write_mvnx

PLANTED = ("raises", "sleeps", "exits", "allocates")
RATE_HZ, FRAMES = 30.0, 31
"""A second at 30 frames a second."""
WRITERS: tuple[Callable[[Path, Made], Path], ...] = (
    lambda folder, motion: write_bvh(folder, named_rig("bandai"), motion),
    write_amass,
    write_kimodo,
    write_glb,
    write_mvnx,
)
"""A BVH, two kinds of NPZ, a GLB and an MVNX."""
LEAST_RATE, MOST_MEMORY = 0.9, 1.2
ENVIRONMENT = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def synthesise(folder: Path, count: int, *, faults: bool) -> None:
    """Write so many clips of a second in five layouts, windows of a made motion that begin at other frames and places;
    and one of each fault among the first."""
    folder.mkdir(parents=True)
    whole = made(RATE_HZ)
    for number in range(count):
        first = number * 7 % (len(whole.time) - FRAMES)
        rows, aside = (
            slice(first, first + FRAMES),
            np.array([0.0, 1e-4 * (number % 10_000), 0.0]),
        )  # no two are the same
        window = replace(
            whole,
            time=whole.time[:FRAMES],
            joints={name: places[rows] + aside for name, places in whole.joints.items()},
            turns={name: turns[rows] for name, turns in whole.turns.items()},
        )
        path = WRITERS[number % len(WRITERS)](folder, window)
        path.rename(folder / f"{number:06}{path.suffix}")
    for at, name in enumerate(PLANTED if faults else ()):
        (folder / f"{5 * at:06}_{name}.bvh").write_bytes((folder / "000000.bvh").read_bytes())


def command(data: Path, out: Path, *more: str) -> list[str]:
    """The driver's command line."""
    return [sys.executable, "-m", "benchmarks.batch_driver", str(data), str(out), *more]


def driven(data: Path, out: Path, *more: str) -> dict[str, Any]:
    """What a driver that runs to its end prints."""
    done = subprocess.run(command(data, out, *more), stdout=subprocess.PIPE, check=True, env=ENVIRONMENT)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def rows_of(out: Path) -> list[dict[str, Any]]:
    """The rows of an index, without a half line."""
    index = out / "index.jsonl"
    lines = index.read_bytes().splitlines(keepends=True) if index.is_file() else []
    return [json.loads(line) for line in lines if line.endswith(b"\n")]


def killed_half_way(data: Path, out: Path, count: int, *more: str) -> int:
    """Kill a driver when half of the clips have their rows. Returns how many have."""
    driver = subprocess.Popen(command(data, out, *more), stdout=subprocess.DEVNULL, env=ENVIRONMENT)
    clock, index = MonotonicClock(), out / "index.jsonl"
    while not index.is_file() or index.read_bytes().count(b"\n") < count // 2:
        if driver.poll() is not None:
            raise RuntimeError("the driver ended before it was killed")
        clock.sleep_until(clock.now() + 0.2)
    driver.kill()
    driver.wait()
    return len(rows_of(out))


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def check(data: Path, out: Path, alone: Path) -> list[str]:
    """What is wrong with the outputs of a batch. alone: outputs of the plain loop."""
    rows, wrong = rows_of(out), []
    seen, sources = Counter(Path(row["source"]).name for row in rows), {path.name for path in data.iterdir()}
    wrong += [f"{name} has {seen[name]} rows" for name in sorted(sources | set(seen)) if seen[name] != 1]
    for row in rows:
        wanted = next((str(status) for name, status in FAULTS.items() if name in row["output"]), "done")
        there = (out / row["output"]).is_file()
        if row["status"] != wanted or there != (wanted == "done"):
            wrong.append(
                f"{row['output']}: {row['status']}, {row['message']}, output {'there' if there else 'missing'}"
            )
    left = [path.name for path in out.rglob("*") if path.name.startswith(".")]
    wrong += [f"{name} is left" for name in left]
    twins = [(path, out / path.name) for path in alone.glob("*.npz")]
    wrong += [f"{twin.name} has other bytes" for path, twin in twins if twin.is_file() and digest(path) != digest(twin)]
    return wrong


def part(engine: str, count: int, folder: Path, asked: argparse.Namespace) -> list[str]:
    """All clips on one engine, killed and resumed. Returns what is wrong."""
    data, out = folder / f"data_{engine}", folder / f"out_{engine}"
    synthesise(data, count, faults=True)
    more = ["--jobs", str(asked.jobs), "--time-limit", "60", "--robot", asked.robot, *["--ray"] * (engine == "ray")]
    before = killed_half_way(data, out, count, *more)
    found = driven(data, out, *more)
    wrong = check(data, out, folder / "alone_out")
    states = Counter(row["status"] for row in rows_of(out))
    print(f"{engine}: {count} clips and {len(PLANTED)} faults, killed after {before} rows: {dict(states)}")
    print(f"{engine}: {found['rate']:.2f} clips a second in the second half, driver's peak {found['peak_mb']:.0f} MB")
    if not wrong:
        shutil.rmtree(out)
    return wrong


def rate(folder: Path, asked: argparse.Namespace) -> list[str]:
    """The rate beside that of the plain loop, in turns, on the clips of `alone`."""
    found: dict[str, list[dict[str, Any]]] = {"loop": [], "batch": []}
    for turn in range(asked.turns):
        place = folder / f"turn{turn}"
        for name, more in (("loop", ["--loop"]), ("batch", ["--jobs", str(asked.jobs)])):
            found[name].append(driven(folder / "alone", place / name, "--robot", asked.robot, *more))
        shutil.rmtree(place)
    for name, turns in found.items():
        rates, cpu = (", ".join(f"{one[key]:.2f}" for one in turns) for key in ("working_rate", "cpu_s"))
        print(f"rate: {name}: {rates} clips a second, {cpu} s of CPU a clip, by turn")
    loop, batch = (max(one["working_rate"] for one in turns) for turns in found.values())
    share = batch / loop / asked.jobs
    print(f"rate: {share:.2f} times the workers at best (asked for: {LEAST_RATE})")
    return [] if share >= LEAST_RATE else ["the rate is too low"]


def memory(folder: Path, count: int) -> list[str]:
    """The driver's peak memory with all clips and with a tenth of them."""
    peaks = []
    for clips in (count // 10, count):
        data, out = folder / f"data{clips}", folder / f"copies{clips}"
        synthesise(data, clips, faults=False)
        peaks.append(driven(data, out, "--instant")["peak_mb"])
        shutil.rmtree(data)
        shutil.rmtree(out)
    share = peaks[1] / peaks[0]
    print(f"memory: {peaks[0]:.1f} MB with {count // 10} clips, {peaks[1]:.1f} MB with {count}: {share:.2f} times")
    return [] if share <= MOST_MEMORY else ["the driver takes too much memory"]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=__doc__)
    parser.add_argument("--clips", type=int, default=10_000, help="on processes, and of the part of memory")
    parser.add_argument("--ray", type=int, default=1_000, help="clips on Ray; 0: none")
    parser.add_argument("--compare", type=int, default=100, help="clips whose bytes and rate are compared with a loop")
    parser.add_argument("--turns", type=int, default=3, help="of the comparison of rates")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--robot", default="op3")
    parser.add_argument("--folder", type=Path, help="for the clips and outputs, 2 MB a clip; else a temporary one")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="retarget.") as made:
        folder = asked.folder or Path(made)
        synthesise(folder / "alone", asked.compare, faults=False)
        driven(folder / "alone", folder / "alone_out", "--loop", "--robot", asked.robot)
        wrong = memory(folder, asked.clips)
        wrong += rate(folder, asked) if asked.turns else []
        wrong += part("processes", asked.clips, folder, asked)
        wrong += part("ray", asked.ray, folder, asked) if asked.ray else []
    for line in wrong:
        print(f"wrong: {line}")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
