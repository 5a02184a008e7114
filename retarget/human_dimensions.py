"""Segment lengths of one person: where each joint lies from its parent, standing with the arms hanging."""

from dataclasses import dataclass, replace

import numpy as np

from retarget.anthropometry import FRACTIONS, StatureFractions
from retarget.errors import InputError, Problem
from retarget.frames import mirrored_name
from retarget.human_joints import ENDS, HUMAN_JOINTS
from retarget.rotations import FloatArray

__all__ = [
    "PARENTS",
    "POINTS",
    "HumanDimensions",
    "check_plausible",
    "default_mass",
    "mirrored_dimensions",
    "points_of",
    "proportional_dimensions",
    "stature_of",
]

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
    """Stature (m) of a person with these offsets (23, 3) m: their standing height from ankles to head tells it."""
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
    """A person of average proportions (see `anthropometry`) of this stature (m)."""
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
"""Points whose distance from their parent is checked: the limbs, which every skeleton knows."""


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
