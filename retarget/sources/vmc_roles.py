"""What the poses of VMC and VRChat trackers are of a body, as data: which joint, which segment, which rest pose.

Canonical orientations are the identity in the T-pose, standing upright, facing x. A sender whose rest pose has hanging
arms tells a turn of its arms in the T-pose: that turn is the role's `rest`.
"""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from retarget.errors import UsageError, suggest
from retarget.frames import SENSORS
from retarget.rotations import FloatArray, conjugate, multiply, rotate

__all__ = ["ROLE_SETS", "Role", "RoleSet", "canonical_orientation", "joint_position", "role_set"]

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
    segment: the canonical sensor whose body segment its rotation is, "" if none. rest: what the sender tells, wxyz,
    in the T-pose facing x. offset: from the joint to the point that is told, m, in the axes of the sender's own
    rotation; of the sender's default proportions, for calibration to begin with.
    """

    name: str
    point: str
    segment: str
    rest: Quaternion = _UPRIGHT
    offset: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        assert {self.point, self.segment} <= {"", *SENSORS} and (self.point or self.segment)


@dataclass(frozen=True, slots=True)
class RoleSet:
    """The roles of one kind of sender, by the name that a performer's file gives. local: relative to parent bones."""

    name: str
    roles: tuple[Role, ...]
    local: bool = False

    def role(self, name: str) -> Role | None:
        """The role of a sender's name; None if it has none."""
        return next((role for role in self.roles if role.name == name), None)


_SIDES = (("l_", "Left"), ("r_", "Right"))

_HAND_FORWARD = 0.13
"""m that SlimeVR's hand lies forward of the forearm's line, arms hanging (measured, default proportions)."""

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
grip, beyond the wrist by a length that the stream does not tell; without a tracker there, it turns with the forearm.
Roles that nobody wears are told all the same, so that the performer's file must list the worn ones."""

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
"""Unity's bones: the joint where the bone begins, and the bone; after forward kinematics (`vmc_bones`)."""

ROLE_SETS = MappingProxyType(
    {
        row.name: row
        for row in (
            RoleSet("slimevr", _SLIMEVR),
            RoleSet("slimevr_vrchat", _SLIMEVR_VRCHAT),
            RoleSet("unity_bones", _BONES, local=True),
        )
    }
)
"""By name."""


def role_set(name: str, *, where: str = "") -> RoleSet:
    """The roles of this name. Raises UsageError with the nearest names."""
    if name in ROLE_SETS:
        return ROLE_SETS[name]
    raise UsageError(
        "unknown roles of a sender",
        where=where,
        found=repr(name),
        allowed=", ".join(ROLE_SETS),
        next_step=suggest(name, ROLE_SETS),
    )


def canonical_orientation(role: Role, orientation: FloatArray) -> FloatArray:
    """World orientation (..., 4) wxyz of the role's segment, identity in the T-pose, from what the sender tells."""
    return multiply(orientation, conjugate(role.rest))


def joint_position(role: Role, position: FloatArray, orientation: FloatArray) -> FloatArray:
    """World position (..., 3) m of the role's joint, from the position and orientation that the sender tells."""
    if role.offset == (0.0, 0.0, 0.0):
        return position  # also where no orientation is told
    return position - rotate(orientation, role.offset)
