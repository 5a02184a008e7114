"""mink with its collision avoidance limit on the pairs that our observers look at."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import mink
import mujoco
import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.observed_body import Watched
from benchmarks.observed_shapes import PREFIX, mujoco_model
from benchmarks.peer_mink import Mink

FAR = 100.0  # m, so that every distance is measured


class ObservedMink(Mink):
    """mink; its detection distance is our influence, its least distance our margin."""

    def __init__(self, body: BenchBody, motion: Motion, *, watched: Watched) -> None:
        self.watched = watched
        super().__init__(body, motion)
        seen = watched.observers
        self.pairs = [(PREFIX + seen.names[a], PREFIX + seen.names[b]) for a, b in seen.pairs.tolist()]
        self.avoidance = mink.CollisionAvoidanceLimit(
            self.model,
            [([a], [b]) for a, b in self.pairs],
            minimum_distance_from_collisions=float(seen.margin.max()),
            collision_detection_distance=float(seen.influence.max()),
        )
        self.limits = [*self.limits, self.avoidance]

    def make_model(self, body: BenchBody) -> Any:
        """The body with our shapes."""
        return mujoco_model(self.watched)

    def distances(self) -> Floats:
        """What MuJoCo finds for every pair (p,) m where it stands; NaN for what mink does not look at."""
        geoms = [(self.model.geom(a).id, self.model.geom(b).id) for a, b in self.pairs]
        looked_at = {frozenset(pair) for pair in self.avoidance.geom_id_pairs}
        data, ends = self.configuration.data, np.zeros(6)
        return np.array(
            [
                mujoco.mj_geomDistance(self.model, data, a, b, FAR, ends) if {a, b} in looked_at else np.nan
                for a, b in geoms
            ]
        )

    @property
    def pair_count(self) -> int:
        """Pairs that it looks at."""
        return len(self.avoidance.geom_id_pairs)


def observed_mink(watched: Watched) -> Callable[[BenchBody, Motion], ObservedMink]:
    """A side for this body, to be made for a motion."""
    return partial(ObservedMink, watched=watched)
