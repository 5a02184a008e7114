"""`python -m benchmarks.reports --mocap DIR [NAME ...] [--docs]`: tables of docs/ that are made of reports of runs.

Every row is one `retarget run ... --report` in a process of its own; NAME chooses tables. `--keep FILE` keeps each
report, a line of JSON, and goes on from what it holds.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.kept import run_cases
from benchmarks.recording import SHARED
from benchmarks.table import add_docs, show_table

Report = dict[str, Any]
"""What `--report` writes; docs/results.md explains its keys."""
LIKENESS = ("upper arms, mean; p95 (best mean), deg", "forearms", "trunk lean, mean; max", "worse hand, mm")
MASS = (
    *("robot, recording", "fallen", "soles tip, degrees", "slip of both soles, mm", "hand path", "lag, s"),
    *("upper arms, deg", "forearms", "thighs", "shanks", "trunk lean", "worse hand, mm", "refused goals, %"),
)
IN_PLACE = (
    *("02_04.amc", "02_05.amc", "02_06.amc", "02_10.amc", "49_18.amc"),
    *("49_02.bvh", "sample.bvh", "test_mocapbank.bvh"),
)
"""Recordings whose performer stays within a metre."""
WAYS = ("feet's path, %", "travelled, m", "turned, deg")


@dataclass(frozen=True)
class Table:
    """A table. rows: words of each, the recording, and its options of `retarget run`; cells: the numbers of a row.
    on_page: a page of docs/ shows it."""

    heads: tuple[str, ...]
    rows: tuple[tuple[tuple[str, ...], str, str], ...]
    cells: Callable[[Report], list[str]]
    on_page: bool = True


def likeness(report: Report) -> list[str]:
    """Angles between limbs, with the best that the joints allow, and how far the trunk leans from the performer's,
    degrees; the worse hand, mm."""
    limbs = [(report["likeness_deg"][limb], report["best_likeness_deg"][limb]) for limb in ("upper_arms", "forearms")]
    lean = report["trunk_lean_deg"]
    angles = [f"{limb['mean']:.0f}; {limb['p95']:.0f} ({best['mean']:.0f})" for limb, best in limbs]
    return [*angles, f"{lean['mean']:.0f}; {lean['max']:.0f}", f"{report['reachable_hands_mm']['worse']:.0f}"]


def ways(report: Report) -> list[str]:
    """The path of the feet against the performer's; how far robot and performer got, m, and turned, degrees."""
    foot, both = report["foot_path_ratio"], (report["travelled_m"], report["turned_deg"])
    ends = [
        f"{one['robot']:.{digits}f} of {one['performer']:.{digits}f}" for one, digits in zip(both, (2, 0), strict=True)
    ]
    return ["-" if foot is None else f"{100.0 * foot:.0f}", *ends]


def standing(report: Report) -> list[str]:
    """How firmly a robot with mass stood, and how well it followed."""
    physics = report["physics"]
    feet = [f"{physics['sole_tilt_max_deg']:.1f}", f"{physics['foot_slip_mm']['total']:.1f}"]
    return ["yes" if report["fallen"] else "no", *feet, f"{report['hand_path_ratio']:.2f}", f"{report['lag_s']:.2f}"]


def with_mass(report: Report) -> list[str]:
    """How firmly a robot with mass stood, its likeness, degrees, and how much of what was asked it refused."""
    limbs = [f"{report['likeness_deg'][limb]['mean']:.1f}" for limb in ("upper_arms", "forearms", "thighs", "shanks")]
    lean, hand = report["trunk_lean_deg"]["mean"], report["reachable_hands_mm"]["worse"]
    refused = 100.0 * report["gated_frames"] / report["ticks"]
    return [*standing(report), *limbs, f"{lean:.1f}", f"{hand:.0f}", f"{refused:.2f}"]


def walking(report: Report) -> list[str]:
    """How far it walked, how like, and how firmly."""
    walk, likeness, hand = report["walk"], report["likeness_deg"], report["reachable_hands_mm"]["worse"]
    limbs = [f"{likeness[limb]['mean']:.0f}" for limb in ("upper_arms", "thighs", "shanks")]
    gone = f"{walk['walked_m']:.2f} / {walk['asked_m']:.2f}"
    turned = f"{walk['turned_deg']:.0f} / {walk['asked_turn_deg']:.0f}"
    fallen, tips, slip, *_ = standing(report)
    slip = f"{float(slip) / max(walk['steps'], 1):.1f}"
    return [str(walk["steps"]), gone, turned, *limbs, f"{hand:.0f}", fallen, tips, slip]


def hanging(report: Report) -> list[str]:
    """Mean error of head, pelvis and soles, mm: of what was sent, and of where the servos were."""
    keys, names = ("tracking_mm", "servo_tracking_mm"), ("head", "pelvis", "l_sole", "r_sole")
    return [f"{sum(report[key][name]['mean'] for name in names) / len(names):.1f}" for key in keys]


TABLES = {
    "shipped-robots": Table(
        ("robot, recording", *LIKENESS, *WAYS),
        tuple(
            ((f"{robot}, {name.removesuffix('.amc')}",), name, f"--robot {robot} --best-likeness")
            for robot in ("op3", "poppy", "toddlerbot", "wolfgang")
            for name in ("02_05.amc", "02_06.amc", "02_10.amc", "sample.bvh", "test_mocapbank.bvh")
        ),
        lambda report: [*likeness(report), *ways(report)],
    ),
    "standing": Table(
        ("recording", "fallen", "soles tip, degrees", "slip of both soles, mm", "hand path", "lag, s"),
        tuple(
            ((words,), name, "--robot op3 --bus physics")
            for words, name in (
                ("02_05 (boxing)", "02_05.amc"),
                ("02_06 (reach, crouch)", "02_06.amc"),
                ("02_10 (wash)", "02_10.amc"),
                ("02_03 (jog)", "02_03.amc"),
                ("02_04 (jump)", "02_04.amc"),
                ("05_13 (dance)", "05_13.amc"),
                ("49_06 (cartwheel)", "49_06.bvh"),
            )
        ),
        standing,
    ),
    "robots": Table(
        MASS,
        tuple(
            ((f"{robot}, {file}",), file, f"--robot {robot} --bus physics")
            for robot in ("op3", "poppy", "toddlerbot", "wolfgang")
            for file in IN_PLACE
        ),
        with_mass,
        on_page=False,
    ),
    "walking": Table(
        (
            "performer, speed",
            *("steps", "m walked / asked", "degrees turned / asked", "upper arms", "thighs", "shanks, degrees"),
            *("worse hand, mm", "fallen", "soles tip, degrees", "slip, mm a step"),
        ),
        tuple(
            (
                (f"{words}, {speed}",),
                name,
                f"--robot op3 --bus physics --steps walk --speed {speed}"
                + (" --skeleton FOLDER/skeleton.asf" if name == "walking.amc" else ""),
            )
            for words, name, speed in (
                ("02_01 (walk)", "02_01.amc", "0.3"),
                ("02_01 (walk)", "02_01.amc", "0.6"),
                ("walking.amc", "walking.amc", "0.3"),
                ("figure of eight", "AV_8Walk_Meredith_HVHA_Rep1.bvh", "0.25"),
                ("figure of eight", "AV_8Walk_Meredith_HVHA_Rep1.bvh", "1"),
                ("02_03 (jog)", "02_03.amc", "0.3"),
                ("49_18 (one leg)", "49_18.amc", "1"),
            )
        ),
        walking,
    ),
    "hanging": Table(
        ("OP3 on a gantry", "postures sent, mm", "servos, mm"),
        tuple(
            ((words,), f"{words[:5]}.amc", "--robot op3 --bus physics --mount gantry --hook neck")
            for words in ("02_01 (walk)", "02_03 (jog)", "02_05 (box)", "02_06 (reach, crouch)")
        ),
        hanging,
    ),
}
"""Tables by name."""


@dataclass(frozen=True)
class ReportedRun:
    """A recording, and the options of its run. FOLDER in them is that of the recording."""

    recording: str
    options: str


@dataclass(frozen=True)
class Found:
    """The report of a run."""

    report: Report


def report_of(run: ReportedRun) -> list[Found]:
    """Run it, and read its report. A run that ends early has one too. Raises SystemExit where there is none."""
    recording = Path(run.recording)
    options = run.options.replace("FOLDER", str(recording.parent)).split()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.json"
        words = [sys.executable, "-m", "retarget", "run", "--source", str(recording), "--report", str(path), *options]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if not path.is_file():
            raise SystemExit(f"{recording.name}: {done.stderr}")
        return [Found(json.loads(path.read_text(encoding="utf-8")))]


def main() -> None:
    """Run and print the tables that are asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reports", description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(TABLES)}; all of docs/ if absent")
    parser.add_argument("--mocap", type=Path, default=SHARED / "mocap", help="folder of recordings")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every report; runs that are in it are not made again")
    add_docs(parser)
    asked = parser.parse_args()
    for name in asked.names or [name for name, table in TABLES.items() if table.on_page]:
        table = TABLES[name]
        runs = [ReportedRun(str(min(asked.mocap.rglob(file))), options) for _, file, options in table.rows]
        found = run_cases(runs, report_of, Found, jobs=asked.jobs, keep=asked.keep)
        rows = [
            [*words, *table.cells(found[run][0].report)] for (words, _, _), run in zip(table.rows, runs, strict=True)
        ]
        show_table(name, table.heads, rows, text=len(table.rows[0][0]), docs=asked.docs and table.on_page)


if __name__ == "__main__":
    main()
