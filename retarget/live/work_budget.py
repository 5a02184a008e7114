"""How much of what arrived is decoded in one tick: work that is counted, so that a replay decides as the run did."""

from retarget.sources.stream_frame import StreamDecoder

__all__ = ["WORK_PER_POLL", "WorkBudget", "work_of"]

WORK_PER_POLL = 3_000.0
"""Of one poll, three eighths of a tick: the bus needs as much. A unit is about a microsecond: 12 datagrams of
SlimeVR; a tick has two."""
PER_DATAGRAM, PER_BYTE, PER_FRAME = 30.0, 1.0 / 40.0, 150.0
"""What every datagram counts, and each frame in it: clock, trust and playout cost more than its decoding."""


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
    """Units beyond their length that a decoder has counted for its datagrams so far; 0 for one that counts none."""
    # A look for a protocol would cost more than a decoded datagram.
    return float(getattr(decoder, "work", 0.0))
