"""Performer calibration: size from the skeleton in the file, or from a rest pose of the sensors.

Limbs keep their lengths and hang straight down, as in the human's rest frame. Unknown lengths are average.
"""

from dataclasses import replace

import numpy as np

from retarget.arithmetic import norm
from retarget.errors import InputError, Problem
from retarget.frames import SensorFrames, Skeleton
from retarget.human.rest_pose import find_rest_frames, fit_rest_pose, standing_stature
from retarget.model.human_dimensions import (
    FRACTIONS,
    PARENTS,
    POINTS,
    HumanDimensions,
    check_plausible,
    default_mass,
    kind_of,
    proportional_dimensions,
)
from retarget.model.rest_skeleton import hanging_toe, rest_faults
from retarget.types import FloatArray

_LIMB = {"elbow", "wrist", "hand", "knee", "ankle"}  # points that hang straight below their parent in the rest frame

# Joints without which a skeleton does not give a person's size.
_NEEDED_JOINTS = (
    "head",
    *(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in "lr"),
)

_DOWN = np.array([0.0, 0.0, -1.0])  # unit vector


def calibrate(frames: SensorFrames) -> HumanDimensions:
    """The performer's size, from the skeleton where the source has one, else from a rest pose.

    Without a rest pose it has average proportions, noted in `origin`. Raises InputError: not a human, or sensors
    missing.
    """
    if frames.skeleton is not None:
        return dimensions_from_skeleton(frames.skeleton, source=frames.source)
    candidates = find_rest_frames(frames)
    for at in candidates:
        names = tuple(name for name, valid in zip(frames.names, frames.valid[at], strict=True) if valid)
        position = frames.position[at, frames.valid[at]]
        try:
            return fit_rest_pose(names, position, stature=frames.stature, source=frames.source).dimensions
        except InputError:
            continue
    # People never look taller than they are, so the tallest frame is the nearest to the truth.
    stature = frames.stature or max(standing_stature(frames, at) for at in candidates)
    usual = proportional_dimensions(stature)
    check_plausible(usual, source=frames.source)
    return replace(usual, origin=f"{usual.origin} (no rest pose in {frames.source})")


def dimensions_from_skeleton(skeleton: Skeleton, *, source: str = "") -> HumanDimensions:
    """Return every length of the skeleton, and average ones for the rest.

    Raises InputError: joints missing, not upright facing x, or not of a human's size and shape.
    """
    known = {
        name: np.asarray(at)
        for name, at in zip(skeleton.names, skeleton.position, strict=True)
        if np.isfinite(at).all()
    }
    missing = [name for name in _NEEDED_JOINTS if name not in known]
    if missing:
        raise InputError("joints missing from the skeleton", where=source, found=f"no {', '.join(missing)}")
    faults = rest_faults(skeleton)
    if faults:
        raise InputError.from_problems(
            [Problem(f"the skeleton is no body that stands and faces x: {fault}", source) for fault in faults]
        )
    # Stature from the legs along the bones and the trunk upward to the middle of the head; average shares add the rest.
    legs = [norm(known[f"{s}_knee"] - known[f"{s}_hip"]) + norm(known[f"{s}_ankle"] - known[f"{s}_knee"]) for s in "lr"]
    trunk = known["head"][2] - 0.5 * (known["l_hip"][2] + known["r_hip"][2])
    stature = float((np.mean(legs) + trunk) / (FRACTIONS.head_height - FRACTIONS.ankle_height))
    usual = proportional_dimensions(stature)
    points = _completed(known, usual)
    offset = np.array([_offset(name, points) for name in POINTS])
    for side in "lr":
        toe = hanging_toe(skeleton, side)
        offset[POINTS.index(f"{side}_toe")] = usual.of(f"{side}_toe") if toe is None else toe
    result = HumanDimensions(
        offset=offset,
        stature=stature,
        mass=default_mass(stature),
        origin=f"skeleton of {source}" if source else "skeleton",
    )
    check_plausible(result, source=source)
    return result


def _completed(known: dict[str, FloatArray], usual: HumanDimensions) -> dict[str, FloatArray]:
    """All canonical points at rest. Missing trunk points lie between their neighbours."""
    points = dict(known)
    hips = 0.5 * (points["l_hip"] + points["r_hip"])
    shoulders = 0.5 * (points["l_shoulder"] + points["r_shoulder"])
    points.setdefault("pelvis", hips - 0.5 * (usual.of("l_hip") + usual.of("r_hip")))
    points.setdefault("neck", shoulders - np.array([0.0, 0.0, usual.of("l_shoulder")[2]]))
    pelvis, neck = points["pelvis"], points["neck"]
    if "chest" not in points:
        points["chest"] = (
            points["spine"] + 0.5 * (neck - points["spine"]) if "spine" in points else _share(pelvis, neck, 2.0 / 3.0)
        )
    points.setdefault("spine", _share(pelvis, points["chest"], 0.5))
    for side in ("l_", "r_"):
        points.setdefault(side + "collar", neck)
        # A hand goes on as the forearm, since rest poses have straight wrists.
        forearm = points[side + "wrist"] - points[side + "elbow"]
        straight = forearm / max(norm(forearm), 1e-9)
        points.setdefault(side + "hand", points[side + "wrist"] + usual.length(side + "hand") * straight)
    return points


def _share(start: FloatArray, end: FloatArray, share: float) -> FloatArray:
    return np.asarray(start + share * (end - start))


def _offset(name: str, points: dict[str, FloatArray]) -> FloatArray:
    parent = PARENTS[POINTS.index(name)]
    if parent < 0 or name not in points:
        return np.zeros(3)
    offset = points[name] - points[POINTS[parent]]
    return np.asarray(norm(offset) * _DOWN if kind_of(name) in _LIMB else offset)
