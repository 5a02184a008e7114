"""What every side of the comparison does."""

from __future__ import annotations

from typing import Protocol

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import RATE, Motion

N_IK = 5
DT = 1.0 / RATE
POSTURE_GAIN = 0.05  # share of the way to the attractor per iteration
POSTURE_WEIGHT = 1e-3  # of squared joint errors beside squared metres, for sides whose levels are weights
LEADING_WEIGHT = 100.0  # of what must come first, for the same sides


class Side(Protocol):
    """A solver set up with the benchmark's tasks and limits."""

    name: str

    def __init__(self, body: BenchBody, motion: Motion) -> None:
        """Start in the motion's first posture."""

    @property
    def failures(self) -> int:
        """Solves that gave no answer."""

    def aim(self, com: Floats, points: Floats) -> None:
        """Take the targets of the next frame: (3,) and (k, 3) m. Not timed."""

    def solve(self) -> None:
        """One frame of N_IK iterations. Timed."""

    def posture(self) -> Floats:
        """The posture reached, as q (nq,) of the body's own model."""
