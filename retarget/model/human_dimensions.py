"""Anthropometry: a person's joints, segment lengths and masses."""

from dataclasses import dataclass, replace

import numpy as np

from retarget.errors import InputError, Problem
from retarget.frames import mirrored_name
from retarget.types import FloatArray

# Joints of the virtual human as data: tree, hinge chains, anatomical limits, and which hinges the smaller model locks.
#
# Eighteen joints: a floating root and seventeen internal ones, each a chain of three hinges in anatomical order, so
# that
# limits are a box. Zero is standing upright with the arms hanging, thumbs forward. Axes are in the rest frame (x
# forward,
# y left, z up) and a positive angle is the motion that the name says: flexion, abduction, medial rotation, pronation,
# dorsiflexion, inversion, elevation, protraction; trunk and neck bend and turn to the left. Limits: AAOS, those of the
# trunk split over spine and chest; a 0 of the table is `LAXITY_DEG` here, because a hinge needs some range.
#
# The shoulder. Three hinges lose one direction (gimbal lock) when the upper arm points along the first axis, either
# way.
# Flexion first would lock with the arm held out to the side, abduction first with the arm held forward, a turn about
# the
# vertical first with the arm hanging or overhead: all common. Here the first hinge raises the arm in the plane of the
# shoulder blade, half way between forward and sideward (`elevation`), the second swings it out of that plane
# (`swing`: positive forward and across the chest, negative outward and back), the third turns it about itself. Lock
# then
# needs the upper arm 45 degrees behind the frontal plane or 45 degrees across the chest, both horizontal and both at
# the
# edge of what a shoulder can do: hanging, overhead, forward and sideward are all at least 45 degrees away.

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


# Body proportions as data: where a person's mass lies and how long the segments are.
#
# Masses, centres of mass and radii of gyration are one table, Winter (2009) after Dempster, and are never mixed with
# another source. Lengths are fractions of stature: limbs and heights after Drillis & Contini (1966; Winter's Figure
# 4.1);
# the inner points of trunk and shoulder girdle, which that figure does not have, are means over twelve skeletons of the
# CMU motion database (clavicle 0.195 m, three trunk links of 0.117 m, hip offset 0.140 m at a stature of 1.72 m).


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


POINTS: tuple[str, ...] = tuple(joint.name for joint in HUMAN_JOINTS) + tuple(name for name, _ in ENDS)
"""All points of the human, parents first: the canonical joint names."""

PARENTS: tuple[int, ...] = tuple(
    POINTS.index(parent) if parent else -1
    for parent in [joint.parent for joint in HUMAN_JOINTS] + [parent for _, parent in ENDS]
)
"""Index of each point's parent; -1 for the pelvis."""

STATURE_M = (0.5, 2.6)
"""Statures that are taken for a human's, m: from an infant to the tallest people alive (2.5 m)."""

LENGTH_RATIO = (0.4, 2.2)
"""How far the length of a limb segment may be from average proportions."""

BODY_MASS_INDEX = 22.5
"""kg/m2: the mass of a person whose mass is not known. It scales forces only; postures depend on shares of it."""


@dataclass(frozen=True, eq=False)
class HumanDimensions:
    """One person's size.

    offset (23, 3) m: each of `POINTS` from its parent in the rest frame (x forward, y left, z up), standing upright,
    arms hanging; zero for the pelvis. stature: m. mass: kg. origin: where the numbers come from, for reports.
    """

    offset: FloatArray
    stature: float
    mass: float
    origin: str

    def __post_init__(self) -> None:
        offset = np.array(self.offset, dtype=float, order="C")
        assert offset.shape == (len(POINTS), 3) and bool(np.isfinite(offset).all())
        offset.flags.writeable = False
        object.__setattr__(self, "offset", offset)

    def of(self, name: str) -> FloatArray:
        """Offset (3,) m of a point from its parent."""
        return np.asarray(self.offset[POINTS.index(name)])

    def length(self, name: str) -> float:
        """Distance (m) of a point from its parent."""
        return float(np.linalg.norm(self.of(name)))

    def standing(self) -> FloatArray:
        """Every point (23, 3) m in the rest posture, the pelvis at the origin."""
        return points_of(self.offset)

    @property
    def pelvis_height(self) -> float:
        """Height (m) of the pelvis above the soles in the rest posture: the longer leg and the ankle's height."""
        points = self.standing()
        ankle = min(points[POINTS.index("l_ankle"), 2], points[POINTS.index("r_ankle"), 2])
        return float(-ankle + FRACTIONS.ankle_height * self.stature)


def points_of(offset: FloatArray) -> FloatArray:
    """Every point (23, 3) from the pelvis, of offsets (23, 3) from the parents, all in one frame."""
    points = np.zeros((len(POINTS), 3))
    for i, parent in enumerate(PARENTS):
        if parent >= 0:
            points[i] = points[parent] + offset[i]
    return points


def stature_of(offset: FloatArray) -> float:
    """Stature (m) of a person with these offsets (23, 3) m, from their standing height from ankles to head."""
    height = points_of(offset)[:, 2]
    ankles = 0.5 * (height[POINTS.index("l_ankle")] + height[POINTS.index("r_ankle")])
    return float((height[POINTS.index("head")] - ankles) / (FRACTIONS.head_height - FRACTIONS.ankle_height))


def default_mass(stature: float) -> float:
    """Mass (kg) of a person of this stature (m) whose mass is not known."""
    return BODY_MASS_INDEX * stature**2


def mirrored_dimensions(dimensions: HumanDimensions) -> HumanDimensions:
    """The same person with left and right exchanged."""
    columns = [POINTS.index(mirrored_name(name)) for name in POINTS]
    return replace(dimensions, offset=dimensions.offset[columns] * np.array([1.0, -1.0, 1.0]))


def proportional_dimensions(stature: float, *, mass: float | None = None) -> HumanDimensions:
    """A person of average proportions (see `StatureFractions`) of this stature (m)."""
    offset = np.array([_proportional_offset(name, FRACTIONS) for name in POINTS]) * stature
    return HumanDimensions(
        offset=offset,
        stature=stature,
        mass=default_mass(stature) if mass is None else mass,
        origin=f"average proportions at a stature of {stature:.2f} m",
    )


def check_plausible(dimensions: HumanDimensions, *, source: str) -> None:
    """Raise InputError, all faults at once, if this cannot be a human: stature, or a limb far from the usual."""
    low, high = STATURE_M
    if not low <= dimensions.stature <= high:
        raise InputError(
            "not the size of a human",
            where=source,
            found=f"a stature of {dimensions.stature:.3g} m",
            allowed=f"{low} to {high} m",
            next_step="Check the unit of length",
        )
    usual = proportional_dimensions(dimensions.stature)
    problems = []
    for name in _CHECKED:
        length, expected = dimensions.length(name), usual.length(name)
        low, high = (ratio * expected for ratio in LENGTH_RATIO)
        if not low <= length <= high:
            problems.append(
                Problem(
                    "not the proportions of a human",
                    where=source,
                    found=f"{POINTS[PARENTS[POINTS.index(name)]]} to {name} {length:.3f} m",
                    allowed=f"{low:.3f} to {high:.3f} m at a stature of {dimensions.stature:.2f} m",
                )
            )
    if problems:
        raise InputError.from_problems(problems)


_CHECKED = tuple(f"{side}_{part}" for part in ("elbow", "wrist", "knee", "ankle") for side in "lr")
"""Points whose distance from their parent is checked: the limbs, which every skeleton has."""


def _proportional_offset(name: str, part: StatureFractions) -> tuple[float, float, float]:
    """Offset of a point from its parent as shares of stature."""
    side = -1.0 if name.startswith("r_") else 1.0
    table = {
        "pelvis": (0.0, 0.0, 0.0),
        "spine": (0.0, 0.0, part.spine_link),
        "chest": (0.0, 0.0, part.spine_link),
        "neck": (0.0, 0.0, part.spine_link),
        "head": (0.0, 0.0, part.head_rise),
        "collar": (0.0, 0.0, part.spine_link),
        "shoulder": (0.0, side * part.shoulder_half_width, part.collar_rise),
        "elbow": (0.0, 0.0, -part.upper_arm),
        "wrist": (0.0, 0.0, -part.forearm),
        "hand": (0.0, 0.0, -part.hand),
        "hip": (part.hip_forward, side * part.hip_half_width, -part.pelvis_rise),
        "knee": (0.0, 0.0, -part.thigh),
        "ankle": (0.0, 0.0, -part.shank),
        "toe": (part.toe_forward, 0.0, -part.toe_drop),
    }
    return table[name[2:] if name[1] == "_" else name]
