"""The virtual human: a body of one person's size, its degrees of freedom, and its reference postures.

Two readings of the paper's "18 joints (51 degrees of freedom)" share one body: A, seventeen internal joints of three
axes each, beside the six of the root (57 velocities); B, 51 with the root, which locks two axes of each knee and the
sideward axis of each elbow. B is the default.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from retarget.body import BodyModel, load_body_text
from retarget.errors import ConfigError, suggest
from retarget.human_dimensions import HumanDimensions
from retarget.human_joints import HUMAN_JOINTS
from retarget.human_mjcf import human_mjcf
from retarget.human_postures import POSTURES
from retarget.joint_weights import joint_weights
from retarget.rotations import FloatArray

__all__ = ["Human", "Reading", "build_human"]

Reading = Literal["A", "B"]

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Human:
    """A virtual human. `locked` (nv,): DoFs that stay at zero. `mjcf`: the text that `body` was compiled from."""

    dimensions: HumanDimensions
    body: BodyModel
    reading: Reading
    locked: BoolArray
    mjcf: str

    @property
    def degrees_of_freedom(self) -> int:
        """Number of DoFs that move: 57 or 51."""
        return int(np.count_nonzero(~self.locked))

    def posture(self, name: str) -> FloatArray:
        """Reference posture q (nq,), standing at the origin. Raises ConfigError with the nearest names."""
        for posture in POSTURES:
            if posture.name == name:
                return self.posture_from(posture.angles_deg)
        names = [posture.name for posture in POSTURES]
        raise ConfigError("unknown posture", found=name, allowed=", ".join(names), next_step=suggest(name, names))

    def posture_from(self, angles_deg: Iterable[tuple[str, float]]) -> FloatArray:
        """Posture q (nq,) from (motion, degrees) pairs over the zero posture; no side means both sides.

        Raises ConfigError: unknown motion, or outside the limits of a joint.
        """
        q = self.body.qpos0.copy()
        single, address = self.body.scalar_joints()
        for motion, degrees in angles_deg:
            for name in self._sided(motion):
                dof = self.body.dof_index(name)
                angle = np.deg2rad(degrees)
                low, high = self.body.lower[dof], self.body.upper[dof]
                if not (single[dof] and low <= angle <= high):
                    allowed = f"{np.rad2deg(low):.0f} to {np.rad2deg(high):.0f} degrees"
                    raise ConfigError("posture outside the joint's limits", where=name, found=degrees, allowed=allowed)
                q[address[dof]] = angle
        return q

    def weights(self, values: Iterable[tuple[str, float]], *, default: float) -> FloatArray:
        """One number per DoF (nv,), as `joint_weights`. Raises ConfigError."""
        return joint_weights(self.body, values, default=default)

    def _sided(self, motion: str) -> list[str]:
        return [motion] if motion in self.body.dof_names else [f"{side}_{motion}" for side in ("l", "r")]


def build_human(dimensions: HumanDimensions, *, reading: Reading = "B") -> Human:
    """The virtual human of this size. About 5 ms, after MuJoCo's own import."""
    mjcf = human_mjcf(dimensions)
    body = load_body_text(mjcf, source=f"virtual human ({dimensions.origin})")
    return Human(dimensions=dimensions, body=body, reading=reading, locked=_locked(body, reading), mjcf=mjcf)


def _locked(body: BodyModel, reading: Reading) -> BoolArray:
    locked = np.zeros(body.nv, dtype=bool)
    if reading == "B":
        for joint in HUMAN_JOINTS:
            for hinge in joint.hinges:
                locked[body.dof_index(f"{joint.name}_{hinge.motion}")] |= hinge.locked
    return locked
