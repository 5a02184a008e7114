"""Animations of glTF 2.0 files (.glb, .gltf) and VRM animations (.vrma), y up, metres (Khronos glTF 2.0 specification).

Nodes are the joints, and the rest pose is theirs. An animated channel replaces a node's rest value; channels have their
own key times and are sampled at one rate. VRM's table of bones gives the names.
"""

import base64
import binascii
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from struct import Struct
from typing import Annotated, Literal
from urllib.parse import unquote

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from retarget import rotations
from retarget.arithmetic import dot, matmul, norms
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.sources.bvh import MAX_JOINTS, MAX_SKELETON_DEPTH
from retarget.sources.canonical import canonical_frames
from retarget.sources.files import (
    AS_WRITTEN,
    MAX_FILE_BYTES,
    MAX_FRAMES,
    MAX_RATE_HZ,
    MAX_VALUE,
    ReadOptions,
    check_frame_count,
    check_rate,
    read_bytes,
)
from retarget.sources.skeletons import JointPoses, JointTree
from retarget.types import FloatArray

Index = Annotated[int, Field(ge=0, le=2**31)]
FiniteNumber = Annotated[float, Field(allow_inf_nan=False, ge=-MAX_VALUE, le=MAX_VALUE)]
Triple = tuple[FiniteNumber, FiniteNumber, FiniteNumber]
Four = tuple[FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber]


class _Part(BaseModel):
    """A part of the document; unknown keys are skipped."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Node(_Part):
    name: str = ""
    children: tuple[Index, ...] = ()
    translation: Triple = (0.0, 0.0, 0.0)
    rotation: Four = (0.0, 0.0, 0.0, 1.0)
    scale: Triple = (1.0, 1.0, 1.0)
    matrix: Annotated[tuple[FiniteNumber, ...], Field(min_length=16, max_length=16)] | None = None


class _Target(_Part):
    node: Index | None = None
    path: str


class _Channel(_Part):
    sampler: Index
    target: _Target


class _Sampler(_Part):
    input: Index
    output: Index
    interpolation: Literal["LINEAR", "STEP", "CUBICSPLINE"] = "LINEAR"


class _Animation(_Part):
    name: str = ""
    channels: tuple[_Channel, ...]
    samplers: tuple[_Sampler, ...]


class _Accessor(_Part):
    bufferView: Index | None = None
    byteOffset: Index = 0
    componentType: int
    normalized: bool = False
    count: Index
    type: str
    sparse: object = None


class _View(_Part):
    buffer: Index
    byteOffset: Index = 0
    byteLength: Index
    byteStride: Annotated[int, Field(ge=1, le=252)] | None = None
    extensions: dict[str, object] = {}


class _Buffer(_Part):
    byteLength: Index
    uri: str | None = None


class _Bone(_Part):
    node: Index


class _Humanoid(_Part):
    humanBones: dict[str, _Bone] = {}


class _Vrm(_Part):
    humanoid: _Humanoid = _Humanoid()


class _Extensions(_Part):
    VRMC_vrm_animation: _Vrm | None = None
    VRMC_vrm: _Vrm | None = None


class _Asset(_Part):
    version: str


class _Document(_Part):
    asset: _Asset
    nodes: tuple[_Node, ...] = ()
    animations: tuple[_Animation, ...] = ()
    accessors: tuple[_Accessor, ...] = ()
    bufferViews: tuple[_View, ...] = ()
    buffers: tuple[_Buffer, ...] = ()
    extensions: _Extensions = _Extensions()


MAGIC = b"glTF"
_HEADER, _CHUNK = Struct("<4sII"), Struct("<II")
JSON_CHUNK, BIN_CHUNK = 0x4E4F534A, 0x004E4942
"""Types of chunks of a GLB container: "JSON" and "BIN"."""


@dataclass(eq=False)
class _File:
    """binary: the second chunk, empty without one. buffers, values: read so far. taken: bytes of these values."""

    path: Path
    document: _Document
    binary: bytes
    buffers: dict[int, bytes] = field(default_factory=dict)
    values: dict[int, FloatArray] = field(default_factory=dict)
    taken: int = 0

    def error(
        self, what: str, part: str, *, found: object = "", allowed: object = "", next_step: str = ""
    ) -> InputError:
        step = next_step or "Export the file again"
        return InputError(what, where=f"{self.path}: {part}", found=found, allowed=allowed, next_step=step)


def _opened(path: Path) -> _File:
    content, binary = read_bytes(path), b""
    if content[:4] == MAGIC:
        content, binary = _chunks(content, path)
    try:
        document = _Document.model_validate(json.loads(content.decode("utf-8-sig")))
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        part = ".".join(map(str, first["loc"]))[:200]
        found = repr(first["input"])[:80]
        raise InputError(
            "not as glTF 2.0 has it", where=f"{path}: {part}", found=found, next_step=first["msg"][:120]
        ) from None
    except (ValueError, RecursionError):  # not UTF-8, not JSON, a number of thousands of digits
        raise InputError(
            "not a glTF file", where=str(path), allowed="JSON in UTF-8", next_step="It may be cut short: get it again"
        ) from None
    if not document.asset.version.startswith("2."):
        found = document.asset.version[:20]
        raise InputError(
            "another version of glTF", where=str(path), found=found, allowed="2.0", next_step="Export it as glTF 2.0"
        )
    return _File(path, document, binary)


def _chunks(content: bytes, path: Path) -> tuple[bytes, bytes]:
    at, found = _HEADER.size, dict[int, bytes]()
    version = int.from_bytes(content[4:8], "little")
    while at + _CHUNK.size <= len(content):
        length, kind = _CHUNK.unpack_from(content, at)
        at += _CHUNK.size
        found.setdefault(kind, content[at : at + length])
        at += length
    if (
        version != 2
        or at != len(content)
        or len(content) != int.from_bytes(content[8:12], "little")
        or JSON_CHUNK not in found
    ):
        raise InputError(
            "a damaged GLB file",
            where=str(path),
            found=f"version {version}, {len(content)} bytes",
            allowed=f"version 2, {int.from_bytes(content[8:12], 'little')} bytes as it declares, whole chunks",
            next_step="It may be cut short: get it again",
        )
    return found[JSON_CHUNK], found.get(BIN_CHUNK, b"")


def _buffer(file: _File, index: int) -> bytes:
    """Bytes of a buffer: in the container, in the document, or in a file beside it."""
    part, data = f"buffers.{index}", file.binary
    if index >= len(file.document.buffers):
        raise file.error("no such buffer", part)
    uri = file.document.buffers[index].uri
    if uri is None:
        if index > 0 or not data:
            raise file.error("a buffer without bytes", part)
    elif uri.startswith("data:"):
        kind, _, text = uri.partition(",")
        try:
            data = base64.b64decode(text, validate=True) if kind.endswith(";base64") else b""
        except (binascii.Error, ValueError):
            data = b""
        if not data:
            raise file.error("an embedded buffer that is no base64", part, found=repr(uri[:40]))
    else:
        data = read_bytes(_beside(file, unquote(uri), part))
    if len(data) < file.document.buffers[index].byteLength:
        found, allowed = f"{len(data)} bytes", f"{file.document.buffers[index].byteLength}, as declared"
        raise file.error("a buffer is cut short", part, found=found, allowed=allowed, next_step="Get the file again")
    return data


def _beside(file: _File, name: str, part: str) -> Path:
    """Path of a file of bytes, which must lie in the document's folder."""
    folder = file.path.parent.resolve()
    try:
        path = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError):  # a NUL character, links in a circle
        path = Path("/")
    if not path.is_relative_to(folder) or ":" in name or path == folder:
        step = "Put the file of bytes beside the document, or export a GLB"
        raise file.error("a buffer outside of the folder", part, found=repr(name[:80]), next_step=step)
    return path


COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
"""FiniteNumber types by their codes."""
ELEMENT_NUMBERS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
"""Numbers of an element by type."""
MAX_VALUES_BYTES = 2 * MAX_FILE_BYTES
"""Most bytes of values: the largest file holds as much in single precision, but accessors may share bytes."""


def _values(file: _File, index: int, kind: str) -> FloatArray:
    """Elements (count, n) of an accessor, normalised integers as floats; each accessor is read once."""
    document, part = file.document, f"accessors.{index}"
    if index >= len(document.accessors):
        raise file.error("no such accessor", part)
    accessor = document.accessors[index]
    view = accessor.bufferView
    if accessor.sparse is not None or view is None or view >= len(document.bufferViews):
        raise file.error("a sparse accessor, or one without a bufferView", part, next_step="Export plain animations")
    where = document.bufferViews[view]
    if "EXT_meshopt_compression" in where.extensions:
        raise file.error("compressed animations (meshopt)", part, next_step="Export without compression")
    floats = accessor.componentType == 5126
    if accessor.type != kind or accessor.componentType not in COMPONENTS or not (floats or accessor.normalized):
        allowed = f"{kind} of floats (5126) or normalised integers (5120 to 5123)"
        raise file.error(
            "numbers of another type", part, found=f"{accessor.type[:20]} of {accessor.componentType}", allowed=allowed
        )
    if index in file.values:
        return file.values[index]
    if where.buffer not in file.buffers:
        file.buffers[where.buffer] = _buffer(file, where.buffer)
    buffer = file.buffers[where.buffer]
    dtype = np.dtype(COMPONENTS[accessor.componentType])
    size = dtype.itemsize * ELEMENT_NUMBERS[kind]
    stride = where.byteStride or size
    start, end = where.byteOffset + accessor.byteOffset, min(where.byteOffset + where.byteLength, len(buffer))
    if accessor.count < 1 or start + stride * (accessor.count - 1) + size > end:
        raise file.error(
            "an accessor beyond its bytes", part, found=f"{accessor.count} elements", next_step="Get the file again"
        )
    shape, strides = (accessor.count, ELEMENT_NUMBERS[kind]), (stride, dtype.itemsize)
    file.taken += 8 * prod(shape)
    if file.taken > MAX_VALUES_BYTES:
        allowed, step = f"up to {MAX_VALUES_BYTES} bytes of them", "Cut it into parts"
        raise file.error("too many values", part, found=f"{accessor.count} elements", allowed=allowed, next_step=step)
    raw = np.ndarray(shape, dtype, buffer, start, strides)
    values = raw.astype(float)
    if not floats:
        values = np.maximum(values / np.iinfo(dtype).max, -1.0)
    if not np.abs(values).max() <= MAX_VALUE:  # False for NaN
        raise file.error("not a usable number", part, allowed="finite numbers up to 1e9")
    return file.values.setdefault(index, values)


WXYZ = [3, 0, 1, 2]
"""Columns of a quaternion xyzw in the order wxyz."""
PATHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
"""Animated properties of a node that are read, and the types of their values."""
LEAST_RATE_HZ = 30.0
"""Least rate, Hz, at which keys are sampled: sparse keys are interpolated."""
SAME_RATE = 2e-4
"""Share of a rate within which it is rounded to a whole number: keys are in single precision."""
KEY_ROUNDING = 1e-6
"""Share of its time (s, at least 1) by which a key may be late: keys are in single precision."""
NEAR_ZERO = 1e-6
"""Length of an interpolated quaternion below which it is rounding error, no rotation."""
MAX_JOINT_POSES = 5_000_000
"""Most joint poses in all frames: as many as a BVH of the largest size holds."""


@dataclass(frozen=True, eq=False)
class _Track:
    """Keys of a property of a node: rising times (k,) s, and values (k, n) as in the file; of a cubic spline (k, 3, n):
    in-tangent, value, out-tangent."""

    times: FloatArray
    values: FloatArray
    path: str
    interpolation: str

    def at(self, times: FloatArray) -> FloatArray:
        """Values (T, n) at times (T,) s, rotations wxyz; the first and last key hold beyond them. NaN where a spline of
        rotations passes through zero."""
        spline = self.interpolation == "CUBICSPLINE"
        later = times + KEY_ROUNDING * np.maximum(np.abs(times), 1.0)
        before = np.clip(np.searchsorted(self.times, later, side="right") - 1, 0, len(self.times) - 1)
        after = np.minimum(before + 1, len(self.times) - 1)
        gap = self.times[after] - self.times[before]
        share = np.clip((times - self.times[before]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)[:, None]
        a, b = (self.values[row, 1] if spline else self.values[row] for row in (before, after))
        if spline:  # specification, appendix C.5
            s2, s3 = share * share, share * share * share
            out, into = gap[:, None] * self.values[before, 2], gap[:, None] * self.values[after, 0]
            a = (
                (2.0 * s3 - 3.0 * s2 + 1.0) * a
                + (s3 - 2.0 * s2 + share) * out
                + (3.0 * s2 - 2.0 * s3) * b
                + (s3 - s2) * into
            )
        if self.path == "rotation":
            if spline:
                a = np.where(norms(a)[:, None] > NEAR_ZERO, a, np.nan)
            a, b = (rotations.normalise(one[:, WXYZ]) for one in (a, b))
            return rotations.slerp(a, b, share[:, 0]) if self.interpolation == "LINEAR" else a
        return a + share * (b - a) if self.interpolation == "LINEAR" else a


def _tracks(file: _File, animation: _Animation, number: int) -> dict[tuple[int, str], _Track]:
    found = dict[tuple[int, str], _Track]()
    for at, channel in enumerate(animation.channels):
        part = f"animations.{number}.channels.{at}"
        node, path = channel.target.node, channel.target.path
        if node is None or path not in PATHS:
            continue
        if node >= len(file.document.nodes) or channel.sampler >= len(animation.samplers):
            raise file.error("a channel of no node or sampler", part)
        if (node, path) in found:
            raise file.error(
                "a second channel of the same property", part, found=f"{path} of node {node}", allowed="one"
            )
        sampler = animation.samplers[channel.sampler]
        times = _values(file, sampler.input, "SCALAR")[:, 0]
        values = _values(file, sampler.output, PATHS[path])
        per_key = 3 if sampler.interpolation == "CUBICSPLINE" else 1
        if len(values) != per_key * len(times) or not (np.diff(times) > 0.0).all():
            found_text = f"{len(times)} times, {len(values)} values"
            raise file.error(
                "keys that do not fit", part, found=found_text, allowed=f"rising times, {per_key} values of each"
            )
        if per_key == 3:
            values = values.reshape(len(times), 3, -1)
        if path == "rotation" and not norms(values[:, 1] if per_key == 3 else values).all():
            raise file.error("a rotation of length zero", part)
        found[node, path] = _Track(times, values, path, sampler.interpolation)
    return found


def _clock(file: _File, tracks: Collection[_Track], joints: int, rate: float | None) -> tuple[FloatArray, float]:
    """Times (T,) s at which keys are sampled, and their rate: that of the densest channel, at least 30 Hz."""
    start, end = min(float(one.times[0]) for one in tracks), max(float(one.times[-1]) for one in tracks)
    if rate is None:
        dense = [(len(one.times) - 1) / float(one.times[-1] - one.times[0]) for one in tracks if len(one.times) > 1]
        rate = min(max([LEAST_RATE_HZ, *dense]), MAX_RATE_HZ)
        rate = float(round(rate)) if abs(rate - round(rate)) < SAME_RATE * rate else rate
    count = (end - start) * check_rate(rate, "--rate") * (1.0 + SAME_RATE)
    frames = int(min(count, MAX_FRAMES)) + 1
    check_frame_count(frames, str(file.path))
    if frames * joints > MAX_JOINT_POSES:
        found = f"{frames} frames of {joints} joints"
        raise file.error(
            "too long", "animations", found=found, allowed=f"{MAX_JOINT_POSES} poses", next_step="Cut it into parts"
        )
    return start + np.arange(frames) / rate, rate


EVEN = 0.01
"""Share by which the scale of a joint may differ between axes: beyond, its bones would change their lengths."""


@dataclass(frozen=True, eq=False)
class _Joints:
    """Nodes (n) that are joints, parents first. parents (n): -1 for the root."""

    nodes: list[int]
    names: tuple[str, ...]
    parents: tuple[int, ...]


def _joints(file: _File, animated: set[int]) -> _Joints:
    """The tree with the most animated nodes, with the nodes above and below them. Raises InputError."""
    nodes, above = file.document.nodes, dict[int, int]()
    for index, node in enumerate(nodes):
        for child in node.children:
            if child >= len(nodes) or child in above or child == index:
                raise file.error("no tree of nodes", f"nodes.{index}.children", found=child)
            above[child] = index
    paths = {}
    for index in sorted(animated):
        path = [index]
        while path[-1] in above:
            path.append(above[path[-1]])
            if len(path) > MAX_SKELETON_DEPTH:
                raise file.error(
                    "nodes too deeply nested, or in a circle", f"nodes.{index}", allowed=f"{MAX_SKELETON_DEPTH} deep"
                )
        paths[index] = path
    roots = [path[-1] for path in paths.values()]
    root = max(dict.fromkeys(roots), key=roots.count)
    kept = {step for path in paths.values() if path[-1] == root for step in path}
    order, parents, below = [root], [-1], [root in animated]
    for at, index in enumerate(order):  # grows in the loop
        for child in nodes[index].children:
            if child in kept or below[at]:
                order.append(child)
                parents.append(at)
                below.append(below[at] or child in animated)
        if len(order) > MAX_JOINTS:
            raise file.error("skeleton too large", "nodes", found=len(order), allowed=f"up to {MAX_JOINTS} joints")
    bones = file.document.extensions.VRMC_vrm_animation or file.document.extensions.VRMC_vrm
    named = {bone.node: name for name, bone in bones.humanoid.humanBones.items()} if bones else {}
    return _Joints(order, tuple(named.get(index, nodes[index].name) for index in order), tuple(parents))


def _rest(file: _File, index: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Translation (3,), rotation (4,) wxyz and scale (3,) of a node at rest. Raises InputError."""
    node = file.document.nodes[index]
    if node.matrix is None:
        x, y, z, w = node.rotation
        turn, scale = rotations.normalise(np.array([w, x, y, z])), np.array(node.scale)
        if not np.isfinite(turn).all():
            raise file.error("a rotation of length zero", f"nodes.{index}")
        return np.array(node.translation), turn, scale
    matrix = np.array(node.matrix).reshape(4, 4).T  # columns first
    scale = norms(matrix[:3, :3].T)
    axes = matrix[:3, :3] / np.where(scale > 0.0, scale, 1.0)
    off = float(np.abs(matmul(axes.T, axes) - np.eye(3)).max())
    if off > EVEN or dot(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2]) < 0.0:
        raise file.error(
            "a matrix that shears or mirrors", f"nodes.{index}.matrix", next_step="Apply it before the export"
        )
    return matrix[:3, 3], rotations.from_matrix(axes), scale


def _moved(
    file: _File, joints: _Joints, own: Mapping[tuple[int, str], _Track], times: FloatArray
) -> tuple[JointPoses, tuple[str, ...]]:
    """Poses of all joints at times (T,), in file axes and units, and notes. `own`: the tracks, none for the rest
    pose."""
    shape, notes = (len(joints.nodes), len(times)), list[str]()
    position, orientation, scales = np.empty((*shape, 3)), np.empty((*shape, 4)), np.ones((shape[0], 3))
    for at, (node, parent) in enumerate(zip(joints.nodes, joints.parents, strict=True)):
        rest = dict(zip(PATHS, _rest(file, node), strict=True))
        now = {
            path: own[node, path].at(times) if (node, path) in own else rest[path]
            for path in ("translation", "rotation")
        }
        if not np.isfinite(now["rotation"]).all():
            step = "Export it with linear interpolation, or with neighbouring keys of the same sign"
            raise file.error("a rotation that a spline takes through zero", f"nodes.{node}.rotation", next_step=step)
        scale = own[node, "scale"].at(times[:1])[0] if (node, "scale") in own else rest["scale"]
        if (node, "scale") in own and np.ptp(own[node, "scale"].at(times), axis=0).max() > EVEN:
            notes.append(f"the changing size of {joints.names[at]!r} is left out")
        if parent < 0:
            position[at], orientation[at], scales[at] = now["translation"], now["rotation"], scale
        else:
            place = scales[parent] * now["translation"]
            position[at] = position[parent] + rotations.rotate(orientation[parent], place)
            orientation[at] = rotations.multiply(orientation[parent], now["rotation"])
            scales[at] = scales[parent] * scale
        if at in joints.parents and not np.ptp(scales[at]) <= EVEN * np.abs(scales[at]).max() > 0.0:
            found = " ".join(f"{value:g}" for value in scales[at])
            raise file.error(
                "a joint with another scale along each axis",
                f"nodes.{node}",
                found=found,
                next_step="Apply it before the export",
            )
    return JointPoses(position.swapaxes(0, 1), orientation.swapaxes(0, 1)), tuple(notes)


def read_gltf(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read the first animation, sampled at the user's rate. Raises InputError with the part of the document."""
    file = _opened(path)
    animations = file.document.animations
    tracks = [_tracks(file, one, number) for number, one in enumerate(animations[:1])]
    if not tracks or not tracks[0]:
        raise InputError("no animation in the file", where=str(path), next_step="Export the model with its animation")
    notes = list[str]()
    if len(animations) > 1:
        named = animations[0].name[:40] or "the first"
        notes.append(f"{len(animations)} animations in the file: only {named!r} is read")
    joints = _joints(file, {node for node, _ in tracks[0]})
    times, rate = _clock(file, tracks[0].values(), len(joints.nodes), options.rate)
    rest, _ = _moved(file, joints, {}, np.zeros(1))
    pose, moved_notes = _moved(file, joints, tracks[0], times)
    # Frames relative to rest: the zero pose is the rest pose.
    offsets = [rest.position[0, at] - rest.position[0, max(parent, 0)] for at, parent in enumerate(joints.parents)]
    ends = tuple(() if at in joints.parents else (np.zeros(3),) for at in range(len(joints.nodes)))
    tree = JointTree(joints.names, joints.parents, np.array(offsets), ends)
    turned = rotations.multiply(pose.orientation, rotations.conjugate(rest.orientation[0]))
    return canonical_frames(
        tree,
        JointPoses(pose.position, turned),
        unit=1.0,
        rate=rate,
        source=str(path),
        options=options,
        notes=(*notes, *moved_notes),
    )
