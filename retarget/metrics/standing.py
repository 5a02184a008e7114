"""Whether a robot would stand, from the postures sent alone: centre of mass, support polygon, soles on the ground.

The ground is z = 0. A corner of a sole supports when it is at most `CONTACT_M` above the ground.
"""

from dataclasses import dataclass

import numpy as np

from retarget import rotations
from retarget.frames import BoolArray
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["OUTSIDE_M", "Sole", "foot_slide", "sole_corners", "sole_tilt", "soles_of", "support_margin"]

CONTACT_M = 0.005
"""Higher than this, m, a corner of a sole carries nothing."""
OUTSIDE_M = 1e-4
"""How far the centre of mass may be beyond the support polygon, m, before it counts."""
_DIRECTIONS = np.deg2rad(np.arange(0.0, 360.0, 2.0))


@dataclass(frozen=True, eq=False)
class Sole:
    """One sole over time. position (T, 3) m, orientation (T, 4) wxyz of its frame, world; polygon (c, 2) m in it."""

    position: FloatArray
    orientation: FloatArray
    polygon: FloatArray


def soles_of(robot: RobotBody, q: FloatArray) -> list[Sole]:
    """The soles of a robot in postures (T, nq)."""
    feet = list(robot.profile.feet.values())
    frames = tuple(foot.frame for foot in feet)
    position, orientation = robot.points(q, frames), robot.orientations(q, frames)
    return [
        Sole(position[:, column], orientation[:, column], np.array(foot.polygon)) for column, foot in enumerate(feet)
    ]


def sole_corners(sole: Sole) -> FloatArray:
    """Corners (T, c, 3) m of a sole, world."""
    local = np.column_stack([sole.polygon, np.zeros(len(sole.polygon))])
    return np.asarray(sole.position[:, None] + rotations.rotate(sole.orientation[:, None], local))


def sole_tilt(sole: Sole) -> FloatArray:
    """Angle (T,) rad between a sole and the ground."""
    upward = rotations.rotate(sole.orientation, np.array([0.0, 0.0, 1.0]))
    return np.asarray(np.arccos(np.clip(upward[:, 2], -1.0, 1.0)))


def support_margin(centre_of_mass: FloatArray, corners: FloatArray) -> FloatArray:
    """How far (T,) m the centre of mass (T, 3) is inside the hull of the corners (T, c, 3) that touch the ground.

    Negative: outside by that much. NaN where nothing touches. The smallest distance, over directions 2 degrees apart,
    to the farthest corner of each direction: exact to 0.02 % of the polygon's size.
    """
    touching = corners[..., 2] <= CONTACT_M  # (T, c)
    directions = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
    farthest = np.full((len(corners), _DIRECTIONS.size), -np.inf)
    for corner in range(corners.shape[1]):
        offset = corners[:, corner, :2] - centre_of_mass[:, :2]
        offset[~touching[:, corner]] = np.nan
        np.fmax(farthest, offset @ directions, out=farthest)
    margin = farthest.min(axis=1)
    return np.asarray(np.where(touching.any(axis=1), margin, np.nan))


def foot_slide(sole: Sole) -> float:
    """How far (m) a sole's centre got, at most, from where it touched the ground, while it touched."""
    down: BoolArray = np.asarray(sole_corners(sole)[..., 2].min(axis=1) <= CONTACT_M)
    slide = 0.0
    for first, last in _spans(down):
        place = sole.position[first:last, :2]
        slide = max(slide, float(np.linalg.norm(place - place[0], axis=1).max()))
    return slide


def _spans(flags: BoolArray) -> list[tuple[int, int]]:
    """(first, one past the last) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
