"""Joint trees in motion, or positions of joints -> sensor frames in metres and world axes."""

import math
from collections.abc import Mapping
from itertools import compress

import numpy as np

from retarget import rotations
from retarget.arithmetic import dot, log, matmul, norms
from retarget.errors import InputError, UsageError, suggest
from retarget.frames import JOINTS, SENSORS, JointTracks, SensorFrames, Skeleton
from retarget.frames import stature as stature_of
from retarget.model.human_dimensions import PARENTS, POINTS, proportional_dimensions
from retarget.model.rest_skeleton import limb_turns
from retarget.sources.axes import world_axes
from retarget.sources.files import AS_WRITTEN, ReadOptions, lost_notes
from retarget.sources.rest_skeleton import find_rest_skeleton, segment_joint
from retarget.sources.skeletons import JointPoses, JointTree
from retarget.types import FloatArray

CMU_METRES = 0.0254 / 0.45
"""Metres per unit of the CMU recordings (ASF `length 0.45`)."""

UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": CMU_METRES}
"""Metres per unit."""

TYPICAL_HEIGHT_M = 1.7
USUAL_HEIGHT_M = (1.4, 2.1)
POSSIBLE_HEIGHT_M = (1.0, 2.5)
"""Statures, m. A guessed unit brings the body nearest to the first. Outside of the second a note warns, outside of the
third the file is refused."""


def named_unit(name: str | None) -> float | None:
    """Metres of the unit that the user named, None without a name. Raises UsageError with the nearest names."""
    if name is None:
        return None
    key = name.lower()
    if key not in UNITS:
        raise UsageError("unknown unit", found=repr(name), allowed=", ".join(UNITS), next_step=suggest(key, UNITS))
    return UNITS[key]


def choose_unit(body_height: float | None, *, where: str) -> tuple[float, str]:
    """Metres of the unit that makes this body height (file units) most human, and a note. Raises InputError if none
    does."""
    if body_height is None or not 0.0 < body_height < math.inf:
        raise InputError("the skeleton has no height", where=where, next_step="Export it with the lengths of its bones")
    name = min(UNITS, key=lambda unit: abs(log(body_height * UNITS[unit] / TYPICAL_HEIGHT_M)))
    height = body_height * UNITS[name]
    if not POSSIBLE_HEIGHT_M[0] <= height <= POSSIBLE_HEIGHT_M[1]:
        raise InputError(
            "the skeleton fits a human in no known unit",
            where=where,
            found=f"a body {body_height:.4g} units high",
            allowed=f"{POSSIBLE_HEIGHT_M[0]} to {POSSIBLE_HEIGHT_M[1]} m in one of {', '.join(UNITS)}",
            next_step="Say how tall the performer is, in m, with --stature",
        )
    note = f"unit not stated: taken as {name}, which makes the body {height:.2f} m high (change it with --unit)"
    if not USUAL_HEIGHT_M[0] <= height <= USUAL_HEIGHT_M[1]:
        note += "; that is unusual for an adult"
    return UNITS[name], note


def canonical_frames(
    tree: JointTree,
    pose: JointPoses,
    *,
    unit: float | None,
    rate: float,
    source: str,
    options: ReadOptions = AS_WRITTEN,
    notes: tuple[str, ...] = (),
) -> SensorFrames:
    """Sensors, joints and rest skeleton of a tree in motion.

    pose: of every frame, in file axes and units. unit: metres per file unit, None to guess it from the size of the
    body. options: unit, up axis and stature are used; a stature overrules a unit. Raises InputError if the tree is no
    human.
    """
    rest = find_rest_skeleton(tree, pose, up=options.up, rate=rate, where=source)
    height, unit_note = stature_of(rest.skeleton), ""
    unit = named_unit(options.unit) or unit
    if options.stature is not None and height:
        unit = options.stature / height
    elif unit is None:
        unit, unit_note = choose_unit(height, where=source)
    names = tuple(name for name in JOINTS if name in rest.joints)
    tracks = np.stack([rest.pose.point(rest.joints[name].joint, rest.joints[name].local) for name in names], axis=1)
    position = matmul(tracks, rest.world.T) * unit
    columns = [rest.skeleton.names.index(name) for name in names]
    skeleton = Skeleton(names, rest.skeleton.position[columns] * unit)
    sensors = tuple(name for name in SENSORS if name in rest.joints)
    turns = np.stack(
        [rest.pose.orientation[:, segment_joint(rest.tree, rest.joints, name)] for name in sensors], axis=1
    )
    # World <- file axes <- segment <- rest pose facing x <- hanging arms. A mirrored file is mirrored on both sides.
    world, body = rest.world, rest.body
    if dot(np.cross(world[0], world[1]), world[2]) < 0.0:
        flip = np.array([-1.0, 1.0, 1.0])
        world, body, turns = world * flip, body * flip, turns * np.array([1.0, 1.0, -1.0, -1.0])
    right = rotations.multiply(rotations.from_matrix(body.T), limb_turns(skeleton, sensors))
    orientation = rotations.multiply(rotations.multiply(rotations.from_matrix(world), turns), right)
    known = [not rest.joints[name].lacking for name in names]
    return SensorFrames(
        time=np.arange(len(position)) / rate,
        names=sensors,
        position=position[:, [names.index(name) for name in sensors]],
        orientation=rotations.normalise(orientation),
        valid=np.ones((len(position), len(sensors)), bool),
        joints=JointTracks(tuple(compress(names, known)), position[:, known]),
        skeleton=skeleton,
        source=source,
        rate_hz=rate,
        notes=(*notes, *((unit_note,) if unit_note else ()), *rest.notes),
    )


def joint_frames(
    tracks: Mapping[str, FloatArray],
    *,
    declared: FloatArray,
    rate: float,
    source: str,
    unit: float = 1.0,
    stature: float | None = None,
    up: FloatArray | None = None,
    notes: tuple[str, ...] = (),
) -> SensorFrames:
    """Sensors and joints of canonical joints (T, 3) without orientations, in file axes and units, NaN where lost.

    declared (3,): the file's up axis. unit: metres per file unit. stature: of the performer, m; it overrules the unit.
    up (3,): the user's up axis. Raises InputError if a needed joint is missing.
    """
    world, axis_notes = world_axes(tracks, declared=declared, default=declared, chosen=up)
    names = tuple(name for name in JOINTS if name in tracks)
    position = matmul(np.stack([tracks[name] for name in names], axis=1), world.T)
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    position[~seen] = np.nan
    skeleton = _hanging(names, position, source)
    height = stature_of(skeleton)
    if stature is not None and height:
        unit = stature / height
    sensors = tuple(name for name in SENSORS if name in names)
    position, columns = position * unit, [names.index(name) for name in sensors]
    return SensorFrames(
        time=np.arange(len(position)) / rate,
        names=sensors,
        position=position[:, columns],
        orientation=np.full((len(position), len(sensors), 4), np.nan),
        valid=seen[:, columns],
        joints=JointTracks(names, position),
        skeleton=Skeleton(skeleton.names, skeleton.position * unit),
        source=source,
        rate_hz=rate,
        notes=(*notes, *axis_notes, *lost_notes(names, seen), "the file has no orientations"),
    )


_TRUNK = (
    "pelvis",
    "spine",
    "chest",
    "neck",
    "head",
    *(f"{s}_{part}" for part in ("collar", "shoulder", "hip") for s in "lr"),
)


def _hanging(names: tuple[str, ...], position: FloatArray, source: str) -> Skeleton:
    """The joints at rest: the trunk of the frame that is most upright, and limbs of median lengths in average
    directions. position (T, m, 3): z up, NaN where lost. Raises InputError if the trunk is never whole, or a bone never
    seen."""
    at = {name: position[:, column] for column, name in enumerate(names)}
    middle, up = 0.5 * (at["l_hip"] + at["r_hip"]), np.array([0.0, 0.0, 1.0])
    upright = [at["head"] - middle, *(at[f"{s}_shoulder"] - at[f"{s}_elbow"] for s in "lr")]
    rises = np.nansum([line[:, 2] / np.maximum(norms(line), 1e-9) for line in upright], axis=0)
    whole = np.isfinite(position[:, [column for column, name in enumerate(names) if name in _TRUNK]]).all(axis=(1, 2))
    if not whole.any():
        raise InputError("no frame with the whole trunk", where=source, next_step="Fill the gaps of its joints")
    row = int(np.argmax(np.where(whole, rises, -np.inf)))
    across = (at["l_hip"] - at["r_hip"])[row] * np.array([1.0, 1.0, 0.0])
    left = across / max(float(norms(across)), 1e-9)
    axes = np.stack((np.cross(left, up), left, up))
    usual, rest = proportional_dimensions(TYPICAL_HEIGHT_M), dict[str, FloatArray]()
    for name, parent in zip(POINTS, PARENTS, strict=True):
        above = POINTS[parent]
        if name in _TRUNK and name in at:
            rest[name] = matmul(axes, at[name][row] - at.get("pelvis", middle)[row])
        elif name in at and above in rest:
            lengths = norms(at[name] - at[above])
            lengths = lengths[np.isfinite(lengths)]
            if not len(lengths):
                step = "Fill the gaps of these joints"
                raise InputError("a bone that is never seen", where=source, found=f"{above} to {name}", next_step=step)
            length = float(np.median(lengths))
            rest[name] = rest[above] + length * usual.of(name) / usual.length(name)
    return Skeleton(tuple(rest), np.stack(list(rest.values())))
