"""The postures that a robot can take: joint ranges, and samples of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.body import BodyModel, JointType
from retarget.rotations import FloatArray, normalise

__all__ = ["JointRanges", "joint_ranges"]

UNLIMITED = {JointType.HINGE: np.pi, JointType.SLIDE: 1.0}
"""Half range of a joint without limits, rad or m."""


@dataclass(frozen=True, eq=False)
class JointRanges:
    """lower, upper (m,) rad or m of the hinges and slides at the places `address` (m,) of q; `dofs` (m,) in velocities.

    balls: places in q of ball joints, which take any orientation. notes: what was assumed.
    """

    q0: FloatArray
    address: NDArray[np.int64]
    dofs: NDArray[np.int64]
    lower: FloatArray
    upper: FloatArray
    balls: tuple[int, ...]
    notes: tuple[str, ...]

    def clipped(self, q: FloatArray) -> FloatArray:
        """Postures (..., nq) inside the ranges."""
        inside = q.copy()
        inside[..., self.address] = np.clip(q[..., self.address], self.lower, self.upper)
        return inside

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Postures (count, nq): half of them uniform, a quarter corners of the ranges, a quarter a mixture of both."""
        size = (count, len(self.address))
        uniform = rng.uniform(size=size)
        corners = rng.integers(2, size=size).astype(np.float64)
        mixed = rng.uniform(size=size) < 0.5
        kind = np.arange(count)[:, None] % 4
        share = np.where((kind == 1) | ((kind == 3) & mixed), corners, uniform)
        q = np.repeat(self.q0[None], count, axis=0)
        q[:, self.address] = self.lower + share * (self.upper - self.lower)
        for ball in self.balls:
            q[:, ball : ball + 4] = normalise(rng.normal(size=(count, 4)))
        return q


def joint_ranges(body: BodyModel, limits: Mapping[str, tuple[float, float]]) -> JointRanges:
    """Ranges of a body: `limits` of joints by name (of their servos) before those of its file. A free root stays.

    Raises ConfigError for an unknown joint.
    """
    notes = []
    lower, upper = body.lower.copy(), body.upper.copy()
    for name, (low, high) in limits.items():
        dof = body.joint_dof[body.joint_index(name)]
        lower[dof], upper[dof] = low, high
    scalar = np.isin(body.joint_type, (JointType.HINGE, JointType.SLIDE))
    for joint in np.flatnonzero(scalar):
        dof, kind = body.joint_dof[joint], JointType(body.joint_type[joint])
        if not np.isfinite([lower[dof], upper[dof]]).all():
            half = UNLIMITED[kind]
            lower[dof] = lower[dof] if np.isfinite(lower[dof]) else -half
            upper[dof] = upper[dof] if np.isfinite(upper[dof]) else half
            unit = "m" if kind is JointType.SLIDE else "rad"
            looked = f"{lower[dof]:.2f} to {upper[dof]:.2f} {unit}"
            notes.append(f"joint {body.joint_names[joint]} has no limits, {looked} was looked at")
    dofs = body.joint_dof[scalar]
    return JointRanges(
        q0=body.qpos0,
        address=body.joint_qpos[scalar],
        dofs=dofs,
        lower=lower[dofs],
        upper=upper[dofs],
        balls=tuple(int(place) for place in body.joint_qpos[body.joint_type == JointType.BALL]),
        notes=tuple(notes),
    )
