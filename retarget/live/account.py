"""What a live run tells of its stream afterwards: what came, what was not used, who was lost, how often it held."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from retarget.live.admission import Admission
from retarget.live.trust_state import StateArray, TrustState

if TYPE_CHECKING:
    from retarget.live.stream import LiveStream

__all__ = ["Holds", "LiveReport", "Tally", "live_report"]

MS = 1e3


@dataclass(frozen=True)
class Holds:
    """Times that the performer was not followed after having been, and how long in all, s."""

    count: int
    s: float


@dataclass(frozen=True)
class LiveReport:
    """A live run's stream.

    frames, datagrams: of the sender from the beginning on, the measuring included. dropped: what was not used, by
    reason: datagrams, frames out of time, and poses that could not be believed. refused: senders that were not listened
    to. lost_s: how long each sensor was not believed while the robot followed or held, those that ever were not.
    playout_delay_ms: in the end. person: the name under which the performer's size is kept, null without one.
    """

    address: str
    frames: int
    datagrams: int
    dropped: dict[str, int]
    refused: tuple[str, ...]
    lost_s: dict[str, float]
    holds: Holds
    playout_delay_ms: float
    person: str | None


class Tally:
    """Counts ticks. names: of the k sensors; dt: s between ticks."""

    def __init__(self, names: tuple[str, ...], dt: float) -> None:
        self._names, self._dt = names, dt
        self._lost = np.zeros(len(names), dtype=int)
        self._holds = self._held = 0
        self._followed = False  # in the tick before
        self._ever = False

    def count(self, states: StateArray, *, followed: bool) -> None:
        """One tick of following. states (k,): a `TrustState` each; followed: whether the performer was."""
        if np.count_nonzero(states):  # FRESH is 0
            self._lost += (states != TrustState.FRESH) & (states != TrustState.NOT_WORN)
        self._holds += self._followed and not followed
        self._followed, self._ever = followed, self._ever or followed
        self._held += self._ever and not followed

    @property
    def holds(self) -> Holds:
        """So far."""
        return Holds(self._holds, self._held * self._dt)

    @property
    def lost_s(self) -> dict[str, float]:
        """s, of every sensor that was lost so far."""
        return {name: ticks * self._dt for name, ticks in zip(self._names, self._lost.tolist(), strict=True) if ticks}


def live_report(stream: "LiveStream", tally: Tally, *, address: str, person: str | None) -> LiveReport:
    """Of a run that has ended."""
    decoder, receiver, trust = stream.decoder.dropped, stream.receiver.dropped, stream.trust.refused
    dropped = stream.admission.refused.reasons + decoder.reasons + receiver.reasons + trust.reasons
    dropped += stream.clock_map.dropped.reasons + stream.playout.dropped.reasons
    return LiveReport(
        address=address,
        frames=stream.frames,
        datagrams=stream.arrived,
        dropped=dict(dropped.most_common()),
        refused=_refused(stream.admission),
        lost_s=tally.lost_s,
        holds=tally.holds,
        playout_delay_ms=MS * stream.playout.delay,
        person=person,
    )


def _refused(admission: Admission) -> tuple[str, ...]:
    return tuple(f"{address}: {reason}" for address, reason in admission.named)
