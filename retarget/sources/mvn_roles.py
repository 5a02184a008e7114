"""Which MVN segment tells the place and which the orientation of each canonical sensor, and of each canonical joint.

The origin of a segment is the joint at its start (RightForeArm: the elbow; T8: where neck and arms part; Head: the
joint below the skull; RightToe: the ball of the foot). Every orientation is the identity in the T-pose, standing
upright and facing the calibrated x, which is the rest pose that canonical sensors are told in.
"""

from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["MVN_JOINTS", "MVN_SENSORS", "SegmentRole"]


@dataclass(frozen=True, slots=True)
class SegmentRole:
    """Names of segments: `position`, whose origin is the place of a sensor, and `orientation`, which turns with it."""

    position: str
    orientation: str


_SIDES = (("l_", "Left"), ("r_", "Right"))

_SIDED = {
    "wrist": ("Hand", "Hand"),
    "ankle": ("Foot", "Foot"),
    "knee": ("LowerLeg", "LowerLeg"),
    "elbow": ("ForeArm", "ForeArm"),
    "shoulder": ("UpperArm", "UpperArm"),
    "hip": ("UpperLeg", "UpperLeg"),
    "toe": ("Toe", "Foot"),
}

MVN_SENSORS = MappingProxyType(
    {
        "head": SegmentRole("Head", "Head"),
        "pelvis": SegmentRole("Pelvis", "Pelvis"),
        "chest": SegmentRole("T8", "T8"),
        **{
            short + part: SegmentRole(side + position, side + orientation)
            for part, (position, orientation) in _SIDED.items()
            for short, side in _SIDES
        },
    }
)
"""Canonical sensor -> segments."""

MVN_JOINTS = MappingProxyType(
    {
        "pelvis": "Pelvis",
        "spine": "L3",
        "chest": "T8",
        "neck": "Neck",
        "head": "Head",
        **{f"{short}collar": f"{side}Shoulder" for short, side in _SIDES},
        **{short + part: side + position for part, (position, _) in _SIDED.items() for short, side in _SIDES},
    }
)
"""Canonical joint -> the segment whose origin it is. MVN has no joint inside of the hand."""
