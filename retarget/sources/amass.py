"""Motion of the SMPL family without its body model (AMASS, and reconstructions from video).

The files hold rotations of joints, but no bone lengths. In the zero pose (a T-pose, x left, y up, z forward) the frames
of all joints are parallel, so orientations need no lengths. Lengths come from the recorded markers if the file has
them, else from the stature with the proportions of Drillis and Contini (1966), and are right to some centimetres. Shape
(`betas`) is not read: statures from it were wrong by 0.2 m. AMASS is z up; files in SMPL's own words (`transl`), such
as those of GVHMR and WHAM, are y up.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from retarget import rotations
from retarget.arithmetic import matmul, norms
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.model.human_dimensions import (
    POINTS,
    STATURE_M,
    HumanDimensions,
    points_of,
    proportional_dimensions,
)
from retarget.schema.arrays import ArrayFile
from retarget.sources.canonical import TYPICAL_HEIGHT_M, canonical_frames, named_unit
from retarget.sources.files import MAX_VALUE, ReadOptions, check_frame_count, check_rate, no_frame_rate
from retarget.sources.markers import MARKER_GROUPS, groups_in, split_label
from retarget.sources.skeletons import SMPL_NAMES, SMPL_PARENTS, JointTree, forward_kinematics
from retarget.types import FloatArray

BODY_JOINTS = 22
"""Joints of a body, the first of every model of the family; hands and faces follow."""
WIDTHS = (3 * BODY_JOINTS, 72, 156, 165)
"""Numbers of a pose: body alone, SMPL, SMPL-H, SMPL-X."""
PELVIS = np.array([0.0, -0.22, 0.03])
"""Offset from the translation to the pelvis, m, in file axes: measured on waist markers of two recordings to 0.05 m."""
HEAD_JOINT = 0.63
"""SMPL's head joint, below the skull, as a share of the line from neck to middle of the head."""

ROTATIONS: tuple[tuple[str, str], ...] = (("root_orient", "pose_body"), ("global_orient", "body_pose"))
"""Arrays of root and body rotations in AMASS's second layout and in SMPL's own words."""
TRANSLATIONS = ("trans", "transl")
RATES = ("mocap_framerate", "mocap_frame_rate", "fps")
MARKERS = ("marker_data", "marker_labels")
KEYS = frozenset(("poses", *TRANSLATIONS, *RATES, *MARKERS, *(name for pair in ROTATIONS for name in pair)))
"""Arrays that are read."""


def is_smpl(names: Collection[str]) -> bool:
    """True if these arrays are a motion of the SMPL family."""
    posed = "poses" in names or any(set(pair) <= set(names) for pair in ROTATIONS)
    return posed and not set(TRANSLATIONS).isdisjoint(names)


def smpl_frames(file: ArrayFile, options: ReadOptions) -> SensorFrames:
    """The motion of a file; the user's stature counts if it has no markers. Raises InputError."""
    unit = named_unit(options.unit) or 1.0
    vectors = _rotation_vectors(file)
    trans = file.floats(next(name for name in TRANSLATIONS if name in file), len(vectors), 3)
    if max(float(np.abs(values).max()) for values in (vectors, trans)) > MAX_VALUE:
        raise InputError("not a usable number", where=file.source, allowed="numbers up to 1e9")
    size, notes = _dimensions(file, unit=unit, stature=options.stature)
    height = abs(float(np.median(trans[:, 1 if "transl" in file else 2]))) * unit
    if height > HIGHEST * size.stature:
        raise InputError(
            "a body far above its ground",
            where=f"{file.source}: {'transl' if 'transl' in file else 'trans'}",
            found=f"{height:.3g} m",
            allowed=f"up to {HIGHEST * size.stature:.3g} m",
            next_step="If lengths are not in m, say their unit: --unit cm, for example",
        )
    tree = _tree(size)
    local = rotations.from_rotation_vector(vectors)
    if "transl" in file:  # y up, as the body is at rest
        ends = tuple(tuple(matmul(AT_REST, end) for end in ends) for ends in tree.ends)
        tree = replace(tree, offsets=matmul(tree.offsets, AT_REST.T), ends=ends)
    else:  # z up, with the body at rest turned by C: the root's rotation is R C, all others are C^T R C
        local[:, 1:, 1:] = matmul(local[:, 1:, 1:], AT_REST)
        local[:, 0] = rotations.multiply(local[:, 0], rotations.from_matrix(AT_REST))
    offsets = np.broadcast_to(tree.offsets, (len(vectors), BODY_JOINTS, 3)).copy()
    offsets[:, 0] = trans * unit + PELVIS * (size.stature / TYPICAL_HEIGHT_M)
    return canonical_frames(
        tree,
        forward_kinematics(tree, local, offsets),
        unit=1.0,
        rate=_rate(file) if options.rate is None else check_rate(options.rate, "--rate"),
        source=file.source,
        options=ReadOptions(up=options.up),
        notes=(*file.notes, *notes),
    )


HIGHEST = 5.0
"""Largest median height of a body above the ground, in statures: beyond, the unit is not m."""
AT_REST = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Axes left, up and forward of a body at rest, as rows in x forward, y left, z up."""


def _rotation_vectors(file: ArrayFile) -> FloatArray:
    """Rotation vectors (T, 22, 3) of the body's joints, rad, each in its parent's frame."""
    if "poses" in file:
        width = file.arrays["poses"].shape[-1] if file.arrays["poses"].ndim == 2 else 0
        if width not in WIDTHS:
            raise InputError(
                "poses of no known body",
                where=f"{file.source}: poses",
                found=f"shape {file.arrays['poses'].shape}",
                allowed=f"(frames, n), n one of {', '.join(map(str, WIDTHS))}: 22, 24, 52 or 55 rotation vectors",
                next_step=file.advice,
            )
        vectors = file.floats("poses", None, width)[:, : 3 * BODY_JOINTS]
    else:
        root, body = next(pair for pair in ROTATIONS if set(pair) <= set(file.arrays))
        turned = file.floats(body, None, None)
        if turned.shape[1] < 3 * BODY_JOINTS - 3:
            turned = file.floats(body, None, 3 * BODY_JOINTS - 3)  # raises
        vectors = np.hstack([file.floats(root, len(turned), 3), turned[:, : 3 * BODY_JOINTS - 3]])
    check_frame_count(len(vectors), file.source)
    return vectors.reshape(len(vectors), BODY_JOINTS, 3)


def _rate(file: ArrayFile) -> float:
    """Frames per second in the file, rounded to 1e-3 (120.00004577636719 is 120)."""
    name = next((name for name in RATES if name in file), None)
    if name is None:
        raise no_frame_rate(file.source, allowed=" or ".join(RATES))
    values = file.floats(name, *(None for _ in file.arrays[name].shape)).reshape(-1)
    if len(values) != 1:
        raise InputError("no frame rate", where=f"{file.source}: {name}", found=f"{len(values)} numbers", allowed="one")
    return check_rate(round(float(values[0]), 3), f"{file.source}: {name}")


MARKED_SEGMENTS: Mapping[str, str] = MappingProxyType({"ankle": "knee", "wrist": "elbow"})
"""Ends -> starts of the segments with markers at both ends."""


def _dimensions(file: ArrayFile, *, unit: float, stature: float | None) -> tuple[HumanDimensions, tuple[str, ...]]:
    measured = _measured(file, unit=unit)
    usual = proportional_dimensions(TYPICAL_HEIGHT_M)
    if measured:
        ratios = [length / usual.length(name) for name, length in measured.items()]
        stature = min(max(float(np.median(ratios)) * TYPICAL_HEIGHT_M, STATURE_M[0]), STATURE_M[1])
        size = proportional_dimensions(stature)
        offset = np.array(size.offset)
        for name, length in measured.items():
            row = POINTS.index(name)
            offset[row] *= length / size.length(name)
        note = f"bone lengths from markers ({', '.join(measured)}), the others from a stature of {stature:.2f} m"
        return replace(size, offset=offset), (note,)
    if stature is not None:
        return proportional_dimensions(stature), (f"bone lengths from --stature {stature:g}: average proportions",)
    note = f"bone lengths not in the file: average ones at a stature of {TYPICAL_HEIGHT_M} m (change it with --stature)"
    return usual, (note,)


def _measured(file: ArrayFile, *, unit: float) -> dict[str, float]:
    """Lengths (m) of segments by their end: medians over the frames in which markers at both ends were seen."""
    if not set(MARKERS) <= set(file.arrays) or file.arrays[MARKERS[1]].dtype.kind not in "US":
        return {}
    named = file.arrays[MARKERS[1]]
    if named.dtype.kind == "S":
        labels = [one.decode("latin-1") for one in named.reshape(-1).tolist()]
    else:
        labels = file.texts(MARKERS[1], *(None for _ in named.shape)).reshape(-1).tolist()
    positions = file.floats(MARKERS[0], None, len(labels), 3, unknown=True)
    known = frozenset(name for options in MARKER_GROUPS.values() for group in options for name in group)
    columns = {split[1]: column for column, label in enumerate(labels) if (split := split_label(label, known))}
    groups = groups_in(columns)
    found: dict[str, float] = {}
    for end, start in MARKED_SEGMENTS.items():
        for side in "lr":
            near, far = f"{side}_{start}", f"{side}_{end}"
            if near in groups and far in groups:
                ends = [positions[:, [columns[name] for name in groups[one]]].mean(axis=1) for one in (near, far)]
                lengths = norms(ends[1] - ends[0])
                seen = lengths[(lengths > 0.0) & (lengths <= MAX_VALUE)]  # False for NaN
                if len(seen):
                    found[far] = float(np.median(seen)) * unit
    return found


def _tree(size: HumanDimensions) -> JointTree:
    """SMPL's joints (22) of a person in a T-pose, m, x forward, y left, z up."""
    offset = np.array(size.offset)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for part in ("elbow", "wrist", "hand"):
            offset[POINTS.index(f"{side}_{part}")] = np.array([0.0, sign * size.length(f"{side}_{part}"), 0.0])
    at = dict(zip(POINTS, points_of(offset), strict=True))
    head = at["neck"] + HEAD_JOINT * (at["head"] - at["neck"])
    places = {"spine1": at["spine"], "spine2": 0.5 * (at["spine"] + at["chest"]), "spine3": at["chest"], "head": head}
    for word, side in (("left", "l"), ("right", "r")):
        for part in ("hip", "knee", "ankle", "collar", "shoulder", "elbow", "wrist"):
            places[f"{word}_{part}"] = at[f"{side}_{part}"]
        places[f"{word}_foot"] = at[f"{side}_toe"]
    names, parents = SMPL_NAMES[:BODY_JOINTS], SMPL_PARENTS[:BODY_JOINTS]
    points = np.stack([places.get(name, at.get(name, np.zeros(3))) for name in names])
    tops = {"head": (2.0 * (at["head"] - head),)}
    return JointTree(
        names=names,
        parents=parents,
        offsets=points - np.array([points[parent] if parent >= 0 else np.zeros(3) for parent in parents]),
        ends=tuple(tops.get(name, ()) for name in names),
    )
