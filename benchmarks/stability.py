"""`python -m benchmarks.stability`: how far noise on the sensors moves a whole run away from the run without noise.

Each robot follows each recording without noise, with 0.1 mm and with 1 mm of it (Gaussian, on every axis of every
sensor). The distance of a tick is the largest of any landmark in the posture that was sent from where the run without
noise has it. Jerk, acceleration and what the gate changed tell how calm a run is. The bus has no mass.
`--keep FILE` keeps each recording as it ends, a line of JSON, and goes on from what it holds.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.kept import run_cases
from benchmarks.recording import SHARED
from benchmarks.robustness import motion
from benchmarks.table import add_docs, show_table
from hardware.clock import VirtualClock
from retarget.cli.buses import PhysicsBench
from retarget.frames import SensorFrames
from retarget.human.samples import Playback
from retarget.report.measure import measure
from retarget.report.motion_metrics import jerk_p95, moved_joints, spans
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.run_result import RunResult
from retarget.sources.open import SAMPLE

ROBOTS = ("op3", "poppy", "toddlerbot", "wolfgang")
FOLDER = SHARED / "mocap"
USUAL = (
    *(f"{FOLDER}/cmu_asfamc/{name}.amc" for name in ("02_01", "02_05", "02_06", "02_10")),
    f"{FOLDER}/other/walking.amc,{FOLDER}/other/skeleton.asf",
)
"""Recordings beside the one that comes with the program: two walks, boxing, reach and crouch, wash."""
LIMITS_MM = {0.0: np.inf, 0.1: 5.0, 1.0: 15.0}
"""Standard deviation of the noise on an axis, mm, and the distance, mm, from which on a tick is named."""
AT_LIMIT = 0.999
"""Share of its largest acceleration from which on a joint is at it."""
APART_S = 0.25
"""Ticks beyond the limit that are nearer to each other than this, s, are one span."""


@dataclass(frozen=True)
class Case:
    """All runs of one robot through one recording. seed: of the noise; end: s of the recording."""

    robot: str
    source: str
    end: float | None
    seed: int


@dataclass(frozen=True)
class Calm:
    """One run, in the ticks in which it follows.

    noise_mm: of the sensors. off_mm: distance from the run without noise, p50, p99, p99.9 and the largest; named: spans
    of ticks beyond the limit, with the landmark that is farthest off. jerk_p95, jerk_rms: of the joints, rad/s^3.
    accelerating: share of ticks in which a joint is at its largest acceleration; gated: in which the gate has changed
    the goal. hands, pelvis: path and excursion, reached over asked, of the report.
    """

    noise_mm: float
    ticks: int
    off_mm: tuple[float, float, float, float]
    named: tuple[str, ...]
    jerk_p95: float
    jerk_rms: float
    accelerating: float
    gated: float
    hands: float | None
    pelvis: float | None


def run_case(case: Case) -> list[Calm]:
    """The runs of a robot through a recording, that without noise first."""
    frames, rng, clean, found = motion(case.source), np.random.default_rng(case.seed), np.zeros(0), list[Calm]()
    for noise in LIMITS_MM:
        error = rng.normal(0.0, 1e-3 * noise, frames.position.shape)
        run = play(replace(frames, position=frames.position + error), case)
        reached = run.landmarks_reached
        assert reached is not None, "there is a robot"
        reached = reached[run.record.following]
        clean = reached if noise == 0.0 else clean
        found.append(calm(run, noise, reached, clean))
    return found


def play(frames: SensorFrames, case: Case) -> RunResult:
    """A whole run on servos without mass."""
    options = RunOptions(robot=case.robot, playback=Playback(end=case.end))
    make_bus = PhysicsBench(options, lambda text: None).make_bus
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=make_bus) as prepared:
        return prepared.run()


def calm(run: RunResult, noise: float, reached: Floats, clean: Floats) -> Calm:
    """Measure a run. reached, clean (T, k, 3): landmarks of it and of the run without noise, m."""
    joints, rows, report = moved_joints(run), run.record.following, measure(run)
    q, dt = joints.positions[rows], joints.dt
    change = np.abs(np.diff(q, n=2, axis=0)) / (joints.limits.max_acceleration * dt**2)
    off = 1e3 * np.linalg.norm(reached - clean, axis=2)
    farthest = np.percentile(off.max(axis=1), (50.0, 99.0, 99.9, 100.0)).tolist()
    return Calm(
        noise_mm=noise,
        ticks=len(q),
        off_mm=tuple(round(value, 3) for value in farthest),
        named=named(off, LIMITS_MM[noise], run.followed[0], round(APART_S / dt)),
        jerk_p95=jerk_p95(q, dt) or 0.0,
        jerk_rms=float(np.sqrt(np.mean(np.diff(q, n=3, axis=0) ** 2)) / dt**3),
        accelerating=float((change >= AT_LIMIT).any(axis=1).mean()),
        gated=float(run.record.gated[rows].mean()),
        hands=report.hand_path_ratio,
        pelvis=report.pelvis_excursion_ratio,
    )


def named(off: Floats, limit: float, names: tuple[str, ...], apart: int) -> tuple[str, ...]:
    """Spans of ticks in which a landmark is farther off (T, k) mm than the limit; `apart` ticks of calm end one."""
    beyond = off.max(axis=1) > limit
    for first, last in spans(~beyond):
        beyond[first:last] |= first > 0 and last < len(beyond) and last - first < apart
    found = []
    for first, last in spans(beyond):
        row, column = np.unravel_index(int(off[first:last].argmax()), off[first:last].shape)
        found.append(f"{first}-{last - 1}: {names[column]} {off[first + row, column]:.0f} mm")
    return tuple(found)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stability", description=__doc__)
    usual = [SAMPLE, *(source for source in USUAL if Path(source.split(",")[0]).is_file())]
    parser.add_argument("--robot", nargs="*", default=ROBOTS, help="by name or path")
    parser.add_argument("--source", nargs="*", default=usual, help="motion files, an AMC also as FILE,SKELETON")
    parser.add_argument("--end", type=float, default=None, help="end at this time of each recording, s")
    parser.add_argument("--seed", type=int, nargs="*", default=[1], help="of the noise")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="file for every recording; those that are in it are not run again")
    add_docs(parser)
    asked = parser.parse_args()
    kinds = product(asked.robot, asked.source, asked.seed)
    cases = [Case(robot, source, asked.end, seed) for robot, source, seed in kinds]
    found = run_cases(cases, run_case, Calm, jobs=asked.jobs, keep=asked.keep)
    heads = ["robot, recording, noise in mm", *(f"{share} off, mm" for share in ("p50", "p99", "p99.9", "most"))]
    heads += ["jerk p95", "jerk RMS", "at acceleration limit, %", "gated, %", "hand path", "pelvis excursion"]
    rows = [row(case, one) for case, runs in found.items() for one in runs]
    show_table("stability", heads, rows, docs=asked.docs)
    for case, runs in found.items():
        for one in runs:
            if one.named:
                where = f"{case.robot}, {_stem(case)}, {one.noise_mm:g} mm, of {one.ticks} ticks"
                print(f"{where}: {'; '.join(one.named)}")


def row(case: Case, one: Calm) -> list[str]:
    """The row of one run."""
    ratios = ["-" if ratio is None else f"{ratio:.2f}" for ratio in (one.hands, one.pelvis)]
    off = [f"{value:.1f}" if one.noise_mm else "-" for value in one.off_mm]
    shares = [f"{100.0 * share:.1f}" for share in (one.accelerating, one.gated)]
    name = f"{case.robot}, {_stem(case)}, {one.noise_mm:g}"
    return [name, *off, f"{one.jerk_p95:.0f}", f"{one.jerk_rms:.0f}", *shares, *ratios]


def _stem(case: Case) -> str:
    return Path(case.source.split(",")[0]).stem


if __name__ == "__main__":
    main()
