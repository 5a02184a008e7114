"""`python -m benchmarks.observed`: our frame with collision observers beside PlaCo and mink on the same pairs, and what
obstacles cost: 1, 2, 4, ... 64 of them around the arms, half of them within influence.

`--json FILE` keeps the numbers.
"""

from __future__ import annotations

import os

# One thread for every library, before any of them is loaded.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.measure import OURS, WARM_UP, play
from benchmarks.motion import crouch_and_reach
from benchmarks.observed_body import Watched, scene_distances, watched_op3
from benchmarks.observed_cases import BASE, Observed, cases, entries, run_observed
from benchmarks.observed_obstacles import around_arms, influence
from benchmarks.ours import Activation, observed
from benchmarks.recording import RECORDING, SHARED
from benchmarks.table import options_of, show_table, write_json

COUNTS = (1, 2, 4, 8, 16, 32, 64)
FRAMES = 360
SWAY = 0.1
"""Share of the motion that is kept, so that obstacles stay within influence or beyond it."""


@dataclass(frozen=True)
class ObstacleCost:
    """Median thread CPU of a frame, us, for each of COUNTS; near: pairs within influence, mean over frames."""

    body: str
    worn: str
    activation: Activation
    counts: tuple[int, ...]
    median_us: tuple[float, ...]
    near: tuple[float, ...]


def obstacle_cost(
    watched: Watched, activation: Activation, *, frames: int, repeats: int, counts: tuple[int, ...] = COUNTS
) -> ObstacleCost:
    """The counts take turns frame by frame."""
    calm = replace(watched.body, swing={name: SWAY * angle for name, angle in watched.body.swing.items()})
    motion = crouch_and_reach(calm, frames)
    free = play(calm, motion, [observed("free", watched, None)])[2][0]
    around = around_arms(watched, free, max(counts))
    sides = [observed(f"{count}", watched, activation, around.leading(count)) for count in counts]
    medians = []
    for _ in range(repeats):
        _, spent, postures = play(calm, motion, sides)
        medians.append(np.median(spent[WARM_UP:], axis=0) / 1e3)
    zone = np.maximum(watched.observers.influence, influence(watched))[:, None]
    near = [
        float((scene_distances(watched, q, around.leading(count)) <= zone).sum(axis=(1, 2)).mean())
        for count, q in zip(counts, postures, strict=True)
    ]
    us = np.median(medians, axis=0)
    return ObstacleCost(calm.name, watched.worn, activation, counts, tuple(us.tolist()), tuple(near))


def show_observed(rows: Sequence[Observed], *, docs: bool) -> None:
    """The table of the documentation: median us of our side with a damper on every pair, and of the peers."""
    cells = []
    for case in dict.fromkeys(_case(row) for row in rows):
        sides = {row.outcome.side: row for row in rows if _case(row) == case}
        shown = {side: row for side, row in sides.items() if side == BASE or not side.startswith(OURS)}
        cells.append([case, str(sides[BASE].pairs), *(f"{row.outcome.median_us:.0f}" for row in shown.values())])
    show_table("observed", ["case", "pairs", *shown], cells, docs=docs)


def _case(row: Observed) -> str:
    return f"{row.outcome.body}, {row.worn}, {row.outcome.motion}"


def main() -> None:
    """The command."""
    options = options_of("benchmarks.observed", __doc__)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    recorded = RECORDING if RECORDING.is_file() else None
    if recorded is None:
        print(f"without the recording: no {RECORDING.name} under {SHARED}")
    rows: list[Observed] = []
    for watched, motion in cases(options.frames, recorded):
        rows += run_observed(watched, motion, entries(watched), repeats=options.repeats)
    show_observed(rows, docs=options.docs)
    ways: tuple[Activation, ...] = ("all", "closest")
    frames = min(options.frames, FRAMES)
    costs = [obstacle_cost(watched_op3(), way, frames=frames, repeats=options.repeats) for way in ways]
    cells = [[f"`activation: {cost.activation}`", *(f"{us:.0f}" for us in cost.median_us)] for cost in costs]
    show_table("obstacles", ["obstacles", *map(str, COUNTS)], cells, docs=options.docs)
    write_json(options.json, {"observed": rows, "obstacles": costs})


if __name__ == "__main__":
    main()
