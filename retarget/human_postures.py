"""Reference postures of the virtual human as data: angles in degrees by motion; what is not named is 0.

A name without a side means both sides. A posture task pulls the joints towards one of these.
"""

from dataclasses import dataclass

__all__ = ["POSTURES", "Posture"]


@dataclass(frozen=True)
class Posture:
    """A named posture: (motion, degrees) pairs, motions as in `human_joints` (`knee_flexion`: both knees)."""

    name: str
    description: str
    angles_deg: tuple[tuple[str, float], ...]


POSTURES: tuple[Posture, ...] = (
    Posture("stand", "upright, arms hanging: the zero posture", ()),
    Posture(
        "attractor",
        "as the paper describes: arms held away from the torso, knees bent, spine and hips near rest",
        (
            ("shoulder_elevation", 25.0),
            ("shoulder_swing", -25.0),
            ("elbow_flexion", 20.0),
            ("hip_flexion", 10.0),
            ("knee_flexion", 30.0),
            ("ankle_dorsiflexion", 15.0),
        ),
    ),
    Posture(
        "natural",
        "relaxed standing: legs vertical, arms hanging 18 degrees out, elbows bent, trunk bent a little",
        (
            ("spine_flexion", 3.0),
            ("chest_flexion", 5.0),
            ("shoulder_elevation", 12.9),
            ("shoulder_swing", -12.6),
            ("elbow_flexion", 35.0),
        ),
    ),
    Posture(
        "crouch",
        "a deep crouch on flat feet, hands free: how people get down to the ground",
        (
            ("spine_flexion", 40.0),
            ("chest_flexion", 6.0),
            ("neck_flexion", -28.0),
            ("shoulder_elevation", 12.9),
            ("shoulder_swing", -12.6),
            ("elbow_flexion", 35.0),
            ("hip_flexion", 100.0),
            ("knee_flexion", 110.0),
            ("ankle_dorsiflexion", 20.0),
        ),
    ),
    Posture(
        "t_pose",
        "arms straight out to the sides",
        (("shoulder_elevation", 90.0), ("shoulder_swing", -45.0), ("shoulder_rotation", 45.0)),
    ),
)
