"""What a role of a sender means, written out: the orientation of its segment and the place of its joint."""

from retarget.live.roles import ROLE_SETS, Role
from retarget.rotations import conjugate, multiply, rotate
from retarget.types import FloatArray


def role(convention: str, name: str) -> Role:
    """The role of a pose by the sender's name."""
    return next(one for one in ROLE_SETS[convention] if one.name == name)


def canonical_orientation(role: Role, orientation: FloatArray) -> FloatArray:
    """World orientation (..., 4) wxyz of the role's segment, identity in the T-pose, from the sent orientation."""
    return multiply(orientation, conjugate(role.rest))


def joint_position(role: Role, position: FloatArray, orientation: FloatArray) -> FloatArray:
    """World position (..., 3) m of the role's joint, from the sent position and orientation."""
    return position - rotate(orientation, role.offset)
