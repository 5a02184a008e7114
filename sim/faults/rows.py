"""The rows of the fault table: what is injected, what a robot must do, and when; read from `rows.yaml`."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import yaml

from hardware.guard_state import StopCause
from sim.faults.bench import Bench
from sim.faults.inject import injection

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
    inject: Callable[[Bench, float], object]
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


TABLE = Path(__file__).with_name("rows.yaml")
ENUMS: dict[str, Any] = {"reaction": Reaction, "idle": Idle, "cause": StopCause, "then": StopCause}


def _row(entry: dict[str, Any]) -> Row:
    values: dict[str, Any] = {key: ENUMS[key][value] if key in ENUMS else value for key, value in entry.items()}
    return Row(**values | {"inject": injection(entry["inject"]), "refusal": tuple(entry.get("refusal", ()))})


ROWS: tuple[Row, ...] = tuple(_row(entry) for entry in yaml.safe_load(TABLE.read_text(encoding="utf-8")))
APPROACHED: tuple[Row, ...] = tuple(row for row in ROWS if row.approach)
"""Rows that are injected on the approach, too: the posture of a performer is neither solved nor gated there."""
