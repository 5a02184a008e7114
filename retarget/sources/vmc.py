"""VMC protocol 3.1 (github.com/sh-akira/VirtualMotionCaptureProtocol), the receiving side: poses over OSC and UDP.

`VmcDecoder` gives the poses as they are sent. Names of a frame: the serial of a device (`human://HEAD`), whether it is
sent as a headset, controller or tracker; `local://SERIAL` for its raw pose (address with `/Local`);
`bone://LeftUpperArm` in Unity's spelling; `root://root`. Devices are world poses. Bones are relative to their parent,
with the T-pose as identity. `VmcBodyDecoder` gives the bones as world poses, by forward kinematics.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions, proportional_dimensions
from retarget.rotations import IDENTITY, from_axis_angle, multiply, rotate
from retarget.sources.osc import OscLayouts, OscMessage, OscPacket
from retarget.sources.stream_frame import CONVENTIONS, MAX_POSES, Dropped, StreamFrame, unusable
from retarget.types import BoolArray, FloatArray

# Names of the poses of VMC: the bones of Unity's humanoid, and the serials of devices that are accepted.

MAX_SERIAL = 128
"""Characters of the longest serial that is accepted."""

_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")

BODY_BONES: tuple[str, ...] = (
    *("Hips", "Spine", "LeftUpperLeg", "RightUpperLeg", "Chest", "LeftLowerLeg", "RightLowerLeg"),
    *("UpperChest", "LeftFoot", "RightFoot", "Neck", "LeftShoulder", "RightShoulder", "LeftToes", "RightToes"),
    *("Head", "LeftUpperArm", "RightUpperArm", "LeftLowerArm", "RightLowerArm", "LeftHand", "RightHand"),
)
"""Bones of trunk, head and limbs, parents first."""

BONES: tuple[str, ...] = (
    *BODY_BONES,
    *("LeftEye", "RightEye", "Jaw"),
    *(
        f"{side}{finger}{part}"
        for side in ("Left", "Right")
        for finger in _FINGERS
        for part in ("Proximal", "Intermediate", "Distal")
    ),
)
"""All bones of Unity's HumanBodyBones, by their canonical spelling."""

_BY_LOWER_CASE = {name.lower(): f"bone://{name}" for name in BONES}
_RESERVED = ("bone://", "root://", "local://")


def bone_name(name: str) -> str | None:
    """`bone://LeftUpperArm` for this bone in any spelling of case; None for a name that Unity does not have."""
    return _BY_LOWER_CASE.get(name.lower())


def device_name(serial: str) -> str | None:
    """The serial itself; None if it is empty, too long, not printable, or could be taken for a bone or the root."""
    if not 0 < len(serial) <= MAX_SERIAL or not serial.isprintable() or serial.lower().startswith(_RESERVED):
        return None
    return serial


# Forward kinematics over the bones of Unity's humanoid: from parent-relative poses to world poses.
#
# For senders that send bones only (VirtualMotionCapture, VSeeFace), and to check senders of both bones and devices.
# Rows are those of `BODY_BONES`. The reference is the T-pose, where every rotation is the identity.

OPTIONAL: tuple[str, ...] = (
    *("Chest", "UpperChest", "Neck"),
    *(f"{side}{part}" for part in ("Shoulder", "Toes") for side in ("Left", "Right")),
)
"""Bones that an avatar may be without (docs.unity3d.com, HumanTrait.RequiredBone).

The children of a missing bone are attached to its parent.
"""

_TRUNK = ("Hips", "Spine", "Chest", "UpperChest", "Neck", "Head")
_ARM = ("Shoulder", "UpperArm", "LowerArm", "Hand")
_LEG = ("UpperLeg", "LowerLeg", "Foot", "Toes")
_CHAINS = (
    _TRUNK,
    *(("UpperChest", *(side + part for part in _ARM)) for side in ("Left", "Right")),
    *(("Hips", *(side + part for part in _LEG)) for side in ("Left", "Right")),
)
_PARENT = {bone: parent for chain in _CHAINS for parent, bone in pairwise(chain)}
_ROW = {bone: row for row, bone in enumerate(BODY_BONES)}
_COLUMN = {**{f"bone://{bone}": row for row, bone in enumerate(BODY_BONES)}, "root://root": len(BODY_BONES)}
_IS_OPTIONAL = np.array([bone in OPTIONAL for bone in BODY_BONES])


def _depth(bone: str) -> int:
    return 1 + _depth(_PARENT[bone]) if bone in _PARENT else 0


_LEVELS = tuple(
    (
        np.array([_ROW[bone] for bone in BODY_BONES if _depth(bone) == depth]),
        np.array([_ROW[_PARENT[bone]] for bone in BODY_BONES if _depth(bone) == depth]),
    )
    for depth in range(1, 1 + max(map(_depth, BODY_BONES)))
)
"""Rows of the bones of each depth, and of their parents: all bones of one depth are turned at once."""

_ARM_POINTS = ("collar", "shoulder", "elbow", "wrist")
_LEG_POINTS = ("hip", "knee", "ankle", "toe")
_PARENT_ROWS = np.array([_ROW[_PARENT[bone]] for bone in BODY_BONES[1:]])
_PRODUCTS = np.array([[multiply(a, b) for b in np.eye(4)] for a in np.eye(4)]).reshape(4, 16)
"""A quaternion a (4,) times this, as (4, 4), is the matrix by which a row b becomes the product a b: fewer and larger
steps than `multiply`, eight times a frame."""

_POINTS = {
    **dict(zip(_TRUNK, ("pelvis", "spine", "chest", "", "neck", "head"), strict=True)),
    **{
        side + bone: short + point
        for side, short in (("Left", "l_"), ("Right", "r_"))
        for bone, point in zip(_ARM + _LEG, _ARM_POINTS + _LEG_POINTS, strict=True)
    },
}
"""The point of our human where a bone begins; the upper chest begins where the chest does."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalBones:
    """Bones relative to their parents, in the world's axes; NaN where not sent.

    rotation (22, 4) wxyz and position (22, 3) m by `BODY_BONES`; root_rotation (4,), root_position (3,) of the avatar.
    """

    rotation: FloatArray
    position: FloatArray
    root_rotation: FloatArray
    root_position: FloatArray


def bone_poses(frame: StreamFrame) -> FloatArray:
    """Position m and orientation wxyz (23, 7) of the tracked bones of one frame, the root last; NaN where not sent."""
    poses = np.full((len(BODY_BONES) + 1, 7), np.nan)
    for index, name in enumerate(frame.names):
        row = _COLUMN.get(name)
        if row is not None and frame.tracked[index]:
            poses[row, :3] = frame.position[index]
            poses[row, 3:] = frame.orientation[index]
    return poses


def local_bones(poses: FloatArray) -> LocalBones:
    """The bones of `bone_poses`."""
    return LocalBones(poses[:-1, 3:], poses[:-1, :3], poses[-1, 3:], poses[-1, :3])


def world_rotations(bones: LocalBones) -> FloatArray:
    """World orientation (22, 4) wxyz of each bone's segment.

    A root or an optional bone that is not sent is the identity. A required bone that is not sent is NaN, and so are
    its descendants.
    """
    world = np.where(_IS_OPTIONAL[:, None] & np.isnan(bones.rotation), IDENTITY, bones.rotation)
    root = np.where(np.isnan(bones.root_rotation), IDENTITY, bones.root_rotation)
    world[0] = multiply(root, world[0])
    for rows, parents in _LEVELS:
        factors = (world[parents] @ _PRODUCTS).reshape(-1, 4, 4)
        world[rows] = (world[rows, None] @ factors)[:, 0]
    return world


def world_positions(bones: LocalBones, rotations: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
    """World position (22, 3) m of the joint where each bone begins.

    rotations (22, 4): of `world_rotations`. offsets (22, 3) m, see `t_pose_offsets`: from parent to bone in the T-pose,
    used where the sender sends no position. An optional bone of which nothing is known begins where its parent does;
    any other is NaN, and so are its descendants.
    """
    step = bones.position if offsets is None else np.where(np.isnan(bones.position), offsets, bones.position)
    absent = _IS_OPTIONAL & np.isnan(bones.rotation[:, 0]) & np.isnan(step[:, 0])
    step = np.where(absent[:, None], 0.0, step)
    world = np.empty_like(step)
    world[1:] = rotate(rotations[_PARENT_ROWS], step[1:])
    root = np.where(np.isnan(bones.root_rotation), IDENTITY, bones.root_rotation)
    world[0] = rotate(root, step[0]) + np.where(np.isnan(bones.root_position), 0.0, bones.root_position)
    for rows, parents in _LEVELS:
        world[rows] += world[parents]
    return world


def t_pose_offsets(person: HumanDimensions) -> FloatArray:
    """Offset (22, 3) m of each bone from its parent for a person's size, in the T-pose; the hips lie in the root."""
    offsets = np.zeros((len(BODY_BONES), 3))
    for bone, point in _POINTS.items():
        if point:
            offsets[_ROW[bone]] = person.offset[POINTS.index(point)]
    for side, quarter in (("Left", 0.5 * np.pi), ("Right", -0.5 * np.pi)):
        # The person's arms hang; in the T-pose they point sideward.
        rows = [_ROW[f"{side}LowerArm"], _ROW[f"{side}Hand"]]
        offsets[rows] = rotate(from_axis_angle((1.0, 0.0, 0.0), quarter), offsets[rows])
    return offsets


# Poses of Unity's wire formats (VMC, VRChat OSC) into the world's axes.
#
# `stream_frame.CONVENTIONS` has the axes; here are the order of the numbers and Unity's Euler angles.

_UNITY = CONVENTIONS["unity"]
_WXYZ = np.array([3, 0, 1, 2])
_POSE = np.zeros((7, 7))
_POSE[:3, :3] = _UNITY.positions(np.eye(3))
_POSE[3:, 3:] = _UNITY.orientations(np.eye(4)[:, _WXYZ])
"""A row of seven numbers times this matrix is the pose; every entry is 0, 1 or -1, so nothing is rounded."""
_HALF_DEGREE = np.pi / 360.0


def position_from_unity(position: ArrayLike) -> FloatArray:
    """Positions (..., 3) m of Unity, in the world's axes."""
    return _UNITY.positions(position)


def poses_from_unity(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position (..., 3) and quaternion wxyz (..., 4) of Unity's x, y, z, qx, qy, qz, qw (..., 7).

    A pose with one number that is not finite is NaN throughout.
    """
    turned = poses @ _POSE
    return turned[..., :3], turned[..., 3:]


def euler_from_unity(degrees: ArrayLike) -> FloatArray:
    """Quaternions wxyz (..., 4), world's axes, of Unity's Euler angles x, y, z (..., 3) in degrees.

    Unity turns by z, then x, then y, about fixed axes: q = q_y q_x q_z (docs.unity3d.com, Quaternion.Euler).
    """
    half = np.asarray(degrees, float) * _HALF_DEGREE
    c, s = np.cos(half), np.sin(half)
    cx, cy, cz = c[..., 0], c[..., 1], c[..., 2]
    sx, sy, sz = s[..., 0], s[..., 1], s[..., 2]
    out = np.empty((*half.shape[:-1], 4))
    out[..., 0] = cy * cx * cz + sy * sx * sz
    out[..., 1] = cy * sx * cz + sy * cx * sz
    out[..., 2] = sy * cx * cz - cy * sx * sz
    out[..., 3] = cy * cx * sz - sy * sx * cz
    return _UNITY.orientations(out)


UNKNOWN_ADDRESS = "OSC address that is not used"
WRONG_ARGUMENTS = "VMC message with too few arguments or of the wrong types"
UNKNOWN_BONE = "bone that Unity's humanoid does not have"
BAD_SERIAL = "serial that is empty, too long, not printable, or reserved"
SENT_TWICE = "pose sent twice in one datagram"
TOO_MANY_POSES = "more than 256 poses in one datagram"
BAD_STAMP = "time that is not finite"
BAD_POSE = "pose that is not finite, far away, or without a unit quaternion"

_ROOT, _BONE, _DEVICE, _RAW = range(4)
_POSES: Mapping[str, int] = {
    "/VMC/Ext/Root/Pos": _ROOT,
    "/VMC/Ext/Bone/Pos": _BONE,
    **{f"/VMC/Ext/{device}/Pos": _DEVICE for device in ("Hmd", "Con", "Tra")},
    **{f"/VMC/Ext/{device}/Pos/Local": _RAW for device in ("Hmd", "Con", "Tra")},
}
_UNUSED = ("/VMC/Ext/", "/VMC/Thru/")
"""Addresses of the protocol without a pose (expressions, camera, light, keys): not used, and not counted as dropped."""
_FLOAT = Struct(">f")
_INT = Struct(">i")


class _State(NamedTuple):
    """Byte offsets of the numbers of /VMC/Ext/OK; None for those that it does not have."""

    loaded: int
    calibration: int | None
    mode: int | None
    tracking: int | None


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """Where one layout of a datagram has its poses.

    words (k, 7): index of each number among the datagram's 32-bit words. bones (k,): whether a pose is a bone.
    all_tracked, none_tracked (k,): all True and all False. stamp: byte of the time.
    """

    names: tuple[str, ...]
    words: NDArray[np.intp]
    bones: BoolArray
    all_tracked: BoolArray
    none_tracked: BoolArray
    stamp: int | None
    state: _State | None
    reasons: Counter[str]


class VmcDecoder:
    """A `StreamDecoder` of one sender's datagrams.

    The decoder keeps only the sender's state of `/VMC/Ext/OK` between datagrams: `loaded` (the sender has a model),
    `calibration` (0 not done, 1 waiting, 2 under way, 3 done), `calibration_mode` and `tracking`; None until sent.
    While the sender reports that no model is loaded, or that tracking is bad, no pose is `tracked`. `time` is the last
    /VMC/Ext/T, s. A frame's stamp is that of its own datagram only.

    A bone position of exactly zero becomes NaN: SlimeVR without an avatar file, iFacialMocap and others send zeros for
    unknown positions, and no bone of a body lies in its parent's joint. A pose that is not finite, out of any room or
    without a unit quaternion keeps its name, becomes NaN and is not tracked.
    """

    def __init__(self) -> None:
        self.dropped = Dropped()
        self.loaded: bool | None = None
        self.calibration: int | None = None
        self.calibration_mode: int | None = None
        self.tracking: bool | None = None
        self.time: float | None = None
        self._layouts = OscLayouts(_plan)
        self._names: tuple[str, ...] = ()

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it has no pose."""
        plan = self._layouts.of(datagram)
        if plan.reasons:
            self.dropped.reasons.update(plan.reasons)
        if plan.state is not None:
            self._keep_state(datagram, plan.state)
        stamp = None if plan.stamp is None else self._stamp(datagram, plan.stamp)
        if not plan.names:
            return []
        if plan.names != self._names:
            self._names = plan.names
        tracking = self.loaded is not False and self.tracking is not False
        position, orientation, tracked = self._poses(datagram, plan, tracking)
        return [StreamFrame(self._names, position, orientation, tracked, stamp)]

    def _poses(self, datagram: bytes, plan: _Plan, tracking: bool) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Position (k, 3), orientation (k, 4) and tracked (k,) by the plan."""
        poses = _numbers(datagram, plan.words)
        bad = unusable(poses[:, :3], poses[:, 3:])
        tracked = plan.all_tracked if tracking else plan.none_tracked
        if bad.any():
            self.dropped.reasons[BAD_POSE] += int(np.count_nonzero(bad))
            poses[bad] = np.nan
            tracked = tracked & ~bad
        position, orientation = poses_from_unity(poses)
        position[plan.bones & ~position.any(axis=1)] = np.nan
        norm = np.sqrt(np.einsum("ij,ij->i", orientation, orientation))
        return position, orientation / norm[:, None], tracked

    def _keep_state(self, datagram: bytes, state: _State) -> None:
        """Keep the state of /VMC/Ext/OK until the next one."""
        self.loaded = _INT.unpack_from(datagram, state.loaded)[0] != 0
        if state.calibration is not None and state.mode is not None:
            self.calibration = _INT.unpack_from(datagram, state.calibration)[0]
            self.calibration_mode = _INT.unpack_from(datagram, state.mode)[0]
        if state.tracking is not None:
            self.tracking = _INT.unpack_from(datagram, state.tracking)[0] != 0

    def _stamp(self, datagram: bytes, at: int) -> float | None:
        """Seconds of the sender's clock; None if they are not finite, which is counted."""
        stamp = float(_FLOAT.unpack_from(datagram, at)[0])
        if not np.isfinite(stamp):
            self.dropped.note(BAD_STAMP)
            return None
        self.time = stamp
        return stamp


def _numbers(datagram: bytes, words: NDArray[np.intp]) -> FloatArray:
    """The float32 at these words, as float64. A signalling NaN raises no warning."""
    with np.errstate(invalid="ignore"):
        return np.frombuffer(datagram, ">f4").take(words).astype(np.float64)


def _plan(packet: OscPacket) -> _Plan:
    """Where the poses are, and what is dropped. The plan holds for every datagram of this layout."""
    reasons = Counter(packet.dropped)
    places: dict[str, int] = {}
    stamp: int | None = None
    state: _State | None = None
    for message in packet.messages:
        if message.address == "/VMC/Ext/T" and message.tags.startswith("f"):
            stamp = message.at[0]
        elif message.address == "/VMC/Ext/OK" and message.tags.startswith("i"):
            state = _state(message)
        else:
            reason = _place(message, places)
            if reason:
                reasons[reason] += 1
    count = len(places)
    first = np.array(list(places.values()), np.intp).reshape(count, 1)
    all_tracked, none_tracked = np.ones(count, bool), np.zeros(count, bool)
    all_tracked.flags.writeable = none_tracked.flags.writeable = False
    bones = np.array([name.startswith("bone://") for name in places], bool)
    return _Plan(tuple(places), first + np.arange(7), bones, all_tracked, none_tracked, stamp, state, reasons)


def _place(message: OscMessage, places: dict[str, int]) -> str:
    """Keep the first word of a pose by its name (the last pose of a name counts); return why it is not used, or ""."""
    kind = _POSES.get(message.address)
    if kind is None:
        known = message.address.startswith(_UNUSED) and message.address not in ("/VMC/Ext/T", "/VMC/Ext/OK")
        return "" if known else WRONG_ARGUMENTS if message.address.startswith("/VMC/Ext/") else UNKNOWN_ADDRESS
    if not message.tags.startswith("sfffffff"):
        return WRONG_ARGUMENTS
    sent = str(message.arguments[0])
    name = "root://root" if kind == _ROOT else bone_name(sent) if kind == _BONE else device_name(sent)
    if name is None:
        return UNKNOWN_BONE if kind == _BONE else BAD_SERIAL
    if kind == _RAW:
        name = f"local://{name}"
    again = name in places
    if not again and len(places) >= MAX_POSES:
        return TOO_MANY_POSES
    places[name] = message.at[1] // 4
    return SENT_TWICE if again else ""


def _state(message: OscMessage) -> _State:
    """The layout of /VMC/Ext/OK: loaded; from 2.5 on, calibration state and mode too; from 2.7 on, tracking too."""
    at = message.at
    calibrated = message.tags.startswith("iii")
    return _State(
        at[0],
        at[1] if calibrated else None,
        at[2] if calibrated else None,
        at[3] if message.tags.startswith("iiii") else None,
    )


# VMC senders that send bones only: the avatar's bones as world poses.

STATURE_M = 1.70
"""Stature of a person of unknown size, m: calibration measures the limbs."""
ROUNDS = 8
"""A bone is lost that was not sent while another one was sent so often: 0.13 s of a sender of 60 Hz."""
_NAMES = tuple(f"bone://{bone}" for bone in BODY_BONES)
_FEET = [BODY_BONES.index("LeftFoot"), BODY_BONES.index("RightFoot")]
_HIPS = BODY_BONES.index("Hips")


class VmcBodyDecoder:
    """A `StreamDecoder`: the 22 bones of a humanoid, each `bone://NAME`, position of the joint where it begins.

    A sender may put an avatar into one datagram, or a bone into each: a body is given once each bone that it sends has
    come, or when the next round begins without one. Bone lengths that are not sent are those of `person`. Where the
    position of the hips is not sent, the lower foot stands on the ground.
    """

    def __init__(self, person: HumanDimensions | None = None) -> None:
        self._decoder = VmcDecoder()
        self.dropped: Dropped = self._decoder.dropped
        self._offsets = t_pose_offsets(person or proportional_dimensions(STATURE_M))
        self._ankle = FRACTIONS.ankle_height * (STATURE_M if person is None else person.stature)
        count = len(_COLUMN)
        self._poses: FloatArray = np.full((count, 7), np.nan)
        self._sent = np.zeros(count, dtype=np.int64)  # how often each bone was sent
        self._last = np.full(count, -ROUNDS, dtype=np.int64)  # of the bone that was sent most, when it was sent last
        self._round: BoolArray = np.zeros(count, dtype=bool)  # bones of the present round

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The body of one datagram; none if it has no bone, or if more of them are to come."""
        return [body for frame in self._decoder.decode(datagram) if (body := self._body(frame)) is not None]

    def _body(self, frame: StreamFrame) -> StreamFrame | None:
        poses = bone_poses(frame)
        sent: BoolArray = np.isfinite(poses[:, 3])
        self._poses[sent] = poses[sent]
        if not sent.any() or not self._is_whole(sent) or np.isnan(self._poses[:-1, 3]).all():
            return None
        bones = local_bones(self._poses)
        rotations = world_rotations(bones)
        positions = world_positions(bones, rotations, self._offsets)
        if np.isnan(bones.position[_HIPS, 0]):
            lowest = np.nanmin(positions[_FEET, 2]) if np.isfinite(positions[_FEET, 2]).any() else self._ankle
            positions[:, 2] += self._ankle - lowest
        known: BoolArray = np.asarray(np.isfinite(np.hstack((rotations, positions))).all(axis=1))
        return StreamFrame(_NAMES, positions, rotations, known, frame.stamp, frame.number)

    def _is_whole(self, sent: BoolArray) -> bool:
        """Whether a body is to be given after the bones (23,) that were just sent: all that are sent at all have come
        in this round, or the round before has ended without one. Forgets the bones that are lost."""
        self._sent[sent] += 1
        most = self._sent.max()
        self._last[sent] = most
        alive = most - self._last < ROUNDS
        self._poses[~alive] = np.nan
        again = bool((sent & self._round).any())
        cut_short = again and not self._round[alive].all()
        self._round = sent if again else self._round | sent
        return cut_short or bool(self._round[alive].all())
