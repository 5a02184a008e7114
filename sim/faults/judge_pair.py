"""Judges two faults in one run: the reaction to the first, and after both the stronger of the two, each in time."""

from collections.abc import Sequence
from dataclasses import dataclass

from sim.faults.always import violations
from sim.faults.bench import Bench
from sim.faults.judge import ENGAGING_S, IDLE_S, STOP_BEFORE, Verdict, When
from sim.faults.reached import Need, need_of, outdone, reached, stronger
from sim.faults.reaction import Row
from sim.faults.sender import FakeSender
from sim.faults.trace import Trace

__all__ = ["Struck", "judged_pair", "missing"]

LONGER_S = 0.7
"""Following after the second fault, s, at least."""
CUED_S = 0.05
"""A fault that waits for its cue has it within this, s."""


@dataclass(frozen=True)
class Struck:
    """A row, and when its fault was to be done, s after following began."""

    row: Row
    at: float


def missing(trace: Trace, first: Struck, second: Struck, others: Sequence[Struck] = ()) -> list[str]:
    """Which reaction to two faults did not come in time, in words. The first is judged by itself where its time is over
    before the second; else, as the second by itself, the stronger one counts from the second on. others: beside which
    a fault may not be seen (a stream is silent); where they overlap, the stronger one counts from the later on."""
    one, other = (_onset(trace, struck.at) for struck in (first, second))
    if one is None:
        return []  # it was over before
    needs: list[tuple[Need, float]] = []  # and from when on
    alone = need_of(first.row)
    if other is None or other > one + alone.limit:
        needs.append((alone, one))
    if other is not None:
        both = outdone(first.row, second.row, apart=other - one)
        if not (needs and both is alone):
            needs.append((both, other))
    for beside in others:
        at = _onset(trace, beside.at)
        needs = [need if at is None else _beside(*need, need_of(beside.row), at) for need in needs]
    left = [need for need, since in needs if not reached(trace, need, one, since + need.limit)]
    return [f"{need.name}: not {need.words} in time" for need in left]


def _beside(need: Need, since: float, other: Need, at: float) -> tuple[Need, float]:
    """What is needed, and from when on (s), where another fault comes at another time (s)."""
    if at - need.limit < since < at + other.limit and stronger(need, other) is other:
        return other, max(since, at)
    return need, since


def _onset(trace: Trace, at: float) -> float | None:
    """When a fault was done, s: at the end of a tick, or on its cue."""
    if trace.began is None:
        return None
    done = next((tick.time for tick in trace.ticks if tick.time >= (trace.began or 0.0) + at), None)
    if done is None:
        return None
    return next((cued for cued in trace.acted if done <= cued < done + CUED_S), done)


def judged_pair(
    first: Row, second: Row, *, at: float, gap: float, seed: int, when: When = When.MOVING, longer: float = LONGER_S
) -> Verdict:
    """Two faults, `gap` s apart, the first at `at` s of following: what may never be is judged, that it ends, and of a
    robot that moves that it reacts."""
    idle, moving = when is When.IDLE, when is When.MOVING
    after = max(longer, *(need_of(row).limit + 0.1 for row in (first, second))) if moving else longer
    duration = IDLE_S if idle else ENGAGING_S + at + gap + after
    six = "six" in (first.performer, second.performer)
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer="six" if six else "five")
    if when is When.STOPPING:
        bench.at(at - STOP_BEFORE, lambda: bench.guard.stop("asked for"))
    first.hurt(bench, -1.0 if idle else at)
    second.hurt(bench, -1.0 if idle else at + gap)
    trace = bench.run()
    wrong = violations(bench, trace)
    if moving:
        wrong += missing(trace, Struck(first, at), Struck(second, at + gap))
    return Verdict(f"{first.name} + {second.name}", tuple(wrong), None)
