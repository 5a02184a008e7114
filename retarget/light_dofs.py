"""Joints that move next to nothing of a body's mass, and no limb: of a head.

Where its mass in motion is kept over its soles, any joint that is left counts, and the lightest one is the last that no
task above it holds: a head would be swung from stop to stop for a millimetre of the centre of mass.
"""

from collections.abc import Mapping

import numpy as np

from retarget.body import BodyModel, Frame, JointType

__all__ = ["light_dofs"]

LIGHT = 0.008
"""A joint is light that moves the centre of mass by less than this share of the body's size a radian, however it is
bent."""
POSTURES, TURNED = 64, 2.0
"""So many postures are tried, each joint turned by so much (rad) at most."""
LIMBS = ("l_hand", "r_hand", "l_sole", "r_sole")
"""Frames at the ends of limbs. What moves them is asked to, however light."""


def light_dofs(body: BodyModel, frames: Mapping[str, Frame]) -> list[int]:
    """The DoFs of hinges that are light and move no limb. frames: of the body, by their names."""
    solver = body.solver_body()
    hinges = body.joint_type == JointType.HINGE
    columns, dofs = body.joint_qpos[hinges], body.joint_dof[hinges]
    random = np.random.default_rng(0)
    low, high = np.maximum(body.lower[dofs], -TURNED), np.minimum(body.upper[dofs], TURNED)
    most = np.zeros(body.nv)
    for _ in range(POSTURES):
        q = body.qpos0.copy()
        q[columns] = random.uniform(np.minimum(low, high), np.maximum(low, high))
        most = np.maximum(most, np.linalg.norm(solver.centre_of_mass_jacobian(q), axis=0))
    limbs = {link for name in LIMBS if name in frames for link in body.chain_to_root(frames[name].body)}
    links = body.joint_body[hinges].tolist()
    light = most[dofs] < LIGHT * _size(body)
    return [int(dof) for dof, link, is_light in zip(dofs, links, light, strict=True) if is_light and link not in limbs]


def _size(body: BodyModel) -> float:
    """How far (m) the origins of its links reach from lowest to highest, joints at 0."""
    links = np.arange(1, len(body.parent))
    height = body.solver_body().points(body.qpos0[None], links.tolist(), np.zeros((len(links), 3)))[0, :, 2]
    return float(np.ptp(height))
