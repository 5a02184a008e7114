"""The results as text."""

from __future__ import annotations

from benchmarks.cost import Cost, slope
from benchmarks.measure import Outcome

HEAD = (
    f"{'side':<16}{'median':>9}{'p99':>9}{'max':>9}{'ratio':>8} |{'CoM':>8}{'max':>8}{'ankles':>8}{'max':>8}"
    f"{'wrists':>9}{'head':>8} |{'speed':>7}{'shake':>7}{'beyond':>8}{'failed':>7}"
)
LEGEND = """\
Times: us of thread CPU per frame of five iterations, targets set beforehand. ratio: our median over this side's.
Errors: mean (max) mm against the targets. speed: highest joint speed over its limit.
shake: change of a joint's speed between frames, p99, over the limit (2: full speed to full speed backwards).
beyond: rad outside joint limits. failed: solves that gave no answer (the posture stays)."""


def print_outcomes(outcomes: list[Outcome], *, ours: str) -> None:
    """One block for each body and motion."""
    for body, motion in dict.fromkeys((o.body, o.motion) for o in outcomes):
        block = [o for o in outcomes if (o.body, o.motion) == (body, motion)]
        base = next(o.median_us for o in block if o.side == ours)
        print(f"\n{body}, {motion}\n{HEAD}")
        for o in block:
            print(
                f"{o.side:<16}{o.median_us:>9.1f}{o.p99_us:>9.1f}{o.max_us:>9.1f}{base / o.median_us:>8.2f} |"
                f"{o.com_mm:>8.3f}{o.com_max_mm:>8.2f}{o.ankles_mm:>8.3f}{o.ankles_max_mm:>8.2f}"
                f"{o.wrists_mm:>9.2f}{o.head_mm:>8.2f} |{o.speed:>7.2f}{o.shake:>7.2f}"
                f"{o.beyond_limits_rad:>8.1e}{o.failures:>7}"
            )
    print(f"\n{LEGEND}")


def print_costs(sensors: list[Cost], freedoms: list[Cost]) -> None:
    """Two small tables and their slopes."""
    print(f"\nhuman, more sensors: {slope(sensors, 'sensors'):.1f} us per sensor and frame")
    print("  " + "  ".join(f"{cost.sensors}: {cost.median_us:.0f} us" for cost in sensors))
    human = [cost for cost in freedoms if cost.body == "human"]
    print(f"five sensors, more DoF: {slope(human, 'degrees_of_freedom'):.2f} us per DoF and frame on the human")
    print("  " + "  ".join(f"{cost.body} {cost.degrees_of_freedom}: {cost.median_us:.0f} us" for cost in freedoms))
