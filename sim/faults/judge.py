"""Judges runs: malformed files, a row alone in each state of the robot, two faults together; each reaction in time."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.errors import RetargetError, TorqueError
from hardware.guard_state import StopCause
from retarget.human.samples import Performance
from retarget.model.robot import RobotBody
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare_for
from retarget.schema.catalogue import Kind, find
from retarget.schema.performer import Performer
from sim.faults.bench import HOLDING, ROBOT, STOPPED, Bench, Trace
from sim.faults.malformed_files import Malformed
from sim.faults.reactions import HALF, Idle, Reaction, Row, Seen, late, let_go, reacted, said, violations
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import not_reads, packets

# Malformed robot files: a run must refuse them before it opens the performer's source or makes a bus.

BEGUN = "the run went on"


class _BegunError(Exception):
    """The run asked for the performer or the bus."""


def judged_file(file: Malformed) -> tuple[str, ...]:
    """Return the violations, a line each."""

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        raise _BegunError

    def bus(robot: RobotBody, clock: Clock) -> ServoBus:
        raise _BegunError

    with tempfile.TemporaryDirectory() as folder:
        path = file.write(find(Kind.ROBOT, ROBOT), Path(folder))
        try:
            with prepare_for(
                perform, RunOptions(robot=str(path)), clock=VirtualClock(), make_bus=bus, goes_to_rest=True
            ):
                return (BEGUN,)
        except _BegunError:
            return (BEGUN,)
        except TorqueError as error:
            return (f"not refused as a file: {error}",)
        except RetargetError as error:  # exit code 2, see `retarget.cli.exit`
            return () if file.reason in str(error) else (f"the refusal does not name {file.reason!r}: {error}",)
        except Exception as error:  # noqa: BLE001 - a traceback is what must not be
            return (f"it was not foreseen: {type(error).__name__}: {error}",)


# Faults before the bus is opened.

CONTROLLERS = frozenset((200,))
"""Ids of devices that are no servos: the OpenCR, whose power switch is written."""


def idle_wrong(row: Row, trace: Trace) -> list[str]:
    """Return how a run differs from the row, a line each."""
    match row.idle:
        case Idle.GOES_ON:
            return [f"it did not begin: {trace.error}"] if trace.error or not trace.ticks else []
        case Idle.ANY:
            return []
    wrong = [] if trace.error or (trace.gone is not None and not trace.left) else ["it began"]
    wrong += ["torque is on"] if any(trace.torque) else []
    wrong += [f"the refusal does not name {text!r}" for text in row.refusal if text not in trace.error]
    if row.idle is Idle.ONLY_READS:
        wrong += not_reads(list(packets(trace.sent)), but=CONTROLLERS)
    return wrong


ONSET = 0.4
"""s of following before the fault."""
STOP_BEFORE = 0.05
"""Time from the command to stop until the fault, s, for a robot that is to be stopping."""
OUTLIVED = (Reaction.NONE, Reaction.MAY_HOLD, Reaction.OUT, Reaction.HOLD, Reaction.RESUME, Reaction.REBASE)
IDLE_S = 0.3
"""Length of a run with a fault before it began, s: no performer is followed in it yet."""
SETTLED_S = 0.5
"""Time for which an approaching robot is observed after its reaction, s."""
ENGAGING_S = 0.6
"""Longest time from the beginning of a run until the performer is followed, s."""


@dataclass(frozen=True)
class Verdict:
    """name: of what was judged. wrong: violations, a line each. took: s from the onset to the reaction, None without
    one."""

    name: str
    wrong: tuple[str, ...]
    took: float | None = None


class When(Enum):
    """What the robot does when the fault begins. approaching: it is on its way to where it follows from."""

    IDLE = "idle"
    APPROACHING = "approaching"
    MOVING = "moving"
    STOPPING = "stopping"


def judged(row: Row, *, when: When = When.MOVING, seed: int = 0) -> Verdict:
    """Run a row and judge it."""
    return verdict_of(row, run_row(row, when=when, seed=seed), when=when)


def run_row(row: Row, *, when: When = When.MOVING, seed: int = 0) -> Bench:
    """Run a row. A run that goes on after its reaction is observed to its end only if the robot was stopping."""
    followed = {When.IDLE: IDLE_S, When.MOVING: ENGAGING_S + ONSET + row.after, When.STOPPING: ENGAGING_S + ONSET}
    duration = followed.get(when, ENGAGING_S)
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer=row.performer, mass=row.mass)
    if when is When.STOPPING:
        bench.at(ONSET - STOP_BEFORE, lambda: bench.guard.latch(StopCause.REQUESTED, "asked for"))
    bench.leaves = row.reaction in OUTLIVED and when is not When.STOPPING
    if when is When.APPROACHING:
        bench.approaching = True
        if row.reaction in OUTLIVED:
            bench.at(ONSET + row.limit + SETTLED_S, bench.leave)
    row.inject(bench, -1.0 if when is When.IDLE else ONSET)
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
    """Return when the fault was injected, after the first tick that ended late enough; or when it first took effect."""
    if trace.acted:
        return trace.acted[0]
    return next((tick.time for tick in trace.ticks if since is not None and tick.time >= since + ONSET), None)


def _moving(row: Row, bench: Bench, trace: Trace) -> tuple[float | None, list[str]]:
    onset = _onset(trace, trace.began)
    if onset is None:
        return None, [f"no performer was followed: {trace.error or trace.said[-1:]}"]
    took, wrong = reacted(row, Seen(bench, trace, onset))
    if not said(row, trace):
        wrong.append(f"no message says {row.said!r}")
    if row.counted and not not_used(bench)[row.counted]:
        wrong.append(f"nothing was counted as {row.counted!r}")
    if trace.error:
        wrong.append(f"it was raised: {trace.error}")
    return took, wrong


def not_used(bench: Bench) -> Counter[str]:
    """Return how many datagrams and values were not used, by reason."""
    stream = bench.stream
    parts = (stream.admission.refused, stream.decoder.dropped, stream.clock_map.dropped, stream.playout.dropped)
    return sum((part.reasons for part in (*parts, stream.validity.refused)), Counter[str]())


def _approaching(row: Row, bench: Bench, trace: Trace) -> tuple[float | None, list[str]]:
    """Judge as while it moves. No performer is followed yet, so no sensor is left out, and no following resumes."""
    onset = _onset(trace, trace.armed)
    if onset is None or (trace.approach_ended is not None and trace.approach_ended <= onset):
        return None, [f"nothing was approached: {trace.error or trace.said[-1:]}"]
    if row.reaction is Reaction.OUT:
        row = replace(row, reaction=Reaction.MAY_HOLD)
    elif row.reaction is Reaction.RESUME:
        row = replace(row, reaction=Reaction.HOLD, limit=row.held)
    return reacted(row, Seen(bench, trace, onset))


def _stopping(row: Row, trace: Trace) -> list[str]:
    """Judge a stopping robot: the stop goes on to its end; where the bus is lost, torque goes off at once."""
    onset = _onset(trace, trace.began)
    if trace.latched is None or onset is None:
        return ["the stop was not latched"]
    if row.reaction is Reaction.GONE:
        return let_go(trace, onset, row)
    if trace.first(STOPPED, trace.latched) is None:
        return ["the stop did not come to its end"]
    if row.reaction is Reaction.TORQUE_OFF:
        return late("torque off", trace.torque_off_at(onset), onset, row.limit) + let_go(trace, onset, row)
    return []


# The least reaction to one fault, or to two in succession, and whether the robot showed it.

SOON_S = 2.0
"""A stop that has more time than this is preceded by a hold."""


@dataclass(frozen=True)
class Need:
    """A required reaction. reaction: at least; limit: s from the onset; name: of the row; sensor: the one that has to
    be left out."""

    name: str
    reaction: Reaction
    limit: float
    sensor: str = ""

    @property
    def strength(self) -> tuple[int, float]:
        """Strength of the reaction, and its limit: of equally strong ones, the one with the longer limit counts."""
        return STRONGER.get(self.reaction, (0, ""))[0], self.limit


STRONGER = {
    Reaction.OUT: (1, "left out"),
    Reaction.SLOW: (2, "slow"),
    Reaction.REBASE: (3, "rebased"),
    Reaction.HOLD: (4, "held"),
    Reaction.STOP: (5, "stopped"),
    Reaction.TORQUE_OFF: (6, "torque off"),
    Reaction.GONE: (7, "stood by watchdogs"),
}
"""Strength of a reaction, and its words. A stronger reaction includes the weaker ones; all others have strength 0."""


def need_of(row: Row) -> Need:
    """Return the reaction that one fault requires."""
    reaction, limit = row.reaction, row.limit
    if reaction in (Reaction.RESUME, Reaction.STAND) or (reaction is Reaction.STOP and limit > SOON_S):
        reaction, limit = Reaction.HOLD, limit if reaction is Reaction.STAND else row.held
    return Need(row.name, reaction, limit * row.chance, sensor=row.sensor)


def outdone(first: Row, second: Row, *, apart: float) -> Need:
    """Return the reaction that two faults `apart`, s, require from the later one on: the stronger of the two."""
    needs = [need_of(row) for row in (first, second) if row.name != second.hides]
    strongest = max(needs, key=lambda need: need.strength)
    if (first.suspends or second.suspends) and apart < first.limit:
        strongest = replace(strongest, limit=strongest.limit + max(first.limit, second.limit))
    for row in (first, second):  # what is counted in ticks takes longer
        if row.name != strongest.name:
            strongest = replace(strongest, limit=row.stretches * strongest.limit)
    return strongest


def reached(trace: Trace, need: Need, first: float, last: float) -> bool:
    """Return whether the robot showed the required reaction, or a stronger one, between two times, s."""
    strength, _ = need.strength
    ticks = [tick for tick in trace.ticks if tick.time <= last + 1e-9]
    if strength == 0 or (trace.gone is not None and trace.gone <= last and need.reaction is not Reaction.GONE):
        return True
    torque_off_at = trace.torque_off_at(first)
    if strength >= STRONGER[Reaction.TORQUE_OFF][0]:
        stopped = any(tick.state in STOPPED for tick in ticks)
        off = stopped or (torque_off_at is not None and torque_off_at <= last)
        return off or (need.reaction is Reaction.GONE and not _driving(trace, last))
    if any(tick.latched for tick in ticks) or trace.error:
        return True
    since = [tick for tick in ticks if tick.time >= first]
    if strength <= STRONGER[Reaction.HOLD][0] and any(tick.state in HOLDING for tick in since):
        return True
    if need.reaction is Reaction.REBASE:
        return trace.rebased is not None and trace.rebased <= last
    if need.reaction is Reaction.SLOW:
        return any(tick.slow <= HALF for tick in ticks)
    if need.reaction is Reaction.OUT:
        return any(need.sensor in gone for time, gone in trace.out if time <= last)
    return False


def _driving(trace: Trace, last: float) -> int:
    """Return how many servos still drive at a time, s."""
    return len(trace.torque) - len({device for time, device in trace.let_go if time <= last})


# Two faults in one run: the reaction to the first, and after both the stronger of the two, each in time.

LONGER_S = 0.7
"""Following after the second fault, s, at least."""
CUED_S = 0.05
"""A fault that waits for an event takes effect within this, s."""


@dataclass(frozen=True)
class Struck:
    """A row, and when its fault is due, s after following began."""

    row: Row
    at: float


def missing(trace: Trace, first: Struck, second: Struck, others: Sequence[Struck] = ()) -> list[str]:
    """Return the reactions to two faults that did not come in time, in words.

    The first is judged by itself where its time is over before the second. Otherwise the stronger reaction counts from
    the second on. others: faults that may hide one of them (a stream is silent); where they overlap, the stronger
    reaction counts from the later one on.
    """
    one, other = (_onset_of(trace, struck.at) for struck in (first, second))
    if one is None:
        return []  # the run was over before
    needs: list[tuple[Need, float]] = []  # and from when on
    alone = need_of(first.row)
    if other is None or other > one + alone.limit:
        needs.append((alone, one))
    if other is not None:
        both = outdone(first.row, second.row, apart=other - one)
        if not (needs and both is alone):
            needs.append((both, other))
    for another in others:
        at = _onset_of(trace, another.at)
        needs = [need if at is None else _with_other(*need, need_of(another.row), at) for need in needs]
    left = [need for need, since in needs if not reached(trace, need, one, since + need.limit)]
    return [f"{need.name}: not {STRONGER[need.reaction][1]} in time" for need in left]


def _with_other(need: Need, since: float, other: Need, at: float) -> tuple[Need, float]:
    """Return the required reaction, and from when on (s), where another fault comes at another time (s)."""
    if at - need.limit < since < at + other.limit and other.strength > need.strength:
        return other, max(since, at)
    return need, since


def _onset_of(trace: Trace, at: float) -> float | None:
    """Return when a fault took effect, s: at the end of a tick, or at its event."""
    if trace.began is None:
        return None
    done = next((tick.time for tick in trace.ticks if tick.time >= (trace.began or 0.0) + at), None)
    if done is None:
        return None
    return next((cued for cued in trace.acted if done <= cued < done + CUED_S), done)


def judged_pair(
    first: Row, second: Row, *, at: float, gap: float, seed: int, when: When = When.MOVING, longer: float = LONGER_S
) -> Verdict:
    """Run and judge two faults, `gap` s apart, the first at `at` s of following.

    Judged are the rules of every run, that it ends, and the reactions of a moving robot.
    """
    idle, moving = when is When.IDLE, when is When.MOVING
    after = max(longer, *(need_of(row).limit + 0.1 for row in (first, second))) if moving else longer
    duration = IDLE_S if idle else ENGAGING_S + at + gap + after
    six = "six" in (first.performer, second.performer)
    bench = Bench(FakeSender(seed=seed + 3), duration=duration, seed=seed, performer="six" if six else "five")
    if when is When.STOPPING:
        bench.at(at - STOP_BEFORE, lambda: bench.guard.latch(StopCause.REQUESTED, "asked for"))
    first.inject(bench, -1.0 if idle else at)
    second.inject(bench, -1.0 if idle else at + gap)
    trace = bench.run()
    wrong = violations(bench, trace)
    if moving:
        wrong += missing(trace, Struck(first, at), Struck(second, at + gap))
    return Verdict(f"{first.name} + {second.name}", tuple(wrong))
