"""How much of what arrived is decoded in one tick: work that is counted, so that a replay decides as the run did."""

from typing import Protocol, runtime_checkable

from retarget.sources.stream_frame import StreamDecoder

__all__ = ["WORK_PER_POLL", "WorkBudget", "Worked", "work_of"]

WORK_PER_POLL = 6_000.0
"""Of one poll, three quarters of a tick. A unit is about a microsecond: 44 datagrams of SlimeVR; a tick has two."""
PER_DATAGRAM, PER_BYTE, PER_FRAME = 30.0, 1.0 / 40.0, 40.0
"""What every datagram counts, and each frame in it."""


@runtime_checkable
class Worked(Protocol):
    """A decoder that some datagrams cost more than their length tells. work: units beyond it, so far."""

    @property
    def work(self) -> float:
        """Never falls."""
        ...


class WorkBudget:
    """What is left of one poll's work."""

    def __init__(self) -> None:
        self._left = WORK_PER_POLL

    @property
    def spent(self) -> bool:
        """Whether the next datagram has to wait for the next poll. The first one of a poll never has to."""
        return self._left <= 0.0

    def charge(self, payload: bytes, *, frames: int, work: float) -> None:
        """One datagram was decoded. work: units that its decoder counted for it."""
        self._left -= PER_DATAGRAM + PER_BYTE * len(payload) + PER_FRAME * frames + work


def work_of(decoder: StreamDecoder) -> float:
    """Units that a decoder has counted so far; 0 for one whose work goes by length."""
    return decoder.work if isinstance(decoder, Worked) else 0.0
