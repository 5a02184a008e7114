"""Body proportions as data: where a person's mass lies and how long the segments are.

Masses, centres of mass and radii of gyration are one table, Winter (2009) after Dempster, and are never mixed with
another source. Lengths are fractions of stature: limbs and heights after Drillis & Contini (1966; Winter's Figure 4.1);
the inner points of trunk and shoulder girdle, which that figure does not have, are means over twelve skeletons of the
CMU motion database (clavicle 0.195 m, three trunk links of 0.117 m, hip offset 0.140 m at a stature of 1.72 m).
"""

from dataclasses import dataclass

__all__ = ["FRACTIONS", "SEGMENTS", "TRUNK_LEVELS", "Segment", "StatureFractions", "TrunkLevels"]


@dataclass(frozen=True)
class Segment:
    """A body segment between two points, `start` (proximal) and `end` (distal).

    body: the joint that carries it. mass: share of the body mass (of one side). com: centre of mass from `start`, as
    a share of the length. gyration: radius of gyration about the centre of mass, across the segment, as a share of the
    length; None where the table has none. The points are canonical joint names, or levels of the trunk (see
    `TrunkLevels`) and `hips`, the middle between the hip joints.
    """

    body: str
    start: str
    end: str
    mass: float
    com: float
    gyration: float | None


SEGMENTS: tuple[Segment, ...] = (
    Segment("pelvis", "l4_l5", "hips", 0.142, 0.105, None),
    Segment("spine", "t12_l1", "l4_l5", 0.139, 0.44, None),
    Segment("chest", "c7_t1", "t12_l1", 0.216, 0.82, None),
    Segment("neck", "neck", "head", 0.081, 1.0, 0.495),
    Segment("shoulder", "shoulder", "elbow", 0.028, 0.436, 0.322),
    Segment("elbow", "elbow", "wrist", 0.016, 0.430, 0.303),
    Segment("wrist", "wrist", "hand", 0.006, 0.506, 0.297),
    Segment("hip", "hip", "knee", 0.100, 0.433, 0.323),
    Segment("knee", "knee", "ankle", 0.0465, 0.433, 0.302),
    Segment("ankle", "ankle", "toe", 0.0145, 0.50, 0.475),
)
"""Winter (2009), Table 4.1. A limb segment occurs on both sides; the collars carry no mass of their own (it is the
thorax's). The head's centre of mass is at the ear canal, where the head point is. Sum over both sides: 1.000."""


@dataclass(frozen=True)
class TrunkLevels:
    """Heights on the trunk, as shares of the way from the hips (0) to the shoulders (1)."""

    l4_l5: float
    t12_l1: float
    c7_t1: float


TRUNK_LEVELS = TrunkLevels(l4_l5=0.25, t12_l1=0.617, c7_t1=1.13)
"""L4-L5 at the iliac crest (0.602 of stature) and C7 at 0.855 of stature; T12-L1 lies where the three trunk parts
together have their centre of mass at 0.50 of the trunk, as the same table says for the trunk as a whole."""


@dataclass(frozen=True)
class StatureFractions:
    """Lengths as shares of stature. `_rise` is upward, `_half_width` to one side, all in the standing body."""

    ankle_height: float = 0.039
    shank: float = 0.246
    thigh: float = 0.245
    hip_half_width: float = 0.054
    """Between the joint centres; the 0.191 of Drillis & Contini is the breadth of the hips outside."""
    hip_forward: float = 0.020
    pelvis_rise: float = 0.058
    """From the hip joints to the pelvis point, at the level of L4-L5."""
    spine_link: float = 0.068
    """Each of pelvis to spine, spine to chest, chest to neck."""
    collar_rise: float = 0.026
    """From the base of the neck up to the shoulder joint; the trunk sums to the 0.288 of Drillis & Contini."""
    shoulder_half_width: float = 0.110
    """Between the joint centres; their 0.259 is the breadth of the shoulders outside."""
    head_rise: float = 0.142
    """From the base of the neck to the middle of the head, at the level of the eyes (0.936)."""
    upper_arm: float = 0.186
    forearm: float = 0.146
    hand: float = 0.050
    """Wrist to knuckles; to the finger tips it is 0.108."""
    toe_forward: float = 0.069
    toe_drop: float = 0.018
    heel_back: float = 0.047
    toe_tip: float = 0.036
    """From the toe joint to the tip of the foot: the foot is 0.152 long."""
    head_height: float = 0.936
    """Middle of the head (eyes, ear canal) above the ground."""


FRACTIONS = StatureFractions()
