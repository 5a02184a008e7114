"""A person's size from sensors alone: the performer stands still, arms hanging, half raised or straight out.

The person of `rest_body` is fitted to the sensors. Five of them cannot tell how a length is shared between trunk and
legs, or between upper arm and forearm: proportions are held near the average by as much as people differ, and more
sensors (knees, elbows, hips, shoulders, pelvis, chest) sharpen what they see. On four recorded people of known size, in
N, A and T, five sensors gave stature within 5 mm, arm length within 28 mm and leg length within 14 mm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from retarget import rest_body
from retarget.anthropometry import FRACTIONS
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.human_dimensions import POINTS, STATURE_M, HumanDimensions, default_mass, stature_of
from retarget.rotations import FloatArray

__all__ = [
    "RestFit",
    "dimensions_from_rest_pose",
    "find_rest_frames",
    "fit_rest_pose",
    "rest_pose_name",
    "standing_stature",
]

REQUIRED = ("head", "l_wrist", "r_wrist")
"""Without ankles the ground (z = 0) stands in for them."""
_ANKLES = ("l_ankle", "r_ankle")

SENSOR_SPREAD_M = 0.01
"""How far a sensor sits from the joint centre that it stands for."""
LOOSE_SPREAD_M = 0.05
"""And how far one that is known to sit beside it: a controller in the hand, a cap on the head."""
MAX_LOOSE_M = 0.2
MAX_RESIDUAL_M = 0.06
"""A fit that misses the sensors by more (root mean square) is no rest pose of a human."""
MAX_SPREADS = 5.0
"""A fit whose proportions are more spreads off the average is no human."""

MAX_CANDIDATES = 8
_LOOKED_AT = 600
"""Frames looked at, evenly over the recording, for some that are most like a rest pose."""
_APART_S = 0.5
"""Candidates for a rest pose are at least this far apart."""


def rest_pose_name(arm_angle: float) -> str:
    """N, A or T: by the angle (rad) of the arms from hanging."""
    degrees = np.rad2deg(arm_angle)
    return "N" if degrees < 25.0 else "A" if degrees < 65.0 else "T"


@dataclass(frozen=True, eq=False)
class RestFit:
    """A person at rest. offset (k, 3) m, world: from its joint to each sensor, zero for those that sit on theirs.
    arms (2,) rad: of the left and the right one, shoulder to wrist, from hanging."""

    dimensions: HumanDimensions
    offset: FloatArray
    arms: FloatArray


def dimensions_from_rest_pose(
    names: Sequence[str], position: FloatArray, *, mass: float | None = None, source: str = ""
) -> HumanDimensions:
    """The size of who is fitted to sensors at rest: see `fit_rest_pose`."""
    return fit_rest_pose(names, position, mass=mass, source=source).dimensions


def fit_rest_pose(
    names: Sequence[str],
    position: FloatArray,
    *,
    loose: Sequence[str] = (),
    mass: float | None = None,
    source: str = "",
) -> RestFit:
    """Fit a person to sensors at rest. names: k canonical sensor names; position (k, 3) m, world, z up. loose: those
    that sit beside their joints, nobody knows where.

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
    on_ground = not set(_ANKLES) <= set(names)
    ankles = [POINTS.index(name) for name in _ANKLES]
    seen = np.array([middle in names for middle, _ in rest_body.LIMBS])
    bend = np.where(seen, rest_body.SEEN_BEND_SPREAD_RAD, rest_body.BEND_SPREAD_RAD)
    beside = [row for row, name in enumerate(names) if name in loose]

    def residual(unknown: FloatArray) -> FloatArray:
        parameters, offset = unknown[: rest_body.COUNT], unknown[rest_body.COUNT :]
        points = rest_body.points(parameters)
        off = points[columns] - position
        off[beside] += offset.reshape(-1, 3)
        parts = [off.ravel() / SENSOR_SPREAD_M, rest_body.prior(parameters, bend), offset / LOOSE_SPREAD_M]
        if on_ground:
            height = FRACTIONS.ankle_height * np.exp(parameters[rest_body.STATURE])
            parts.append((points[ankles, 2] - height) / SENSOR_SPREAD_M)
        return np.concatenate(parts)

    start = _first_guess(dict(zip(names, position, strict=True)), source=source)
    found = least_squares(residual, np.concatenate([start, np.zeros(3 * len(beside))]), max_nfev=100).x
    fit, offset = found[: rest_body.COUNT], np.zeros((len(names), 3))
    offset[beside] = found[rest_body.COUNT :].reshape(-1, 3)
    offset *= np.minimum(1.0, MAX_LOOSE_M / np.maximum(np.linalg.norm(offset, axis=1), 1e-9))[:, None]
    unusual = float(np.abs(rest_body.prior(fit, bend)[:7]).max())
    points = rest_body.points(fit)
    _check_fit(points[columns] + offset - position, unusual, source=source)
    return RestFit(_dimensions(fit, mass=mass, source=source), offset, _arms(points))


def _arms(points: FloatArray) -> FloatArray:
    """Angles (2,) rad of both arms from hanging, by all points (23, 3) m."""
    ends = [[POINTS.index(f"{side}_{end}") for side in "lr"] for end in ("shoulder", "wrist")]
    along = points[ends[1]] - points[ends[0]]
    return np.asarray(np.arccos(np.clip(-along[:, 2] / np.linalg.norm(along, axis=1), -1.0, 1.0)))


def find_rest_frames(frames: SensorFrames) -> tuple[int, ...]:
    """Frames most like a rest pose, best first, at most `MAX_CANDIDATES`: the person tall and the sensors slow.

    Raises InputError if head and wrists are never valid together.
    """
    needed = [name for name in (*REQUIRED, *_ANKLES) if name in frames.names]
    columns = np.array([frames.index(name) for name in needed])
    rows = np.unique(np.linspace(0, len(frames) - 1, _LOOKED_AT).astype(int))
    rows = rows[frames.valid[np.ix_(rows, columns)].all(axis=1)]
    if rows.size == 0 or not set(REQUIRED) <= set(needed):
        raise InputError("no frame shows head and both wrists", where=frames.source, next_step="Record a rest pose")
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(frames) - 1)
    moved = frames.position[np.ix_(after, columns)] - frames.position[np.ix_(before, columns)]
    duration = np.maximum(frames.time[after] - frames.time[before], 1e-9)[:, None]
    speed = np.nan_to_num(np.linalg.norm(moved, axis=2) / duration, nan=10.0).max(axis=1)
    stature = np.array([standing_stature(frames, row) for row in rows])
    chosen: list[int] = []
    # One tenth of a metre of stature is worth a metre per second of motion.
    for row in rows[np.argsort(0.1 * speed - stature, kind="stable")]:
        if all(abs(frames.time[row] - frames.time[other]) >= _APART_S for other in chosen):
            chosen.append(int(row))
        if len(chosen) == MAX_CANDIDATES:
            break
    return tuple(chosen)


def standing_stature(frames: SensorFrames, at: int) -> float:
    """Stature (m) of an average person whose head is as high above the ankles (or the ground) as in this frame."""
    known = [name for name in ("head", *_ANKLES) if name in frames.names]
    sensors = {name: frames.position[at, frames.index(name)] for name in known}
    above, share, _ = _head_height(sensors)
    return above / share


def _head_height(sensors: Mapping[str, FloatArray]) -> tuple[float, float, float]:
    """Height (m) of the head above the ankles, or the ground without them; its share of stature; where that is."""
    head = float(sensors["head"][2])
    if not set(_ANKLES) <= set(sensors):
        return head, FRACTIONS.head_height, 0.0
    ankles = float(np.mean([sensors[name][2] for name in _ANKLES]))
    ground = ankles - FRACTIONS.ankle_height / (FRACTIONS.head_height - FRACTIONS.ankle_height) * (head - ankles)
    return head - ankles, FRACTIONS.head_height - FRACTIONS.ankle_height, ground


def _first_guess(sensors: Mapping[str, FloatArray], *, source: str) -> FloatArray:
    """Parameters near the answer: heading from left and right, stature from the head, arms from the wrists."""
    above, share, ground = _head_height(sensors)
    low, high = STATURE_M
    if not low * share <= above <= high * share:
        raise InputError(
            "the sensors do not show a standing human",
            where=source,
            found=f"the head {above:.2f} m above the {'ankles' if ground else 'ground'}",
            allowed=f"{low * share:.2f} to {high * share:.2f} m",
            next_step="Check the unit and the upward axis, and stand upright to calibrate",
        )
    stature = above / share
    left = sensors["l_wrist"] - sensors["r_wrist"]
    half_span = 0.5 * float(np.hypot(left[0], left[1]))
    if set(_ANKLES) <= set(sensors):
        left = left + sensors["l_ankle"] - sensors["r_ankle"]
    parameters = np.zeros(rest_body.COUNT)
    parameters[:2] = sensors["head"][:2]
    parameters[2] = ground + (FRACTIONS.ankle_height + FRACTIONS.shank + FRACTIONS.thigh) * stature
    parameters[rest_body.HEADING] = np.arctan2(-left[0], left[1])
    parameters[rest_body.STATURE] = np.log(stature)
    arm = (FRACTIONS.upper_arm + FRACTIONS.forearm) * stature
    outward = np.clip((half_span - FRACTIONS.shoulder_half_width * stature) / arm, -0.5, 1.0)
    angles = parameters[rest_body.ANGLES].reshape(4, 2, 2)
    angles[:2, :, 0] = np.arcsin(outward)
    return parameters


def _check_fit(misfit: FloatArray, unusual: float, *, source: str) -> None:
    rms = float(np.sqrt(np.mean(np.sum(misfit**2, axis=1))))
    if not rms <= MAX_RESIDUAL_M or unusual > MAX_SPREADS:
        raise InputError(
            "the sensors do not show a human at rest",
            where=source,
            found=f"a best fit {1000 * rms:.0f} mm off, {unusual:.1f} spreads from average proportions",
            allowed=f"{1000 * MAX_RESIDUAL_M:.0f} mm and {MAX_SPREADS:.0f} spreads",
            next_step="Stand upright with straight arms, hanging, half raised or straight out, and record again",
        )


def _dimensions(parameters: FloatArray, *, mass: float | None, source: str) -> HumanDimensions:
    offset = rest_body.offsets(parameters)
    stature = stature_of(offset)
    arms = parameters[rest_body.ANGLES].reshape(4, 2, 2)[:2, 0, 0]
    return HumanDimensions(
        offset=offset,
        stature=stature,
        mass=default_mass(stature) if mass is None else mass,
        origin=f"{rest_pose_name(float(arms.mean()))}-pose of the sensors" + (f" of {source}" if source else ""),
    )
