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
from benchmarks.observed_body import Watched, scene_distances, watched_human, watched_op3
from benchmarks.observed_cases import BASE, Observed, cases, entries, run_observed
from benchmarks.observed_obstacles import around_arms, influence
from benchmarks.ours import Activation, observed
from benchmarks.recording import RECORDING, SHARED
from benchmarks.table import options_of, print_table, show_table, write_json

OP3 = "op3"
COUNTS = (1, 2, 4, 8, 16, 32, 64)
FRAMES = 360
SWAY = 0.1
"""Share of the motion that is kept, so that obstacles stay within influence or beyond it."""
HEADS = ("median", "p99", "ours / side", "pairs", "near", "self", "scene")
ERRORS = ("CoM mean (max)", "ankles mean (max)", "wrists", "head", "shake", "failed")
LEGEND = """\
Times: us of thread CPU per frame of five iterations. closest: the closest observer of each obstacle acts (paper); all:
a damper on every pair within influence. ours / side: our median with all, without an obstacle, over this side's.
pairs: looked at; near: of them within influence, mean over frames. self, scene: smallest clearance, mm, in this side's
postures, by our distances (-: never within influence). Peers look at the same shapes and self pairs (distances are
ours to 1e-5 m, or the run stops), and at no obstacle. Errors as above: mm."""


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


def print_observed(rows: Sequence[Observed]) -> None:
    """One row for each side in each case."""
    cells = []
    for case in dict.fromkeys(_case(row) for row in rows):
        block = [row for row in rows if _case(row) == case]
        base = next(row.outcome.median_us for row in block if row.outcome.side == BASE)
        cells += [[case if row is block[0] else "", *_row(row, base)] for row in block]
    print("\nWith observers")
    print_table(["case", "side", *HEADS, *ERRORS], cells, text=2)
    print(f"\n{LEGEND}")


def print_obstacle_costs(costs: Sequence[ObstacleCost]) -> None:
    """Medians by number of obstacles."""
    rows = [
        [
            f"{cost.body}, {cost.worn}, {cost.activation}",
            *(f"{us:.0f} ({near:.0f})" for us, near in zip(cost.median_us, cost.near, strict=True)),
        ]
        for cost in costs
    ]
    print("\nObstacles around the arms, half of them within influence: us (pairs with them within influence)")
    print_table(["obstacles", *(str(count) for count in costs[0].counts)], rows)


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


def _row(row: Observed, base: float) -> list[str]:
    o = row.outcome
    return [
        o.side,
        f"{o.median_us:.0f}",
        f"{o.p99_us:.0f}",
        "" if o.side == BASE else f"{base / o.median_us:.2f}",
        str(row.pairs),
        f"{row.near:.1f}",
        *("-" if clearance is None else f"{clearance:.1f}" for clearance in (row.self_mm, row.scene_mm)),
        f"{o.com_mm:.2f} ({o.com_max_mm:.2f})",
        f"{o.ankles_mm:.2f} ({o.ankles_max_mm:.2f})",
        f"{o.wrists_mm:.2f}",
        f"{o.head_mm:.2f}",
        f"{o.shake:.2f}",
        str(o.failures),
    ]


def main() -> None:
    """The command."""
    options = options_of("benchmarks.observed", __doc__)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    recorded = RECORDING if RECORDING.is_file() else None
    if recorded is None:
        print(f"without the recording: no {RECORDING.name} under {SHARED}")
    rows: list[Observed] = []
    for watched, motion in cases(options.frames, recorded):
        rows += run_observed(watched, motion, entries(watched, motion), repeats=options.repeats)
    print_observed(rows)
    bodies = (watched_human("lines_and_head"), watched_human("capsules"), watched_op3())
    ways: tuple[Activation, ...] = ("closest", "all")
    frames = min(options.frames, FRAMES)
    costs = [obstacle_cost(one, way, frames=frames, repeats=options.repeats) for one in bodies for way in ways]
    print_obstacle_costs(costs)
    robot = [cost for cost in costs if cost.body == OP3]
    cells = [[f"`activation: {cost.activation}`", *(f"{us:.0f}" for us in cost.median_us)] for cost in robot]
    show_table("obstacles", ["obstacles", *map(str, COUNTS)], cells, docs=options.docs)
    show_observed([row for row in rows if row.outcome.body == OP3], docs=options.docs)
    write_json(options.json, {"observed": rows, "obstacles": costs})


if __name__ == "__main__":
    main()
