"""How long the reaction to a fault of a moving robot took, and what is wrong with it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hardware.guard_state import GuardState
from sim.faults.always import REST_S
from sim.faults.bench import Bench
from sim.faults.reaction import Reaction, Row
from sim.faults.trace import Trace
from sim.faults.wire_checker import Track, hasty, once, restless, stood, tracks
from sim.faults.wire_clearance import clearance_of
from sim.faults.wire_packets import goal_writes, torque_off, written

HEALTHY_S = 0.5
"""So long data must be good before a hold ends."""
BACK_S = 0.6
"""So long after data are good again a robot goes on, at the latest."""
HELD_S = 0.150
"""So soon a silent stream is held."""
HALF = 0.5
STEP_M = 0.025
"""From sample to sample no sensor goes farther, m, once a hold is over: 0.6 m/s on the way back, 2 m/s of its own."""
MARGIN_M = 0.004
"""What the observers of the profile keep, m."""
STOOD_S = 0.2

Judged = tuple[float | None, list[str]]


@dataclass(frozen=True)
class Seen:
    """A run, and when it was hurt, s."""

    bench: Bench
    trace: Trace
    onset: float

    @property
    def dt(self) -> float:
        """s between ticks."""
        return 1.0 / self.bench.robot.profile.safety.rate_hz

    @cached_property
    def ways(self) -> list[Track]:
        """The goals of each servo."""
        goals = goal_writes(written(self.trace.sent))
        return tracks(once(goals, within=0.5 * self.dt), self.bench.robot.joint_map.servos)

    def first(self, state: GuardState) -> float | None:
        """When a state was first seen since."""
        return self.trace.first(state, self.onset)

    @property
    def stopped(self) -> float | None:
        """When a stop was latched since."""
        return next((tick.time for tick in self.trace.ticks if tick.time >= self.onset and tick.latched), None)

    @staticmethod
    def cut(trace: Trace, onset: float) -> float | None:
        """When torque was told to go off at once, or the guard had given up the bus."""
        seen = (torque_off(written(trace.sent), onset), trace.first(GuardState.STOPPED, onset))
        return min((time for time in seen if time is not None), default=None)

    @staticmethod
    def let_go(trace: Trace, onset: float, row: Row) -> list[str]:
        """Servos that still drive after the row's time."""
        if row.watchdog is None:
            return []
        last = onset + row.watchdog
        gone = {device for time, device in trace.let_go if onset <= time <= last}
        still = len(trace.torque) - len(gone)
        return [f"{still} servos still drove {row.watchdog:g} s after it"] if still else []


def late(what: str, time: float | None, onset: float, limit: float) -> list[str]:
    """Words for a reaction that did not come, or too late."""
    if time is None:
        return [f"not {what}"]
    return [f"{what} after {time - onset:.3f} s, allowed {limit:g} s"] if time - onset > limit + 1e-9 else []


def reacted(row: Row, seen: Seen) -> Judged:
    """s from the onset to the reaction, and what is wrong with it."""
    took, wrong = _JUDGES[row.reaction](row, seen)
    ended = seen.trace.ended - seen.onset
    if row.ends is not None and ended > row.ends:
        wrong.append(f"it ended after {ended:.1f} s, allowed {row.ends:g} s")
    since = None if took is None else took - seen.onset
    return since, wrong + (Seen.let_go(seen.trace, seen.onset, row) if row.reaction is not Reaction.GONE else [])


def _none(row: Row, seen: Seen) -> Judged:
    hold, stop = seen.first(GuardState.HOLDING), seen.stopped
    if row.reaction is Reaction.MAY_HOLD:
        hold = None
    return None, [f"it reacted after {time - seen.onset:.3f} s" for time in (hold, stop) if time is not None][:1]


def _out(row: Row, seen: Seen) -> Judged:
    out = next((time for time, gone in seen.trace.out if time >= seen.onset and row.sensor in gone), None)
    wrong = late("left out", out, seen.onset, row.limit)
    return out, wrong + (["the robot held"] if seen.first(GuardState.HOLDING) is not None else [])


def _hold(row: Row, seen: Seen) -> Judged:
    hold = seen.first(GuardState.HOLDING)
    wrong = late("held", hold, seen.onset, row.limit if row.reaction is Reaction.HOLD else HELD_S)
    wrong += ["it stopped"] if seen.stopped is not None else []
    on = None if hold is None else seen.trace.first(GuardState.MOVING, hold)
    if row.back is not None and on is not None and on - seen.onset < row.back + HEALTHY_S:
        wrong.append(f"it went on after {on - seen.onset:.3f} s, data were good from {row.back:g} s on")
    leap = max((step for time, step in seen.trace.steps if on is not None and time >= on), default=0.0)
    if leap > STEP_M:
        wrong.append(f"it went on by a leap: {leap:.3f} m of a sensor in a tick")
    if row.reaction is Reaction.HOLD:
        return hold, wrong
    return on, wrong + late("on its way again", on, seen.onset, row.limit)


def _rebase(row: Row, seen: Seen) -> Judged:
    again, hold = seen.trace.rebased, seen.first(GuardState.HOLDING)
    wrong = late("understood", again, seen.onset, row.limit)
    if hold is not None:
        on = seen.trace.first(GuardState.MOVING, hold)
        wrong += late("on its way again", on, seen.onset, row.limit + BACK_S)
    return again, wrong


def _stand(row: Row, seen: Seen) -> Judged:
    """From the goals alone: at rest in time, torque on."""
    end = seen.first(GuardState.STOPPING) or seen.trace.ended
    wrong = restless(seen.ways, seen.onset + row.limit + REST_S, end - seen.dt)
    return None, wrong + (["it stopped"] if seen.stopped is not None else [])


def _gated(row: Row, seen: Seen) -> Judged:
    """What was asked for came nearer than the margin, and the robot stood; what was sent is looked at in any case."""
    robot, asked = seen.bench.robot, seen.trace.asked
    postures = np.tile(robot.body.qpos0, (len(asked), 1))
    postures[:, robot.servo_columns] = [posture for _, posture in asked]
    closest = clearance_of(robot, postures).smallest if asked else None
    wrong = [] if closest is not None and closest < MARGIN_M else ["what was asked for was no danger"]
    end = seen.first(GuardState.STOPPING) or seen.trace.ended
    return None, wrong + restless(seen.ways, end - STOOD_S, end - seen.dt)


def _slow(row: Row, seen: Seen) -> Judged:
    slow = next((tick.time for tick in seen.trace.ticks if tick.time >= seen.onset and tick.slow <= HALF), None)
    wrong = late("slow", slow, seen.onset, row.limit) + (["it stopped"] if seen.stopped is not None else [])
    return slow, wrong + hasty(seen.ways, seen.onset + row.limit, seen.trace.ended, share=HALF, dt=seen.dt)


def _stop(row: Row, seen: Seen) -> Judged:
    stop = seen.stopped
    wrong = late("stopped", stop, seen.onset, row.limit)
    first = next((tick.state for tick in seen.trace.ticks if tick.time == stop), None)
    if stop is not None and first is GuardState.STOPPED and not stood(seen.ways, stop):
        wrong.append("it did not brake")
    if seen.trace.stop is None or seen.trace.first(GuardState.STOPPED, seen.onset) is None:
        wrong.append("it was not latched")
    return stop, wrong


def _cut(row: Row, seen: Seen) -> Judged:
    cut = Seen.cut(seen.trace, seen.onset)
    wrong = late("torque off", cut, seen.onset, row.limit)
    return cut, wrong + ([] if seen.first(GuardState.STOPPED) is not None else ["it was not latched"])


def _gone(row: Row, seen: Seen) -> Judged:
    wrong = Seen.let_go(seen.trace, seen.onset, row)
    latched = seen.first(GuardState.STOPPED)
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
    Reaction.CUT: _cut,
    Reaction.GONE: _gone,
}
