"""What every side of the comparison does."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import RATE, Motion
from benchmarks.observed_body import Watched, exact_self_distances

N_IK = 2
DT = 1.0 / RATE
POSTURE_GAIN = 0.05  # share of the way to the attractor per iteration
POSTURE_WEIGHT = 1e-3  # of squared joint errors beside squared metres, for sides whose levels are weights
LEADING_WEIGHT = 100.0  # of what must come first, for the same sides


class Side(Protocol):
    """A solver set up with the benchmark's tasks and limits."""

    name: str

    @property
    def failures(self) -> int:
        """Solves that gave no answer."""

    def aim(self, com: Floats, points: Floats) -> None:
        """Take the targets of the next frame: (3,) and (k, 3) m. Not timed."""

    def solve(self) -> None:
        """One frame of N_IK iterations. Timed."""

    def posture(self) -> Floats:
        """The posture reached, as q (nq,) of the body's own model."""


MakeSide = Callable[[BenchBody, Motion], Side]
"""Makes one that starts in the motion's first posture."""
SAME_M = 1e-5
"""Distances that differ by less are the same. PlaCo's come from Coal, which between boxes stops iterating at about
1e-6; MuJoCo's are ours to 1e-14."""


def peers(watched: Watched | None = None) -> list[MakeSide]:
    """PlaCo hard and soft, and mink, as far as they are installed; the others are named."""
    found: list[MakeSide] = []
    try:
        from benchmarks.peer_placo import Placo

        found += [partial(Placo, leading=leading, watched=watched) for leading in ("hard", "soft")]
    except ImportError as error:
        print(f"without PlaCo: {error}; install the extra 'bench'")
    try:
        from benchmarks.peer_mink import Mink

        found.append(partial(Mink, watched=watched))
    except ImportError as error:
        print(f"without mink: {error}; install the extra 'bench'")
    return found


def check_distances(name: str, theirs: Floats, watched: Watched, q: Floats) -> None:
    """Raises RuntimeError where a peer's distances (p,) m in a posture q (nq,) are not ours, pair by pair.

    How deep a pair overlaps is not compared: each library has its own measure of that.
    """
    ours = exact_self_distances(watched, q)
    off = np.abs(theirs - ours)[(ours > SAME_M) | (theirs > SAME_M) | np.isnan(theirs)]
    if not np.all(off <= SAME_M):
        raise RuntimeError(f"{name} sees distances that are not ours, by up to {off.max():.2g} m")
