"""Holds a run against its row: the reaction in time, and what may never be, whatever happens."""

from collections import Counter
from dataclasses import dataclass, replace
from enum import Enum

from hardware.guard_state import GuardState
from sim.faults.always import violations
from sim.faults.bench import Bench
from sim.faults.judge_idle import idle_wrong
from sim.faults.reaction import Reaction, Row
from sim.faults.reactions import HELD_S, Seen, late, reacted
from sim.faults.sender import FakeSender
from sim.faults.trace import Trace

__all__ = ["ENGAGING_S", "IDLE_S", "ONSET", "STOP_BEFORE", "Verdict", "When", "hurt_run", "judged", "verdict_of"]

ONSET = 0.4
"""s of following before the fault."""
STOP_BEFORE = 0.05
"""So long before the fault a robot that is to be stopping was told to, s."""
OUTLIVED = (Reaction.NONE, Reaction.MAY_HOLD, Reaction.OUT, Reaction.HOLD, Reaction.RESUME, Reaction.REBASE)
IDLE_S = 0.3
"""Ticks of a run that was hurt before it began, s: nobody is followed in it yet."""
SETTLED_S = 0.5
"""A robot that approaches is looked at for so long after its reaction, s."""
ENGAGING_S = 0.6
"""So long after the beginning of a run the performer is followed, at most."""


@dataclass(frozen=True)
class Verdict:
    """wrong: what was not as it has to be, a line each. took: s from the onset to the reaction, None without one."""

    row: str
    wrong: tuple[str, ...]
    took: float | None


class When(Enum):
    """What the robot does when the fault begins. approaching: it is on its way to where it follows from."""

    IDLE = "idle"
    APPROACHING = "approaching"
    MOVING = "moving"
    STOPPING = "stopping"


def judged(row: Row, *, when: When = When.MOVING, seed: int = 0) -> Verdict:
    """Run a row and judge it."""
    return verdict_of(row, hurt_run(row, when=when, seed=seed), when=when)


def hurt_run(row: Row, *, when: When = When.MOVING, seed: int = 0) -> Bench:
    """Run a row. What is outlived is not seen to the end of the run: a row that hurts while stopping is."""
    followed = {When.IDLE: IDLE_S, When.MOVING: ENGAGING_S + ONSET + row.after, When.STOPPING: ENGAGING_S + ONSET}
    duration = followed.get(when, ENGAGING_S)
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer=row.performer)
    if when is When.STOPPING:
        bench.at(ONSET - STOP_BEFORE, lambda: bench.guard.stop("asked for"))
    bench.leaves = row.reaction in OUTLIVED and when is not When.STOPPING
    if when is When.APPROACHING:
        bench.approaching = True
        if row.reaction in OUTLIVED:
            bench.at(ONSET + row.limit + SETTLED_S, bench.leave)
    row.hurt(bench, -1.0 if when is When.IDLE else ONSET)
    bench.run()
    return bench


def verdict_of(row: Row, bench: Bench, *, when: When = When.MOVING) -> Verdict:
    """Judge a run."""
    trace = bench.trace
    took, wrong = None, list[str]()
    if when is When.MOVING:
        took, wrong = _moving(row, bench, trace)
    elif when is When.APPROACHING:
        took, wrong = _approaching(row, bench, trace)
    elif when is When.STOPPING:
        wrong = _stopping(row, trace)
    else:
        wrong = idle_wrong(row, trace)
    return Verdict(row.name, tuple(wrong + violations(bench, trace)), took)


def _onset(trace: Trace, since: float | None) -> float | None:
    """When the fault was done, after the first tick that ended late enough; or first took effect."""
    if trace.acted:
        return trace.acted[0]
    return next((tick.time for tick in trace.ticks if since is not None and tick.time >= since + ONSET), None)


def _moving(row: Row, bench: Bench, trace: Trace) -> tuple[float | None, list[str]]:
    onset = _onset(trace, trace.began)
    if onset is None:
        return None, [f"nobody was followed: {trace.error or trace.said[-1:]}"]
    took, wrong = reacted(row, Seen(bench, trace, onset))
    if row.said and not any(row.said in text for text in (*trace.said, trace.stop.reason if trace.stop else "")):
        wrong.append(f"nobody was told of {row.said!r}")
    if row.counted and not not_used(bench)[row.counted]:
        wrong.append(f"nothing was counted as {row.counted!r}")
    if trace.error:
        wrong.append(f"it was raised: {trace.error}")
    return took, wrong


def not_used(bench: Bench) -> Counter[str]:
    """What came and was not used, by reason."""
    stream = bench.stream
    parts = (stream.admission.refused, stream.decoder.dropped, stream.clock_map.dropped, stream.playout.dropped)
    return sum((part.reasons for part in (*parts, stream.trust.refused)), Counter[str]())


def _approaching(row: Row, bench: Bench, trace: Trace) -> tuple[float | None, list[str]]:
    """As while it moves; but nobody is followed yet, so nobody can be left out, or followed again."""
    onset = _onset(trace, trace.armed)
    if onset is None or (trace.arrived is not None and trace.arrived <= onset):
        return None, [f"nothing was approached: {trace.error or trace.said[-1:]}"]
    if row.reaction is Reaction.OUT:
        row = replace(row, reaction=Reaction.MAY_HOLD)
    elif row.reaction is Reaction.RESUME:
        row = replace(row, reaction=Reaction.HOLD, limit=HELD_S)
    return reacted(row, Seen(bench, trace, onset))


def _stopping(row: Row, trace: Trace) -> list[str]:
    """A stop goes on to its end, whatever comes on the way; where the bus is lost, torque goes at once."""
    onset = _onset(trace, trace.began)
    if trace.latched is None or onset is None:
        return ["the stop was not latched"]
    if row.reaction is Reaction.GONE:
        return Seen.let_go(trace, onset, row)
    if trace.first(GuardState.STOPPED, trace.latched) is None:
        return ["the stop did not come to its end"]
    if row.reaction is Reaction.CUT:
        return late("torque off", Seen.cut(trace, onset), onset, row.limit) + Seen.let_go(trace, onset, row)
    return []
