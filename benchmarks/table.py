"""The results as Markdown, as docs/benchmarks.md draws on it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmarks.cost import Cost, slope
from benchmarks.measure import Outcome
from benchmarks.real_frame import FrameCost

LEGEND = """\
Times: us of thread CPU per frame of five iterations, targets set beforehand. ours / side: our median over this side's.
Errors: mean (max) mm against the targets, every frame from the first. speed: highest joint speed over its limit.
shake: change of a joint's speed between frames, p99, over the limit (2: full speed to full speed backwards).
beyond: rad outside joint limits. failed: solves that gave no answer (the posture stays)."""


def print_outcomes(outcomes: list[Outcome], *, ours: str) -> None:
    """One row for each side in each case."""
    rows = []
    for body, motion in dict.fromkeys((o.body, o.motion) for o in outcomes):
        block = [o for o in outcomes if (o.body, o.motion) == (body, motion)]
        base = next(o.median_us for o in block if o.side == ours)
        rows += [[f"{body}, {motion}" if o is block[0] else "", *_row(o, base, ours)] for o in block]
    errors = ["CoM mean (max)", "ankles mean (max)", "wrists", "head"]
    print_table(
        ["case", "side", "median", "p99", "ours / side", *errors, "speed", "shake", "beyond", "failed"], rows, text=2
    )
    print(f"\n{LEGEND}")


def print_real_frame(costs: list[FrameCost]) -> None:
    """What a tick of `retarget run` computes, and how much of that is in the solver."""
    rows = [
        [c.stage, f"{c.median_us:.0f}", f"{c.p99_us:.0f}", f"{c.solver_median_us:.0f}", f"{c.solver_p99_us:.0f}"]
        for c in costs
    ]
    print("\nBoth stages as `retarget run` has them, Python included: us of thread CPU per tick")
    print_table(["stage", "median", "p99", "solver alone: median", "p99"], rows)


def print_costs(sensors: list[Cost], freedoms: list[Cost]) -> None:
    """Two small tables and their slopes."""
    print(f"\nHuman, more sensors: {slope(sensors, 'sensors'):.1f} us per sensor and frame")
    print_table(["sensors", *(str(cost.sensors) for cost in sensors)], [_medians(sensors)])
    human = [cost for cost in freedoms if cost.body == "human"]
    print(f"\nFive sensors, more DoF: {slope(human, 'degrees_of_freedom'):.2f} us per DoF and frame on the human")
    print_table(["DoF", *(f"{cost.body} {cost.degrees_of_freedom}" for cost in freedoms)], [_medians(freedoms)])


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, text: int = 1) -> None:
    """A Markdown table; the first `text` columns are words, the others numbers."""
    print(f"\n| {' | '.join(heads)} |")
    print("|" + "---|" * text + "---:|" * (len(heads) - text))
    for row in rows:
        print(f"| {' | '.join(row)} |")


def _row(o: Outcome, base: float, ours: str) -> list[str]:
    return [
        o.side,
        f"{o.median_us:.0f}",
        f"{o.p99_us:.0f}",
        "" if o.side == ours else f"{base / o.median_us:.2f}",
        f"{_mm(o.com_mm)} ({_mm(o.com_max_mm)})",
        f"{_mm(o.ankles_mm)} ({_mm(o.ankles_max_mm)})",
        _mm(o.wrists_mm),
        _mm(o.head_mm),
        f"{o.speed:.2f}",
        f"{o.shake:.2f}",
        f"{o.beyond_limits_rad:.0e}" if o.beyond_limits_rad > 0.0 else "0",
        str(o.failures),
    ]


def _medians(costs: list[Cost]) -> list[str]:
    return ["us", *(f"{cost.median_us:.0f}" for cost in costs)]


def _mm(value: float) -> str:
    """Three digits or so."""
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"
