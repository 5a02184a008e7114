"""Proof that a peer looks at the pairs that our observers look at, and sees the same distances."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from benchmarks.bodies import Floats
from benchmarks.observed_body import Watched, exact_self_distances
from benchmarks.side import Side

SAME_M = 1e-5
"""Distances that differ by less are the same. PlaCo's come from Coal, which between boxes stops iterating at about
1e-6; MuJoCo's are ours to 1e-14."""


@runtime_checkable
class Looking(Protocol):
    """A side that can list what it looks at."""

    @property
    def pair_count(self) -> int:
        """Pairs that it looks at."""

    def distances(self) -> Floats:
        """What it finds for each of our pairs (p,) m where it stands; NaN for a pair that it does not look at."""

    def posture(self) -> Floats:
        """See `Side`."""


def check_pairs(watched: Watched, side: Side) -> None:
    """Raises RuntimeError where a peer's pairs or distances are not ours.

    How deep a pair overlaps is not compared: each library has its own measure of that.
    """
    if not isinstance(side, Looking):
        return
    expected = len(watched.observers.pairs)
    if side.pair_count != expected:
        raise RuntimeError(f"{side.name} looks at {side.pair_count} pairs, we at {expected}")
    ours, theirs = exact_self_distances(watched, side.posture()), side.distances()
    off = np.abs(theirs - ours)[(ours > SAME_M) | (theirs > SAME_M) | np.isnan(theirs)]
    if not np.all(off <= SAME_M):
        raise RuntimeError(f"{side.name} sees distances that are not ours, by up to {off.max():.2g} m")
