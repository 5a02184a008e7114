"""Holds a run against its row: the reaction in time, and what may never be, whatever happens."""

from dataclasses import dataclass
from enum import Enum

from hardware.guard_state import GuardState
from sim.faults.always import violations
from sim.faults.bench import Bench
from sim.faults.judge_idle import idle_wrong
from sim.faults.reaction import Reaction, Row
from sim.faults.reactions import Seen, late, reacted
from sim.faults.sender import FakeSender
from sim.faults.stream_rows import STREAM_ROWS
from sim.faults.trace import Trace

__all__ = ["ONSET", "Verdict", "When", "hurt_run", "judged", "judged_pair", "verdict_of"]

ONSET = 0.4
"""s of following before the fault."""
STOP_BEFORE = 0.05
"""So long before the fault a robot that is to be stopping was told to, s."""
OUTLIVED = (Reaction.NONE, Reaction.MAY_HOLD, Reaction.OUT, Reaction.HOLD, Reaction.RESUME, Reaction.REBASE)
IDLE_S = 0.3
"""Ticks of a run that was hurt before it began, s: nobody is followed in it yet."""
ENGAGING_S = 0.6
"""So long after the beginning of a run the performer is followed, at most."""


@dataclass(frozen=True)
class Verdict:
    """wrong: what was not as it has to be, a line each. took: s from the onset to the reaction, None without one."""

    row: str
    wrong: tuple[str, ...]
    took: float | None


class When(Enum):
    """What the robot does when the fault begins."""

    IDLE = "idle"
    MOVING = "moving"
    STOPPING = "stopping"


def judged(row: Row, *, when: When = When.MOVING, seed: int = 0) -> Verdict:
    """Run a row and judge it."""
    return verdict_of(row, hurt_run(row, when=when, seed=seed), when=when)


def hurt_run(row: Row, *, when: When = When.MOVING, seed: int = 0) -> Bench:
    """Run a row. Where a sender's fault is outlived, the end of the run is not waited for: it is that of any other."""
    duration = {When.IDLE: IDLE_S, When.MOVING: ENGAGING_S + ONSET + row.after, When.STOPPING: ENGAGING_S + ONSET}[when]
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer=row.performer)
    if when is When.STOPPING:
        bench.at(ONSET - STOP_BEFORE, lambda: bench.guard.stop("asked for"))
    bench.leaves = row.reaction in OUTLIVED and row in STREAM_ROWS and when is not When.STOPPING
    row.hurt(bench, -1.0 if when is When.IDLE else ONSET)
    bench.run()
    return bench


def verdict_of(row: Row, bench: Bench, *, when: When = When.MOVING) -> Verdict:
    """Judge a run."""
    trace = bench.trace
    took, wrong = None, list[str]()
    if when is When.MOVING:
        took, wrong = _moving(row, bench, trace)
    elif when is When.STOPPING:
        wrong = _stopping(row, trace)
    else:
        wrong = idle_wrong(row, trace)
    return Verdict(row.name, tuple(wrong + violations(bench, trace)), took)


def _onset(trace: Trace) -> float | None:
    """When the fault was done, after the first tick that ended late enough; or first took effect."""
    if trace.acted is not None:
        return trace.acted
    return next((tick.time for tick in trace.ticks if trace.began and tick.time >= trace.began + ONSET), None)


def _moving(row: Row, bench: Bench, trace: Trace) -> tuple[float | None, list[str]]:
    onset = _onset(trace)
    if onset is None:
        return None, [f"nobody was followed: {trace.error or trace.said[-1:]}"]
    took, wrong = reacted(row, Seen(bench, trace, onset))
    if row.said and not any(row.said in text for text in (*trace.said, trace.stop.reason if trace.stop else "")):
        wrong.append(f"nobody was told of {row.said!r}")
    if trace.error:
        wrong.append(f"it was raised: {trace.error}")
    return took, wrong


def _stopping(row: Row, trace: Trace) -> list[str]:
    """A stop goes on to its end, whatever comes on the way; where the bus is lost, torque goes at once."""
    onset = _onset(trace)
    if trace.latched is None or onset is None:
        return ["the stop was not latched"]
    if row.reaction is Reaction.GONE:
        return Seen.let_go(trace, onset, row)
    if trace.first(GuardState.STOPPED, trace.latched) is None:
        return ["the stop did not come to its end"]
    if row.reaction is Reaction.CUT:
        return late("torque off", Seen.cut(trace, onset), onset, row.limit) + Seen.let_go(trace, onset, row)
    return []


def judged_pair(
    first: Row, second: Row, *, at: float, gap: float, seed: int, when: When = When.MOVING, longer: float = 0.7
) -> Verdict:
    """Two faults, `gap` s apart, the first at `at` s of following: what may never be is judged, and that it ends."""
    idle = when is When.IDLE
    duration = IDLE_S if idle else ENGAGING_S + at + gap + longer
    six = "six" in (first.performer, second.performer)
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer="six" if six else "five")
    if when is When.STOPPING:
        bench.at(at - STOP_BEFORE, lambda: bench.guard.stop("asked for"))
    first.hurt(bench, -1.0 if idle else at)
    second.hurt(bench, -1.0 if idle else at + gap)
    trace = bench.run()
    return Verdict(f"{first.name} + {second.name}", tuple(violations(bench, trace)), None)
