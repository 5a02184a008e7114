"""How a drafted robot follows the human, limb by limb: landmarks by what limbs it has."""

from dataclasses import dataclass

import numpy as np

from retarget.importing.posed import Placed
from retarget.rotations import FloatArray

__all__ = ["LandmarkDraft", "find_landmarks"]

STRETCH = 0.97
"""Share of the stretched limb: a stretched human limb must not ask for a singular one."""


@dataclass(frozen=True)
class LandmarkDraft:
    """As `profile_parts.Landmark`, as text of its lists. offset (3,) m, or nothing."""

    name: str
    follows: str
    measured_from: str
    anchor: str
    length: float
    human_length: str
    offset: tuple[float, float, float] | None = None


def find_landmarks(placed: Placed, leg: float, axes: FloatArray) -> tuple[LandmarkDraft, ...]:
    """placed: the robot standing, trunk upright. leg: stretched hip to ankle, m. axes (3, 3): of the robot, columns."""
    at = placed.positions
    found = []
    for side in ("l", "r"):
        shoulder, elbow, hand = (f"{side}_{part}" for part in ("shoulder", "elbow", "hand"))
        if hand in at:
            way = [at[name] for name in (shoulder, elbow, hand) if name in at]
            length = STRETCH * float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
            chain = f"[{side}_shoulder, {side}_elbow, {side}_wrist]"
            found.append(LandmarkDraft(hand, f"{side}_wrist", shoulder, shoulder, length, chain))
    if "pelvis" in at:
        length = max(float(np.linalg.norm(at["head"] - at["pelvis"])), 0.01)
        found.append(LandmarkDraft("head", "head", "[l_hip, r_hip]", "pelvis", length, "[[l_hip, r_hip], head]"))
    else:
        length = max(float(np.linalg.norm(at["head"] - at["neck"])), 0.01)
        found.append(LandmarkDraft("head", "head", "neck", "neck", length, "[neck, head]"))
    if "l_sole" not in at or "r_sole" not in at:
        return tuple(found)
    chain, length = "[l_hip, l_knee, l_ankle]", STRETCH * leg
    ankles = "[l_ankle, r_ankle]"
    found.append(LandmarkDraft("pelvis", "[l_hip, r_hip]", ankles, ankles, length, chain))
    for side in ("l", "r"):
        x, y, z = (axes.T @ (at[f"{side}_sole"] - at[f"{side}_ankle"])).round(4).tolist()
        chain = f"[{side}_hip, {side}_knee, {side}_ankle]"
        hip, ankle = f"{side}_hip", f"{side}_ankle"
        found.append(LandmarkDraft(f"{side}_sole", ankle, hip, hip, length, chain, (x, y, z)))
    return tuple(found)
