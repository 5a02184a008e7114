"""How much a robot looks like its performer: angles between their limbs, and how their trunks lean."""

import numpy as np

from retarget.ik.support_polygon import plant
from retarget.model.human_dimensions import POINTS
from retarget.model.robot import RobotBody
from retarget.report.tracking import Performance, headings, turned
from retarget.types import FloatArray

LIMBS = {
    "upper_arms": ("shoulder", "elbow"),
    "forearms": ("elbow", "hand"),
    "thighs": ("hip", "knee"),
    "shanks": ("knee", "ankle"),
}
"""By name: the frames of a robot, and the joints of a human, between which a limb of each side lies."""
OF_HUMAN = {"hand": "wrist"}
"""Where the joint of a human has another name than the frame of a robot."""
LEAN = "trunk_lean"
TRUNK = ("l_hip", "r_hip", "neck")


def limb_angles(robot: RobotBody, q: FloatArray, asked: Performance) -> dict[str, FloatArray]:
    """Angles (T, s) rad, by the name of a limb and for each side, between a robot in postures (T, nq) and the performer
    in their heading; `LEAN` (T, 1): between the leans of their trunks, each from where it is upright.

    A limb is left out where the robot has no such frames.
    """
    heading = headings(asked.pelvis, asked.joint_names, asked.joints, asked.dt)

    def line(first: str, last: str) -> FloatArray:
        ends = [asked.joints[:, asked.joint_names.index(name)] for name in (first, last)]
        return turned(ends[1] - ends[0], heading)

    found = {}
    for limb, parts in LIMBS.items():
        sides = [[f"{side}_{part}" for part in parts] for side in "lr"]
        if all(name in robot.profile.frames for names in sides for name in names):
            lines = [np.subtract(*np.moveaxis(robot.points(q, (last, first)), 1, 0)) for first, last in sides]
            human = [line(*(f"{side}_{OF_HUMAN.get(part, part)}" for part in parts)) for side in "lr"]
            found[limb] = np.stack([_angle(a, b) for a, b in zip(lines, human, strict=True)], axis=1)
    if all(name in robot.profile.frames for name in TRUNK):
        stood = plant(robot, robot.profile.postures.stand).q
        rest = dict(zip(POINTS, asked.dimensions.standing(), strict=True))
        performer = 0.5 * (line("l_hip", "neck") + line("r_hip", "neck"))
        upright = rest["neck"] - 0.5 * (rest["l_hip"] + rest["r_hip"])
        lean = _lean(_trunk(robot, q)) - _lean(_trunk(robot, stood[None])) - _lean(performer) + _lean(upright[None])
        found[LEAN] = np.linalg.norm(lean, axis=1)[:, None]
    return found


def _trunk(robot: RobotBody, q: FloatArray) -> FloatArray:
    """From the middle of the hips to the neck (T, 3), m."""
    left, right, neck = np.moveaxis(robot.points(q, TRUNK), 1, 0)
    return np.asarray(neck - 0.5 * (left + right))


def _lean(line: FloatArray) -> FloatArray:
    """How far (T, 2) lines (T, 3) lean forward and to the left, rad."""
    return np.arctan2(line[:, :2], line[:, 2:])


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles (T,) rad between lines (T, 3)."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)))
