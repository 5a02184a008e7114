"""Cases of `retarget faults` that can be sent to another process, and random runs with several faults."""

import random
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

from sim.faults.bounds import BOUNDS
from sim.faults.judge import (
    Struck,
    Verdict,
    When,
    bench_of,
    judged_pair,
    least,
    missing,
    run_row,
    verdict_of,
    violations,
)
from sim.faults.rows import APPROACHED, ROWS

# Random runs: faults of the table one after another, at random times, until one of them ends the run.

LIVE = tuple(row for row in ROWS if not (row.recorded or row.alone))
FEWEST_MILD, MOST_MILD = 2, 5
"""Harmless faults of a random run. It has one of the others, too."""


def judged_seed(seed: int, *, seconds: float = 60.0) -> Verdict:
    """Make and judge a run of `seconds` of following, unless a fault ends it."""
    chance = random.Random(seed)
    mild, harsh = (
        [row for row in LIVE if BOUNDS.reactions[row.reaction.name].harmless is harmless] for harmless in (True, False)
    )
    count = chance.randint(FEWEST_MILD, MOST_MILD)
    drawn = [(chance.uniform(0.1, 0.9 * seconds), chance.choice(mild)) for _ in range(count)]
    milder = [Struck(row, at) for at, row in drawn]
    last = chance.uniform(0.5, 0.98) * seconds
    end = Struck(chance.choice(harsh), last)
    second = Struck(row=chance.choice(LIVE), at=last + chance.choice((0.0, 0.02, 0.2, 0.8)))
    plan = sorted([*milder, end, second], key=lambda one: one.at)
    over = max(least(one.row).limit + one.at - seconds for one in (end, second)) + BOUNDS.more_s
    bench = bench_of(plan, following=seconds + max(over, 0.0), performer="six", seed=seed)
    trace = bench.run()
    names = ", ".join(f"{one.row.name} at {one.at:.1f} s" for one in plan)
    return Verdict(names, tuple(violations(bench, trace) + missing(trace, end, second, milder)))


PAIRED = (When.IDLE, When.MOVING, When.STOPPING)


@dataclass(frozen=True)
class Case:
    """One run. name: of its row, or of the first of two; second: of the other; when: state of the robot. seed: of a
    random run of `seconds`; None: it is none."""

    name: str = ""
    second: str | None = None
    when: When = When.MOVING
    seed: int | None = None
    seconds: float = 0.0


def row_cases() -> list[Case]:
    """Return every row idle, moving and stopping, and those that may come on the approach."""
    return [
        Case(row.name, when=when) for row in ROWS for when in When if when is not When.APPROACHING or row in APPROACHED
    ]


def pair_cases() -> list[Case]:
    """Return every two rows of a live run, one twice included, in the states of `PAIRED`."""
    return [Case(a.name, b.name, when) for a, b in combinations_with_replacement(LIVE, 2) for when in PAIRED]


def seed_cases(seeds: Iterable[int], *, seconds: float) -> list[Case]:
    """Make random runs, from a seed each."""
    return [Case(seed=seed, seconds=seconds) for seed in seeds]


def judged_case(case: Case) -> Verdict:
    """Run and judge it."""
    if case.seed is not None:
        found = judged_seed(case.seed, seconds=case.seconds)
        return replace(found, name=f"seed {case.seed}: {found.name}")
    rows = {one.name: one for one in ROWS}
    row, other = rows[case.name], rows.get(case.second or "")
    if other is None:
        found = verdict_of(row, run_row(row, when=case.when), when=case.when)
    else:
        found = judged_pair(row, other, at=BOUNDS.pair_at_s, gap=BOUNDS.pair_gap_s, when=case.when)
    return replace(found, name=f"{found.name}, {case.when.value}")
