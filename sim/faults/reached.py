"""What a robot has at least to do after one fault, or after two that come one upon the other; and whether it did."""

from dataclasses import dataclass, replace

from hardware.guard_state import GuardState
from sim.faults.reaction import Reaction, Row
from sim.faults.reactions import HALF, HELD_S, Seen
from sim.faults.trace import Trace

__all__ = ["HIDDEN", "Need", "need_of", "outdone", "reached", "stronger"]

SOON_S = 2.0
"""A stop that has more time than this is preceded by a hold."""


@dataclass(frozen=True)
class Need:
    """reaction: at least; limit: s from the onset; name: of the row that asks for it; words: what must be seen. sensor:
    who has to be left out. watchdog: s until every servo stands by itself."""

    name: str
    reaction: Reaction
    limit: float
    words: str = ""
    sensor: str = ""
    watchdog: float | None = None


STRENGTH = {
    Reaction.NONE: 0,
    Reaction.MAY_HOLD: 0,
    Reaction.GATED: 0,
    Reaction.OUT: 1,
    Reaction.SLOW: 2,
    Reaction.REBASE: 3,
    Reaction.HOLD: 4,
    Reaction.STOP: 5,
    Reaction.CUT: 6,
    Reaction.GONE: 7,
}
"""Who does the stronger thing has done the weaker."""
WORDS = {
    Reaction.OUT: "left out",
    Reaction.SLOW: "slow",
    Reaction.REBASE: "understood",
    Reaction.HOLD: "held",
    Reaction.STOP: "stopped",
    Reaction.CUT: "torque off",
    Reaction.GONE: "stood by watchdogs",
}
HIDDEN = {("servo too hot", "servo warm"): "servo too hot"}
"""Of two rows, one after the other, the one whose fault is not to be seen, or no more: the servo cools down."""
BY_CHANCE, LUCK = ("30 % of packets damaged", "30 % of answers damaged"), 2.0
"""Rows that are known by what share of the cycles of late was hurt, and by how much later that may be by chance: of 8
seeds one needs 0.142 s instead of 0.1 s."""
SLEEPS = "stopped for a second"
"""Its host does nothing in the meantime."""
DAWDLES, DAWDLING = "deadline missed", 2.2
"""Its ticks last so many times as long, and what is counted in ticks takes as much longer: the robot holds by then."""


def need_of(row: Row) -> Need:
    """What one fault asks for."""
    reaction, limit = row.reaction, row.limit
    if reaction in (Reaction.RESUME, Reaction.STAND) or (reaction is Reaction.STOP and limit > SOON_S):
        reaction, limit = Reaction.HOLD, limit if reaction is Reaction.STAND else HELD_S
    if row.name in BY_CHANCE:
        limit *= LUCK
    words = WORDS.get(reaction, "")
    return Need(row.name, reaction, limit, words, sensor=row.sensor, watchdog=row.watchdog)


def outdone(first: Row, second: Row, *, apart: float) -> Need:
    """What two faults ask for that are `apart`, s, from the later one on: the stronger of the two."""
    one, other = need_of(first), need_of(second)
    hidden = HIDDEN.get((first.name, second.name))
    one, other = (Need(need.name, Reaction.NONE, 0.0) if need.name == hidden else need for need in (one, other))
    strongest = stronger(one, other)
    if SLEEPS in (first.name, second.name) and apart < first.limit:
        strongest = replace(strongest, limit=strongest.limit + max(first.limit, second.limit))
    if DAWDLES in (first.name, second.name) and strongest.name != DAWDLES:
        strongest = replace(strongest, limit=DAWDLING * strongest.limit)
    return strongest


def stronger(one: Need, other: Need) -> Need:
    """Which of two asks for more; of the same, the one that has longer."""
    return max(one, other, key=lambda need: (STRENGTH[need.reaction], need.limit))


def reached(trace: Trace, need: Need, first: float, last: float) -> bool:
    """Whether the robot did between two times, s, what was needed, or more."""
    strength = STRENGTH[need.reaction]
    ticks = [tick for tick in trace.ticks if tick.time <= last + 1e-9]
    if strength == 0 or (trace.gone is not None and trace.gone <= last and need.reaction is not Reaction.GONE):
        return True
    cut = Seen.cut(trace, first)
    if strength >= STRENGTH[Reaction.CUT]:
        stopped = any(tick.state is GuardState.STOPPED for tick in ticks)
        off = stopped or (cut is not None and cut <= last)
        return off or (need.reaction is Reaction.GONE and not _driving(trace, last))
    if any(tick.latched for tick in ticks) or trace.error:
        return True
    since = [tick for tick in ticks if tick.time >= first]
    if strength <= STRENGTH[Reaction.HOLD] and any(tick.state is GuardState.HOLDING for tick in since):
        return True
    if need.reaction is Reaction.REBASE:
        return trace.rebased is not None and trace.rebased <= last
    if need.reaction is Reaction.SLOW:
        return any(tick.slow <= HALF for tick in ticks)
    if need.reaction is Reaction.OUT:
        return any(need.sensor in gone for time, gone in trace.out if time <= last)
    return False


def _driving(trace: Trace, last: float) -> int:
    """Servos that nothing has let go of by a time, s."""
    return len(trace.torque) - len({device for time, device in trace.let_go if time <= last})
