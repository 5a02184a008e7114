"""Motion as arrays (.npz): the SMPL family (`amass`), joint positions (as holosoma takes them), and Kimodo's output.

The names of the arrays give the layout. Pickled arrays are refused if they are needed, and skipped otherwise.
"""

from collections.abc import Collection
from itertools import pairwise
from pathlib import Path

import numpy as np

from retarget import rotations
from retarget.arithmetic import norms, squares
from retarget.errors import InputError
from retarget.frames import ANKLE, HEAD_CENTRE, JOINTS, SensorFrames
from retarget.model.human_dimensions import STATURE_M
from retarget.schema.arrays import ArrayFile, open_arrays
from retarget.sources.amass import KEYS, MARKERS, is_smpl, smpl_frames
from retarget.sources.axes import UP_AXES
from retarget.sources.canonical import canonical_frames, joint_frames, named_unit
from retarget.sources.files import (
    AS_WRITTEN,
    HEAD_BYTES,
    MAX_VALUE,
    SAVED_RUN,
    ReadOptions,
    assumed_rate,
    check_frame_count,
    check_rate,
    no_frame_rate,
    read_bytes,
)
from retarget.sources.rest_skeleton import HEAD_RISE
from retarget.sources.skeletons import (
    SMPL_NAMES,
    SMPL_PARENTS,
    TABLES,
    JointPoses,
    joints_by_name,
    layout,
    named_in_part,
    tree_of_poses,
)
from retarget.types import FloatArray

MAX_ARRAY_BYTES = 256 * 2**20
"""Most bytes of the arrays that are read: 200,000 frames of SMPL-H in doubles are 250 MB."""
ADVICE = "See the layouts in docs/motion-files.md"
JOINTS_KEY = "global_joint_positions"
JOINT_KEYS = frozenset((JOINTS_KEY, "height", "fps", "joint_names"))
KIMODO_KEYS = frozenset(("posed_joints", "global_rot_mats"))
"""Arrays that are read."""
KNOWN_LAYOUTS = (
    "poses, trans and mocap_framerate (AMASS); root_orient, pose_body and trans (AMASS stageii); global_orient, "
    "body_pose and transl (SMPL); global_joint_positions (joints); posed_joints and global_rot_mats (Kimodo)"
)
"""Arrays of each layout, for messages."""
KIMODO_RATE_HZ = 30.0
"""Rate, Hz, of Kimodo's motions, which do not state it."""
SMPL_COUNTS = (22, 24, 52, 55)
"""Joints of SMPL bodies: without hands, SMPL, SMPL-H and SMPL-X."""
TRUNK_WORDS = ("spine", "chest", "torso")
"""Words in names of joints between pelvis and neck."""
UNLIKE = 1.5
"""Largest ratio of the lengths of a bone, between sides and over time."""
KIMODO_SKELETONS = {
    77: layout(TABLES["layouts"]["soma"]),
    30: layout(TABLES["layouts"]["soma_30"]),
    22: (SMPL_NAMES[:22], SMPL_PARENTS[:22]),
}
"""Number of joints -> names and parents of Kimodo's skeletons: SOMA, and SMPL."""
G1_COUNT = 34
"""Joints of Kimodo's skeleton of Unitree's G1, a robot."""
TURNED = 0.01
"""Largest error of the length of a row of a rotation matrix: single precision has 1e-6."""


def read_npz(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read a motion. Raises InputError with the file and the array."""
    read_bytes(path, HEAD_BYTES)
    file = open_arrays(
        path,
        lambda names: _keys_to_read(names, path),
        max_bytes=MAX_ARRAY_BYTES,
        advice=ADVICE,
        optional=(*MARKERS, "joint_names"),
    )
    if is_smpl(file.arrays):
        return smpl_frames(file, options)
    return (_read_joints if JOINTS_KEY in file else _read_kimodo)(file, options)


def _keys_to_read(names: Collection[str], path: Path) -> Collection[str]:
    if is_smpl(names):
        return KEYS
    if JOINTS_KEY in names:
        return JOINT_KEYS
    if set(names) >= KIMODO_KEYS:
        return KIMODO_KEYS
    if "root_quaternion" in names:
        raise InputError("a saved run is no motion of a performer", where=str(path), next_step=SAVED_RUN)
    found = ", ".join(sorted(name[:40] for name in names)[:12]) or "no array"
    raise InputError(
        "arrays of no known motion",
        where=str(path),
        found=found,
        allowed=KNOWN_LAYOUTS,
        next_step="Rename the arrays to one of these",
    )


def _positions(file: ArrayFile, key: str, *, lost: bool = False) -> FloatArray:
    """Positions (T, J, 3) of joints, in file axes. lost: they may be NaN."""
    position = file.floats(key, None, None, 3, unknown=lost)
    check_frame_count(len(position), file.source)
    if (np.abs(position) > MAX_VALUE).any():
        raise InputError("not a usable number", where=f"{file.source}: {key}", allowed="numbers up to 1e9")
    return position


def _read_joints(file: ArrayFile, options: ReadOptions) -> SensorFrames:
    """Joints by name, else in SMPL's order, z up, NaN where lost."""
    position = _positions(file, JOINTS_KEY, lost=True)
    tracks = _tracks(file, position)
    rate = options.rate
    if rate is None and "fps" in file:
        rate = float(file.floats("fps", *(None for _ in file.arrays["fps"].shape)).reshape(-1)[:1].sum())
    if rate is None:
        raise no_frame_rate(file.source)
    height = _height(file) if options.stature is None else options.stature
    if never := [name for name, track in tracks.items() if not np.isfinite(track).all(axis=1).any()]:
        raise InputError(
            "joints that are lost in every frame",
            where=f"{file.source}: {JOINTS_KEY}",
            found=", ".join(never),
            allowed="NaN in some of the frames",
            next_step="Export them too",
        )
    # The head joint is below the skull: its centre is farther along the neck.
    line = tracks["head"] - tracks["neck"]
    rise = HEAD_RISE * (height or _stature(tracks))
    tracks["head"] = tracks["head"] + rise * line / np.maximum(norms(line), 1e-9)[:, None]
    return joint_frames(
        tracks,
        declared=UP_AXES["z"],
        rate=check_rate(rate, "--rate" if rate == options.rate else f"{file.source}: fps"),
        source=file.source,
        unit=named_unit(options.unit) or 1.0,
        stature=options.stature,
        up=options.up,
        notes=file.notes,
    )


def _tracks(file: ArrayFile, position: FloatArray) -> dict[str, FloatArray]:
    """Canonical joints (T, 3) of positions (T, J, 3), by the names in the file, else in SMPL's order. Raises InputError
    for others."""
    count = position.shape[1]
    if "joint_names" in file:
        names = tuple(file.texts("joint_names", count).tolist())
        found = joints_by_name(names)
        if found is None:
            raise InputError(
                "joints whose names are not known",
                where=f"{file.source}: joint_names",
                found=", ".join(repr(name[:40]) for name in names[:8]),
                allowed="such as Mixamo's, SMPL's, or as docs/motion-files.md lists them",
                next_step=f"Missing: {', '.join(named_in_part(names)[1].values())}. Rename those",
            )
    elif count in SMPL_COUNTS:
        names, found = SMPL_NAMES[:22], joints_by_name(SMPL_NAMES[:22])
        assert found is not None, "SMPL's joints are known by name"
    else:
        raise InputError(
            "joints of no known layout",
            where=f"{file.source}: {JOINTS_KEY}",
            found=f"{count} joints",
            allowed=f"{', '.join(map(str, SMPL_COUNTS))} in the order of SMPL, or joint_names beside them",
            next_step="Put joint_names into the file, or export BVH (docs/motion-files.md)",
        )
    tracks = {name: position[:, at] for name, at in found.items() if name in JOINTS}
    pelvis = tracks.setdefault("pelvis", 0.5 * (tracks["l_hip"] + tracks["r_hip"]))
    trunk = [position[:, at] for at, name in enumerate(names) if any(word in name.lower() for word in TRUNK_WORDS)]
    if trunk:
        trunk.sort(key=lambda track: np.median([0.0, *(far := norms(track - pelvis))[np.isfinite(far)]]))
        tracks |= {"spine": trunk[0], "chest": trunk[-1]}
    if "joint_names" not in file:
        _refuse_order(file, tracks)
    return tracks


def _refuse_order(file: ArrayFile, tracks: dict[str, FloatArray]) -> None:
    """Raise InputError if bones differ so much between sides or over time that the joints are others."""
    unlike = []
    for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
        lengths = [norms(tracks[f"{side}_{b}"] - tracks[f"{side}_{a}"]) for side in "lr"]
        known = [np.sort(one[np.isfinite(one)]) for one in lengths if np.isfinite(one).any()]
        spreads = [one[[len(one) // 10, len(one) * 9 // 10]] for one in known]  # all but the outliers
        low, high = np.min(spreads, initial=np.inf), np.max(spreads, initial=0.0)
        if high > UNLIKE * low:
            unlike.append(f"{a} to {b} {low:.3g} to {high:.3g}")
    if len(unlike) > 1:
        raise InputError(
            "the joints are not in the order of SMPL: their limbs have no length",
            where=f"{file.source}: {JOINTS_KEY}",
            found="; ".join(unlike),
            next_step="Put joint_names, an array of their names, into the file",
        )


def _height(file: ArrayFile) -> float | None:
    """The performer's height, m, in the file; None without one."""
    if "height" not in file:
        return None
    values = file.floats("height", *(None for _ in file.arrays["height"].shape)).reshape(-1)
    low, high = STATURE_M
    if len(values) != 1 or not low <= values[0] <= high:
        found = ", ".join(f"{value:g}" for value in values[:3])
        raise InputError(
            "no height of a human", where=f"{file.source}: height", found=found, allowed=f"{low:g} to {high:g} m"
        )
    return float(values[0])


def _stature(tracks: dict[str, FloatArray]) -> float:
    """Stature in the file's unit, along the median bones from ankle to head joint."""
    chain = ("pelvis", *(name for name in ("spine", "chest") if name in tracks), "neck", "head")
    bones = (("l_ankle", "l_knee"), ("l_knee", "l_hip"), *pairwise(chain))
    lengths = [np.nanmedian(norms(tracks[b] - tracks[a])) for a, b in bones]
    return float(np.sum(lengths)) / (HEAD_CENTRE - ANKLE - HEAD_RISE)


def _read_kimodo(file: ArrayFile, options: ReadOptions) -> SensorFrames:
    """Poses of all joints, y up: SOMA with 77 or 30 joints, or SMPL with 22."""
    position = _positions(file, "posed_joints")
    rate, notes = assumed_rate(options.rate, KIMODO_RATE_HZ)
    count, where = position.shape[1], f"{file.source}: posed_joints"
    if count == G1_COUNT:
        raise InputError(
            "the motion of a robot, not of a performer",
            where=where,
            found=f"{count} joints, as Kimodo's G1 has them",
            allowed="77 or 30 (SOMA), 22 (SMPL)",
            next_step="Generate the motion with Kimodo's model of SOMA or SMPL",
        )
    if count not in KIMODO_SKELETONS:
        allowed = "77 or 30 (SOMA), 22 (SMPL)"
        raise InputError(
            "joints of no known skeleton", where=where, found=f"{count} joints", allowed=allowed, next_step=ADVICE
        )
    names, parents = KIMODO_SKELETONS[count]
    matrices = file.floats("global_rot_mats", *position.shape[:2], 3, 3)
    if float(np.abs(squares(matrices) - 1.0).max()) > TURNED:
        raise InputError("no rotation matrices", where=f"{file.source}: global_rot_mats", next_step=ADVICE)
    pose = JointPoses(position, rotations.from_matrix(matrices))
    tree = tree_of_poses(names, parents, pose)
    if "headend" not in (name.lower() for name in names):  # a head of usual height
        ends = tuple((np.zeros(3),) if name.lower() == "head" else () for name in names)
        tree = type(tree)(tree.names, tree.parents, tree.offsets, ends)
    return canonical_frames(
        tree,
        pose,
        unit=1.0,
        rate=rate,
        source=file.source,
        options=options,
        notes=notes,
    )
