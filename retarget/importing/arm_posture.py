"""Arms beside the trunk with bent elbows: the joint angles of it, whatever joints the arms have."""

import numpy as np
from scipy.optimize import least_squares

from retarget.importing.limb_roles import arm_roles
from retarget.importing.limbs import UP
from retarget.importing.posed import Posed
from retarget.rotations import FloatArray

__all__ = ["arm_posture"]

REST = 0.02
"""Weight of staying near the middle of 0: joints that do not matter stay there."""
STARTS = 6
"""Guesses that the search starts from; an elbow may bend either way."""
GOOD = 2e-3
"""Cost of a posture that is near enough: elbow and hand within a few hundredths of the arm's length."""
SIGNIFICANT = 1e-3
"""[rad] Less is 0."""


def arm_posture(posed: Posed, *, spread: float, ahead: float, bend: float) -> dict[str, float]:
    """Angles (rad) of both arms: upper arms down, `spread` out to the side and `ahead` to the front, elbows bent to the
    front by `bend`, rad. As near to that as the arms get; mirrored."""
    anatomy, tree = posed.anatomy, posed.tree
    if not anatomy.arms:
        return {}
    side = "l" if len(anatomy.arms) == 2 else "r"
    arm = anatomy.arms[0]
    joints = [tree.nodes[node].joint for node in arm.nodes]
    last = arm_roles(tree, arm).wrist
    if last is not None:
        joints = joints[: arm.nodes.index(last)]
    zero = posed.place({})
    shoulder, hand = zero.positions[f"{side}_shoulder"], f"{side}_hand"
    elbow = f"{side}_elbow" if f"{side}_elbow" in zero.positions else None
    outward = anatomy.left if side == "l" else -anatomy.left
    upper = float(np.linalg.norm(zero.positions[elbow] - shoulder)) if elbow else 0.0
    lower = float(np.linalg.norm(zero.positions[hand] - (zero.positions[elbow] if elbow else shoulder)))
    length = max(upper + lower, 1e-6)
    at_elbow = shoulder + upper * _down(anatomy.forward, outward, ahead, spread)
    at_hand = at_elbow + lower * _down(anatomy.forward, outward, ahead + bend, spread)
    low, high = np.array([posed.limits[joint] for joint in joints]).T
    middle = np.clip(0.0, low, high)

    def off(angles: FloatArray) -> FloatArray:
        there = posed.place(dict(zip(joints, angles.tolist(), strict=True))).positions
        parts = [there[hand] - at_hand] + ([there[elbow] - at_elbow] if elbow else [])
        return np.concatenate([*(part / length for part in parts), REST * (angles - middle)])

    rng, best = np.random.default_rng(0), None
    for number in range(1 + STARTS):
        start = middle if number == 0 else rng.uniform(0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
        found = least_squares(off, start, bounds=(low - 1e-9, high + 1e-9), max_nfev=60)
        best = found if best is None or found.cost < best.cost else best
        if best.cost < GOOD:
            break
    assert best is not None
    angles = {
        joint: posed.inside(joint, round(float(angle), 3))
        for joint, angle in zip(joints, best.x, strict=True)
        if abs(angle) > SIGNIFICANT
    }
    return posed.mirrored(angles)


def _down(forward: FloatArray, outward: FloatArray, ahead: float, spread: float) -> FloatArray:
    """Direction (3,) from straight down, `ahead` to the front and `spread` outwards."""
    return np.asarray(np.cos(spread) * (np.sin(ahead) * forward - np.cos(ahead) * UP) + np.sin(spread) * outward)
