"""What every live stream is decoded into: the poses of one datagram, by the sender's own names, in our axes."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from retarget.frames import BoolArray
from retarget.rotations import FloatArray

__all__ = ["MAX_DATAGRAM", "MAX_POSES", "Dropped", "StreamDecoder", "StreamFrame"]

MAX_DATAGRAM = 65_536
"""Bytes of the longest datagram that is looked at."""
MAX_POSES = 256
"""Poses of one datagram; what is beyond is dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamFrame:
    """The poses that one datagram told, all of one performer. World REP-103 (x forward, y left, z up).

    names: the sender's own names of k poses, each once; the same tuple as long as they do not change. position (k, 3)
    m and orientation (k, 4) wxyz: NaN where the datagram has none. tracked (k,): whether the sender vouches for the
    pose; True where it says nothing of it. stamp: when it was captured, s of the sender's clock, and number: of the
    frame; both as they came (they may jump, wrap or repeat), None where the sender tells none.
    """

    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray
    tracked: BoolArray
    stamp: float | None = None
    number: int | None = None

    def __post_init__(self) -> None:
        count = len(self.names)
        shapes = self.position.shape, self.orientation.shape, self.tracked.shape
        assert shapes == ((count, 3), (count, 4), (count,)), f"{count} names, and arrays of shape {shapes}"
        assert self.tracked.dtype == np.bool_, f"tracked is of {self.tracked.dtype}, not of bool"


@dataclass(eq=False)
class Dropped:
    """What was not used, by reason; `reasons` are few and written down in the decoder, never text from outside."""

    reasons: Counter[str] = field(default_factory=Counter)

    def note(self, reason: str) -> None:
        """Count one."""
        self.reasons[reason] += 1

    @property
    def count(self) -> int:
        """Of all reasons."""
        return self.reasons.total()


class StreamDecoder(Protocol):
    """Datagrams of one sender in, frames out. It holds bounded state and reads no clock."""

    dropped: Dropped

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frames of one datagram, mostly one. Never raises: what cannot be used is counted in `dropped`."""
        ...
