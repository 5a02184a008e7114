"""Names of the poses of VMC: the bones of Unity's humanoid, and which serials of devices are taken."""

__all__ = ["BODY_BONES", "BONES", "bone_name", "device_name"]

MAX_SERIAL = 128
"""Letters of the longest serial that is taken."""

_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")

BODY_BONES: tuple[str, ...] = (
    *("Hips", "Spine", "LeftUpperLeg", "RightUpperLeg", "Chest", "LeftLowerLeg", "RightLowerLeg"),
    *("UpperChest", "LeftFoot", "RightFoot", "Neck", "LeftShoulder", "RightShoulder", "LeftToes", "RightToes"),
    *("Head", "LeftUpperArm", "RightUpperArm", "LeftLowerArm", "RightLowerArm", "LeftHand", "RightHand"),
)
"""Bones of trunk, head and limbs, parents first."""

BONES: tuple[str, ...] = (
    *BODY_BONES,
    *("LeftEye", "RightEye", "Jaw"),
    *(
        f"{side}{finger}{part}"
        for side in ("Left", "Right")
        for finger in _FINGERS
        for part in ("Proximal", "Intermediate", "Distal")
    ),
)
"""All bones of Unity's HumanBodyBones, by their canonical spelling."""

_BY_LOWER_CASE = {name.lower(): f"bone://{name}" for name in BONES}
_RESERVED = ("bone://", "root://", "local://")


def bone_name(told: str) -> str | None:
    """`bone://LeftUpperArm` of a bone told in any case; None for a name that Unity does not have."""
    return _BY_LOWER_CASE.get(told.lower())


def device_name(serial: str) -> str | None:
    """The serial itself; None if it is empty, too long, not printable, or could be taken for a bone or the root."""
    if not 0 < len(serial) <= MAX_SERIAL or not serial.isprintable() or serial.lower().startswith(_RESERVED):
        return None
    return serial
