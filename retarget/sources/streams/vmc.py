"""VMC protocol 3.1 (github.com/sh-akira/VirtualMotionCaptureProtocol), receiving side: poses over OSC and UDP.

Names of poses: the serial of a device (`human://HEAD`), `bone://LeftUpperArm` in Unity's spelling, `root://root`.
Devices are world poses. Bones are relative to their parent, with the T-pose as identity.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from math import isfinite, isnan, nan, pi

import numpy as np

from retarget.arithmetic import matmul, norms
from retarget.model.human_dimensions import FRACTIONS, POINTS, HumanDimensions, proportional_dimensions
from retarget.rotations import NO_TURN, Quat, Vector, axis_turn, plus, product, rotated
from retarget.sources.canonical import TYPICAL_HEIGHT_M
from retarget.sources.skeletons import TABLES
from retarget.sources.streams.osc import (
    UNKNOWN_ADDRESS,
    Number,
    OscLayouts,
    OscMessage,
    OscNumbers,
    OscPacket,
    number_in,
)
from retarget.sources.streams.stream_frame import CONVENTIONS, MAX_POSES, SENT_TWICE, Dropped, StreamFrame, unusable
from retarget.types import BoolArray

MAX_SERIAL = 128
"""Characters of the longest accepted serial."""

BODY_BONES: tuple[str, ...] = tuple(TABLES["unity"])
"""Bones of trunk, head and limbs, parents first."""

_BY_LOWER_CASE = {name.lower(): f"bone://{name}" for name in (*BODY_BONES, *TABLES["unity_face_and_fingers"])}
"""Bone in lower case -> its name as a pose."""
_RESERVED = ("bone://", "root://")


def device_name(serial: str) -> str | None:
    """The serial itself; None if it is empty, too long, not printable, or looks like a bone or the root."""
    if not 0 < len(serial) <= MAX_SERIAL or not serial.isprintable() or serial.lower().startswith(_RESERVED):
        return None
    return serial


OPTIONAL = frozenset(TABLES["unity_optional"])
"""Bones that an avatar may lack; they are then not turned."""

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
"""Poses of a bone at the origin, and of one that was not sent."""


def bone_poses(frame: StreamFrame) -> dict[str, BonePose]:
    """The tracked bones of a frame, and the root, by name."""
    poses: dict[str, BonePose] = {}
    sent = zip(frame.names, frame.tracked.tolist(), frame.position.tolist(), frame.orientation.tolist(), strict=True)
    for name, tracked, (x, y, z), (qw, qx, qy, qz) in sent:
        if tracked and (name in _PARENT or name == _ROOT_NAME):
            poses[name] = (x, y, z), (qw, qx, qy, qz)
    return poses


def world_poses(local: Mapping[str, BonePose], lengths: Mapping[str, Vector]) -> dict[str, BonePose]:
    """World poses of the bones by name: of the joint where each begins, and of its segment.

    local: relative to the parent, in world axes. lengths: offsets as of `t_pose_offsets`, used if no position was sent.
    A required bone that was not sent is NaN, and so are its descendants.
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
    """Offset m of each bone from its parent in the T-pose, for a person's size, by name; the hips lie in the root."""
    offsets = dict.fromkeys(_NAMES, _ORIGIN)
    for bone, (_, point) in TABLES["unity"].items():
        if point:
            x, y, z = person.offset[POINTS.index(point)].tolist()
            # The arms of `person` hang; in the T-pose they point sideward.
            out = 0.5 * pi if bone.startswith("Left") else -0.5 * pi
            arm = bone.endswith(("LowerArm", "Hand"))
            offsets[f"bone://{bone}"] = rotated(axis_turn((1.0, 0.0, 0.0), out), (x, y, z)) if arm else (x, y, z)
    return offsets


_UNITY = CONVENTIONS["unity"]
_POSE = np.zeros((7, 7))
_POSE[:3, :3] = _UNITY.positions(np.eye(3))
_POSE[3:, 3:] = _UNITY.orientations(np.eye(4)[:, [3, 0, 1, 2]])  # xyzw -> wxyz
"""Matrix from a row x, y, z, qx, qy, qz, qw of Unity to position and quaternion wxyz. Entries are 0 or +-1: nothing is
rounded, and one number that is not finite makes the pose NaN."""


WRONG_ARGUMENTS = "VMC message with too few arguments or of the wrong types"
UNKNOWN_BONE = "bone that Unity's humanoid does not have"
BAD_SERIAL = "serial that is empty, too long, not printable, or reserved"
TOO_MANY_POSES = "more than 256 poses in one datagram"
BAD_STAMP = "time that is not finite"
BAD_POSE = "pose that is not finite, far away, or without a unit quaternion"

_BONE = "/VMC/Ext/Bone/Pos"
_POSES: Mapping[str, Callable[[str], str | None]] = {
    "/VMC/Ext/Root/Pos": lambda _: _ROOT_NAME,
    _BONE: lambda name: _BY_LOWER_CASE.get(name.lower()),
    **{f"/VMC/Ext/{device}/Pos": device_name for device in ("Hmd", "Con", "Tra")},
}
"""Address of a pose message -> the function from its text to the name of the pose."""
_UNUSED = ("/VMC/Ext/", "/VMC/Thru/")
"""Addresses of other content, ignored and not counted."""


@dataclass(frozen=True, slots=True, eq=False)
class _VmcPlan:
    """Places of the poses in one layout: 7 numbers for each. stamp, loaded, tracking: None if not in the datagram."""

    names: tuple[str, ...]
    numbers: OscNumbers
    bones: BoolArray
    stamp: Number | None
    loaded: Number | None
    tracking: Number | None
    reasons: Counter[str]


class VmcDecoder:
    """A `StreamDecoder` of one sender's datagrams.

    It keeps the state of `/VMC/Ext/OK`: `loaded` (the sender has a model) and `tracking`, None until sent. While one is
    False, no pose is `tracked`. A bone position of exactly zero becomes NaN: SlimeVR without an avatar file,
    iFacialMocap and others send zeros for unknown positions. An unusable pose becomes NaN and is not tracked.
    """

    def __init__(self) -> None:
        self.dropped = Dropped()
        self.loaded: bool | None = None
        self.tracking: bool | None = None
        self._layouts = OscLayouts(_plan)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it has no pose."""
        plan = self._layouts.of(datagram)
        self.dropped.reasons.update(plan.reasons)
        if plan.loaded is not None:
            self.loaded = number_in(datagram, plan.loaded) != 0.0
        if plan.tracking is not None:
            self.tracking = number_in(datagram, plan.tracking) != 0.0
        stamp = None if plan.stamp is None else number_in(datagram, plan.stamp)
        if stamp is not None and not isfinite(stamp):
            self.dropped.note(BAD_STAMP)
            stamp = None
        if not plan.names:
            return []
        poses = plan.numbers.read(datagram).reshape(-1, 7)
        bad = unusable(poses[:, :3], poses[:, 3:])
        tracked = np.full(len(plan.names), self.loaded is not False and self.tracking is not False)
        if bad.any():
            self.dropped.note(BAD_POSE, int(np.count_nonzero(bad)))
            poses[bad] = np.nan
            tracked &= ~bad
        turned = matmul(poses, _POSE)
        position, orientation = turned[:, :3], turned[:, 3:]
        position[plan.bones & ~position.any(axis=1)] = np.nan
        return [StreamFrame(plan.names, position, orientation / norms(orientation)[:, None], tracked, stamp)]


def _plan(packet: OscPacket) -> _VmcPlan:
    """Places of the poses, and reasons for dropped messages, for all datagrams of this layout."""
    reasons = Counter(packet.dropped)
    places: dict[str, tuple[Number, ...]] = {}
    stamp: Number | None = None
    loaded: Number | None = None
    tracking: Number | None = None
    for message in packet.messages:
        if message.address == "/VMC/Ext/T" and (sent := message.numbers(0, 1)):
            stamp = sent[0]
        elif message.address == "/VMC/Ext/OK" and (sent := message.numbers(0, 1)):
            # The second and third numbers (since 2.5) are of the calibration, the fourth (2.7) is the tracking.
            loaded, tracking = sent[0], next(iter(message.numbers(3, 1)), None)
        else:
            reason = _place(message, places)
            if reason:
                reasons[reason] += 1
    bones = np.array([name.startswith("bone://") for name in places], bool)
    numbers = OscNumbers(number for pose in places.values() for number in pose)
    return _VmcPlan(tuple(places), numbers, bones, stamp, loaded, tracking, reasons)


def _place(message: OscMessage, places: dict[str, tuple[Number, ...]]) -> str:
    """Keep the numbers of a pose by its name (the last one counts); return the reason if it is not used."""
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


ROUNDS = 3
"""A bone is lost if it was not sent while another one was sent so often: 0.1 s at 30 Hz. Less would lose it with one
datagram."""
_NOT_SENT = {
    f"bone://{bone}": f"{bone}, a bone that an avatar needs, is not sent" for bone in BODY_BONES if bone not in OPTIONAL
}
_FEET = ("bone://LeftFoot", "bone://RightFoot")
_HIPS = "bone://Hips"


class VmcBodyDecoder:
    """A `StreamDecoder` of senders of bones only (VirtualMotionCapture, VSeeFace): known bones `bone://NAME` as world
    poses, each at the joint where it begins.

    A sender may put an avatar into one datagram, or a bone into each. A body is complete once each bone that is sent
    has come, or when the next round begins. Unsent lengths are those of a person of TYPICAL_HEIGHT_M; without a
    position of the hips, the lower foot stands on the ground.
    """

    def __init__(self) -> None:
        self._decoder = VmcDecoder()
        self.dropped: Dropped = self._decoder.dropped
        self._offsets = t_pose_offsets(proportional_dimensions(TYPICAL_HEIGHT_M))
        self._ankle = FRACTIONS.ankle_height * TYPICAL_HEIGHT_M
        self._poses: dict[str, BonePose] = {}  # without lost bones
        self._sent = Counter[str]()  # count by bone
        self._last: dict[str, int] = {}  # largest count of any bone when this one was last sent
        self._round: set[str] = set()  # bones sent in the present round

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The body of one datagram; none if it has no bone, or if more bones are to come."""
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
        """True if the bones just sent complete a round, or begin the next one early. Forgets lost bones."""
        self._sent.update(sent)
        most = max(self._sent.values())
        self._last |= dict.fromkeys(sent, most)
        for lost in [bone for bone, last in self._last.items() if most - last >= ROUNDS]:
            del self._last[lost], self._poses[lost]
        alive, again = self._last.keys(), not self._round.isdisjoint(sent)
        cut_short = again and not self._round >= alive
        self._round = set(sent) if again else self._round | sent
        return cut_short or self._round >= alive
