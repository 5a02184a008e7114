"""Judges runs with faults: the rules of every run, a row alone in each state of the robot, several faults together."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from itertools import takewhile
from math import inf
from typing import NamedTuple

import numpy as np

from hardware.dynamixel import opencr
from hardware.guard_state import StopCause
from retarget.types import RunState
from sim.faults.bench import HOLDING, MOVING, STOPPED, STOPPING, Bench, Trace
from sim.faults.rows import Idle, Reaction, Row
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import (
    Track,
    Written,
    after_latch,
    beyond_limits,
    clearance_of,
    collisions,
    detours,
    goal_writes,
    not_reads,
    once,
    packets,
    posture_tracks,
    still_moving,
    stood,
    too_fast,
    torque_off,
    torque_on_again,
    tracks,
    written,
)

# The rules of every run, whatever the fault.

REST_S = 0.35
"""Time from the beginning of a hold, or of a stop, until the robot stands, s."""
OFF_S = 4.0
"""Time, s, from the beginning of a stop until torque is off; of a robot that is slow because a servo is warm, so much
longer, and of one that a fault holds on its way, so much longer as that fault may."""
TO_REST_SHARE = 0.55
"""Share of the greatest speeds on the way to rest: the longest way of a joint, 2.4 rad, takes 1.9 s at this speed, with
a gentle rise and fall."""
AGAIN_SHARE, AGAIN_S = 0.25, 0.75
"""Share of the greatest speeds after following resumes, and for how long, s."""
STILL_WITHIN_S = 0.3
"""Length, s, of a hold: after a shorter one, of single ticks, the way back need not be slow."""
SETTLED = (*STOPPING, RunState.STANDING, *STOPPED)
STANDING = (RunState.RETURN_TO_STANCE, RunState.GO_TO_REST, RunState.STANDING, *STOPPED)
"""States of a robot that has braked, or has no torque any more."""
AT_REST_RAD = 0.01
"""A robot this near to posture `rest` is at rest, rad."""


def goals_of(bench: Bench, trace: Trace) -> tuple[float, list[Track]]:
    """The time between two ticks, s, and the goals of each servo."""
    dt = 1.0 / bench.robot.profile.safety.rate_hz
    return dt, tracks(once(goal_writes(written(trace.sent)), within=0.5 * dt), bench.robot.joint_map.servos)


def violations(bench: Bench, trace: Trace) -> list[str]:
    """Return every violation of the rules, a line each."""
    if not hasattr(bench, "robot"):
        return []
    robot, writes = bench.robot, written(trace.sent)
    dt, goal_tracks = goals_of(bench, trace)
    wrong = beyond_limits(goal_tracks, dt) + collisions(robot, goal_tracks)
    for first, last in () if bench.presses else trace.holds:  # a limb gives way as fast as the gate lets it
        wrong += [f"in a hold {text}" for text in still_moving(goal_tracks, first + REST_S, last - dt)]
    wrong += [] if bench.presses else _speeds(bench, trace, goal_tracks, dt)
    wrong += _stop_violations(bench, trace, goal_tracks, writes, dt)
    if trace.gone is None and not (trace.error or trace.stop) and trace.began is None and not trace.ticks:
        wrong.append("nothing was done, and no message says why")
    if trace.endless:
        wrong.append("the run did not end")
    if bench.witness is not None and bench.witness.fall is not None:
        wrong.append(f"the robot fell: {bench.witness.fall.how}")
    return wrong + _torque(bench, trace)


def _speeds(bench: Bench, trace: Trace, goal_tracks: list[Track], dt: float) -> list[str]:
    """Return the joints that are too fast on the approach, or when following resumes."""
    if trace.armed is None:
        return []
    ends = (trace.ended, trace.latched, trace.first(SETTLED, trace.armed))
    over = min(time for time in ends if time is not None)
    approach_ended = over if trace.approach_ended is None else trace.approach_ended
    share = bench.robot.profile.safety.speed_caps.approach
    wrong = [
        f"on its approach {text}"
        for text in too_fast(goal_tracks, trace.armed - dt, min(approach_ended, over), share=share, dt=dt)
    ]
    for first, last in trace.holds:
        if last - first > STILL_WITHIN_S:
            again = too_fast(goal_tracks, last, min(last + AGAIN_S, over), share=AGAIN_SHARE, dt=dt)
            wrong += [f"after a hold {text}" for text in again]
    return wrong[:8]


def _stop_violations(
    bench: Bench, trace: Trace, goal_tracks: list[Track], writes: list[Written], dt: float
) -> list[str]:
    """Return violations of the rule that a stop goes on to its end, and nothing else happens."""
    begun = trace.latched
    if begun is None:
        return []
    since = trace.ticks[next(row for row, tick in enumerate(trace.ticks) if tick.latched) :]  # two may end at one time
    wrong = [f"{tick.state.value} after a stop" for tick in since if tick.state not in SETTLED]
    before = max((tick.time for tick in trace.ticks if tick.time < begun), default=begun)
    wrong += torque_on_again(writes, before)
    off = torque_off(writes, before)
    # Faults since the stop began may have held the robot for so long, s.
    held_up = sum(limit for at, limit in bench.held_up if begun <= at + (trace.began or 0.0) < (off or begun))
    if since[-1].state is RunState.STANDING:
        wrong += ["torque went off though the robot stood"] if off is not None and off < since[-1].time else []
    elif off is None:
        if trace.gone is None and not trace.writes_fail:
            wrong.append("torque off was never commanded")
    elif off - begun > (allowed := OFF_S / min(tick.slow for tick in since) + held_up):
        wrong.append(f"torque went off {off - begun:.2f} s after the stop began, allowed {allowed:g} s")
    ended = trace.first(STOPPED, begun)
    if ended is not None:
        wrong += after_latch(writes, ended)
    wrong += too_fast(goal_tracks, begun + REST_S, trace.ended, share=TO_REST_SHARE, dt=dt)
    braking = list(takewhile(lambda tick: tick.state not in STANDING, since))
    wrong += late("at rest", braking[-1].time, begun, REST_S) if braking else []
    # With mass, goals lead the postures by the servos' deflection.
    shafts = posture_tracks(trace.postures, bench.robot.joint_map.servos) if bench.mass else goal_tracks
    if ended is not None and trace.stop is not None and trace.stop.is_bearable:
        wrong += _not_at_rest(bench, shafts)
    to_rest = trace.first((RunState.GO_TO_REST,), begun)
    return wrong[:8] + detours(shafts, begun + REST_S if to_rest is None else to_rest, trace.ended)


def _not_at_rest(bench: Bench, shafts: list[Track]) -> list[str]:
    """Return the servos that did not go to posture `rest` in the end, but for those that were lost."""
    robot = bench.robot
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    rest_angles = dict(zip(robot.joint_map.joints, rest.tolist(), strict=True))
    lost = {servo.id for servo, gone in zip(robot.joint_map.servos, bench.guard.health.lost, strict=True) if gone}
    kept = [track for track in shafts if track.servo.id not in lost]
    off = {track.servo.label: float(track.angle[-1]) - rest_angles[track.servo.joint] for track in kept}
    return [f"{label} is not at rest, {by:.3f} rad off" for label, by in off.items() if abs(by) > AT_REST_RAD]


def _torque(bench: Bench, trace: Trace) -> list[str]:
    """Judge the end: no servo has torque, or a message says so; servos of a killed host are stopped by watchdogs."""
    if not any(trace.torque):
        return []
    if trace.gone is not None:
        return [] if all(servo.tripped or not servo.shaft.torque for servo in bench.servos) else ["servos still drive"]
    reported = trace.error or (trace.stop is not None and trace.stop.powered)
    return [] if reported else ["torque is on in the end, and no message says so"]


HEALTHY_S = 0.5
"""Time for which data must be good before a hold ends, s."""
BACK_S = 0.6
"""Longest time from good data until a robot goes on, s."""
HALF = 0.5
FASTEST_BACK_M_S = 3.1
"""Greatest speed of a joint with a sensor after a hold, m/s: 0.25 of being led in, and 2.85 of its own."""
MARGIN_M = 0.004
"""Margin of the observers of the profile, m."""
STOOD_S = 0.2
"""Time, s, at the end of a run in which a robot that the gate holds must not move."""

Judged = tuple[float | None, list[str]]
"""When the robot reacted, s, None without a time of its own; and what is wrong, a line each."""


@dataclass(frozen=True)
class Seen:
    """A run, and the onset of its fault, s."""

    bench: Bench
    onset: float

    @property
    def trace(self) -> Trace:
        """The events of the run."""
        return self.bench.trace

    @cached_property
    def goals(self) -> tuple[float, list[Track]]:
        """The time between two ticks, s, and the goals of each servo."""
        return goals_of(self.bench, self.trace)

    def first(self, states: tuple[RunState, ...]) -> float | None:
        """Time, s, at which one of these states was first seen since the onset."""
        return self.trace.first(states, self.onset)

    @property
    def stopped(self) -> float | None:
        """Time, s, at which a stop was latched since the onset."""
        return self.trace.stopped(self.onset)

    @property
    def on_again(self) -> float | None:
        """Time, s, at which the robot went on after a hold."""
        hold = self.first(HOLDING)
        return None if hold is None else self.trace.first(MOVING, hold)

    def moves(self, within: float, span: float = 0.0, *, ticks: int = 0) -> list[str]:
        """Servos that still move from `within` s after the onset, or for the last `span` s, until the robot stops."""
        dt, goal_tracks = self.goals
        end = self.first(STOPPING) or self.trace.ended
        return still_moving(goal_tracks, end - span if span else self.onset + within, end - dt, ticks=ticks)


def _driving(trace: Trace, first: float, last: float) -> int:
    """Return how many servos still drive that did not let go between two times, s."""
    return len(trace.torque) - len({device for time, device in trace.let_go if first <= time <= last})


def let_go(trace: Trace, onset: float, row: Row) -> list[str]:
    """Return how many servos still drive after the row's time."""
    if row.watchdog is None:
        return []
    still = _driving(trace, onset, onset + row.watchdog)
    return [f"{still} servos still drove {row.watchdog:g} s after it"] if still else []


def late(what: str, time: float | None, onset: float, limit: float) -> list[str]:
    """Return a line for a reaction that did not come, or came later than `limit` s after the onset."""
    if time is None:
        return [f"not {what}"]
    return [f"{what} after {time - onset:.3f} s, allowed {limit:g} s"] if time - onset > limit + 1e-9 else []


def reacted(row: Row, seen: Seen) -> Judged:
    """Return s from the onset to the reaction, and what is wrong with it."""
    took, wrong = _JUDGES[row.reaction](row, seen)
    ended = seen.trace.ended - seen.onset
    if row.ends is not None and ended > row.ends:
        wrong.append(f"it ended after {ended:.1f} s, allowed {row.ends:g} s")
    since = None if took is None else took - seen.onset
    stop = seen.trace.stop
    for wanted, cause in ((row.cause, stop.cause if stop else None), (row.then, stop.then if stop else None)):
        if wanted is not None and cause is not wanted:
            wrong.append(f"the reported cause is {'none' if cause is None else cause.value}, not {wanted.value}")
    return since, wrong + (let_go(seen.trace, seen.onset, row) if row.reaction is not Reaction.GONE else [])


def said(row: Row, trace: Trace) -> bool:
    """Return whether a message says what the row asks for."""
    return any(re.search(row.said, text) for text in (*trace.said, trace.stop.reason if trace.stop else ""))


def _none(row: Row, seen: Seen) -> Judged:
    hold = None if row.reaction is Reaction.MAY_HOLD else seen.first(HOLDING)
    return None, [f"it reacted after {time - seen.onset:.3f} s" for time in (hold, seen.stopped) if time is not None][
        :1
    ]


def _out(row: Row, seen: Seen) -> Judged:
    out = next((time for time, gone in seen.trace.out if time >= seen.onset and row.sensor in gone), None)
    wrong = late("left out", out, seen.onset, row.limit)
    return out, wrong + (["the robot held"] if seen.first(HOLDING) is not None else [])


def _hold(row: Row, seen: Seen) -> Judged:
    hold, on = seen.first(HOLDING), seen.on_again
    wrong = late("held", hold, seen.onset, row.limit if row.reaction is Reaction.HOLD else row.held)
    wrong += ["it stopped"] if seen.stopped is not None else []
    if row.back is not None and on is not None and on - seen.onset < row.back + HEALTHY_S:
        wrong.append(f"it went on after {on - seen.onset:.3f} s, data were good from {row.back:g} s on")
    jump = max((step for time, step in seen.trace.speeds if on is not None and time >= on), default=0.0)
    if not jump <= FASTEST_BACK_M_S:
        wrong.append(f"it went on with a jump: {jump:.1f} m/s of a joint")
    if row.reaction is Reaction.HOLD:
        return hold, wrong
    return on, wrong + late("on its way again", on, seen.onset, row.limit)


def _rebase(row: Row, seen: Seen) -> Judged:
    again = seen.trace.rebased
    wrong = late("rebased", again, seen.onset, row.limit)
    if seen.first(HOLDING) is not None:
        wrong += late("on its way again", seen.on_again, seen.onset, row.limit + BACK_S)
    return again, wrong


def _stand(row: Row, seen: Seen) -> Judged:
    """Judge the goals alone: at rest in time, torque on."""
    return None, seen.moves(row.limit + REST_S) + (["it stopped"] if seen.stopped is not None else [])


def _gated(row: Row, seen: Seen) -> Judged:
    """Judge that the asked postures came nearer than the margin, and the robot stood, but for a tick that the moving
    limbs leave it. Sent goals are judged anyway."""
    robot, asked = seen.bench.robot, seen.trace.asked
    postures = np.tile(robot.body.qpos0, (len(asked), 1))
    postures[:, robot.servo_columns] = [posture for _, posture in asked]
    closest = clearance_of(robot, postures).smallest if asked else None
    wrong = [] if closest is not None and closest < MARGIN_M else ["what was asked for was no danger"]
    return None, wrong + seen.moves(0.0, STOOD_S, ticks=1)


def _slow(row: Row, seen: Seen) -> Judged:
    slow = next((tick.time for tick in seen.trace.ticks if tick.time >= seen.onset and tick.slow <= HALF), None)
    wrong = late("slow", slow, seen.onset, row.limit) + (["it stopped"] if seen.stopped is not None else [])
    dt, goal_tracks = seen.goals
    return slow, wrong + too_fast(goal_tracks, seen.onset + row.limit, seen.trace.ended, share=HALF, dt=dt)


def _stop(row: Row, seen: Seen) -> Judged:
    stop = seen.stopped
    wrong = late("stopped", stop, seen.onset, row.limit)
    first = next((tick.state for tick in seen.trace.ticks if tick.time == stop), None)
    if stop is not None and first in STOPPED and not stood(seen.goals[1], stop):
        wrong.append("it did not brake")
    if seen.trace.stop is None or seen.trace.first(STOPPED, seen.onset) is None:
        wrong.append("it was not latched")
    return stop, wrong


def _stands(row: Row, seen: Seen) -> Judged:
    wrong = late("stopped", seen.stopped, seen.onset, row.limit)
    last = seen.trace.ticks[-1]
    wrong += [] if last.state is RunState.STANDING and last.latched else ["it did not stand in the end, latched"]
    return seen.stopped, wrong


def _torque_off(row: Row, seen: Seen) -> Judged:
    torque_off_at = seen.trace.torque_off_at(seen.onset)
    wrong = late("torque off", torque_off_at, seen.onset, row.limit)
    return torque_off_at, wrong + ([] if seen.first(STOPPED) is not None else ["it was not latched"])


def _gone(row: Row, seen: Seen) -> Judged:
    wrong = let_go(seen.trace, seen.onset, row)
    latched = seen.first(STOPPED)
    if seen.trace.gone is None:
        wrong += late("latched", latched, seen.onset, row.limit)
    gone = [time for time, _ in seen.trace.let_go if time >= seen.onset]
    return max(gone, default=None), wrong


_JUDGES = {
    Reaction.NONE: _none,
    Reaction.MAY_HOLD: _none,
    Reaction.OUT: _out,
    Reaction.HOLD: _hold,
    Reaction.RESUME: _hold,
    Reaction.REBASE: _rebase,
    Reaction.STAND: _stand,
    Reaction.GATED: _gated,
    Reaction.SLOW: _slow,
    Reaction.STOP: _stop,
    Reaction.STANDS: _stands,
    Reaction.TORQUE_OFF: _torque_off,
    Reaction.GONE: _gone,
}


# Runs: faults one after another, and the state in which they find the robot.

ONSET = 0.4
"""s of following before the fault of a row."""
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


class Struck(NamedTuple):
    """A row, and when its fault is due, s after following began."""

    row: Row
    at: float


def bench_of(
    strikes: Sequence[Struck],
    *,
    when: When = When.MOVING,
    following: float,
    performer: str | None = None,
    seed: int = 0,
) -> Bench:
    """A bench with these faults. following: how long the performer is followed, s; no time at all where the robot is
    idle, or approaching. performer: None: the one that the rows ask for."""
    idle = when is When.IDLE
    still = {When.IDLE: IDLE_S, When.APPROACHING: ENGAGING_S}
    bench = Bench(
        FakeSender(seed=seed + 3),
        duration=still.get(when, ENGAGING_S + following),
        seed=seed,
        performer=performer or max((one.row.performer for one in strikes), key=["five", "six"].index),
        mass=len(strikes) == 1 and strikes[0].row.mass,
    )
    bench.approaching = when is When.APPROACHING
    bench.held_up = [(at, row.limit) for row, at in strikes if row.reaction is Reaction.RESUME]
    recorded = strikes[0].row.recorded
    if recorded:
        strikes[0].row.inject(bench, -1.0 if idle else strikes[0].at)
        bench.record()
    if when is When.STOPPING:
        bench.at(strikes[0].at - STOP_BEFORE, lambda: bench.guard.latch(StopCause.REQUESTED, "asked for"))
    for row, at in () if recorded else strikes:
        row.inject(bench, -1.0 if idle else at)
    return bench


def run_row(row: Row, *, when: When = When.MOVING) -> Bench:
    """Run a row. A run that goes on after its reaction is observed to its end only if the robot was stopping."""
    following = ONSET + (row.after if when is When.MOVING else 0.0)
    bench = bench_of([Struck(row, ONSET)], when=when, following=following)
    if row.reaction in OUTLIVED:
        bench.leaves = when is not When.STOPPING
        if when is When.APPROACHING:
            bench.at(ONSET + row.limit + SETTLED_S, bench.leave)
    bench.run()
    return bench


def judged(row: Row, *, when: When = When.MOVING) -> Verdict:
    """Run a row and judge it."""
    return verdict_of(row, run_row(row, when=when), when=when)


def verdict_of(row: Row, bench: Bench, *, when: When = When.MOVING) -> Verdict:
    """Judge the run of a row."""
    judge = {When.IDLE: _idle, When.APPROACHING: _approaching, When.MOVING: _moving, When.STOPPING: _stopping}[when]
    took, wrong = judge(row, bench)
    return Verdict(row.name, tuple(wrong + violations(bench, bench.trace)), took)


def _onset(trace: Trace, since: float | None) -> float | None:
    """Return when the fault was injected, after the first tick that ended late enough; or when it first took effect."""
    if trace.acted:
        return trace.acted[0]
    return next((tick.time for tick in trace.ticks if since is not None and tick.time >= since + ONSET), None)


def _idle(row: Row, bench: Bench) -> Judged:
    """Judge a run whose fault is there before the bus is opened."""
    trace = bench.trace
    match row.idle:
        case Idle.GOES_ON:
            return None, [f"it did not begin: {trace.error}"] if trace.error or not trace.ticks else []
        case Idle.ANY:
            return None, []
    wrong = [] if trace.error or (trace.gone is not None and not trace.left) else ["it began"]
    wrong += ["torque is on"] if any(trace.torque) else []
    wrong += [f"the refusal does not name {text!r}" for text in row.refusal if text not in trace.error]
    if row.idle is Idle.ONLY_READS:
        wrong += not_reads(list(packets(trace.sent)), but=frozenset((opencr.ID,)))  # its power switch is written
    return None, wrong


def _moving(row: Row, bench: Bench) -> Judged:
    trace = bench.trace
    onset = _onset(trace, trace.began)
    if onset is None:
        return None, [f"no performer was followed: {trace.error or trace.said[-1:]}"]
    took, wrong = reacted(row, Seen(bench, onset))
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


def _approaching(row: Row, bench: Bench) -> Judged:
    """Judge as while it moves. No performer is followed yet, so no sensor is left out, and no following resumes."""
    trace = bench.trace
    onset = _onset(trace, trace.armed)
    if onset is None or (trace.approach_ended is not None and trace.approach_ended <= onset):
        return None, [f"nothing was approached: {trace.error or trace.said[-1:]}"]
    if row.reaction is Reaction.OUT:
        row = replace(row, reaction=Reaction.MAY_HOLD)
    elif row.reaction is Reaction.RESUME:
        row = replace(row, reaction=Reaction.HOLD, limit=row.held)
    return reacted(row, Seen(bench, onset))


def _stopping(row: Row, bench: Bench) -> Judged:
    """Judge a stopping robot: the stop goes on to its end; where the bus is lost, torque goes off at once."""
    trace = bench.trace
    onset = _onset(trace, trace.began)
    if trace.latched is None or onset is None:
        return None, ["the stop was not latched"]
    if row.reaction is Reaction.GONE:
        return None, let_go(trace, onset, row)
    if row.reaction is Reaction.STANDS:
        return _stands(row, Seen(bench, onset))
    if trace.first(STOPPED, trace.latched) is None:
        return None, ["the stop did not come to its end"]
    if row.reaction is Reaction.TORQUE_OFF:
        wrong = late("torque off", trace.torque_off_at(onset), onset, row.limit) + let_go(trace, onset, row)
        return None, wrong
    return None, []


# Several faults in one run: the reaction to the first, and after two the stronger one, each in time.

SOON_S = 2.0
"""A stop for a performer who cannot be followed that has more time than this is preceded by a hold."""
LONGER_S = 0.7
"""Following after the second fault, s, at least."""
CUED_S = 0.05
"""A fault that waits for an event takes effect within this, s."""
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


def strength(row: Row) -> tuple[int, float]:
    """Strength of the reaction, and its limit: of equally strong ones, the one with the longer limit counts."""
    return STRONGER.get(row.reaction, (0, ""))[0], row.limit


def least(row: Row) -> Row:
    """The row with the least reaction that its fault requires beside another one."""
    reaction, limit = row.reaction, row.limit
    waits = reaction is Reaction.STOP and limit > SOON_S and row.cause is StopCause.STALE_GOAL
    if reaction in (Reaction.RESUME, Reaction.STAND) or waits:
        reaction, limit = Reaction.HOLD, limit if reaction is Reaction.STAND else row.held
    return replace(row, reaction=reaction, limit=limit * row.chance)


def outdone(first: Row, second: Row, *, apart: float) -> Row:
    """Return the row whose reaction two faults `apart`, s, require from the later one on: the stronger of the two."""
    strongest = max((least(row) for row in (first, second) if row.name != second.hides), key=strength)
    if (first.suspends or second.suspends) and apart < first.limit:
        strongest = replace(strongest, limit=strongest.limit + max(first.limit, second.limit))
    for row in (first, second):  # what is counted in ticks takes longer
        if row.name != strongest.name:
            strongest = replace(strongest, limit=row.stretches * strongest.limit)
    return strongest


def reached(trace: Trace, row: Row, first: float, last: float) -> bool:
    """Return whether the robot showed a row's reaction, or a stronger one, between two times, s."""
    needed, _ = strength(row)
    ticks = [tick for tick in trace.ticks if tick.time <= last + 1e-9]
    if needed == 0 or (trace.gone is not None and trace.gone <= last and row.reaction is not Reaction.GONE):
        return True
    torque_off_at = trace.torque_off_at(first)
    if needed >= STRONGER[Reaction.TORQUE_OFF][0]:
        stopped = any(tick.state in STOPPED for tick in ticks)
        off = stopped or (torque_off_at is not None and torque_off_at <= last)
        return off or (row.reaction is Reaction.GONE and not _driving(trace, -inf, last))
    if any(tick.latched for tick in ticks) or trace.error:
        return True
    if needed <= STRONGER[Reaction.HOLD][0] and any(tick.state in HOLDING for tick in ticks if tick.time >= first):
        return True
    if row.reaction is Reaction.REBASE:
        return trace.rebased is not None and trace.rebased <= last
    if row.reaction is Reaction.SLOW:
        return any(tick.slow <= HALF for tick in ticks)
    return row.reaction is Reaction.OUT and any(row.sensor in gone for time, gone in trace.out if time <= last)


def missing(trace: Trace, first: Struck, second: Struck, others: Sequence[Struck] = ()) -> list[str]:
    """Return the reactions to two faults that did not come in time, in words.

    The first is judged by itself where its time is over before the second. Otherwise the stronger reaction counts from
    the second on. others: faults that may hide one of them (a stream is silent); where they overlap, the stronger
    reaction counts from the later one on.
    """
    one, other = (_onset_of(trace, struck.at) for struck in (first, second))
    if one is None:
        return []  # the run was over before
    needs: list[tuple[Row, float]] = []  # and from when on
    alone = least(first.row)
    if other is None or other > one + alone.limit:
        needs.append((alone, one))
    if other is not None:
        needs.append((outdone(first.row, second.row, apart=other - one), other))
    for another in others:
        at = _onset_of(trace, another.at)
        needs = [need if at is None else _with_other(*need, least(another.row), at) for need in needs]
    left = [need for need, since in needs if not reached(trace, need, one, since + need.limit)]
    return [f"{need.name}: not {STRONGER[need.reaction][1]} in time" for need in left]


def _with_other(need: Row, since: float, other: Row, at: float) -> tuple[Row, float]:
    """Return the required reaction, and from when on (s), where another fault comes at another time (s)."""
    if at - need.limit < since < at + other.limit and strength(other) > strength(need):
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


def judged_pair(first: Row, second: Row, *, at: float, gap: float, when: When = When.MOVING) -> Verdict:
    """Run and judge two faults, `gap` s apart, the first at `at` s of following.

    Judged are the rules of every run, that it ends, and the reactions of a moving robot.
    """
    strikes = Struck(first, at), Struck(second, at + gap)
    moving = when is When.MOVING
    after = max(LONGER_S, *(least(row).limit + 0.1 for row in (first, second))) if moving else LONGER_S
    bench = bench_of(strikes, when=when, following=at + gap + after)
    return verdict_of_pair(bench, bench.run(), *strikes, reacts=moving)


def verdict_of_pair(bench: Bench, trace: Trace, first: Struck, second: Struck, *, reacts: bool = True) -> Verdict:
    """Judge the run of two faults. reacts: whether their reactions are judged, too."""
    wrong = violations(bench, trace) + (missing(trace, first, second) if reacts else [])
    return Verdict(f"{first.row.name} + {second.row.name}", tuple(wrong))
