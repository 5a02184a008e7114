"""Motion as arrays (.npz): the SMPL family (`amass`), mere joint positions (as holosoma takes them), Kimodo's output.

The layout is known by the names of the arrays. No pickle is read: an array of Python objects is refused where it is
needed, and passed over where it is not.
"""

from collections.abc import Collection
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
from retarget.sources.files import AS_WRITTEN, MAX_VALUE, ReadOptions, check_frame_count, check_rate, read_head
from retarget.sources.rest_skeleton import HEAD_RISE
from retarget.sources.skeletons import (
    SMPL_NAMES,
    SMPL_PARENTS,
    TABLES,
    JointPoses,
    joints_by_name,
    layout,
    tree_of_poses,
)
from retarget.types import FloatArray

MAX_ARRAY_BYTES = 256 * 2**20
"""Largest content, bytes, of the arrays that are read: 200,000 frames of SMPL-H in doubles are 250 MB."""
ADVICE = "See the layouts in docs/motion-files.md"
JOINT_KEYS = frozenset(("global_joint_positions", "height"))
KIMODO_KEYS = frozenset(("posed_joints", "global_rot_mats"))
"""Arrays that are read of these layouts."""
LAYOUTS = (
    "poses, trans and mocap_framerate (AMASS); root_orient, pose_body and trans (AMASS stageii); global_orient, "
    "body_pose and transl (SMPL); global_joint_positions (joints); posed_joints and global_rot_mats (Kimodo)"
)
KIMODO_RATE_HZ = 30.0
"""Rate, Hz, of Kimodo's motions, which do not say it."""
SMPL_COUNTS = (22, 24, 52, 55)
"""Joints of bodies of the SMPL family: without hands, SMPL, SMPL-H and SMPL-X."""
G1_COUNT = 34
"""Joints of Kimodo's skeleton of Unitree's G1, a robot."""
TURNED = 0.01
"""Most that rows of a rotation matrix may miss unit length: single precision misses 1e-6."""


def read_npz(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read a motion. Raises InputError with the file and the array."""
    read_head(path)
    file = open_arrays(
        path, lambda names: _wanted(names, path), max_bytes=MAX_ARRAY_BYTES, advice=ADVICE, optional=MARKERS
    )
    if is_smpl(file.arrays):
        return smpl_frames(file, options)
    return (_read_joints if "global_joint_positions" in file else _read_kimodo)(file, options)


def _wanted(names: Collection[str], path: Path) -> Collection[str]:
    """The arrays that are read of a layout. Raises InputError for arrays of none."""
    if is_smpl(names):
        return KEYS
    if "global_joint_positions" in names:
        return JOINT_KEYS
    if set(names) >= KIMODO_KEYS:
        return KIMODO_KEYS
    found = ", ".join(sorted(name[:40] for name in names)[:12]) or "no array"
    raise InputError(
        "arrays of no known motion",
        where=str(path),
        found=found,
        allowed=LAYOUTS,
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
    """Joints in SMPL's order, z up, NaN where lost. The file may hold the performer's height, but no rate."""
    position = _positions(file, "global_joint_positions", lost=True)
    if position.shape[1] not in SMPL_COUNTS:
        raise InputError(
            "joints of no known layout",
            where=f"{file.source}: global_joint_positions",
            found=f"{position.shape[1]} joints",
            allowed=f"{', '.join(map(str, SMPL_COUNTS))} in the order of SMPL",
            next_step="Put the joints into that order (docs/motion-files.md), or export BVH",
        )
    if options.rate is None:
        raise InputError(
            "no frame rate in the file", where=file.source, next_step="Say the frames per second with --rate"
        )
    height = _height(file) if options.stature is None else options.stature
    found = joints_by_name(SMPL_NAMES[:22])
    assert found is not None, "SMPL's joints are known by name"
    tracks = {name: position[:, at] for name, at in found.items() if name in JOINTS}
    tracks["spine"], tracks["chest"] = (position[:, SMPL_NAMES.index(name)] for name in ("spine1", "spine3"))
    if never := [name for name, track in tracks.items() if not np.isfinite(track).all(axis=1).any()]:
        raise InputError(
            "joints that are lost in every frame",
            where=f"{file.source}: global_joint_positions",
            found=", ".join(never),
            allowed="NaN in some of the frames",
            next_step="Export them too",
        )
    # SMPL's head joint is below the skull: its middle is on, along the neck.
    tracks["head"] = _beyond(tracks["neck"], tracks["head"], HEAD_RISE * (height or _stature(tracks)))
    return joint_frames(
        tracks,
        declared=UP_AXES["z"],
        rate=check_rate(options.rate, "--rate"),
        source=file.source,
        unit=named_unit(options.unit) or 1.0,
        stature=options.stature,
        up=options.up,
    )


def _height(file: ArrayFile) -> float | None:
    """The performer's height, m, by the file; None without one."""
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
    bones = (("l_ankle", "l_knee"), ("l_knee", "l_hip"), ("pelvis", "spine"), ("spine", "chest"), ("chest", "neck"))
    lengths = [np.nanmedian(norms(tracks[b] - tracks[a])) for a, b in (*bones, ("neck", "head"))]
    return float(np.sum(lengths)) / (HEAD_CENTRE - ANKLE - HEAD_RISE)


def _beyond(start: FloatArray, end: FloatArray, length: float) -> FloatArray:
    """Points (T, 3) beyond the ends of lines by a length."""
    line = end - start
    return np.asarray(end + length * line / np.maximum(norms(line), 1e-9)[:, None])


def _read_kimodo(file: ArrayFile, options: ReadOptions) -> SensorFrames:
    """Poses of all joints, y up: SOMA with 77 or 30 joints, or SMPL with 22."""
    position = _positions(file, "posed_joints")
    notes: tuple[str, ...] = ()
    if (rate := options.rate) is None:
        notes = (f"frame rate not stated: taken as {KIMODO_RATE_HZ:g} Hz (change it with --rate)",)
    rate = KIMODO_RATE_HZ if rate is None else check_rate(rate, "--rate")
    names, parents = _kimodo_skeleton(position.shape[1], file)
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
        unit=named_unit(options.unit) or 1.0,
        rate=rate,
        source=file.source,
        stature=options.stature,
        up=options.up,
        notes=notes,
    )


def _kimodo_skeleton(count: int, file: ArrayFile) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names and parents of a skeleton of so many joints."""
    soma, parents = layout(TABLES["layouts"]["soma"])
    if count == len(soma):
        return soma, parents
    if count == len(TABLES["soma_30"]):
        names = tuple(TABLES["soma_30"])
        above = dict(TABLES["layouts"]["soma"])
        kept = []
        for name in names:
            parent = above[name]
            while parent and parent not in names:
                parent = above[parent]
            kept.append(names.index(parent) if parent else -1)
        return names, tuple(kept)
    if count == 22:
        return SMPL_NAMES[:count], SMPL_PARENTS[:count]
    if count == G1_COUNT:
        raise InputError(
            "the motion of a robot, not of a performer",
            where=f"{file.source}: posed_joints",
            found=f"{count} joints, as Kimodo's G1 has them",
            allowed="77 or 30 (SOMA), 22 (SMPL)",
            next_step="Generate the motion with Kimodo's model of SOMA or SMPL",
        )
    raise InputError(
        "joints of no known skeleton",
        where=f"{file.source}: posed_joints",
        found=f"{count} joints",
        allowed="77 or 30 (SOMA), 22 (SMPL)",
        next_step=ADVICE,
    )
