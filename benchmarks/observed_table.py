"""The observed results as Markdown, with what was asked beside what is."""

from __future__ import annotations

from benchmarks.measure import Outcome
from benchmarks.observed_cases import BASE, Observed
from benchmarks.observed_cost import ASKED_GROWTH, ObstacleCost
from benchmarks.table import print_table

HEADS = ("median", "p99", "asked", "ours / side", "asked", "pairs", "near", "self", "scene")
ERRORS = ("CoM mean (max)", "ankles mean (max)", "wrists", "head", "shake", "failed")
LEGEND = """\
Times: us of thread CPU per frame of five iterations. closest: the closest observer of each obstacle acts (paper); all:
a damper on every pair within influence. ours / side: our median with all, without an obstacle, over this side's.
What is asked and not met has a !. pairs: looked at; near: of them within influence, mean over frames. self, scene:
smallest clearance, mm, in this side's postures, by our distances (-: never within influence). Peers look at the same
shapes and self pairs (distances are ours to 1e-5 m, or the run stops), and at no obstacle. Errors as above: mm."""


def print_observed(rows: list[Observed]) -> None:
    """One row for each side in each case."""
    cells = []
    for case in dict.fromkeys(_case(row) for row in rows):
        block = [row for row in rows if _case(row) == case]
        base = next(row.outcome.median_us for row in block if row.outcome.side == BASE)
        cells += [[case if row is block[0] else "", *_row(row, base)] for row in block]
    print("\nWith observers")
    print_table(["case", "side", *HEADS, *ERRORS], cells, text=2)
    print(f"\n{LEGEND}")


def print_obstacle_costs(costs: list[ObstacleCost]) -> None:
    """Medians by number of obstacles."""
    rows = []
    for cost in costs:
        met = "" if cost.growth <= ASKED_GROWTH else " !"
        times = [f"{us:.0f} ({near:.0f})" for us, near in zip(cost.median_us, cost.near, strict=True)]
        name = f"{cost.body}, {cost.worn}, {cost.activation}"
        rows.append([name, *times, f"{cost.growth:.2f}", f"<= {ASKED_GROWTH:g}{met}"])
    counts = [str(count) for count in costs[0].counts]
    print("\nObstacles around the arms, half of them within influence: us (pairs with them within influence)")
    print_table(["obstacles", *counts, f"{counts[-1]} / {counts[0]}", "asked"], rows)


def _case(row: Observed) -> str:
    return f"{row.outcome.body}, {row.worn}, {row.outcome.motion}"


def _row(row: Observed, base: float) -> list[str]:
    o = row.outcome
    share = base / o.median_us
    return [
        o.side,
        f"{o.median_us:.0f}",
        f"{o.p99_us:.0f}",
        "" if row.asked_us is None else _asked_us(o, *row.asked_us),
        "" if o.side == BASE else f"{share:.2f}",
        "" if row.asked_share is None else _asked(share, row.asked_share),
        str(row.pairs),
        f"{row.near:.1f}",
        _clearance(row.self_mm),
        _clearance(row.scene_mm),
        f"{o.com_mm:.2f} ({o.com_max_mm:.2f})",
        f"{o.ankles_mm:.2f} ({o.ankles_max_mm:.2f})",
        f"{o.wrists_mm:.2f}",
        f"{o.head_mm:.2f}",
        f"{o.shake:.2f}",
        str(o.failures),
    ]


def _asked_us(o: Outcome, median: float, p99: float) -> str:
    return f"{_asked(o.median_us, median)} / {_asked(o.p99_us, p99)}"


def _asked(value: float, limit: float) -> str:
    return f"<= {limit:g}{'' if value <= limit else ' !'}"


def _clearance(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
