"""Random pairs of faults: the same seed gives the same run."""

import random

from sim.faults.judge import Verdict, judged_pair
from sim.faults.rows import ROWS

__all__ = ["judged_seed"]


def judged_seed(seed: int) -> Verdict:
    """Two rows at random times, maybe the same one twice."""
    chance = random.Random(seed)
    first, second = chance.choice(ROWS), chance.choice(ROWS)
    return judged_pair(first, second, at=chance.uniform(0.2, 1.5), gap=chance.choice((0.0, 0.02, 0.2, 0.8)), seed=seed)
