"""How near the geoms of two links come themselves: whether a shape around them hides that they come apart."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from retarget.fitting.geometry import solid_geoms
from retarget.fitting.ranges import JointRanges

__all__ = ["OwnDistances", "own_distances"]

SAMPLES = 2000
FAR = 1e3
"""[m]"""


@dataclass(frozen=True)
class OwnDistances:
    """Smallest and largest distance of two links' own geoms over the sample, m, negative inside."""

    smallest: float
    largest: float

    @property
    def may_collide(self) -> bool:
        """Whether they are sometimes apart and sometimes not."""
        return self.smallest < 0.0 < self.largest


def own_distances(model: Any, ranges: JointRanges, links: list[tuple[int, int]], *, seed: int) -> list[OwnDistances]:
    """For pairs of links of the compiled body `model`, over a sample of postures. Deterministic by `seed`."""
    import mujoco

    data = mujoco.MjData(model)
    geoms = [[(a, b) for a in solid_geoms(model, first) for b in solid_geoms(model, second)] for first, second in links]
    found = np.zeros((SAMPLES, len(links)))
    for row, q in enumerate(ranges.sample(np.random.default_rng(seed), SAMPLES)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for column, pairs in enumerate(geoms):
            found[row, column] = min(mujoco.mj_geomDistance(model, data, a, b, FAR, None) for a, b in pairs)
    return [OwnDistances(float(column.min()), float(column.max())) for column in found.T]
