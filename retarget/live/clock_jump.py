"""A sender's clock that leapt: which way, and how many datagrams must agree before it is believed."""

from dataclasses import dataclass
from enum import StrEnum
from math import inf

__all__ = ["PLENTY", "ClockJump", "JumpKind", "OddRun"]

ALIKE_S = 0.020
"""Datagrams of one leap agree on the new offset to this, jitter included."""
ENOUGH = 3
"""So many that agree are believed: one or two may be strays."""
SPREAD_S = 0.010
"""They arrive over at least this time: a backlog that arrives at once tells nothing of the clock."""
PLENTY = 8
"""So many without any agreement are believed too, when nothing else is usable."""


class JumpKind(StrEnum):
    """What the sender's clock did."""

    RESTARTED = "restarted"
    FORWARD = "forward"
    BACK = "back"


@dataclass(frozen=True, slots=True)
class ClockJump:
    """A leap of the sender's clock, or of the path from it. shift: s by which local minus sender time grew."""

    kind: JumpKind
    arrival: float
    shift: float


class OddRun:
    """Consecutive datagrams that do not fit the present estimate. `least`: their least (arrival - stamp), s."""

    def __init__(self) -> None:
        self.least = inf
        self._agreed = 0
        self._count = 0
        self._since = self._agreed_since = self._gap = self._stamp = 0.0

    def clear(self) -> None:
        """One that fits came between."""
        self._agreed = self._count = 0
        self.least = inf

    def note(self, arrival: float, stamp: float, step: float) -> None:
        """One more. step: s, of the sender's clock."""
        gap = arrival - stamp
        if self._count == 0:
            self._since = arrival
        self._count += 1
        if self._agreed and abs(gap - self._gap) <= ALIKE_S + step and stamp > self._stamp:
            self._agreed += 1
            self.least = min(self.least, gap)
        else:
            self._agreed, self._agreed_since, self.least = 1, arrival, gap
        self._gap, self._stamp = gap, stamp

    def is_believed(self, arrival: float, *, patience: float) -> bool:
        """Whether the clock leapt: enough agree, or nothing else came for `patience` s."""
        agree = self._agreed >= ENOUGH and arrival - self._agreed_since >= SPREAD_S
        return agree or (self._count >= PLENTY and arrival - self._since >= patience)
