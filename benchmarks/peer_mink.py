"""mink: one weighted quadratic program per iteration."""

from __future__ import annotations

from typing import Any

import mink
import mujoco
import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.side import DT, LEADING_WEIGHT, N_IK, POSTURE_GAIN, POSTURE_WEIGHT


class Mink:
    """mink with daqp; its costs multiply errors, so they are the roots of our weights."""

    name = "mink"

    def __init__(self, body: BenchBody, motion: Motion) -> None:
        model = self.model = self.make_model(body)
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

    def make_model(self, body: BenchBody) -> Any:
        """The MuJoCo model to work on."""
        return body.reduced_model()

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
