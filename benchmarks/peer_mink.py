"""mink: one weighted quadratic program per iteration; with its collision avoidance limit where observers are given."""

from __future__ import annotations

from typing import Any

import mink
import mujoco
import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.observed_body import Watched
from benchmarks.observed_shapes import PREFIX, mujoco_model
from benchmarks.side import DT, LEADING_WEIGHT, N_IK, POSTURE_GAIN, POSTURE_WEIGHT

FAR = 100.0  # m, so that every distance is measured


class Mink:
    """mink with daqp; its costs multiply errors, so they are the roots of our weights.

    watched: with these observers; its detection distance is their influence, its least distance their margin.
    """

    name = "mink"

    def __init__(self, body: BenchBody, motion: Motion, *, watched: Watched | None = None) -> None:
        model = self.model = body.reduced_model() if watched is None else mujoco_model(watched)
        self.failures = 0
        joints = [body.model.joint_index(model.joint(i).name) for i in range(1, model.njnt)]
        self.columns = np.concatenate([np.arange(7), body.model.joint_qpos[joints]]).astype(int)
        self.whole = np.zeros(body.model.nq)
        self.configuration = mink.Configuration(model)
        self.configuration.update(motion.start[self.columns])
        leading = np.sqrt(LEADING_WEIGHT)
        self.com = mink.ComTask(cost=leading * np.array(motion.com_rows))
        self.points = [
            mink.FrameTask(f"bench_{p.name}", "site", leading if "ankle" in p.name else 1.0, 0.0) for p in body.points
        ]
        cost = np.full(model.nv, np.sqrt(POSTURE_WEIGHT))
        cost[:6] = 0.0
        posture = mink.PostureTask(model, cost=cost, gain=POSTURE_GAIN)
        posture.set_target(body.attractor[self.columns])
        self.tasks = [self.com, *self.points, posture]
        speeds = {model.joint(i).name: body.max_speed for i in range(1, model.njnt)}
        self.limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
        if watched is not None:
            seen = watched.observers
            self.pairs = [(PREFIX + seen.names[a], PREFIX + seen.names[b]) for a, b in seen.pairs.tolist()]
            self.avoidance: Any = mink.CollisionAvoidanceLimit(
                model,
                [([a], [b]) for a, b in self.pairs],
                minimum_distance_from_collisions=float(seen.margin.max()),
                collision_detection_distance=float(seen.influence.max()),
            )
            self.limits.append(self.avoidance)

    def aim(self, com: Floats, points: Floats) -> None:
        """See `Side`."""
        self.com.set_target(com)
        for task, point in zip(self.points, points, strict=True):
            task.set_target(mink.SE3.from_translation(point))

    def solve(self) -> None:
        """See `Side`."""
        dt = DT / N_IK
        for _ in range(N_IK):
            try:
                velocity = mink.solve_ik(self.configuration, self.tasks, dt, "daqp", damping=1e-6, limits=self.limits)
            except mink.NoSolutionFound:
                self.failures += 1
                continue
            self.configuration.integrate_inplace(velocity, dt)

    def posture(self) -> Floats:
        """See `Side`."""
        self.whole[3] = 1.0
        self.whole[self.columns] = self.configuration.q
        mujoco.mju_normalize4(self.whole[3:7])
        return self.whole.copy()

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
