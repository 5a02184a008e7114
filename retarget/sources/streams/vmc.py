"""VMC protocol 3.1 (github.com/sh-akira/VirtualMotionCaptureProtocol), the receiving side: poses over OSC and UDP.

`VmcDecoder` gives the poses as they are sent. Names of a frame: the serial of a device (`human://HEAD`), whether it is
sent as a headset, controller or tracker; `bone://LeftUpperArm` in Unity's spelling; `root://root`. Devices are world
poses. Bones are relative to their parent, with the T-pose as identity. `VmcBodyDecoder` gives the bones as world poses,
by forward kinematics.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from math import isfinite, isnan, nan, pi

import numpy as np

from retarget.arithmetic import matmul, norms
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions, proportional_dimensions
from retarget.rotations import NO_TURN, Quat, Vector, axis_turn, plus, product, rotated
from retarget.sources.skeletons import TABLES
from retarget.sources.streams.osc import Number, OscLayouts, OscMessage, OscNumbers, OscPacket, number_in
from retarget.sources.streams.stream_frame import CONVENTIONS, MAX_POSES, Dropped, StreamFrame, unusable
from retarget.types import BoolArray, FloatArray

# Names of the poses of VMC: the bones of Unity's humanoid, and the serials of devices that are accepted.

MAX_SERIAL = 128
"""Characters of the longest serial that is accepted."""

_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")

BODY_BONES: tuple[str, ...] = tuple(TABLES["unity"])
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
"""`bone://LeftUpperArm` by the name of this bone in lower case."""
_RESERVED = ("bone://", "root://")


def device_name(serial: str) -> str | None:
    """The serial itself; None if it is empty, too long, not printable, or could be taken for a bone or the root."""
    if not 0 < len(serial) <= MAX_SERIAL or not serial.isprintable() or serial.lower().startswith(_RESERVED):
        return None
    return serial


# Forward kinematics over the bones of Unity's humanoid: from parent-relative poses to world poses.
#
# For senders that send bones only (VirtualMotionCapture, VSeeFace), and to check senders of both bones and devices.
# The reference is the T-pose, where every rotation is the identity.

OPTIONAL = frozenset(TABLES["unity_optional"])
"""Bones that an avatar may be without: they are then not turned."""

_ROOT_NAME = "root://root"
_PARENT = {
    f"bone://{bone}": f"bone://{parent}" if parent else _ROOT_NAME for bone, (parent, _) in TABLES["unity"].items()
}
_NAMES = tuple(_PARENT)

BonePose = tuple[Vector, Quat]
"""Position m, NaN where not sent, and orientation wxyz, in the parent or in the world."""
_ORIGIN: Vector = (0.0, 0.0, 0.0)
_AT_ORIGIN: BonePose = (_ORIGIN, NO_TURN)
_UNKNOWN: BonePose = ((nan,) * 3, (nan,) * 4)
"""Position m and orientation wxyz of a bone at the origin, and of one that was not sent."""


def bone_poses(frame: StreamFrame) -> dict[str, BonePose]:
    """The tracked bones of a frame, and the root, by their names in it."""
    poses: dict[str, BonePose] = {}
    sent = zip(frame.names, frame.tracked.tolist(), frame.position.tolist(), frame.orientation.tolist(), strict=True)
    for name, tracked, (x, y, z), (qw, qx, qy, qz) in sent:
        if tracked and (name in _PARENT or name == _ROOT_NAME):
            poses[name] = (x, y, z), (qw, qx, qy, qz)
    return poses


def world_poses(local: Mapping[str, BonePose], lengths: Mapping[str, Vector]) -> dict[str, BonePose]:
    """The world pose of each bone, by name: of the joint where it begins, and of its segment.

    local: by name, relative to the parent, in the world's axes. lengths: see `t_pose_offsets`, used where the sender
    sends no position. A required bone that is not sent is NaN, and so are its descendants.
    """
    world = {_ROOT_NAME: local.get(_ROOT_NAME, _AT_ORIGIN)}
    for name, bone in zip(_NAMES, BODY_BONES, strict=True):
        place, turn = local.get(name) or (_UNKNOWN[0], NO_TURN if bone in OPTIONAL else _UNKNOWN[1])
        at, turned = world[_PARENT[name]]
        step = lengths[name] if isnan(place[0]) else place
        world[name] = plus(at, rotated(turned, step)), product(turned, turn)
    del world[_ROOT_NAME]
    return world


def t_pose_offsets(person: HumanDimensions) -> dict[str, Vector]:
    """Offset m of each bone from its parent for a person's size, in the T-pose, by name; the hips lie in the root."""
    offsets = dict.fromkeys(_NAMES, _ORIGIN)
    for bone, (_, point) in TABLES["unity"].items():
        if point:
            x, y, z = person.offset[POINTS.index(point)].tolist()
            # The person's arms hang; in the T-pose they point sideward.
            out = 0.5 * pi if bone.startswith("Left") else -0.5 * pi
            arm = bone.endswith(("LowerArm", "Hand"))
            offsets[f"bone://{bone}"] = rotated(axis_turn((1.0, 0.0, 0.0), out), (x, y, z)) if arm else (x, y, z)
    return offsets


# Poses of Unity into the world's axes: `stream_frame.CONVENTIONS` has the axes, here is the order of the numbers.

_UNITY = CONVENTIONS["unity"]
_WXYZ = [3, 0, 1, 2]
_POSE = np.zeros((7, 7))
_POSE[:3, :3] = _UNITY.positions(np.eye(3))
_POSE[3:, 3:] = _UNITY.orientations(np.eye(4)[:, _WXYZ])
"""A row x, y, z, qx, qy, qz, qw of Unity times this matrix is our position and quaternion wxyz; every entry is 0, 1 or
-1, so nothing is rounded. A pose with one number that is not finite is NaN throughout."""


UNKNOWN_ADDRESS = "OSC address that is not used"
WRONG_ARGUMENTS = "VMC message with too few arguments or of the wrong types"
UNKNOWN_BONE = "bone that Unity's humanoid does not have"
BAD_SERIAL = "serial that is empty, too long, not printable, or reserved"
SENT_TWICE = "pose sent twice in one datagram"
TOO_MANY_POSES = "more than 256 poses in one datagram"
BAD_STAMP = "time that is not finite"
BAD_POSE = "pose that is not finite, far away, or without a unit quaternion"

_BONE = "/VMC/Ext/Bone/Pos"
_POSES: Mapping[str, Callable[[str], str | None]] = {
    "/VMC/Ext/Root/Pos": lambda _: _ROOT_NAME,
    _BONE: lambda name: _BY_LOWER_CASE.get(name.lower()),
    **{f"/VMC/Ext/{device}/Pos": device_name for device in ("Hmd", "Con", "Tra")},
}
"""Address of a message with a pose -> the name of the pose, by the text that it is sent with."""
_UNUSED = ("/VMC/Ext/", "/VMC/Thru/")
"""Addresses without a world pose (raw poses, expressions, camera, keys): not used, and not counted as dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """Where one layout of a datagram has its poses.

    numbers: 7 for each of the k poses. bones (k,): whether a pose is a bone. all_tracked, none_tracked (k,): all True
    and all False. stamp, loaded, tracking: the time and these states; None where the datagram does not have them.
    """

    names: tuple[str, ...]
    numbers: OscNumbers
    bones: BoolArray
    all_tracked: BoolArray
    none_tracked: BoolArray
    stamp: Number | None
    loaded: Number | None
    tracking: Number | None
    reasons: Counter[str]


class VmcDecoder:
    """A `StreamDecoder` of one sender's datagrams.

    The decoder keeps only the sender's state of `/VMC/Ext/OK` between datagrams: `loaded` (the sender has a model) and
    `tracking`; None until sent. While the sender reports that no model is loaded, or that tracking is bad, no pose is
    `tracked`. A frame's stamp is that of its own datagram only.

    A bone position of exactly zero becomes NaN: SlimeVR without an avatar file, iFacialMocap and others send zeros for
    unknown positions, and no bone of a body lies in its parent's joint. A pose that is not finite, out of any room or
    without a unit quaternion keeps its name, becomes NaN and is not tracked.
    """

    def __init__(self) -> None:
        self.dropped = Dropped()
        self.loaded: bool | None = None
        self.tracking: bool | None = None
        self._layouts = OscLayouts(_plan)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it has no pose."""
        plan = self._layouts.of(datagram)
        if plan.reasons:
            self.dropped.reasons.update(plan.reasons)
        if plan.loaded is not None:
            self.loaded = number_in(datagram, plan.loaded) != 0.0
        if plan.tracking is not None:
            self.tracking = number_in(datagram, plan.tracking) != 0.0
        stamp = None if plan.stamp is None else self._stamp(datagram, plan.stamp)
        if not plan.names:
            return []
        tracking = self.loaded is not False and self.tracking is not False
        position, orientation, tracked = self._poses(datagram, plan, tracking)
        return [StreamFrame(plan.names, position, orientation, tracked, stamp)]

    def _poses(self, datagram: bytes, plan: _Plan, tracking: bool) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Position (k, 3), orientation (k, 4) and tracked (k,) by the plan."""
        poses = plan.numbers.read(datagram).reshape(-1, 7)
        bad = unusable(poses[:, :3], poses[:, 3:])
        tracked = plan.all_tracked if tracking else plan.none_tracked
        if bad.any():
            self.dropped.reasons[BAD_POSE] += int(np.count_nonzero(bad))
            poses[bad] = np.nan
            tracked = tracked & ~bad
        turned = matmul(poses, _POSE)
        position, orientation = turned[:, :3], turned[:, 3:]
        position[plan.bones & ~position.any(axis=1)] = np.nan
        return position, orientation / norms(orientation)[:, None], tracked

    def _stamp(self, datagram: bytes, number: Number) -> float | None:
        """Seconds of the sender's clock; None if they are not finite, which is counted."""
        stamp = number_in(datagram, number)
        if not isfinite(stamp):
            self.dropped.note(BAD_STAMP)
            return None
        return stamp


def _plan(packet: OscPacket) -> _Plan:
    """Where the poses are, and what is dropped. The plan holds for every datagram of this layout."""
    reasons = Counter(packet.dropped)
    places: dict[str, tuple[Number, ...]] = {}
    stamp: Number | None = None
    loaded: Number | None = None
    tracking: Number | None = None
    for message in packet.messages:
        if message.address == "/VMC/Ext/T" and (sent := message.numbers(0, 1)):
            stamp = sent[0]
        elif message.address == "/VMC/Ext/OK" and (sent := message.numbers(0, 1)):
            # Its second and third numbers, from 2.5 on, are of the calibration; the fourth came with 2.7.
            loaded, tracking = sent[0], next(iter(message.numbers(3, 1)), None)
        else:
            reason = _place(message, places)
            if reason:
                reasons[reason] += 1
    count = len(places)
    all_tracked, none_tracked = np.ones(count, bool), np.zeros(count, bool)
    all_tracked.flags.writeable = none_tracked.flags.writeable = False
    bones = np.array([name.startswith("bone://") for name in places], bool)
    numbers = OscNumbers(number for pose in places.values() for number in pose)
    return _Plan(tuple(places), numbers, bones, all_tracked, none_tracked, stamp, loaded, tracking, reasons)


def _place(message: OscMessage, places: dict[str, tuple[Number, ...]]) -> str:
    """Keep the numbers of a pose by its name (the last pose of a name counts); return why it is not used, or ""."""
    named = _POSES.get(message.address)
    if named is None:
        known = message.address.startswith(_UNUSED) and message.address not in ("/VMC/Ext/T", "/VMC/Ext/OK")
        return "" if known else WRONG_ARGUMENTS if message.address.startswith("/VMC/Ext/") else UNKNOWN_ADDRESS
    numbers = message.numbers(1, 7)
    if not (numbers and message.tags.startswith("s")):
        return WRONG_ARGUMENTS
    name = named(message.text)
    if name is None:
        return UNKNOWN_BONE if message.address == _BONE else BAD_SERIAL
    again = name in places
    if not again and len(places) >= MAX_POSES:
        return TOO_MANY_POSES
    places[name] = numbers
    return SENT_TWICE if again else ""


# VMC senders that send bones only: the avatar's bones as world poses.

STATURE_M = 1.70
"""Stature of a person of unknown size, m: calibration measures the limbs."""
ROUNDS = 3
"""A bone is lost that was not sent while another one was sent so often: 0.1 s of a sender of 30 Hz, 0.05 s of one of 60
Hz, 0.3 s of one of 10 Hz. Less would lose a bone for one lost datagram; in seconds, 0.1 s is one round of the last."""
_NOT_SENT = {
    f"bone://{bone}": f"{bone}, a bone that an avatar needs, is not sent" for bone in BODY_BONES if bone not in OPTIONAL
}
_FEET = ("bone://LeftFoot", "bone://RightFoot")
_HIPS = "bone://Hips"


class VmcBodyDecoder:
    """A `StreamDecoder`: the known bones of a humanoid, each `bone://NAME`, position of the joint where it begins.
    Without a bone that is needed, it and those that hang from it are not known.

    A sender may put an avatar into one datagram, or a bone into each: a body is given once each bone that it sends has
    come, or when the next round begins without one. Bone lengths that are not sent are those of a person of
    STATURE_M. Where the position of the hips is not sent, the lower foot stands on the ground.
    """

    def __init__(self) -> None:
        self._decoder = VmcDecoder()
        self.dropped: Dropped = self._decoder.dropped
        self._offsets = t_pose_offsets(proportional_dimensions(STATURE_M))
        self._ankle = FRACTIONS.ankle_height * STATURE_M
        self._poses: dict[str, BonePose] = {}  # of the bones that are not lost
        self._sent = Counter[str]()  # how often each bone was sent
        self._last: dict[str, int] = {}  # how often the one that was sent most had been, when a bone was sent last
        self._round: set[str] = set()  # bones of the present round

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The body of one datagram; none if it has no bone, or if more of them are to come."""
        return [body for frame in self._decoder.decode(datagram) if (body := self._body(frame)) is not None]

    def _body(self, frame: StreamFrame) -> StreamFrame | None:
        poses = bone_poses(frame)
        self._poses |= poses
        if not poses or not self._is_whole(poses.keys()) or self._poses.keys() <= {_ROOT_NAME}:
            return None
        if max(self._sent.values()) >= ROUNDS:
            self.dropped.reasons.update(reason for bone, reason in _NOT_SENT.items() if bone not in self._poses)
        world = world_poses(self._poses, self._offsets)
        positions, rotations = map(np.array, zip(*world.values(), strict=True))
        if isnan(self._poses.get(_HIPS, _UNKNOWN)[0][0]):
            lowest = min((height for foot in _FEET if isfinite(height := world[foot][0][2])), default=self._ankle)
            positions[:, 2] += self._ankle - lowest
        known: BoolArray = np.isfinite(rotations).all(axis=1) & np.isfinite(positions).all(axis=1)
        names = tuple(name for name, is_known in zip(_NAMES, known.tolist(), strict=True) if is_known)
        return StreamFrame(names, positions[known], rotations[known], known[known], frame.stamp, frame.number)

    def _is_whole(self, sent: Set[str]) -> bool:
        """Whether a body is to be given after the bones that were just sent: all that are sent at all have come in this
        round, or the round before has ended without one. Forgets the bones that are lost."""
        self._sent.update(sent)
        most = max(self._sent.values())
        self._last |= dict.fromkeys(sent, most)
        for lost in [bone for bone, last in self._last.items() if most - last >= ROUNDS]:
            del self._last[lost], self._poses[lost]
        alive, again = self._last.keys(), not self._round.isdisjoint(sent)
        cut_short = again and not self._round >= alive
        self._round = set(sent) if again else self._round | sent
        return cut_short or self._round >= alive
