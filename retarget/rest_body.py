"""A person at rest as a few numbers: where they stand, how they are built, and which way their limbs point.

The body is upright; each arm and leg is two segments with a direction each. Proportions are logarithms about the
average (see `anthropometry`), so that 0 is average and a sum of squares is how unusual a person is.
"""

import numpy as np

from retarget.human_dimensions import POINTS, points_of, proportional_dimensions
from retarget.rotations import FloatArray

__all__ = ["ANGLES", "COUNT", "HEADING", "LIMBS", "PROPORTIONS", "ROOT", "STATURE", "offsets", "points", "prior"]

ROOT, HEADING, STATURE, PROPORTIONS, ANGLES, COUNT = slice(0, 3), 3, 4, slice(5, 12), slice(12, 28), 28
"""Layout of the parameters: pelvis position (3) m, heading (rad), logarithm of the stature in m, logarithms of the
proportions (7: the groups below, then breadth), and angles (rad) of 4 limbs x 2 segments x (sideward, forward)."""

LIMBS: tuple[tuple[str, str], ...] = (
    ("l_elbow", "l_wrist"),
    ("r_elbow", "r_wrist"),
    ("l_knee", "l_ankle"),
    ("r_knee", "r_ankle"),
)
"""Far ends of the two segments of each limb."""

_GROUPS: tuple[tuple[str, ...], ...] = (
    ("pelvis", "spine", "chest", "neck", "collar"),
    ("head",),
    ("elbow",),
    ("wrist", "hand"),
    ("knee",),
    ("ankle", "toe"),
)
"""Points whose offsets share one proportion: trunk, head, upper arm, forearm, thigh, shank."""

SEGMENT_SPREAD = 0.05
"""Relative spread between people of a segment's share of stature."""
BREADTH_SPREAD = 0.08
ARM_SPREAD_RAD = 0.6
"""Spread of an arm's direction at rest, forward and back; sideward it is free: it tells N, A and T apart."""
LEG_SPREAD_RAD = 0.25
"""Spread of a leg's direction at rest."""
BEND_SPREAD_RAD = 0.15
"""Spread of the bend of an elbow or knee at rest, where no sensor sees it."""
SEEN_BEND_SPREAD_RAD = 0.4
"""And where one does."""

_UNIT = proportional_dimensions(1.0).offset


def _group_of(name: str) -> int:
    kind = name[2:] if name[1] == "_" else name
    return next((group for group, members in enumerate(_GROUPS) if kind in members), 0)


_GROUP_OF = np.array([_group_of(name) for name in POINTS])
_BROAD = np.array([name[2:] in ("shoulder", "hip") for name in POINTS])
_SEGMENT_ROWS = np.array([[POINTS.index(name) for name in limb] for limb in LIMBS])
_HANDS = np.array([POINTS.index("l_hand"), POINTS.index("r_hand")])


def offsets(parameters: FloatArray) -> FloatArray:
    """Offsets (23, 3) m from the parents, in the rest frame of the human, for these parameters."""
    scale = np.exp(parameters[PROPORTIONS])
    result = _UNIT * np.exp(parameters[STATURE]) * scale[_GROUP_OF, None]
    result[_BROAD, 1] *= scale[-1] / scale[0]
    return np.asarray(result)


def points(parameters: FloatArray) -> FloatArray:
    """All points (23, 3) m of the person, world."""
    offset = offsets(parameters)
    direction = _directions(parameters)
    offset[_SEGMENT_ROWS] = direction * -offset[_SEGMENT_ROWS][..., 2:]
    offset[_HANDS] = direction[:2, 1] * -offset[_HANDS][:, 2:]
    result = points_of(offset)
    cosine, sine = np.cos(parameters[HEADING]), np.sin(parameters[HEADING])
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(result @ turn.T + parameters[ROOT])


def prior(parameters: FloatArray, bend_spread: FloatArray) -> FloatArray:
    """How unusual a person and a rest pose are, as residuals: seven proportions first, then directions and bends.

    bend_spread (4,): spread (rad) of the bend of each limb.
    """
    spread = np.array([SEGMENT_SPREAD] * len(_GROUPS) + [BREADTH_SPREAD])
    angles = parameters[ANGLES].reshape(4, 2, 2)
    arms, legs = angles[:2, 0, 1], angles[2:, 0]
    bends = (angles[:, 1] - angles[:, 0]) / bend_spread[:, None]
    return np.concatenate(
        [parameters[PROPORTIONS] / spread, arms / ARM_SPREAD_RAD, legs.ravel() / LEG_SPREAD_RAD, bends.ravel()]
    )


def _directions(parameters: FloatArray) -> FloatArray:
    """Unit vectors (4, 2, 3) of the limbs' segments, downward at zero, in the person's frame."""
    sideward, forward = np.moveaxis(parameters[ANGLES].reshape(4, 2, 2), -1, 0)
    side = np.array([[1.0], [-1.0], [1.0], [-1.0]])
    level = np.cos(forward)
    return np.stack([np.sin(forward), side * np.sin(sideward) * level, -np.cos(sideward) * level], axis=-1)
