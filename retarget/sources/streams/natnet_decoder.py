"""NatNet datagrams -> frames of named world poses: names, parents of bones, and the rest pose of a skeleton."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from retarget.arithmetic import matmul, norm
from retarget.frames import Skeleton
from retarget.rotations import plus, product, rotated
from retarget.sources.skeletons import joints_by_name
from retarget.sources.streams.natnet_wire import (
    OLDEST,
    POSE_RECORD,
    SIZED_SINCE,
    BodyDefinition,
    Definitions,
    FrameOfData,
    GroupDefinition,
    MessageId,
    Owner,
    PoseGroup,
    read_definitions,
    read_frame,
    read_server_info,
    split,
)
from retarget.sources.streams.stream_frame import (
    CONVENTIONS,
    MAX_DATAGRAM,
    MAX_POSES,
    TOO_LONG,
    Convention,
    Dropped,
    StreamFrame,
    make_unit,
)
from retarget.types import BoolArray, FloatArray

_Key = tuple[Owner, int, int]
"""A pose: kind and number of its owner, and its own number there."""
_Named = TypeVar("_Named", BodyDefinition, GroupDefinition)


def _by_number(items: Sequence[_Named], owner: Owner = Owner.RIGID_BODIES) -> dict[int, _Named]:
    """The first item of each number; a name that an earlier item has becomes ""."""
    found: dict[int, _Named] = {}
    names: set[str] = set()
    for item in items:
        found.setdefault(_within(item.number, owner), replace(item, name="" if item.name in names else item.name))
        names.add(item.name)
    return found


def _within(number: int, owner: Owner) -> int:
    """Number of a body within its owner: the wire has owner << 16 | bone, the definitions only the bone."""
    return number if owner is Owner.RIGID_BODIES else number & 0xFFFF


@dataclass(frozen=True, slots=True, eq=False)
class PosePlan:
    """Plan of the k poses that are kept, made when the ids change. rows (k,): of the frame. doubled, surplus: counts of
    rows left out. bones: (row, parent row) among the rows kept, parents first. lost: rows of bones with unknown
    parents."""

    names: tuple[str, ...]
    rows: NDArray[np.intp]
    doubled: int
    surplus: int
    all_defined: bool
    bones: tuple[tuple[int, int], ...]
    lost: tuple[int, ...]


def plan_poses(definitions: Definitions, groups: Sequence[PoseGroup], numbers: Sequence[int]) -> PosePlan:
    """The plan for these groups and their wire numbers, each name once, at most MAX_POSES of them.

    Names are `rigid://NAME`, `bone://SKELETON/BONE` or `asset://ASSET/BODY`, with `#NUMBER` for a name that is unknown
    or taken."""
    known = {
        Owner.RIGID_BODIES: (GroupDefinition("", 0, definitions.rigid_bodies),),
        Owner.SKELETON: definitions.skeletons,
        Owner.ASSET: definitions.assets,
    }
    owners = {
        (owner, number): (group.name, _by_number(group.bones, owner))
        for owner, defined in known.items()
        for number, group in _by_number(defined).items()
    }
    owned = [group for group in groups for _ in range(group.count)]
    first: dict[str, int] = {}
    found: list[tuple[str, _Key, bool, _Key | None]] = []  # name, key, True if defined, key of the parent
    for row, (group, wire) in enumerate(zip(owned, numbers, strict=True)):
        name, bodies = owners.get((group.owner, group.number), ("", {}))
        number = _within(wire, group.owner)
        body = bodies.get(number)
        within = "" if group.owner is Owner.RIGID_BODIES else f"{name or f'#{group.number}'}/"
        text = f"{group.owner.value}://{within}{(body.name if body else '') or f'#{number}'}"
        # Only skeletons have parents. A bone that is not defined gets a parent that does not exist.
        parent = -1 if body is None else _within(body.parent, group.owner)
        has_parent = group.owner is Owner.SKELETON and (body is None or (parent in bodies and parent != number))
        key = (group.owner, group.number, number)
        found.append((text, key, body is not None, (*key[:2], parent) if has_parent else None))
        first.setdefault(text, row)
    rows = list(first.values())[:MAX_POSES]
    kept = [found[row] for row in rows]
    places = {key: row for row, (_, key, _, _) in enumerate(kept)}
    waiting = {row: places.get(parent) for row, (_, _, _, parent) in enumerate(kept) if parent is not None}
    bones: list[tuple[int, int]] = []
    while ready := [(row, parent) for row, parent in waiting.items() if parent is not None and parent not in waiting]:
        bones += ready
        for row, _ in ready:
            del waiting[row]
    return PosePlan(
        names=tuple(text for text, *_ in kept),
        rows=np.array(rows, np.intp),
        doubled=len(found) - len(first),
        surplus=len(first) - len(kept),
        all_defined=all(is_defined for _, _, is_defined, _ in kept),
        bones=tuple(bones),
        lost=tuple(waiting),
    )


def compose_bones(plan: PosePlan, position: FloatArray, orientation: FloatArray, tracked: BoolArray) -> None:
    """Turn parent-relative poses of bones into world poses, in place: T_world_bone = T_world_parent T_parent_bone. A
    bone is tracked only if its parents are; with unknown parents it becomes NaN."""
    points = [(p[0], p[1], p[2]) for p in position.tolist()]
    turns = [(q[0], q[1], q[2], q[3]) for q in orientation.tolist()]
    for row, parent in plan.bones:
        points[row] = plus(points[parent], rotated(turns[parent], points[row]))
        turns[row] = product(turns[parent], turns[row])
        tracked[row] &= tracked[parent]
    position[:] = points
    orientation[:] = turns
    for row in plan.lost:
        position[row] = np.nan
        orientation[row] = np.nan
        tracked[row] = False


def rest_skeleton(group: GroupDefinition, axes: Convention) -> Skeleton | None:
    """The canonical joints of a skeleton in its T-pose, facing x; None if it is no human's.

    No bone is turned in that pose, so offsets add up. The stream does not state its heading: y is the direction from
    the right hip to the left one.
    """
    waiting = {bone.number & 0xFFFF: bone for bone in group.bones}
    numbers, prefix = list(waiting), f"{group.name}_"
    joints = joints_by_name(tuple(bone.name.removeprefix(prefix) for bone in waiting.values()))
    places: dict[int, FloatArray] = {}  # from the root, m, in the server's axes; bones in a cycle have none
    while ready := [
        number
        for number, bone in waiting.items()
        if (parent := bone.parent & 0xFFFF) not in waiting or parent == number
    ]:
        for number in ready:
            bone = waiting.pop(number)
            places[number] = places.get(bone.parent & 0xFFFF, np.zeros(3)) + bone.offset
    if joints is None:
        return None
    joints = {"pelvis": 0, **joints}  # the first bone
    known = {joint: places[numbers[at]] for joint, at in joints.items() if numbers[at] in places}
    if not {"pelvis", "l_hip", "r_hip"} <= set(known):
        return None
    position = axes.positions(np.array(list(known.values())))
    names = tuple(known)
    position -= position[names.index("pelvis")]
    left = position[names.index("l_hip")] - position[names.index("r_hip")]
    x, y = left[:2] / max(norm(left[:2]), 1e-9)
    # Turn about the vertical until the hips lie in y and z.
    return Skeleton(names, matmul(position, np.array([[y, x, 0.0], [-x, y, 0.0], [0.0, 0.0, 1.0]])))


DATAGRAM_CUT_SHORT = "shorter than its header says"
STRANGE = "not a message of a NatNet server"
BAD_FRAME = "frame that fits no known version"
BAD_DEFINITIONS = "model definitions that fit no known version"
BAD_SERVER = "ServerInfo too short"
DOUBLED = "pose of a name that the frame had already"
SURPLUS_POSE = "pose beyond the most that are taken"
NO_POSE = "pose that is not finite, not in a room, or not a rotation"
NO_PARENT = "bone whose parents are not known"

_WITHOUT_POSES = {
    MessageId.COMMAND_ANSWER,
    MessageId.ECHO_ANSWER,
    MessageId.TEXT,
    MessageId.DISCONNECT,
    MessageId.KEEP_ALIVE,
    MessageId.UNRECOGNISED,
}
"""Messages of a server without poses."""
_AXES = {"y": CONVENTIONS["motive_y_up"], "z": CONVENTIONS["motive_z_up"]}
"""Conventions by Motive's Up Axis, which the stream does not state."""
_QUATERNION_COLUMNS = np.array([6, 3, 4, 5])
"""Columns w, x, y, z in the wire's x, y, z, qx, qy, qz, qw."""

_PlanKey = tuple[tuple[PoseGroup, ...], bytes]
"""Key of a plan: the groups, and the ids of their poses."""


class NatnetDecoder:
    """A `StreamDecoder` of one Motive server. Before ServerInfo and definitions arrive, names are numbers.

    bones: Motive's setting Skeleton Coordinates, `global`, or `local` to the parent. up: its Up Axis. The stamp is the
    mid-exposure in s of the server's clock, or the timestamp of another clock if the frame has no ticks (playback).
    """

    def __init__(self, *, bones: Literal["global", "local"] = "global", up: Literal["y", "z"] = "y") -> None:
        self.dropped = Dropped()
        self._local = bones == "local"
        self._axes = _AXES[up]
        self._definitions = Definitions()
        self._version = OLDEST
        self._clock_hz = 0
        self._plan: tuple[_PlanKey, PosePlan] | None = None

    @property
    def names_missing(self) -> bool:
        """True if the last frame had ids without a definition, so definitions should be requested."""
        return self._plan is not None and not self._plan[1].all_defined

    def rest_of(self, names: Sequence[str]) -> Skeleton | None:
        """The T-pose of the one skeleton with bones of these names; None if there is none, or it is no human's."""
        owners = {name.removeprefix("bone://").partition("/")[0] for name in names if name.startswith("bone://")}
        group = next((group for group in self._definitions.skeletons if owners == {group.name}), None)
        return None if group is None else rest_skeleton(group, self._axes)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of a datagram. ServerInfo and definitions are kept and give no frame."""
        if len(datagram) > MAX_DATAGRAM:
            return self._drop(TOO_LONG)
        parts = split(datagram)
        if parts is None:
            return self._drop(DATAGRAM_CUT_SHORT)
        kind, payload = parts
        if kind == MessageId.FRAME:
            frame = self._read(payload)
            return self._drop(BAD_FRAME) if frame is None else [self._frame(frame)]
        if kind == MessageId.SERVER_INFO:
            info = read_server_info(payload)
            if info is None:
                return self._drop(BAD_SERVER)
            self._version, self._clock_hz = max(info.version, OLDEST), info.clock_hz
        elif kind == MessageId.DEFINITIONS:
            definitions = read_definitions(payload, self._version)
            if definitions is None:
                return self._drop(BAD_DEFINITIONS)
            self._definitions, self._plan = definitions, None
        elif kind not in _WITHOUT_POSES:
            return self._drop(STRANGE)
        return []

    def _drop(self, reason: str) -> list[StreamFrame]:
        self.dropped.note(reason)
        return []

    def _read(self, payload: bytes) -> FrameOfData | None:
        """The frame in the layout that uses up every byte: a pinned bitstream is older than the server's version."""
        frame = read_frame(payload, self._version)
        if frame is not None and frame.surplus == 0:
            return frame
        sized = self._version >= SIZED_SINCE
        other = read_frame(payload, OLDEST if sized else SIZED_SINCE)
        if other is not None and other.surplus == 0:
            self._version = OLDEST if sized else SIZED_SINCE
            return other
        # With sized blocks, a later version may have a longer suffix.
        return frame if sized else None

    def _frame(self, frame: FrameOfData) -> StreamFrame:
        records = np.frombuffer(frame.poses, POSE_RECORD)
        key = (frame.groups, records["id"].tobytes())
        if self._plan is None or self._plan[0] != key:
            self._plan = (key, plan_poses(self._definitions, frame.groups, records["id"].tolist()))
        plan = self._plan[1]
        self.dropped.note(DOUBLED, plan.doubled)
        self.dropped.note(SURPLUS_POSE, plan.surplus)
        records = records[plan.rows]
        tracked = (records["flags"] & 1).astype(np.bool_)
        with np.errstate(invalid="ignore"):  # signalling NaNs from the wire
            poses = records["pose"].astype(np.float64)
            position = self._axes.positions(poses[:, :3].copy())
            orientation = self._axes.orientations(poses.take(_QUATERNION_COLUMNS, axis=1))
        bad = make_unit(position, orientation)
        # An untracked body may have no pose yet (all zeros), which is no damage.
        self.dropped.note(NO_POSE, int(np.count_nonzero(bad & tracked)))
        tracked &= ~bad
        if self._local and (plan.bones or plan.lost):
            compose_bones(plan, position, orientation, tracked)
            self.dropped.note(NO_PARENT, len(plan.lost))
        stamp = frame.timestamp if isfinite(frame.timestamp) else None
        if self._clock_hz and frame.mid_exposure:
            stamp = frame.mid_exposure / self._clock_hz
        return StreamFrame(plan.names, position, orientation, tracked, stamp, frame.number)
