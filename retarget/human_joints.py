"""Joints of the virtual human as data: tree, hinge chains, anatomical limits, and which hinges the smaller model locks.

Eighteen joints: a floating root and seventeen internal ones, each a chain of three hinges in anatomical order, so that
limits are a box. Zero is standing upright with the arms hanging, thumbs forward. Axes are in the rest frame (x forward,
y left, z up) and a positive angle is the motion that the name says: flexion, abduction, medial rotation, pronation,
dorsiflexion, inversion, elevation, protraction; trunk and neck bend and turn to the left. Limits: AAOS, those of the
trunk split over spine and chest; a 0 of the table is `LAXITY_DEG` here, because a hinge needs some range.

The shoulder. Three hinges lose one direction (gimbal lock) when the upper arm points along the first axis, either way.
Flexion first would lock with the arm held out to the side, abduction first with the arm held forward, a turn about the
vertical first with the arm hanging or overhead: all common. Here the first hinge raises the arm in the plane of the
shoulder blade, half way between forward and sideward (`elevation`), the second swings it out of that plane
(`swing`: positive forward and across the chest, negative outward and back), the third turns it about itself. Lock then
needs the upper arm 45 degrees behind the frontal plane or 45 degrees across the chest, both horizontal and both at the
edge of what a shoulder can do: hanging, overhead, forward and sideward are all at least 45 degrees away.
"""

from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray

__all__ = ["ENDS", "HUMAN_JOINTS", "LAXITY_DEG", "Hinge", "HumanJoint"]

LAXITY_DEG = 2.0
"""Range to each side of a hinge that the table gives none."""

_SCAPULAR = float(np.sqrt(0.5))
"""Sine and cosine of 45 degrees: the plane of shoulder elevation lies between forward and sideward."""


@dataclass(frozen=True)
class Hinge:
    """One axis of a joint: motion name, axis in the rest frame (for a pair: of the left side), limits in degrees."""

    motion: str
    axis: tuple[float, float, float]
    lower_deg: float
    upper_deg: float
    locked: bool = False
    """Locked in the model of 51 degrees of freedom."""


@dataclass(frozen=True)
class HumanJoint:
    """A joint with its chain of hinges, outermost first; the root has none. `name` and `parent` are canonical."""

    name: str
    parent: str
    hinges: tuple[Hinge, ...]

    def axis(self, hinge: Hinge) -> FloatArray:
        """Axis (3,) in the rest frame; on the right side mirrored, so that the same angle is the same motion."""
        mirror = np.array([-1.0, 1.0, -1.0]) if self.name.startswith("r_") else np.ones(3)
        return np.asarray(np.array(hinge.axis) * mirror)


_BACK, _LEFT, _UP = (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_FRONT, _RIGHT, _DOWN = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)


def _trunk(flexion: tuple[float, float], lateral: float, rotation: float) -> tuple[Hinge, ...]:
    return (
        Hinge("flexion", _LEFT, *flexion),
        Hinge("lateral", _BACK, -lateral, lateral),
        Hinge("rotation", _UP, -rotation, rotation),
    )


_COLLAR = (
    Hinge("protraction", _DOWN, -20.0, 20.0),
    Hinge("elevation", _FRONT, -10.0, 30.0),
    Hinge("tilt", _LEFT, -20.0, 20.0),
)
_SHOULDER = (
    Hinge("elevation", (_SCAPULAR, -_SCAPULAR, 0.0), -51.0, 180.0),
    Hinge("swing", (-_SCAPULAR, -_SCAPULAR, 0.0), -80.0, 80.0),
    Hinge("rotation", _DOWN, -90.0, 70.0),
)
_ELBOW = (
    Hinge("flexion", _RIGHT, 0.0, 150.0),
    Hinge("abduction", _FRONT, -LAXITY_DEG, LAXITY_DEG, locked=True),
    Hinge("pronation", _DOWN, -80.0, 80.0),
)
_WRIST = (
    Hinge("flexion", _BACK, -70.0, 80.0),
    Hinge("deviation", _RIGHT, -30.0, 20.0),
    Hinge("rotation", _DOWN, -10.0, 10.0),
)
_HIP = (
    Hinge("flexion", _RIGHT, -30.0, 120.0),
    Hinge("abduction", _FRONT, -30.0, 45.0),
    Hinge("rotation", _DOWN, -45.0, 45.0),
)
_KNEE = (
    Hinge("flexion", _LEFT, 0.0, 135.0),
    Hinge("abduction", _FRONT, -LAXITY_DEG, LAXITY_DEG, locked=True),
    Hinge("rotation", _DOWN, -LAXITY_DEG, LAXITY_DEG, locked=True),
)
_ANKLE = (
    Hinge("dorsiflexion", _RIGHT, -50.0, 20.0),
    Hinge("inversion", _BACK, -20.0, 35.0),
    Hinge("rotation", _DOWN, -15.0, 15.0),
)


def _sides(name: str, parent: str, hinges: tuple[Hinge, ...], *, paired_parent: bool = True) -> list[HumanJoint]:
    return [
        HumanJoint(f"{side}_{name}", f"{side}_{parent}" if paired_parent else parent, hinges) for side in ("l", "r")
    ]


HUMAN_JOINTS: tuple[HumanJoint, ...] = (
    HumanJoint("pelvis", "", ()),
    HumanJoint("spine", "pelvis", _trunk((-15.0, 45.0), 20.0, 20.0)),
    HumanJoint("chest", "spine", _trunk((-10.0, 35.0), 15.0, 25.0)),
    HumanJoint("neck", "chest", _trunk((-45.0, 45.0), 45.0, 60.0)),
    *_sides("collar", "chest", _COLLAR, paired_parent=False),
    *_sides("shoulder", "collar", _SHOULDER),
    *_sides("elbow", "shoulder", _ELBOW),
    *_sides("wrist", "elbow", _WRIST),
    *_sides("hip", "pelvis", _HIP, paired_parent=False),
    *_sides("knee", "hip", _KNEE),
    *_sides("ankle", "knee", _ANKLE),
)
"""Parents before children; the parent of the root is the world, ""."""

ENDS: tuple[tuple[str, str], ...] = (
    ("head", "neck"),
    ("l_hand", "l_wrist"),
    ("r_hand", "r_wrist"),
    ("l_toe", "l_ankle"),
    ("r_toe", "r_ankle"),
)
"""Points at the ends of the tree that no joint carries: name and the joint whose segment they are on."""
