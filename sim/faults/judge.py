"""Judges runs with faults: the rules of every run, one fault in each state of the robot, several faults together."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import takewhile
from math import inf
from typing import NamedTuple

import numpy as np

from hardware.dynamixel import opencr
from hardware.guard_state import StopCause
from retarget.types import RunState
from sim.faults.bench import HOLDING, MOVING, STOPPED, STOPPING, Bench, Trace
from sim.faults.bounds import BOUNDS
from sim.faults.rows import Idle, Reaction, Row
from sim.faults.sender import FakeSender
from sim.faults.wire_checker import (
    Track,
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

SETTLED = (*STOPPING, RunState.STANDING, *STOPPED)
STANDING = (RunState.RETURN_TO_STANCE, RunState.GO_TO_REST, RunState.STANDING, *STOPPED)
"""States of a robot that has braked, or has no torque any more."""


def goals_of(bench: Bench, trace: Trace) -> tuple[float, list[Track]]:
    """The period of the ticks, s, and the goals of each servo."""
    dt = 1.0 / bench.robot.profile.safety.rate_hz
    return dt, tracks(once(goal_writes(written(trace.sent)), within=0.5 * dt), bench.robot.joint_map.servos)


def violations(bench: Bench, trace: Trace) -> list[str]:
    """Return every violation of the rules, a line each."""
    if not hasattr(bench, "robot"):
        return []
    dt, goal_tracks = goals_of(bench, trace)
    wrong = beyond_limits(goal_tracks, dt) + collisions(bench.robot, goal_tracks)
    # A limb that something presses against gives way as fast as the gate allows.
    for first, last in () if bench.presses else trace.holds:
        wrong += [f"in a hold {text}" for text in still_moving(goal_tracks, first + BOUNDS.brake_s, last - dt)]
    if trace.armed is not None and not bench.presses:
        ends = (trace.ended, trace.latched, trace.first(SETTLED, trace.armed))
        over = min(time for time in ends if time is not None)
        approach_ended = over if trace.approach_ended is None else trace.approach_ended
        share = bench.robot.profile.safety.speed_caps.approach
        approach = too_fast(goal_tracks, trace.armed - dt, min(approach_ended, over), share=share, dt=dt)
        fast = [f"on its approach {text}" for text in approach]
        for first, last in trace.holds:
            if last - first > BOUNDS.short_hold_s:
                until = min(last + BOUNDS.resume_s, over)
                again = too_fast(goal_tracks, last, until, share=BOUNDS.resume_share, dt=dt)
                fast += [f"after a hold {text}" for text in again]
        wrong += fast[:8]
    if trace.latched is not None:
        wrong += _stop_violations(bench, trace, goal_tracks, dt, begun=trace.latched)
    if trace.gone is None and not (trace.error or trace.stop) and trace.began is None and not trace.ticks:
        wrong.append("nothing was done, and no message says why")
    if trace.endless:
        wrong.append("the run did not end")
    if bench.witness is not None and bench.witness.fall is not None:
        wrong.append(f"the robot fell: {bench.witness.fall.how}")
    # In the end no servo has torque, or a message reports it. The servos of a killed host are stopped by watchdogs.
    if any(trace.torque) and trace.gone is not None:
        if not all(servo.tripped or not servo.shaft.torque for servo in bench.servos):
            wrong.append("servos still drive")
    elif any(trace.torque) and not trace.error and not (trace.stop is not None and trace.stop.powered):
        wrong.append("torque is on in the end, and no message says so")
    return wrong


def _stop_violations(bench: Bench, trace: Trace, goal_tracks: list[Track], dt: float, *, begun: float) -> list[str]:
    """Return violations of the rule that a stop, latched at `begun` s, goes on to its end and nothing else happens."""
    robot, writes = bench.robot, written(trace.sent)
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
    elif off - begun > (allowed := BOUNDS.off_s / min(tick.slow for tick in since) + held_up):
        wrong.append(f"torque went off {off - begun:.2f} s after the stop began, allowed {allowed:g} s")
    ended = trace.first(STOPPED, begun)
    if ended is not None:
        wrong += after_latch(writes, ended)
    wrong += too_fast(goal_tracks, begun + BOUNDS.brake_s, trace.ended, share=BOUNDS.to_rest_share, dt=dt)
    braking = list(takewhile(lambda tick: tick.state not in STANDING, since))
    wrong += late("at rest", braking[-1].time, begun, BOUNDS.brake_s) if braking else []
    # With mass, goals lead the postures by the servos' deflection.
    shafts = posture_tracks(trace.postures, robot.joint_map.servos) if bench.mass else goal_tracks
    if ended is not None and trace.stop is not None and trace.stop.is_bearable:
        # All servos but those that were lost go to posture `rest`.
        rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
        rest_angles = dict(zip(robot.joint_map.joints, rest.tolist(), strict=True))
        lost = {servo.id for servo, gone in zip(robot.joint_map.servos, bench.guard.health.lost, strict=True) if gone}
        kept = [track for track in shafts if track.servo.id not in lost]
        by = {track.servo.label: float(track.angle[-1]) - rest_angles[track.servo.joint] for track in kept}
        far = {label: distance for label, distance in by.items() if abs(distance) > BOUNDS.at_rest_rad}
        wrong += [f"{label} is not at rest, {distance:.3f} rad off" for label, distance in far.items()]
    to_rest = trace.first((RunState.GO_TO_REST,), begun)
    return wrong[:8] + detours(shafts, begun + BOUNDS.brake_s if to_rest is None else to_rest, trace.ended)


Judged = tuple[float | None, list[str]]
"""When the robot reacted, s, None without a time of its own; and what is wrong, a line each."""


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
    """A line for a reaction that did not come, or came later than `limit` s after the onset."""
    if time is None:
        return [f"not {what}"]
    return [f"{what} after {time - onset:.3f} s, allowed {limit:g} s"] if time - onset > limit + 1e-9 else []


def _reaction(row: Row, bench: Bench, onset: float) -> Judged:
    trace, limit, words = bench.trace, row.limit, BOUNDS.reactions[row.reaction.name].words
    dt, goal_tracks = goals_of(bench, trace)
    hold, stop, off = trace.first(HOLDING, onset), trace.stopped(onset), trace.first(STOPPED, onset)
    resumed = None if hold is None else trace.first(MOVING, hold)
    stopped = [] if stop is None else ["it stopped"]
    end = trace.first(STOPPING, onset) or trace.ended  # a robot that stops has rules of its own
    match row.reaction:
        case Reaction.NONE | Reaction.MAY_HOLD:
            seen = (stop,) if row.reaction is Reaction.MAY_HOLD else (hold, stop)
            return None, [f"it reacted after {time - onset:.3f} s" for time in seen if time is not None][:1]
        case Reaction.OUT:
            out = next((time for time, gone in trace.out if time >= onset and row.sensor in gone), None)
            return out, late(words, out, onset, limit) + ([] if hold is None else ["the robot held"])
        case Reaction.HOLD | Reaction.RESUME:
            resumes = row.reaction is Reaction.RESUME
            wrong = late("held", hold, onset, row.held if resumes else limit) + stopped
            if row.back is not None and resumed is not None and resumed - onset < row.back + BOUNDS.healthy_s:
                wrong.append(f"it went on after {resumed - onset:.3f} s, data were good from {row.back:g} s on")
            jump = max((step for time, step in trace.speeds if resumed is not None and time >= resumed), default=0.0)
            if not jump <= BOUNDS.resume_m_s:
                wrong.append(f"it went on with a jump: {jump:.1f} m/s of a joint")
            return (resumed, wrong + late("on its way again", resumed, onset, limit)) if resumes else (hold, wrong)
        case Reaction.REBASE:
            wrong = late(words, trace.rebased, onset, limit)
            on_time = [] if hold is None else late("on its way again", resumed, onset, limit + BOUNDS.resumed_s)
            return trace.rebased, wrong + on_time
        case Reaction.STAND:
            return None, still_moving(goal_tracks, onset + (limit + BOUNDS.brake_s), end - dt) + stopped
        case Reaction.GATED:
            # The desired postures came nearer than the margin, and the robot stood, but for a tick that the moving
            # limbs leave it. Goals that were sent are judged anyway.
            postures = np.tile(bench.robot.body.qpos0, (len(trace.desired), 1))
            postures[:, bench.robot.servo_columns] = [posture for _, posture in trace.desired]
            closest = clearance_of(bench.robot, postures).smallest if trace.desired else None
            near = closest is not None and closest < BOUNDS.margin_m
            moving = still_moving(goal_tracks, end - BOUNDS.stood_s, end - dt, ticks=1)
            return None, ([] if near else ["what was asked for was no danger"]) + moving
        case Reaction.SLOW:
            share = BOUNDS.slow_share
            slow = next((tick.time for tick in trace.ticks if tick.time >= onset and tick.slow <= share), None)
            wrong = late(words, slow, onset, limit) + stopped
            return slow, wrong + too_fast(goal_tracks, onset + limit, trace.ended, share=share, dt=dt)
        case Reaction.STOP:
            wrong = late(words, stop, onset, limit)
            first = next((tick.state for tick in trace.ticks if tick.time == stop), None)
            if stop is not None and first in STOPPED and not stood(goal_tracks, stop):
                wrong.append("it did not brake")
            return stop, wrong + (["it was not latched"] if trace.stop is None or off is None else [])
        case Reaction.STANDS:
            last = trace.ticks[-1]
            stands = last.state is RunState.STANDING and last.latched
            return stop, late("stopped", stop, onset, limit) + (
                [] if stands else ["it did not stand in the end, latched"]
            )
        case Reaction.TORQUE_OFF:
            torque_off_at = trace.torque_off_at(onset)
            wrong = late(words, torque_off_at, onset, limit)
            return torque_off_at, wrong + ([] if off is not None else ["it was not latched"])
        case Reaction.GONE:
            wrong = let_go(trace, onset, row) + (late("latched", off, onset, limit) if trace.gone is None else [])
            return max((time for time, _ in trace.let_go if time >= onset), default=None), wrong


def reacted(row: Row, bench: Bench, onset: float) -> Judged:
    """The time from the onset to the reaction, s, and what is wrong since the onset."""
    trace, stop = bench.trace, bench.trace.stop
    time, wrong = _reaction(row, bench, onset)
    ended = trace.ended - onset
    if row.ends is not None and ended > row.ends:
        wrong.append(f"it ended after {ended:.1f} s, allowed {row.ends:g} s")
    for expected, cause in ((row.cause, stop.cause if stop else None), (row.then, stop.then if stop else None)):
        if expected is not None and cause is not expected:
            wrong.append(f"the reported cause is {'none' if cause is None else cause.value}, not {expected.value}")
    wrong += let_go(trace, onset, row) if row.reaction is not Reaction.GONE else []
    return None if time is None else time - onset, wrong


# Runs: faults one after another, and the state in which they find the robot.


@dataclass(frozen=True)
class Verdict:
    """The result of a run. wrong: violations, a line each. took: s from the onset to the reaction."""

    name: str
    wrong: tuple[str, ...]
    took: float | None = None


class When(Enum):
    """State of the robot when the fault begins. approaching: on its approach trajectory."""

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
    """Make a bench with these faults. following: how long the performer is followed, s, unless the robot is idle or
    approaching. performer: None: the one of the rows."""
    idle = when is When.IDLE
    still = {When.IDLE: BOUNDS.idle_s, When.APPROACHING: BOUNDS.engaging_s}
    bench = Bench(
        FakeSender(seed=seed + 3),
        duration=still.get(when, BOUNDS.engaging_s + following),
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
        before = strikes[0].at - BOUNDS.stop_before_s
        bench.at(before, lambda: bench.guard.latch(StopCause.REQUESTED, "asked for"))
    for row, at in () if recorded else strikes:
        row.inject(bench, -1.0 if idle else at)
    return bench


def run_row(row: Row, *, when: When = When.MOVING) -> Bench:
    """Run a row. If the run outlives its reaction, only a stopping robot is observed to its end."""
    following = BOUNDS.onset_s + (row.after if when is When.MOVING else 0.0)
    bench = bench_of([Struck(row, BOUNDS.onset_s)], when=when, following=following)
    if BOUNDS.reactions[row.reaction.name].outlived:
        bench.leaves = when is not When.STOPPING
        if when is When.APPROACHING:
            bench.at(BOUNDS.onset_s + row.limit + BOUNDS.settled_s, bench.leave)
    bench.run()
    return bench


def verdict_of(row: Row, bench: Bench, *, when: When = When.MOVING) -> Verdict:
    """Judge the run of a row."""
    trace = bench.trace
    # The fault was injected after the first tick that ended late enough, or first took effect at its event.
    since = trace.armed if when is When.APPROACHING else trace.began
    late_enough = [tick.time for tick in trace.ticks if since is not None and tick.time >= since + BOUNDS.onset_s]
    onset = next(iter([*trace.acted[:1], *late_enough]), None)
    took: float | None = None
    wrong: list[str] = []
    match when:
        case When.IDLE:
            wrong = _idle(row, trace)
        case When.APPROACHING:
            # No performer is followed yet, so no sensor is left out, and no following resumes.
            if row.reaction is Reaction.OUT:
                row = replace(row, reaction=Reaction.MAY_HOLD)
            elif row.reaction is Reaction.RESUME:
                row = replace(row, reaction=Reaction.HOLD, limit=row.held)
            if onset is None or (trace.approach_ended is not None and trace.approach_ended <= onset):
                wrong = [f"nothing was approached: {trace.error or trace.said[-1:]}"]
            else:
                took, wrong = reacted(row, bench, onset)
        case When.MOVING:
            if onset is None:
                wrong = [f"no performer was followed: {trace.error or trace.said[-1:]}"]
            else:
                took, wrong = reacted(row, bench, onset)
                messages = (*trace.said, trace.stop.reason if trace.stop else "")
                if not any(re.search(row.said, text) for text in messages):
                    wrong.append(f"no message says {row.said!r}")
                if row.counted:
                    stream = bench.stream
                    parts = (stream.admission.refused, stream.decoder.dropped, stream.clock_map.dropped)
                    not_used = (*parts, stream.playout.dropped, stream.validity.refused)
                    if not any(part.reasons[row.counted] for part in not_used):
                        wrong.append(f"nothing was counted as {row.counted!r}")
                if trace.error:
                    wrong.append(f"it was raised: {trace.error}")
        case When.STOPPING:
            # The stop goes on to its end; where the bus is lost, torque goes off at once.
            if trace.latched is None or onset is None:
                wrong = ["the stop was not latched"]
            elif row.reaction is Reaction.GONE:
                wrong = let_go(trace, onset, row)
            elif row.reaction is Reaction.STANDS:
                took, wrong = _reaction(row, bench, onset)
            elif trace.first(STOPPED, trace.latched) is None:
                wrong = ["the stop did not come to its end"]
            elif row.reaction is Reaction.TORQUE_OFF:
                wrong = late("torque off", trace.torque_off_at(onset), onset, row.limit) + let_go(trace, onset, row)
    return Verdict(row.name, tuple(wrong + violations(bench, trace)), took)


def _idle(row: Row, trace: Trace) -> list[str]:
    if row.idle is Idle.ANY:
        return []
    if row.idle is Idle.GOES_ON:
        return [f"it did not begin: {trace.error}"] if trace.error or not trace.ticks else []
    wrong = [] if trace.error or (trace.gone is not None and not trace.left) else ["it began"]
    wrong += ["torque is on"] if any(trace.torque) else []
    wrong += [f"the refusal does not name {text!r}" for text in row.refusal if text not in trace.error]
    if row.idle is Idle.ONLY_READS:
        wrong += not_reads(list(packets(trace.sent)), but=frozenset((opencr.ID,)))  # its power switch is written
    return wrong


# Several faults in one run: the reaction to the first, and after two the stronger one, each in time.


def strength(row: Row) -> tuple[int, float]:
    """The strength of the reaction, and its limit, of which the longer one counts."""
    return BOUNDS.reactions[row.reaction.name].strength, row.limit


def least(row: Row) -> Row:
    """The row with the least reaction that its fault requires beside another one."""
    reaction, limit = row.reaction, row.limit
    waits = reaction is Reaction.STOP and limit > BOUNDS.soon_s and row.cause is StopCause.STALE_GOAL
    if reaction in (Reaction.RESUME, Reaction.STAND) or waits:
        reaction, limit = Reaction.HOLD, limit if reaction is Reaction.STAND else row.held
    return replace(row, reaction=reaction, limit=limit * row.chance)


def outdone(first: Row, second: Row, *, gap: float) -> Row:
    """The row whose reaction two faults, `gap` s apart, require from the later one on: the stronger one."""
    strongest = max((least(row) for row in (first, second) if row.name != second.hides), key=strength)
    if (first.suspends or second.suspends) and gap < first.limit:
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
    if needed >= BOUNDS.reactions["TORQUE_OFF"].strength:
        stopped = any(tick.state in STOPPED for tick in ticks)
        off = stopped or (torque_off_at is not None and torque_off_at <= last)
        return off or (row.reaction is Reaction.GONE and not _driving(trace, -inf, last))
    if any(tick.latched for tick in ticks) or trace.error:
        return True
    held = any(tick.state in HOLDING for tick in ticks if tick.time >= first)
    if held and needed <= BOUNDS.reactions["HOLD"].strength:
        return True
    if row.reaction is Reaction.REBASE:
        return trace.rebased is not None and trace.rebased <= last
    if row.reaction is Reaction.SLOW:
        return any(tick.slow <= BOUNDS.slow_share for tick in ticks)
    return row.reaction is Reaction.OUT and any(row.sensor in gone for time, gone in trace.out if time <= last)


def missing(trace: Trace, first: Struck, second: Struck, others: Sequence[Struck] = ()) -> list[str]:
    """The reactions to two faults that did not come in time, in words.

    The first is judged by itself if its time is over before the second. Otherwise the stronger reaction counts from the
    second on. others: faults that may hide one of them; where they overlap, the stronger reaction counts from the later
    one on.
    """
    one, other = (_onset_of(trace, struck.at) for struck in (first, second))
    if one is None:
        return []  # the run was over before
    needs: list[tuple[Row, float]] = []  # and from when on
    alone = least(first.row)
    if other is None or other > one + alone.limit:
        needs.append((alone, one))
    if other is not None:
        needs.append((outdone(first.row, second.row, gap=other - one), other))
    for another in others:
        at, hiding = _onset_of(trace, another.at), least(another.row)
        for index, (need, since) in enumerate(needs):
            overlap = at is not None and at - need.limit < since < at + hiding.limit
            if at is not None and overlap and strength(hiding) > strength(need):
                needs[index] = hiding, max(since, at)
    left = [need for need, since in needs if not reached(trace, need, one, since + need.limit)]
    return [f"{need.name}: not {BOUNDS.reactions[need.reaction.name].words} in time" for need in left]


def _onset_of(trace: Trace, at: float) -> float | None:
    """Return when a fault took effect, s: at the end of a tick, or at its event."""
    if trace.began is None:
        return None
    done = next((tick.time for tick in trace.ticks if tick.time >= (trace.began or 0.0) + at), None)
    if done is None:
        return None
    return next((cued for cued in trace.acted if done <= cued < done + BOUNDS.cued_s), done)


def judged_pair(first: Row, second: Row, *, at: float, gap: float, when: When = When.MOVING) -> Verdict:
    """Run and judge two faults, `gap` s apart, the first at `at` s of following. Only reactions of a moving robot are
    judged."""
    strikes = Struck(first, at), Struck(second, at + gap)
    moving = when is When.MOVING
    limits = (least(row).limit + 0.1 for row in (first, second) if moving)
    bench = bench_of(strikes, when=when, following=at + gap + max([BOUNDS.longer_s, *limits]))
    return verdict_of_pair(bench, bench.run(), *strikes, reacts=moving)


def verdict_of_pair(bench: Bench, trace: Trace, first: Struck, second: Struck, *, reacts: bool = True) -> Verdict:
    """Judge the run of two faults. reacts: whether their reactions are judged, too."""
    wrong = violations(bench, trace) + (missing(trace, first, second) if reacts else [])
    return Verdict(f"{first.row.name} + {second.row.name}", tuple(wrong))
