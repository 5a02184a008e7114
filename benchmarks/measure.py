"""Interleaved timing of several sides, what each of them reached, and a table of it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import RATE, Motion
from benchmarks.side import MakeSide, Side
from benchmarks.table import show_table

WARM_UP = 20  # frames whose times are not counted; their errors are
OURS = "retarget"
"""Name of our side."""
TIMES = ("median_us", "p99_us", "max_us")


@dataclass(frozen=True)
class Outcome:
    """One side on one motion. Times in us of thread CPU per frame; errors in mm; speed as a share of the limit.

    shake: change of a joint's speed from frame to frame that one frame in a hundred exceeds, same unit: 2 is from full
    speed to full speed backwards.
    """

    body: str
    motion: str
    side: str
    median_us: float
    p99_us: float
    max_us: float
    com_mm: float
    com_max_mm: float
    ankles_mm: float
    ankles_max_mm: float
    wrists_mm: float
    head_mm: float
    speed: float
    shake: float
    beyond_limits_rad: float
    failures: int


def run(body: BenchBody, motion: Motion, sides: Sequence[MakeSide], *, repeats: int = 1) -> list[Outcome]:
    """Every side solves frame by frame, turn by turn, in this process; times are medians over the repeats."""
    runs = [run_once(body, motion, sides) for _ in range(repeats)]
    return [
        replace(same[0], **{field: float(np.median([getattr(one, field) for one in same])) for field in TIMES})
        for same in zip(*runs, strict=True)
    ]


def run_once(body: BenchBody, motion: Motion, sides: Sequence[MakeSide]) -> list[Outcome]:
    """Once, every side from the start."""
    running, spent, postures = play(body, motion, sides)
    return [outcome(body, motion, side, spent[:, s], postures[s]) for s, side in enumerate(running)]


def play(body: BenchBody, motion: Motion, sides: Sequence[MakeSide]) -> tuple[list[Side], Floats, Floats]:
    """The sides after the motion, their thread CPU (T, sides) ns, and their postures (sides, T, nq)."""
    running = [make(body, motion) for make in sides]
    spent = np.zeros((motion.frames, len(sides)))
    postures = np.zeros((len(sides), motion.frames, body.model.nq))
    for k in range(motion.frames):
        for s, side in enumerate(running):
            side.aim(motion.com[k], motion.points[k])
            before = time.thread_time_ns()
            side.solve()
            spent[k, s] = time.thread_time_ns() - before
            postures[s, k] = side.posture()
    return running, spent, postures


def outcome(body: BenchBody, motion: Motion, side: Side, spent_ns: Floats, postures: Floats) -> Outcome:
    """Errors and limits of one side's postures (T, nq), by one and the same kinematics for all."""
    solver_body = body.model.solver_body()
    leak = (solver_body.centre_of_mass(postures) - motion.com) * (np.array(motion.com_rows) > 0.0)
    error = np.linalg.norm(solver_body.points(postures, body.links(), body.offsets()) - motion.points, axis=2) * 1e3
    com = np.linalg.norm(leak, axis=1) * 1e3
    columns = {part: [i for i, p in enumerate(body.points) if part in p.name] for part in ("ankle", "wrist", "head")}
    ankles, wrists, head = (error[:, columns[part]] for part in ("ankle", "wrist", "head"))
    us = spent_ns[WARM_UP:] / 1e3
    speed, shake, beyond = limits(body, postures)
    return Outcome(
        body=body.name,
        motion=motion.name,
        side=side.name,
        median_us=float(np.median(us)),
        p99_us=float(np.percentile(us, 99.0)),
        max_us=float(us.max()),
        com_mm=float(com.mean()),
        com_max_mm=float(com.max()),
        ankles_mm=float(ankles.mean()),
        ankles_max_mm=float(ankles.max()),
        wrists_mm=float(wrists.mean()),
        head_mm=float(head.mean()),
        speed=speed,
        shake=shake,
        beyond_limits_rad=beyond,
        failures=side.failures,
    )


def limits(body: BenchBody, postures: Floats) -> tuple[float, float, float]:
    """Highest joint speed as a share of the limit, shake (see `Outcome`), and rad that a joint was beyond its range."""
    model = body.model
    joints, lower, upper = postures[:, 7:], model.lower[6:], model.upper[6:]
    speed = np.diff(joints, axis=0) * RATE / body.max_speed
    change = np.abs(np.diff(speed, axis=0)).max(axis=1)
    beyond = np.maximum(lower - joints, joints - upper)[:, ~body.locked[6:]]
    return float(np.abs(speed).max()), float(np.percentile(change, 99.0)), float(max(beyond.max(), 0.0))


def show_sides(name: str, outcomes: Sequence[Outcome], *, docs: bool) -> None:
    """A table of the documentation: a column for each side, median us, and in brackets the error of the ankles, mm."""
    sides = list(dict.fromkeys(o.side for o in outcomes))
    cells = {(o.body, o.motion, o.side): f"{o.median_us:.0f} ({_mm(o.ankles_mm)})" for o in outcomes}
    cases = dict.fromkeys((o.body, o.motion) for o in outcomes)
    rows = [[f"{body}, {motion}", *(cells[body, motion, side] for side in sides)] for body, motion in cases]
    show_table(name, ["case", *sides], rows, docs=docs)


def _mm(value: float) -> str:
    """Three digits or so."""
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"
