"""Rows of the fault table, the rules of every run, and how long a moving robot took to react, and what is wrong."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import takewhile

import numpy as np

from hardware.guard_state import StopCause
from retarget.types import RunState
from sim.faults.bench import HOLDING, MOVING, STOPPED, STOPPING, Bench, Trace
from sim.faults.wire_checker import (
    Track,
    Written,
    after_latch,
    beyond_limits,
    clearance_of,
    collisions,
    detours,
    goal_writes,
    once,
    posture_tracks,
    still_moving,
    stood,
    too_fast,
    torque_off,
    torque_on_again,
    tracks,
    written,
)

# A row of the fault table: the fault, and the required reaction.


HELD_S = 0.150
"""Longest time from silence of the stream to the hold, s."""


class Reaction(Enum):
    """The required reaction of a moving robot."""

    NONE = "goes on"
    MAY_HOLD = "goes on, or holds"
    OUT = "the sensor takes no part"
    HOLD = "holds: brakes and stands, torque on"
    RESUME = "holds, and goes on by itself"
    REBASE = "follows the new clock"
    STAND = "brakes and stands, torque on"
    SLOW = "goes on at half its speed"
    STOP = "stops: brakes, goes to rest, torque off, latched"
    TORQUE_OFF = "torque off at once, latched"
    GONE = "the servos stop by themselves"
    GATED = "what is asked is not sent"


class Idle(Enum):
    """The required reaction to a fault before the bus is opened."""

    GOES_ON = "begins"
    REFUSES = "does not begin, torque off"
    ONLY_READS = "does not begin, nothing written"
    ANY = "begins or not, torque off in the end"


@dataclass(frozen=True)
class Row:
    """One fault. inject: injects it into a bench at a time (s after following began; below 0: before the bus opens).

    limit: s from its onset to the reaction; held: to the hold, where the reaction comes after one. cause, then: of the
    stop that is reported, and what ended its braking. sensor: the one that is judged for OUT. said: pattern that a
    message must match. counted: reason under which unused data must be counted. watchdog: s from the onset until every
    servo has stopped by itself; None: not judged. refusal: texts that the refusal of an idle run must have. back: s
    from the onset until data are good again; before back + 0.5 nothing goes on. after: s of following after the onset.
    ends: s from the onset until the run has ended. performer: the performer file. mass: run on the path of a real
    port, with simulated mechanics behind the wire. approach: it is injected on the approach too.

    Beside another fault: chance, by which factor chance may delay the reaction; stretches, by which factor long ticks
    delay the other's; suspends: the host is suspended for the limit; hides: name of a row whose fault it ends.
    """

    name: str
    inject: "Callable[[Bench, float], object]"
    reaction: Reaction = Reaction.NONE
    limit: float = 0.0
    held: float = HELD_S
    idle: Idle = Idle.GOES_ON
    cause: StopCause | None = None
    then: StopCause | None = None
    sensor: str = ""
    said: str = ""
    counted: str = ""
    watchdog: float | None = None
    refusal: tuple[str, ...] = ()
    back: float | None = None
    after: float = 0.55
    ends: float | None = None
    performer: str = "five"
    mass: bool = False
    approach: bool = False
    chance: float = 1.0
    stretches: float = 1.0
    suspends: bool = False
    hides: str = ""


# The rules of every run, whatever the fault.

REST_S = 0.35
"""Time from the beginning of a hold, or of a stop, until the robot stands, s."""
OFF_S = 4.0
"""From the beginning of a stop until torque is off, s; of a robot that is slow because a servo is warm, so much
longer."""
TO_REST_SHARE = 0.55
"""Share of the greatest speeds on the way to rest: the longest way of a joint, 2.4 rad, takes 1.9 s at this speed, with
a gentle rise and fall."""
AGAIN_SHARE, AGAIN_S = 0.25, 0.75
"""Share of the greatest speeds after following resumes, and for how long, s."""
STILL_WITHIN_S = 0.3
"""After a shorter hold, one of single ticks, the way back need not be slow, s."""
SETTLED = (*STOPPING, *STOPPED)
STANDING = (RunState.RETURN_TO_STANCE, RunState.GO_TO_REST, *STOPPED)
"""States of a robot that has braked, or has no torque any more."""
ORDINARY_STOPS = (StopCause.REQUESTED, StopCause.STALE_GOAL, StopCause.SOURCE)
"""Stops of a robot without a fault: it goes to rest before its torque goes off."""
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
    for first, last in trace.holds:
        wrong += [f"in a hold {text}" for text in still_moving(goal_tracks, first + REST_S, last - dt)]
    wrong += _speeds(bench, trace, goal_tracks, dt) + _stop_violations(bench, trace, goal_tracks, writes, dt)
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
    if off is None:
        if trace.gone is None and not trace.writes_fail:
            wrong.append("torque off was never commanded")
    elif off - begun > (allowed := OFF_S / min(tick.slow for tick in since)):
        wrong.append(f"torque went off {off - begun:.2f} s after the stop began, allowed {allowed:g} s")
    ended = trace.first(STOPPED, begun)
    if ended is not None:
        wrong += after_latch(writes, ended)
    wrong += too_fast(goal_tracks, begun + REST_S, trace.ended, share=TO_REST_SHARE, dt=dt)
    braking = list(takewhile(lambda tick: tick.state not in STANDING, since))
    wrong += late("at rest", braking[-1].time, begun, REST_S) if braking else []
    # With mass, goals lead the postures by the servos' deflection.
    shafts = posture_tracks(trace.postures, bench.robot.joint_map.servos) if bench.mass else goal_tracks
    if ended is not None and trace.stop is not None and trace.stop.cause in ORDINARY_STOPS and trace.stop.then is None:
        wrong += _not_at_rest(bench, shafts)
    to_rest = trace.first((RunState.GO_TO_REST,), begun)
    return wrong[:8] + detours(shafts, begun + REST_S if to_rest is None else to_rest, trace.ended)


def _not_at_rest(bench: Bench, shafts: list[Track]) -> list[str]:
    """Return the servos that did not go to posture `rest` in the end."""
    robot = bench.robot
    rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]
    rest_angles = dict(zip(robot.joint_map.joints, rest.tolist(), strict=True))
    off = {track.servo.label: float(track.angle[-1]) - rest_angles[track.servo.joint] for track in shafts}
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
STEP_M = 0.025
"""Most that a sensor moves from sample to sample after a hold, m: 0.6 m/s of blending back, 2 m/s of its own."""
MARGIN_M = 0.004
"""Margin of the observers of the profile, m."""
STOOD_S = 0.2

Judged = tuple[float | None, list[str]]


@dataclass(frozen=True)
class Seen:
    """A run, and the onset of its fault, s."""

    bench: Bench
    trace: Trace
    onset: float

    @cached_property
    def goals(self) -> tuple[float, list[Track]]:
        """The time between two ticks, s, and the goals of each servo."""
        return goals_of(self.bench, self.trace)

    def first(self, states: tuple[RunState, ...]) -> float | None:
        """When one of these states was first seen since."""
        return self.trace.first(states, self.onset)

    @property
    def stopped(self) -> float | None:
        """When a stop was latched since."""
        return self.trace.stopped(self.onset)


def let_go(trace: Trace, onset: float, row: Row) -> list[str]:
    """Return how many servos still drive after the row's time."""
    if row.watchdog is None:
        return []
    last = onset + row.watchdog
    still = len(trace.torque) - len({device for time, device in trace.let_go if onset <= time <= last})
    return [f"{still} servos still drove {row.watchdog:g} s after it"] if still else []


def late(what: str, time: float | None, onset: float, limit: float) -> list[str]:
    """Return a line for a reaction that did not come, or came too late."""
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
    wrong += _reason(row, seen.trace)
    return since, wrong + (let_go(seen.trace, seen.onset, row) if row.reaction is not Reaction.GONE else [])


def _reason(row: Row, trace: Trace) -> list[str]:
    """Return how the reported reason differs from the row's."""
    stop = trace.stop
    found = ((row.cause, stop.cause if stop else None), (row.then, stop.then if stop else None))
    return [
        f"the reported cause is {'none' if cause is None else cause.value}, not {wanted.value}"
        for wanted, cause in found
        if wanted is not None and cause is not wanted
    ]


def said(row: Row, trace: Trace) -> bool:
    """Return whether a message says what the row asks for."""
    return any(re.search(row.said, text) for text in (*trace.said, trace.stop.reason if trace.stop else ""))


def _none(row: Row, seen: Seen) -> Judged:
    hold, stop = seen.first(HOLDING), seen.stopped
    if row.reaction is Reaction.MAY_HOLD:
        hold = None
    return None, [f"it reacted after {time - seen.onset:.3f} s" for time in (hold, stop) if time is not None][:1]


def _out(row: Row, seen: Seen) -> Judged:
    out = next((time for time, gone in seen.trace.out if time >= seen.onset and row.sensor in gone), None)
    wrong = late("left out", out, seen.onset, row.limit)
    return out, wrong + (["the robot held"] if seen.first(HOLDING) is not None else [])


def _hold(row: Row, seen: Seen) -> Judged:
    hold = seen.first(HOLDING)
    wrong = late("held", hold, seen.onset, row.limit if row.reaction is Reaction.HOLD else row.held)
    wrong += ["it stopped"] if seen.stopped is not None else []
    on = None if hold is None else seen.trace.first(MOVING, hold)
    if row.back is not None and on is not None and on - seen.onset < row.back + HEALTHY_S:
        wrong.append(f"it went on after {on - seen.onset:.3f} s, data were good from {row.back:g} s on")
    jump = max((step for time, step in seen.trace.steps if on is not None and time >= on), default=0.0)
    if jump > STEP_M:
        wrong.append(f"it went on with a jump: {jump:.3f} m of a sensor in a tick")
    if row.reaction is Reaction.HOLD:
        return hold, wrong
    return on, wrong + late("on its way again", on, seen.onset, row.limit)


def _rebase(row: Row, seen: Seen) -> Judged:
    again, hold = seen.trace.rebased, seen.first(HOLDING)
    wrong = late("rebased", again, seen.onset, row.limit)
    if hold is not None:
        on = seen.trace.first(MOVING, hold)
        wrong += late("on its way again", on, seen.onset, row.limit + BACK_S)
    return again, wrong


def _stand(row: Row, seen: Seen) -> Judged:
    """Judge the goals alone: at rest in time, torque on."""
    (dt, goal_tracks), end = seen.goals, seen.first(STOPPING) or seen.trace.ended
    wrong = still_moving(goal_tracks, seen.onset + row.limit + REST_S, end - dt)
    return None, wrong + (["it stopped"] if seen.stopped is not None else [])


def _gated(row: Row, seen: Seen) -> Judged:
    """Judge that the asked postures came nearer than the margin, and the robot stood, but for a tick that the moving
    limbs leave it. Sent goals are judged anyway."""
    robot, asked = seen.bench.robot, seen.trace.asked
    postures = np.tile(robot.body.qpos0, (len(asked), 1))
    postures[:, robot.servo_columns] = [posture for _, posture in asked]
    closest = clearance_of(robot, postures).smallest if asked else None
    wrong = [] if closest is not None and closest < MARGIN_M else ["what was asked for was no danger"]
    (dt, goal_tracks), end = seen.goals, seen.first(STOPPING) or seen.trace.ended
    return None, wrong + still_moving(goal_tracks, end - STOOD_S, end - dt, ticks=1)


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
    Reaction.TORQUE_OFF: _torque_off,
    Reaction.GONE: _gone,
}
