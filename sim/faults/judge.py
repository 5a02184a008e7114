"""Holds a run against its row: the reaction in time, and what may never be, whatever happens."""

from dataclasses import dataclass
from enum import Enum

from hardware.guard_state import GuardState
from sim.faults.bench import Bench, Trace
from sim.faults.rows import Reaction, Row
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import goal_writes, violations

ONSET = 0.8
"""s of following before the fault."""
AFTER = 1.2
"""s of following after it."""
REST_S = 0.35
"""From the beginning of a hold until goals stand still."""
OFF_S = 4.0
"""From the beginning of a stop until torque is off."""


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
    longer = 6.0 if row.limit > AFTER and when is When.MOVING else AFTER
    duration = 0.3 if when is When.IDLE else ONSET + longer + 0.3
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed)
    if when is When.STOPPING:
        bench.at(ONSET - 0.05, lambda: bench.guard.stop("asked for"))
    row.hurt(bench, -1.0 if when is When.IDLE else ONSET)
    trace = bench.run()
    took, wrong = None, list[str]()
    if when is When.MOVING:
        took, wrong = _moving(row, trace)
    elif when is When.STOPPING:
        wrong = _stopping(trace)
    wrong += _never(bench, trace, idle=when is When.IDLE)
    return Verdict(row.name, tuple(wrong), took)


def _moving(row: Row, trace: Trace) -> tuple[float | None, list[str]]:
    if trace.began is None:
        return None, [f"nobody was followed: {trace.error or trace.said[-1:]}"]
    took, wrong = _reaction(row, trace, trace.began + ONSET)
    if row.said and not any(row.said in text for text in trace.said):
        wrong.append(f"nobody was told of {row.said!r}")
    if trace.error:
        wrong.append(f"it was raised: {trace.error}")
    return took, wrong


def _stopping(trace: Trace) -> list[str]:
    """A stop goes on to its end, whatever comes on the way."""
    begun = trace.first(GuardState.STOPPING, 0.0)
    latched = None if begun is None else trace.first(GuardState.STOPPED, begun)
    if begun is None or latched is None:
        return ["the stop did not end in a latch"]
    return [f"the stop took {latched - begun:.1f} s"] if latched - begun > OFF_S else []


def _never(bench: Bench, trace: Trace, *, idle: bool) -> list[str]:
    """What may never be: goals beyond a limit or after a latch, torque that nobody knows of."""
    if not hasattr(bench, "robot"):
        return []
    latched = None if idle else trace.first(GuardState.STOPPED, trace.began or 0.0)
    servos, dt = bench.robot.joint_map.servos, 1.0 / bench.robot.profile.safety.rate_hz
    wrong = violations(trace.sent, servos, dt, latched=latched)
    told = trace.error or (trace.stop is not None and trace.stop.powered)
    if any(trace.torque) and not told:
        wrong.append("torque is on in the end, and nobody was told")
    return wrong


def _reaction(row: Row, trace: Trace, onset: float) -> tuple[float | None, list[str]]:
    """How long the reaction took, and what is wrong with it."""
    hold, stop = trace.first(GuardState.HOLDING, onset), _stopped(trace, onset)
    match row.reaction:
        case Reaction.NONE:
            seen = [one for one in (hold, stop) if one is not None]
            return None, [f"it reacted after {min(seen) - onset:.3f} s"] if (
                seen and trace.stop is not None
            ) or hold else []
        case Reaction.OUT:
            out = next((time for time, gone in trace.out if time >= onset and row.sensor in gone), None)
            wrong = _late("left out", out, onset, row.limit)
            return _took(out, onset), wrong + (["the robot held"] if hold is not None else [])
        case Reaction.HOLD:
            return _took(hold, onset), _late("held", hold, onset, row.limit) + _rests(trace, hold)
        case Reaction.RESUME:
            back = None if hold is None else trace.first(GuardState.MOVING, hold)
            late = hold is not None and (back is None or back - onset > row.limit + 0.6)
            return _took(back, onset), ["it did not go on"] if late else []
        case Reaction.STOP | Reaction.CUT:
            wrong = _late("stopped", stop, onset, row.limit)
            latched = trace.first(GuardState.STOPPED, onset)
            if latched is None or trace.stop is None:
                wrong.append("it was not latched")
            elif stop is not None and latched - stop > OFF_S:
                wrong.append(f"it took {latched - stop:.1f} s until the latch")
            return _took(stop, onset), wrong


def _stopped(trace: Trace, since: float) -> float | None:
    seen = [trace.first(state, since) for state in (GuardState.STOPPING, GuardState.STOPPED)]
    return min((time for time in seen if time is not None), default=None)


def _took(time: float | None, onset: float) -> float | None:
    return None if time is None else time - onset


def _late(what: str, time: float | None, onset: float, limit: float) -> list[str]:
    if time is None:
        return [f"not {what}"]
    return [f"{what} after {time - onset:.3f} s, allowed {limit:g} s"] if time - onset > limit else []


def _rests(trace: Trace, hold: float | None) -> list[str]:
    """Whether goals stand still in time after a hold began, until it ends."""
    if hold is None:
        return []
    end = min((time for time, state in trace.states if time > hold and state is not GuardState.HOLDING), default=1e9)
    late = [goals for time, goals in goal_writes(trace.sent) if hold + REST_S <= time < end - 0.02]
    return ["goals still move in a hold"] if any(one != late[0] for one in late) else []


def judged_pair(first: Row, second: Row, *, at: float, gap: float, seed: int) -> Verdict:
    """Two faults, `gap` s apart, the first at `at` s of following: what may never be is judged, and that it ends."""
    bench = Bench(FakeSender(seed=seed + 3), duration=at + gap + AFTER, seed=seed)
    first.hurt(bench, at)
    second.hurt(bench, at + gap)
    trace = bench.run()
    return Verdict(f"{first.name} + {second.name}", tuple(_never(bench, trace, idle=trace.began is None)), None)
