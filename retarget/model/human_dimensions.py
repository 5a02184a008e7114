"""Anthropometry: a person's joints, segment lengths and masses."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from retarget.arithmetic import norm
from retarget.errors import InputError, Problem
from retarget.frames import mirrored_name
from retarget.schema import strict_yaml
from retarget.types import FloatArray

TABLES: Mapping[str, Any] = strict_yaml.load(Path(__file__).with_name("human.yaml")).data
"""Content of `human.yaml` by section."""


@dataclass(frozen=True)
class Hinge:
    """One axis of a joint: motion, axis in the rest frame (of the left side), limits in degrees."""

    motion: str
    axis: list[float]
    limits: tuple[float, float]
    locked: bool = False
    """Locked in the model of 51 degrees of freedom."""


@dataclass(frozen=True)
class HumanJoint:
    """A joint with its hinges, outermost first; the root has none. Names are canonical."""

    name: str
    parent: str
    hinges: tuple[Hinge, ...]

    def axis(self, hinge: Hinge) -> FloatArray:
        """Axis (3,) in the rest frame, mirrored on the right side."""
        mirror = np.array([-1.0, 1.0, -1.0]) if self.name.startswith("r_") else np.ones(3)
        return np.asarray(np.array(hinge.axis) * mirror)


def _each_side(name: str, parent: str) -> list[tuple[str, str]]:
    """Names of a table's entry and its parent: `{s}` stands for both sides."""
    sides = "lr" if "{s}" in name else "l"
    return [(name.replace("{s}", side), parent.replace("{s}", side)) for side in sides]


HUMAN_JOINTS: tuple[HumanJoint, ...] = tuple(
    HumanJoint(name, parent, tuple(Hinge(**hinge) for hinge in entry["hinges"]))
    for key, entry in TABLES["joints"].items()
    for name, parent in _each_side(key, entry["parent"])
)
"""Parents before children; the root has parent ""."""

ENDS: tuple[tuple[str, str], ...] = tuple(pair for end in TABLES["ends"].items() for pair in _each_side(*end))
"""Points at the ends of the tree, and their segments' joints."""


@dataclass(frozen=True)
class Segment:
    """A body segment from proximal `start` to distal `end`: joints or levels of the trunk.

    mass: share of the body's. com, gyration: centre of mass from `start`, radius of gyration across, relative to
    length.
    """

    body: str
    start: str
    end: str
    mass: float
    com: float
    gyration: float | None = None


SEGMENTS: tuple[Segment, ...] = tuple(Segment(**entry) for entry in TABLES["segments"])

TRUNK_LEVELS: Mapping[str, float] = TABLES["trunk_levels"]
"""Heights on the trunk, from hips (0) to shoulders (1)."""


@dataclass(frozen=True)
class StatureFractions:
    """Lengths relative to stature: heights of ankle and middle of the head, heel behind ankle, tip of foot ahead of toe
    joint."""

    ankle_height: float
    head_height: float
    heel_back: float
    toe_tip: float


FRACTIONS = StatureFractions(**TABLES["lengths"])


POINTS: tuple[str, ...] = tuple(joint.name for joint in HUMAN_JOINTS) + tuple(name for name, _ in ENDS)
"""Canonical names of all points, parents first."""

PARENTS: tuple[int, ...] = tuple(
    POINTS.index(parent) if parent else -1
    for parent in [joint.parent for joint in HUMAN_JOINTS] + [parent for _, parent in ENDS]
)
"""Index of each point's parent; -1 for the pelvis."""


def kind_of(name: str) -> str:
    """Name of a point without its side."""
    return name[2:] if name[1] == "_" else name


STATURE_M = (0.5, 2.6)
"""Statures of humans, m."""

LENGTH_RATIO = (0.4, 2.2)
"""Bounds of a limb segment's length, relative to the average."""

BODY_MASS_INDEX = 22.5
"""Default body-mass index, kg/m2. It scales forces only."""


@dataclass(frozen=True, eq=False)
class HumanDimensions:
    """The size of one person.

    offset (23, 3) m: of `POINTS` from their parents in the rest frame (x forward, y left, z up), standing with hanging
    arms. stature: m. mass: kg. origin: for reports.
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
        """Distance of a point from its parent, m."""
        return norm(self.of(name))

    def standing(self) -> FloatArray:
        """All points (23, 3) m in the rest posture, from the pelvis."""
        return points_of(self.offset)

    @property
    def pelvis_height(self) -> float:
        """Height of the pelvis above the soles at rest, m."""
        points = self.standing()
        ankle = min(points[POINTS.index("l_ankle"), 2], points[POINTS.index("r_ankle"), 2])
        return float(-ankle + FRACTIONS.ankle_height * self.stature)


def points_of(offset: FloatArray) -> FloatArray:
    """Points (23, 3) m from the pelvis, for offsets (23, 3) m in one frame."""
    points = np.zeros((len(POINTS), 3))
    for i, parent in enumerate(PARENTS):
        if parent >= 0:
            points[i] = points[parent] + offset[i]
    return points


def stature_of(offset: FloatArray) -> float:
    """Stature, m, for offsets (23, 3) m."""
    height = points_of(offset)[:, 2]
    ankles = 0.5 * (height[POINTS.index("l_ankle")] + height[POINTS.index("r_ankle")])
    return float((height[POINTS.index("head")] - ankles) / (FRACTIONS.head_height - FRACTIONS.ankle_height))


def default_mass(stature: float) -> float:
    """Mass, kg, of a person of unknown mass."""
    return BODY_MASS_INDEX * stature * stature


def mirrored_dimensions(dimensions: HumanDimensions) -> HumanDimensions:
    """Dimensions with left and right exchanged."""
    columns = [POINTS.index(mirrored_name(name)) for name in POINTS]
    return replace(dimensions, offset=dimensions.offset[columns] * np.array([1.0, -1.0, 1.0]))


def proportional_dimensions(stature: float) -> HumanDimensions:
    """Dimensions of average proportions for a stature, m."""
    offset = np.array([TABLES["offsets"][kind_of(name)] for name in POINTS]) * stature
    right = [POINTS.index(name) for name in ("r_shoulder", "r_hip")]
    offset[right, 1] *= -1.0
    return HumanDimensions(
        offset=offset,
        stature=stature,
        mass=default_mass(stature),
        origin=f"average proportions at a stature of {stature:.2f} m",
    )


def check_plausible(dimensions: HumanDimensions, *, source: str) -> None:
    """Raise InputError, with all faults, for implausible stature or limbs."""
    low, high = STATURE_M
    if not low <= dimensions.stature <= high:
        raise InputError(
            "not the size of a human",
            where=source,
            found=f"a stature of {dimensions.stature:.3g} m",
            allowed=f"{low} to {high} m",
            next_step="Check the unit of length and the up axis: of a file, --unit and --up say them",
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
