"""What each role of a sender means, written out: the orientation of its segment and the place of its joint.

Canonical orientations are the identity in the T-pose, standing upright, facing x. A sender whose rest pose has hanging
arms sends turned arms in the T-pose: that turn is the role's `rest`.
"""

from dataclasses import dataclass

import numpy as np

from retarget.frames import SENSORS
from retarget.rotations import conjugate, multiply
from retarget.types import FloatArray

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
_HALF_ROOT = float(np.sqrt(0.5))
_RAISED: dict[str, Quaternion] = {"l_": (_HALF_ROOT, _HALF_ROOT, 0.0, 0.0), "r_": (_HALF_ROOT, -_HALF_ROOT, 0.0, 0.0)}
"""A hanging arm turned to the T-pose: by 90 degrees about forward, the left one to the left."""


@dataclass(frozen=True, slots=True)
class Role:
    """One pose of a sender.

    name: the sender's, as in `StreamFrame.names`. point: the canonical sensor whose joint its position is, "" if none.
    segment: the canonical sensor whose body segment its rotation is, "" if none. rest: the orientation that is sent,
    wxyz, in the T-pose facing x. offset: from the joint to the point that is sent, m, in the axes of the sent rotation;
    of the sender's default proportions, where calibration begins.
    """

    name: str
    point: str
    segment: str
    rest: Quaternion = _UPRIGHT
    offset: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        assert {self.point, self.segment} <= {"", *SENSORS} and (self.point or self.segment)


_SIDES = (("l_", "Left"), ("r_", "Right"))

_HAND_FORWARD = 0.13
"""m by which SlimeVR's hand is forward of the forearm's line, arms hanging (measured, default proportions)."""

_SLIMEVR = (
    Role("human://HEAD", "head", "head"),
    Role("human://CHEST", "chest", "chest"),
    Role("human://WAIST", "pelvis", "pelvis"),
    *(
        role
        for short, side in _SIDES
        for role in (
            Role(f"human://{side.upper()}_KNEE", f"{short}knee", f"{short}hip"),
            Role(f"human://{side.upper()}_FOOT", f"{short}ankle", f"{short}ankle"),
            Role(f"human://{side.upper()}_ELBOW", f"{short}elbow", f"{short}shoulder", _RAISED[short]),
            Role(
                f"human://{side.upper()}_HAND",
                f"{short}wrist",
                f"{short}wrist",
                _RAISED[short],
                (_HAND_FORWARD, 0.0, 0.0),
            ),
        )
    ),
)
"""SlimeVR's sparse set. Knee and elbow: the joint, turned with the segment above it. Hand: a point in front of the
grip, beyond the wrist by a length that the stream does not hold; without a tracker there, it turns with the forearm.
SlimeVR sends roles without trackers too, so the performer's file must list those with trackers."""

_SLIMEVR_VRCHAT = (
    Role("tracker://head", "head", ""),
    Role("tracker://6", "chest", "chest"),
    Role("tracker://1", "pelvis", "pelvis"),
    *(
        Role(f"tracker://{number}", short + point, short + segment, _RAISED[short] if point == "elbow" else _UPRIGHT)
        for point, segment, numbers in (("ankle", "ankle", "23"), ("knee", "hip", "45"), ("elbow", "shoulder", "78"))
        for (short, _), number in zip(_SIDES, numbers, strict=True)
    ),
)
"""SlimeVR's fixed ids over VRChat OSC, same meaning as above. The head turns on a yaw reset only; no wrists."""

_BONES = (
    Role("bone://Head", "head", "head"),
    Role("bone://Chest", "chest", ""),
    Role("bone://UpperChest", "", "chest"),
    Role("bone://Hips", "pelvis", "pelvis"),
    *(
        Role(f"bone://{side}{bone}", short + sensor, short + sensor)
        for bone, sensor in (
            *(("UpperArm", "shoulder"), ("LowerArm", "elbow"), ("Hand", "wrist")),
            *(("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toes", "toe")),
        )
        for short, side in _SIDES
    ),
)
"""Unity's bones: the joint where the bone begins, and the bone; after forward kinematics (`VmcBodyDecoder`)."""

ROLE_SETS = {"slimevr": _SLIMEVR, "slimevr_vrchat": _SLIMEVR_VRCHAT, "unity_bones": _BONES}
"""The roles of one kind of sender, under the name that performers' files use."""


def role(convention: str, name: str) -> Role:
    """The role of a pose by the sender's name."""
    return next(one for one in ROLE_SETS[convention] if one.name == name)


def canonical_orientation(role: Role, orientation: FloatArray) -> FloatArray:
    """World orientation (..., 4) wxyz of the role's segment, identity in the T-pose, from the sent orientation."""
    return multiply(orientation, conjugate(role.rest))
