"""A person's size from sensors alone: the performer stands still, arms hanging, half raised or straight out.

A body of straight limbs is fitted to the sensors: stature, six proportions (thigh, shank, trunk, upper arm, forearm,
breadth), where the body stands and which way its limbs point. Five sensors cannot tell how a length is shared between
trunk and legs, or between upper arm and forearm: proportions are held near the average by as much as people differ, so
that more sensors (knees, elbows, hips, shoulders, pelvis, chest) sharpen exactly what they see.
"""

from collections.abc import Sequence

import numpy as np

from retarget.anthropometry import FRACTIONS
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.human_dimensions import (
    PARENTS,
    POINTS,
    STATURE_M,
    HumanDimensions,
    default_mass,
    proportional_dimensions,
)
from retarget.rotations import FloatArray

__all__ = ["dimensions_from_rest_pose", "find_rest_frame", "rest_pose_name"]

REQUIRED = ("head", "l_wrist", "r_wrist")
"""Without ankles the ground (z = 0) stands in for them."""

SENSOR_SPREAD_M = 0.01
"""How far a sensor sits from the joint centre that it stands for."""
PROPORTION_SPREAD = 0.035
"""Relative spread of a limb's share of stature between people."""
BREADTH_SPREAD = 0.08
LIMB_SPREAD_RAD = 0.6
"""Spread of the directions of arms (in front or behind) and legs at rest."""
MAX_RESIDUAL_M = 0.06
"""A fit that misses the sensors by more (root mean square) is no rest pose of a human."""
MAX_PROPORTION_SPREADS = 5.0

_UNIT = proportional_dimensions(1.0).offset
_GROUPS: tuple[tuple[str, ...], ...] = (
    ("knee",),
    ("ankle", "toe"),
    ("pelvis", "spine", "chest", "neck", "collar", "head"),
    ("elbow",),
    ("wrist", "hand"),
)
_TRUNK = 2
_HEADING, _SIZES, _ARM_ANGLES, _LEG_ANGLES, _COUNT = 3, slice(4, 11), slice(11, 15), slice(15, 19), 19
"""Layout of the parameters: root position (3), heading, then the logarithms of stature, of the proportions of `_GROUPS`
and of breadth, then left and right (sideward, forward) angles of the arms, and of the legs."""
_BLEND_FRAMES = 600
"""Frames looked at, evenly over the recording, for one that is most like a rest pose."""


def rest_pose_name(arm_angle_rad: float) -> str:
    """N, A or T: by the angle of the arms from hanging."""
    degrees = np.rad2deg(arm_angle_rad)
    return "N" if degrees < 25.0 else "A" if degrees < 65.0 else "T"


def dimensions_from_rest_pose(
    names: Sequence[str], position: FloatArray, *, mass: float | None = None, source: str = ""
) -> HumanDimensions:
    """Fit a person to sensors at rest. names: k canonical sensor names; position (k, 3) m, world, z up.

    Head and wrists are needed, ankles should be there. Raises InputError: sensors missing, or no upright human.
    """
    from scipy.optimize import least_squares  # 0.2 s to import, and rarely needed

    missing = [name for name in REQUIRED if name not in names]
    if missing:
        raise InputError(
            "sensors missing for the calibration",
            where=source,
            found=f"no {', '.join(missing)}",
            allowed="at least head, both wrists and both ankles",
        )
    position = np.asarray(position, float)
    columns = [POINTS.index(name) for name in names]
    grounded = not {"l_ankle", "r_ankle"} <= set(names)
    start = _first_guess(dict(zip(names, position, strict=True)), source=source)

    def residual(parameters: FloatArray) -> FloatArray:
        points = _straight_body(parameters)
        misfit = (points[columns] - position).ravel() / SENSOR_SPREAD_M
        parts = [misfit, _prior(parameters)]
        if grounded:
            sole = np.exp(parameters[_SIZES][0]) * FRACTIONS.ankle_height
            ankles = points[[POINTS.index("l_ankle"), POINTS.index("r_ankle")], 2]
            parts.append((ankles - sole) / SENSOR_SPREAD_M)
        return np.concatenate(parts)

    fit = least_squares(residual, start, max_nfev=200)
    _check_fit(fit.x, _straight_body(fit.x)[columns] - position, source=source)
    return _dimensions(fit.x, mass=mass, source=source)


def find_rest_frame(frames: SensorFrames) -> int:
    """Index of the frame most like a rest pose: the head highest above the ankles, the wrists low or level, all slow.

    Raises InputError if head and wrists are never valid together.
    """
    needed = [name for name in (*REQUIRED, "l_ankle", "r_ankle") if name in frames.names]
    columns = [frames.index(name) for name in needed]
    rows = np.unique(np.linspace(0, len(frames) - 1, _BLEND_FRAMES).astype(int))
    rows = rows[frames.valid[np.ix_(rows, columns)].all(axis=1)]
    if rows.size == 0 or not set(REQUIRED) <= set(needed):
        raise InputError("no frame shows head and both wrists", where=frames.source, next_step="Record a rest pose")
    height = frames.position[rows, frames.index("head"), 2].copy()
    if {"l_ankle", "r_ankle"} <= set(needed):
        height -= 0.5 * sum(frames.position[rows, frames.index(name), 2] for name in ("l_ankle", "r_ankle"))
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(frames) - 1)
    moved = frames.position[np.ix_(after, columns)] - frames.position[np.ix_(before, columns)]
    duration = np.maximum(frames.time[after] - frames.time[before], 1e-9)[:, None]
    speed = np.nan_to_num(np.linalg.norm(moved, axis=2) / duration, nan=10.0).max(axis=1)
    # One tenth of a metre of height is worth a metre per second of motion.
    return int(rows[np.argmax(height - 0.1 * speed)])


def _first_guess(sensors: dict[str, FloatArray], *, source: str) -> FloatArray:
    """Parameters (19,) near the answer: heading from left and right, stature from the head, arms from the wrists."""
    ankles = [sensors[name] for name in ("l_ankle", "r_ankle") if name in sensors]
    ground = np.mean(ankles, axis=0)[2] if len(ankles) == 2 else 0.0
    share = FRACTIONS.head_height - (FRACTIONS.ankle_height if len(ankles) == 2 else 0.0)
    stature = float((sensors["head"][2] - ground) / share)
    low, high = STATURE_M
    if not low <= stature <= high:
        raise InputError(
            "the sensors do not show a standing human",
            where=source,
            found=f"the head {stature * share:.2f} m above the {'ankles' if ankles else 'ground'}",
            allowed=f"{low * share:.2f} to {high * share:.2f} m",
            next_step="Check the unit and the upward axis, and stand upright to calibrate",
        )
    left = sensors["l_wrist"] - sensors["r_wrist"]
    if len(ankles) == 2:
        left = left + sensors["l_ankle"] - sensors["r_ankle"]
    parameters = np.zeros(_COUNT)
    parameters[:2] = sensors["head"][:2]
    parameters[2] = ground + stature * 0.55
    parameters[_HEADING] = np.arctan2(-left[0], left[1])
    parameters[_SIZES.start] = np.log(stature)
    span = np.hypot(*(sensors["l_wrist"] - sensors["r_wrist"])[:2]) / 2.0 - FRACTIONS.shoulder_half_width * stature
    arm = (FRACTIONS.upper_arm + FRACTIONS.forearm) * stature
    parameters[[_ARM_ANGLES.start, _ARM_ANGLES.start + 2]] = np.arcsin(np.clip(span / arm, -0.5, 1.0))
    return parameters


def _prior(parameters: FloatArray) -> FloatArray:
    """Residuals that hold proportions near the average, and limbs in the plane of the body."""
    sizes = parameters[_SIZES][1:] / np.array([*[PROPORTION_SPREAD] * len(_GROUPS), BREADTH_SPREAD])
    forward = parameters[[_ARM_ANGLES.start + 1, _ARM_ANGLES.start + 3]] / LIMB_SPREAD_RAD
    return np.concatenate([sizes, forward, parameters[_LEG_ANGLES] / LIMB_SPREAD_RAD])


def _offsets(sizes: FloatArray) -> FloatArray:
    """Offsets (23, 3) m of a person whose stature and proportions are these logarithms (7,)."""
    stature, *groups, breadth = np.exp(sizes)
    offset = _UNIT * stature
    for i, name in enumerate(POINTS):
        kind = name[2:] if name[1] == "_" else name
        if kind in ("shoulder", "hip"):
            offset[i] *= np.array([groups[_TRUNK], breadth, groups[_TRUNK]])
        else:
            offset[i] *= next(groups[g] for g, members in enumerate(_GROUPS) if kind in members)
    return offset


def _straight_body(parameters: FloatArray) -> FloatArray:
    """All points (23, 3) m, world, of an upright body with straight limbs."""
    offset = _offsets(parameters[_SIZES])
    points = np.empty_like(offset)
    for i, (name, parent) in enumerate(zip(POINTS, PARENTS, strict=True)):
        if parent < 0:
            points[i] = 0.0
            continue
        points[i] = points[parent] + _turned(name, offset[i], parameters)
    heading = parameters[_HEADING]
    cosine, sine = np.cos(heading), np.sin(heading)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(points @ turn.T + parameters[:3])


def _turned(name: str, offset: FloatArray, parameters: FloatArray) -> FloatArray:
    """A limb's offset, which hangs at rest, along the limb's direction; any other as it is."""
    kind = name[2:]
    if kind in ("elbow", "wrist", "hand"):
        angles = parameters[_ARM_ANGLES]
    elif kind in ("knee", "ankle"):
        angles = parameters[_LEG_ANGLES]
    else:
        return offset
    side = 1.0 if name[0] == "l" else -1.0
    sideward, forward = angles[:2] if name[0] == "l" else angles[2:]
    cosine = np.cos(forward)
    direction = np.array([np.sin(forward), side * np.sin(sideward) * cosine, -np.cos(sideward) * cosine])
    return np.asarray(direction * -offset[2])


def _check_fit(parameters: FloatArray, misfit: FloatArray, *, source: str) -> None:
    rms = float(np.sqrt(np.mean(np.sum(misfit**2, axis=1))))
    spreads = np.abs(_prior(parameters)[: _SIZES.stop - _SIZES.start - 1]).max()
    if not np.isfinite(rms) or rms > MAX_RESIDUAL_M or spreads > MAX_PROPORTION_SPREADS:
        raise InputError(
            "the sensors do not show a human at rest",
            where=source,
            found=f"a best fit {1000 * rms:.0f} mm off, {spreads:.1f} spreads from average proportions",
            allowed=f"{1000 * MAX_RESIDUAL_M:.0f} mm and {MAX_PROPORTION_SPREADS:.0f} spreads",
            next_step="Stand upright with straight arms, hanging, half raised or straight out, and record again",
        )


def _dimensions(parameters: FloatArray, *, mass: float | None, source: str) -> HumanDimensions:
    sizes = parameters[_SIZES]
    stature = float(np.exp(sizes[0]))
    arm = float(np.mean(parameters[[_ARM_ANGLES.start, _ARM_ANGLES.start + 2]]))
    pose = rest_pose_name(arm)
    return HumanDimensions(
        offset=_offsets(sizes),
        stature=stature,
        mass=default_mass(stature) if mass is None else mass,
        origin=f"{pose}-pose of the sensors" + (f" of {source}" if source else ""),
    )
