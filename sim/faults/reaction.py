"""What a row of the fault table says: what is done to a run, and what the robot has to do about it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim.faults.bench import Bench

__all__ = ["EVER", "Idle", "Reaction", "Row"]

EVER = math.inf


class Reaction(Enum):
    """What a robot that moves has to do."""

    NONE = "goes on"
    MAY_HOLD = "goes on, or holds"
    OUT = "the sensor takes no part"
    HOLD = "holds: brakes and stands, torque on"
    RESUME = "holds, and goes on by itself"
    REBASE = "understands the clock anew"
    STAND = "brakes and stands, torque on"
    SLOW = "goes on at half its speed"
    STOP = "stops: brakes, is parked, torque off, latched"
    CUT = "torque off at once, latched"
    GONE = "the servos stop by themselves"
    GATED = "what is asked is not sent"


class Idle(Enum):
    """What a run has to do that is hurt before its bus is opened."""

    GOES_ON = "begins"
    REFUSES = "does not begin, torque off"
    ONLY_READS = "does not begin, nothing written"
    ANY = "begins or not, torque off in the end"


@dataclass(frozen=True)
class Row:
    """One fault. hurt: does it to a bench at a time (s after following began; below 0: before the bus is opened).

    limit: s from its onset to the reaction. sensor: whose place is judged for OUT. said: what a person has to be told.
    watchdog: s from the onset until every servo stands by itself; None: not asked. refusal: what the refusal of an idle
    run must name, all of it. back: s after the onset data are good again, so that before back + 0.5 nothing goes on.
    counted: by which reason what comes has to be counted as not used.
    after: s of following after the onset. ends: s from the onset until the run has ended. performer: who wears what.
    """

    name: str
    reaction: Reaction
    limit: float
    hurt: "Callable[[Bench, float], object]"
    idle: Idle = Idle.GOES_ON
    sensor: str = ""
    said: str = ""
    counted: str = ""
    watchdog: float | None = None
    refusal: tuple[str, ...] = ()
    back: float | None = None
    after: float = 0.55
    ends: float | None = None
    performer: str = "five"
