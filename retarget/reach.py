"""Sensors as far from each other as a body can be, and no further.

A tracker that loses its mind asks for a wrist metres away. The hierarchy would stretch the whole body after it,
singular and restless, to come a little closer. So what is asked is pulled back to where this body could just have it.
"""

from collections.abc import Sequence

import numpy as np

from retarget import rotations
from retarget.frames import BoolArray
from retarget.human_dimensions import POINTS, HumanDimensions
from retarget.rotations import FloatArray

__all__ = ["Reach"]

TRUNK_GIVE = 1.25
"""How much further apart than at rest two points of the trunk, neck and shoulder girdle can be."""

_LIMBS = {
    "shoulder": ("elbow", "wrist", "hand"),
    "hip": ("knee", "ankle", "toe"),
}
"""Where each limb begins, and its joints from there on."""


class Reach:
    """Largest distances of k sensors from one of them, the anchor: the pelvis if it is worn, else the head."""

    def __init__(self, sensors: Sequence[str], joints: Sequence[str], dimensions: HumanDimensions) -> None:
        """sensors: names. joints: the joint that each sits on."""
        self._anchor = next((sensors.index(name) for name in ("pelvis", "head") if name in sensors), None)
        anchor = joints[0 if self._anchor is None else self._anchor]
        self._furthest = np.array([_furthest(anchor, joint, dimensions) for joint in joints])

    def clamp(self, position: FloatArray, present: BoolArray) -> None:
        """Pull positions (k, 3) m back, in place; `present` (k,)."""
        if self._anchor is None or not present[self._anchor]:
            return
        away = position - position[self._anchor]
        distance = np.sqrt(rotations.squares(away))
        too_far = present & (distance > self._furthest)
        if np.count_nonzero(too_far):
            share = self._furthest[too_far] / distance[too_far]
            position[too_far] = position[self._anchor] + share[:, None] * away[too_far]


def _furthest(anchor: str, joint: str, dimensions: HumanDimensions) -> float:
    """Most that two joints can be apart, m."""
    start, first = _from_trunk(anchor, dimensions)
    end, second = _from_trunk(joint, dimensions)
    rest = dict(zip(POINTS, dimensions.standing(), strict=True))
    return TRUNK_GIVE * float(np.linalg.norm(rest[start] - rest[end])) + first + second


def _from_trunk(joint: str, dimensions: HumanDimensions) -> tuple[str, float]:
    """(joint of the trunk that a limb hangs on, length of the limb up to this joint); the joint itself on the trunk."""
    side, kind = (joint[:2], joint[2:]) if joint[1] == "_" else ("", joint)
    for root, chain in _LIMBS.items():
        if kind in chain:
            return side + root, sum(dimensions.length(side + part) for part in chain[: chain.index(kind) + 1])
    return joint, 0.0
