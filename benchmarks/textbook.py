"""The strict hierarchy in NumPy with the paper's clamping loop (Figure 2), for scale."""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.bodies import BenchBody, Floats
from benchmarks.motion import Motion
from benchmarks.side import DT, N_IK, POSTURE_GAIN

sys.path.insert(
    0, str(Path(__file__).resolve().parent.parent / "tests" / "support")
)  # the algorithm lives among the tests' oracles

from oracles.textbook import clamping_loop

MAX_ERROR = 0.05  # m asked per task and iteration
MAX_STEP = 0.3  # rad or m per iteration


class Textbook:
    """Projectors and pseudo-inverses on MuJoCo's kinematics; not optimal once joints are clamped."""

    name = "NumPy, Figure 2"

    def __init__(self, body: BenchBody, motion: Motion) -> None:
        self.body, self.failures = body, 0
        self.model = body.reduced_model()
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(1, self.model.njnt)]
        joints = [body.model.joint_index(name) for name in names]
        self.columns = np.concatenate([np.arange(7), body.model.joint_qpos[joints]]).astype(int)
        self.dofs = np.concatenate([np.arange(6), body.model.joint_dof[joints]]).astype(int)
        self.sites = [self.model.site(f"bench_{point.name}").id for point in body.points]
        self.ankles = [i for i, point in enumerate(body.points) if "ankle" in point.name]
        self.hands = [i for i, point in enumerate(body.points) if "ankle" not in point.name]
        self.rows = [i for i, weight in enumerate(motion.com_rows) if weight > 0.0]
        self.attractor = body.attractor[self.columns]
        self.q = motion.start[self.columns]
        self.com_target, self.targets = np.zeros(3), np.zeros((len(self.sites), 3))

    def aim(self, com: Floats, points: Floats) -> None:
        """See `Side`."""
        self.com_target, self.targets = com, points

    def solve(self) -> None:
        """See `Side`. The velocity limit holds for the frame, not for the iteration."""
        start = self.q.copy()
        for _ in range(N_IK):
            lo, hi = self.box(start)
            weight = np.ones(self.model.nv)
            step, _ = clamping_loop(self.levels(), weight, np.clip(self.to_attractor(), lo, hi), lo, hi)
            mujoco.mj_integratePos(self.model, self.q, step, 1.0)

    def levels(self) -> list[tuple[Floats, Floats]]:
        """Rows and errors of centre of mass, ankles, wrists and head."""
        model, data = self.model, self.data
        data.qpos[:] = self.q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        J_com = np.zeros((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, J_com, 1)
        com = capped(self.com_target - data.subtree_com[1])
        points = [self.point_rows(i) for i in range(len(self.sites))]
        join = [(np.vstack([points[i][0] for i in group]), np.concatenate([points[i][1] for i in group]))
                for group in (self.ankles, self.hands)]  # fmt: skip
        return [(J_com[self.rows], com[self.rows]), *join]

    def point_rows(self, index: int) -> tuple[Floats, Floats]:
        """Jacobian (3, nv) and error (3,) of one point."""
        J = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, J, None, self.sites[index])
        return J, capped(self.targets[index] - self.data.site_xpos[self.sites[index]])

    def to_attractor(self) -> Floats:
        """Step (nv,) towards the attractor; the root stays."""
        step = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, step, 1.0, self.q, self.attractor)
        step[:6] = 0.0
        return POSTURE_GAIN * step

    def box(self, start: Floats) -> tuple[Floats, Floats]:
        """Bounds of this iteration's step from joint limits, the frame's speed and the step limit."""
        body, moved = self.body, np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, moved, 1.0, start, self.q)
        reach = np.full(self.model.nv, np.inf)
        reach[6:] = body.max_speed * DT
        joints = np.concatenate([np.zeros(6), self.q[7:]])
        lo = np.maximum.reduce([body.model.lower[self.dofs] - joints, -reach - moved, np.full(len(moved), -MAX_STEP)])
        hi = np.minimum.reduce([body.model.upper[self.dofs] - joints, reach - moved, np.full(len(moved), MAX_STEP)])
        return np.minimum(lo, 0.0), np.maximum(hi, 0.0)

    def posture(self) -> Floats:
        """See `Side`."""
        whole = np.zeros(self.body.model.nq)
        whole[self.columns] = self.q
        return whole


def capped(error: Floats) -> Floats:
    """The error, no longer than MAX_ERROR."""
    length = float(np.linalg.norm(error))
    return error if length <= MAX_ERROR else error * (MAX_ERROR / length)
