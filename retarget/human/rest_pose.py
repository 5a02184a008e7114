"""A person's size from sensors alone: a body at rest is fitted to a performer who stands still.

Five sensors do not determine how a length is shared between trunk and legs, or upper arm and forearm, so proportions
are held near the average. On four recorded people five sensors gave stature within 5 mm, arm length within 28 mm and
leg length within 14 mm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from retarget.arithmetic import arccos, arcsin, arctan2, cos, exp, hypot, log, matmul, norms, sin, squares
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.human.posture_prior import ANKLES
from retarget.ik.least_squares import least_squares
from retarget.model.human_dimensions import (
    FRACTIONS,
    POINTS,
    STATURE_M,
    HumanDimensions,
    default_mass,
    kind_of,
    points_of,
    proportional_dimensions,
    stature_of,
)
from retarget.types import FloatArray

# The body is upright, with two straight segments in each arm and leg. Proportions are logarithms about the average, so
# that a sum of squares measures how unusual a person is.

ROOT, HEADING, STATURE, PROPORTIONS, ANGLES, COUNT = slice(0, 3), 3, 4, slice(5, 12), slice(12, 28), 28
"""Layout of the parameters: pelvis position (3) m, heading (rad), log of the stature in m, logs of the proportions (7:
the groups below, then breadth), and angles (rad) of 4 limbs x 2 segments x (sideward, forward)."""

# Far ends of the two segments of each limb.
LIMBS: tuple[tuple[str, str], ...] = (
    ("l_elbow", "l_wrist"),
    ("r_elbow", "r_wrist"),
    ("l_knee", "l_ankle"),
    ("r_knee", "r_ankle"),
)

# Points that share one proportion: trunk, head, upper arm, forearm, thigh, shank.
_GROUPS: tuple[tuple[str, ...], ...] = (
    ("pelvis", "spine", "chest", "neck", "collar"),
    ("head",),
    ("elbow",),
    ("wrist", "hand"),
    ("knee",),
    ("ankle", "toe"),
)

SEGMENT_SPREAD = 0.05  # relative, between people, of a segment's share of stature
BREADTH_SPREAD = 0.08  # the same of the breadths of shoulders and hips
ARM_SPREAD_RAD = 0.6  # forward and back; sideward arms are free, which distinguishes N, A and T
LEG_SPREAD_RAD = 0.25  # of a leg from straight down
BEND_SPREAD_RAD = 0.15  # of an elbow or knee without a sensor
SEEN_BEND_SPREAD_RAD = 0.4  # of one with a sensor

_AVERAGE = proportional_dimensions(1.0)  # of stature 1 m: only the proportions are used


_GROUP_OF = np.array(  # index of the group of each point
    [next((group for group, members in enumerate(_GROUPS) if kind_of(name) in members), 0) for name in POINTS]
)
_BROAD = np.array([name[2:] in ("shoulder", "hip") for name in POINTS])  # points that give the body its breadth
_SEGMENT_ROWS = np.array([[POINTS.index(name) for name in limb] for limb in LIMBS])
_HANDS = np.array([POINTS.index("l_hand"), POINTS.index("r_hand")])


def offsets(parameters: FloatArray) -> FloatArray:
    """Offsets (23, 3) m from the parents, in the rest frame."""
    scale = exp(parameters[PROPORTIONS])
    result = _AVERAGE.offset * exp(parameters[STATURE]) * scale[_GROUP_OF, None]
    result[_BROAD, 1] *= scale[-1] / scale[0]
    return np.asarray(result)


def body_points(parameters: FloatArray) -> FloatArray:
    """All points (23, 3) m, world."""
    offset = offsets(parameters)
    # Unit vectors (4, 2, 3) of the limbs' segments, downward at angle zero.
    sideward, forward = np.moveaxis(parameters[ANGLES].reshape(4, 2, 2), -1, 0)
    side, level = np.array([[1.0], [-1.0], [1.0], [-1.0]]), cos(forward)
    direction = np.stack([sin(forward), side * sin(sideward) * level, -cos(sideward) * level], axis=-1)
    # In the rest frame limbs hang: minus their z is their length.
    offset[_SEGMENT_ROWS] = direction * -offset[_SEGMENT_ROWS][..., 2:]
    offset[_HANDS] = direction[:2, 1] * -offset[_HANDS][:, 2:]
    result = points_of(offset)
    cosine, sine = cos(parameters[HEADING]), sin(parameters[HEADING])
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(matmul(result, turn.T) + parameters[ROOT])


def prior(parameters: FloatArray, bend_spread: FloatArray) -> FloatArray:
    """Residuals of the prior: proportions (7), directions and bends. bend_spread (4,): rad, by limb."""
    spread = np.array([SEGMENT_SPREAD] * len(_GROUPS) + [BREADTH_SPREAD])
    angles = parameters[ANGLES].reshape(4, 2, 2)
    arms, legs = angles[:2, 0, 1], angles[2:, 0]
    bends = (angles[:, 1] - angles[:, 0]) / bend_spread[:, None]
    return np.concatenate(
        [parameters[PROPORTIONS] / spread, arms / ARM_SPREAD_RAD, legs.ravel() / LEG_SPREAD_RAD, bends.ravel()]
    )


REQUIRED = ("head", "l_wrist", "r_wrist")  # without ankles the ground (z = 0) stands in for them

SENSOR_SPREAD_M = 0.01  # of a sensor about the joint centre that it stands for
LOOSE_SPREAD_M = 0.05  # of a sensor beside its joint: a controller in the hand, a cap on the head
KNOWN_SPREAD_M = 0.001  # of a known stature
MAX_LOOSE_M = 0.2  # a sensor sits no farther from its joint
MAX_RESIDUAL_M = 0.06  # root mean square; a worse fit is no rest pose of a human
MAX_SPREADS = 5.0  # proportions farther off the average are no human's

ALIKE_RAD = 0.61  # largest difference between the angles of both arms at rest
MAX_CANDIDATES = 8  # frames for which a rest pose is fitted
_LOOKED_AT = 600  # frames, evenly over the recording, among which rest poses are sought
_APART_S = 0.5  # least time between candidates


def rest_pose_name(arm_angle: float) -> str:
    """Return N, A or T for arms at this angle (rad) from hanging."""
    degrees = np.rad2deg(arm_angle)
    return "N" if degrees < 25.0 else "A" if degrees < 65.0 else "T"


@dataclass(frozen=True, eq=False)
class RestFit:
    """A person at rest. offset (k, 3) m, world: from its joint to each sensor. arms (2,) rad: left and right, from
    hanging."""

    dimensions: HumanDimensions
    offset: FloatArray
    arms: FloatArray


def fit_rest_pose(
    names: Sequence[str],
    position: FloatArray,
    *,
    loose: Sequence[str] = (),
    stature: float | None = None,
    source: str = "",
) -> RestFit:
    """Fit a person to k sensors at rest. position (k, 3) m, world, z up. loose: sensors at unknown offsets beside their
    joints. stature: m, if known.

    Raises InputError: head or wrists are missing, or no human stands upright.
    """
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
    on_ground = not set(ANKLES) <= set(names)
    ankles = [POINTS.index(name) for name in ANKLES]
    seen = np.array([middle in names for middle, _ in LIMBS])
    bend = np.where(seen, SEEN_BEND_SPREAD_RAD, BEND_SPREAD_RAD)
    loose_rows = [row for row, name in enumerate(names) if name in loose]

    def residual(unknown: FloatArray) -> FloatArray:
        parameters, offset = unknown[:COUNT], unknown[COUNT:]
        points = body_points(parameters)
        off = points[columns] - position
        off[loose_rows] += offset.reshape(-1, 3)
        parts = [off.ravel() / SENSOR_SPREAD_M, prior(parameters, bend), offset / LOOSE_SPREAD_M]
        if on_ground:
            height = FRACTIONS.ankle_height * exp(parameters[STATURE])
            parts.append((points[ankles, 2] - height) / SENSOR_SPREAD_M)
        if stature is not None:
            parts.append(np.array([stature_of(offsets(parameters)) - stature]) / KNOWN_SPREAD_M)
        return np.concatenate(parts)

    start = _first_guess(dict(zip(names, position, strict=True)), source=source)
    found = least_squares(residual, np.concatenate([start, np.zeros(3 * len(loose_rows))]))
    fit, offset = found[:COUNT], np.zeros((len(names), 3))
    offset[loose_rows] = found[COUNT:].reshape(-1, 3)
    # Offsets beyond those of a cap or a controller are cut, and show as a misfit below.
    offset *= np.minimum(1.0, MAX_LOOSE_M / np.maximum(norms(offset), 1e-9))[:, None]
    unusual = float(np.abs(prior(fit, bend)[:7]).max())
    points = body_points(fit)
    misfit = points[columns] + offset - position
    rms = float(np.sqrt(squares(misfit).mean()))
    if not rms <= MAX_RESIDUAL_M or unusual > MAX_SPREADS:
        raise InputError(
            "the sensors do not show a human at rest",
            where=source,
            found=f"a best fit {1000 * rms:.0f} mm off, {unusual:.1f} spreads from average proportions",
            allowed=f"{1000 * MAX_RESIDUAL_M:.0f} mm and {MAX_SPREADS:.0f} spreads",
            next_step="Stand upright with straight arms, hanging, half raised or straight out, and record again",
        )
    ends = [[POINTS.index(f"{side}_{end}") for side in "lr"] for end in ("shoulder", "wrist")]
    along = points[ends[1]] - points[ends[0]]
    arms = np.asarray(arccos(np.clip(-along[:, 2] / norms(along), -1.0, 1.0)))
    return RestFit(_dimensions(fit, source=source), offset, arms)


def find_rest_frames(frames: SensorFrames) -> tuple[int, ...]:
    """Frames most like a rest pose, best first, at most `MAX_CANDIDATES`. Raises InputError if there are none."""
    needed = [name for name in (*REQUIRED, *ANKLES) if name in frames.names]
    columns = np.array([frames.index(name) for name in needed])
    seen = frames.valid[:, columns]
    rows = np.unique(np.linspace(0, len(frames) - 1, _LOOKED_AT).astype(int))
    rows = rows[seen[rows].all(axis=1)]
    if rows.size == 0 or not set(REQUIRED) <= set(needed):
        never = [name for name in REQUIRED if name not in needed]
        never += [name for name, ever in zip(needed, np.any(seen, axis=0), strict=True) if not ever]
        raise InputError(
            "no frame in which the size of the performer shows",
            where=frames.source,
            found=f"{', '.join(never)} never seen" if never else f"{', '.join(needed)} never seen together",
            allowed="head, both wrists and the ankles that the source has, at once",
            next_step="Record a rest pose with all of them in view",
        )
    # Central differences; NaN beside an invalid frame counts as fast.
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(frames) - 1)
    moved = frames.position[np.ix_(after, columns)] - frames.position[np.ix_(before, columns)]
    duration = np.maximum(frames.time[after] - frames.time[before], 1e-9)[:, None]
    speed = np.nan_to_num(norms(moved) / duration, nan=10.0).max(axis=1)
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
    """Stature (m) of an average person whose head is as high above the ankles, or the ground."""
    known = [name for name in ("head", *ANKLES) if name in frames.names]
    sensors = {name: frames.position[at, frames.index(name)] for name in known}
    above, share, _ = _head_height(sensors)
    return above / share


def _head_height(sensors: Mapping[str, FloatArray]) -> tuple[float, float, float]:
    """Height (m) of the head above the ankles, or the ground, its share of stature, and the ground's height."""
    head = float(sensors["head"][2])
    if not set(ANKLES) <= set(sensors):
        return head, FRACTIONS.head_height, 0.0
    ankles = float(np.mean([sensors[name][2] for name in ANKLES]))
    ground = ankles - FRACTIONS.ankle_height / (FRACTIONS.head_height - FRACTIONS.ankle_height) * (head - ankles)
    return head - ankles, FRACTIONS.head_height - FRACTIONS.ankle_height, ground


def may_stand(sensors: Mapping[str, FloatArray]) -> bool:
    """True if the head is as high as that of a standing human."""
    above, share, _ = _head_height(sensors)
    low, high = STATURE_M
    return low * share <= above <= high * share


def _first_guess(sensors: Mapping[str, FloatArray], *, source: str) -> FloatArray:
    above, share, ground = _head_height(sensors)
    if not may_stand(sensors):
        low, high = STATURE_M
        raise InputError(
            "the sensors do not show a standing human",
            where=source,
            found=f"the head {above:.2f} m above the {'ankles' if ground else 'ground'}",
            allowed=f"{low * share:.2f} to {high * share:.2f} m",
            next_step="Check the unit and the upward axis, and stand upright to calibrate",
        )
    stature = above / share
    # The normal of the line from right to left is where the person faces.
    left = sensors["l_wrist"] - sensors["r_wrist"]
    half_span = 0.5 * hypot(left[0], left[1])
    if set(ANKLES) <= set(sensors):
        left = left + sensors["l_ankle"] - sensors["r_ankle"]
    parameters = np.zeros(COUNT)
    parameters[:2] = sensors["head"][:2]
    hips = FRACTIONS.ankle_height + _AVERAGE.length("l_ankle") + _AVERAGE.length("l_knee")
    parameters[2] = ground + hips * stature
    parameters[HEADING] = arctan2(-left[0], left[1])
    parameters[STATURE] = log(stature)
    arm = (_AVERAGE.length("l_elbow") + _AVERAGE.length("l_wrist")) * stature
    # sine of the arms' angle from hanging
    outward = np.clip((half_span - _AVERAGE.of("l_shoulder")[1] * stature) / arm, -0.5, 1.0)
    angles = parameters[ANGLES].reshape(4, 2, 2)
    angles[:2, :, 0] = arcsin(outward)
    return parameters


def _dimensions(parameters: FloatArray, *, source: str) -> HumanDimensions:
    offset = offsets(parameters)
    stature = stature_of(offset)
    arms = parameters[ANGLES].reshape(4, 2, 2)[:2, 0, 0]
    return HumanDimensions(
        offset=offset,
        stature=stature,
        mass=default_mass(stature),
        origin=f"{rest_pose_name(float(arms.mean()))}-pose of the sensors" + (f" of {source}" if source else ""),
    )
