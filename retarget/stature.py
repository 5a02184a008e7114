"""How tall a body is, measured along its bones."""

from itertools import pairwise

import numpy as np

from retarget.frames import Skeleton

__all__ = ["stature"]

HEAD_CENTRE, ANKLE = 0.936, 0.039
"""Heights of the eyes (level with the centre of the head) and of the ankle, as shares of stature (Drillis, Contini)."""


def stature(skeleton: Skeleton) -> float | None:
    """Height in the skeleton's unit, None if it lacks a leg, the neck or the head.

    Along the bones (ankle, knee, hip, middle of the hips, chest, neck, centre of the head), so it does not depend on
    how the rest pose stands.
    """
    needed = ("l_hip", "r_hip", "l_knee", "l_ankle", "neck", "head")
    if not set(needed) <= set(skeleton.names):
        return None
    trunk = [0.5 * (skeleton.of("l_hip") + skeleton.of("r_hip"))]
    trunk += [skeleton.of(name) for name in ("chest", "neck", "head") if name in skeleton.names]
    leg = skeleton.distance("l_hip", "l_knee") + skeleton.distance("l_knee", "l_ankle")
    return (leg + sum(float(np.linalg.norm(b - a)) for a, b in pairwise(trunk))) / (HEAD_CENTRE - ANKLE)
