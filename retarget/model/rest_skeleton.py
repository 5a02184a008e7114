"""Checks of a rest skeleton, from which sizes and turns of limbs are read: it stands upright, and faces x."""

from collections.abc import Sequence

import numpy as np

from retarget import rotations
from retarget.arithmetic import norm
from retarget.frames import Skeleton, stature
from retarget.types import FloatArray

ALONG = 0.7
"""Least cosine between parallel lines of a body, such as trunk and legs."""
LEAST_SHOULDERS, LEAST_HIPS, LEAST_FOOT = 0.1, 0.03, 0.03
"""Least widths of shoulders and hips, and length of a foot, relative to stature."""

SEGMENT_END = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}
_SEGMENT_OF = {"wrist": "elbow", "ankle": "knee", "toe": "knee"}
"""At rest a hand is turned as the forearm, and a foot as the shank."""
_DOWN = np.array([0.0, 0.0, -1.0])  # unit vector


def limb_turns(skeleton: Skeleton, sensors: Sequence[str]) -> FloatArray:
    """Turns (k, 4) wxyz of sensors' segments from hanging down to the rest pose; the identity for the trunk, NaN for a
    bone of no length."""
    result = np.tile(rotations.IDENTITY, (len(sensors), 1))
    for row, sensor in enumerate(sensors):
        side, part = sensor[:2], sensor[2:]
        near = _SEGMENT_OF.get(part, part)
        if near in SEGMENT_END:
            along = skeleton.of(side + SEGMENT_END[near]) - skeleton.of(side + near)
            result[row] = rotations.shortest_arc(_DOWN, along)
    return result


def hanging_toe(skeleton: Skeleton, side: str) -> FloatArray | None:
    """Offset (3,) m of a toe from its ankle under a hanging leg; None without it."""
    if f"{side}_toe" not in skeleton.names:
        return None
    ankle = f"{side}_ankle"
    offset = skeleton.of(f"{side}_toe") - skeleton.of(ankle)
    toe = rotations.rotate(rotations.conjugate(limb_turns(skeleton, [ankle])[0]), offset)
    return toe if norm(toe[:2]) >= LEAST_FOOT * _size(skeleton) else None


def rest_faults(skeleton: Skeleton) -> tuple[str, ...]:
    """Reasons why a rest skeleton does not stand upright and face x."""
    size, faults = _size(skeleton), []
    trunk = skeleton.of("head") - _middle(skeleton, "hip")
    legs = _middle(skeleton, "hip") - _middle(skeleton, "ankle")
    shoulders, hips = _across(skeleton, "shoulder"), _across(skeleton, "hip")
    if not trunk[2] >= ALONG * norm(trunk) > 0.0:
        faults.append("its head is not above its hips")
    if not legs[2] >= ALONG * norm(legs) > 0.0:
        faults.append("its hips are not above its ankles")
    if not shoulders[1] >= max(ALONG * norm(shoulders), LEAST_SHOULDERS * size):
        faults.append("its shoulders are not apart to the left and right of its front")
    if not hips[1] >= max(ALONG * norm(hips), LEAST_HIPS * size):
        faults.append("its hips are not apart to the left and right of its front")
    toes = [skeleton.of(f"{s}_toe") - skeleton.of(f"{s}_ankle") for s in "lr" if f"{s}_toe" in skeleton.names]
    if any(norm(toe[:2]) >= LEAST_FOOT * size and toe[0] < 0.0 for toe in toes):
        faults.append("its toes do not point ahead")
    return tuple(faults)


def _size(skeleton: Skeleton) -> float:
    leg = skeleton.distance("l_hip", "l_knee") + skeleton.distance("l_knee", "l_ankle")
    return stature(skeleton) or leg + norm(skeleton.of("head") - _middle(skeleton, "hip"))


def _middle(skeleton: Skeleton, part: str) -> FloatArray:
    return 0.5 * (skeleton.of(f"l_{part}") + skeleton.of(f"r_{part}"))


def _across(skeleton: Skeleton, part: str) -> FloatArray:
    return skeleton.of(f"l_{part}") - skeleton.of(f"r_{part}")
