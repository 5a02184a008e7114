"""Random runs: faults of the table one after another, at random times, until one of them ends the run."""

import random

from sim.faults.always import violations
from sim.faults.bench import Bench
from sim.faults.judge import ENGAGING_S, Verdict
from sim.faults.judge_pair import Struck, missing
from sim.faults.reached import HIDDEN, need_of
from sim.faults.reaction import Reaction
from sim.faults.rows import ROWS
from sim.faults.sender import FakeSender

__all__ = ["judged_seed"]

HARMLESS = (Reaction.NONE, Reaction.MAY_HOLD, Reaction.REBASE, Reaction.RESUME, Reaction.OUT, Reaction.SLOW)
"""What a run outlives: of these there may be several, of the others there is one, which may come at any time."""
FEWEST, MOST = 2, 5
MORE_S = 0.1
"""The run goes on for so long after the last reaction is due, s."""


def judged_seed(seed: int, *, seconds: float = 60.0) -> Verdict:
    """A run of so many virtual seconds of following, unless a fault ends it.

    What may never be is judged, and the reaction to the harsh fault.
    """
    chance = random.Random(seed)
    mild, harsh = ([row for row in ROWS if (row.reaction in HARMLESS) is harmless] for harmless in (True, False))
    count = chance.randint(FEWEST, MOST)
    drawn = [(chance.uniform(0.1, 0.9 * seconds), chance.choice(mild)) for _ in range(count)]
    milder = [Struck(row, at) for at, row in drawn]
    last = chance.uniform(0.5, 0.98) * seconds
    end = Struck(chance.choice(harsh), last)
    beside = Struck(row=chance.choice(ROWS), at=last + chance.choice((0.0, 0.02, 0.2, 0.8)))
    plan = sorted([*milder, end, beside], key=lambda one: one.at)
    after = max(need_of(one.row).limit + one.at - seconds for one in (end, beside)) + MORE_S
    duration = ENGAGING_S + seconds + max(after, 0.0)
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer="six")
    for one in plan:
        one.row.hurt(bench, one.at)
    trace = bench.run()
    names = ", ".join(f"{one.row.name} at {one.at:.1f} s" for one in plan)
    wrong = violations(bench, trace)
    if not any((one.row.name, end.row.name) in HIDDEN for one in plan):
        wrong += missing(trace, end, beside, milder)
    return Verdict(names, tuple(wrong), None)
