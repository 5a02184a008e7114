"""NatNet datagrams in, frames of named poses out."""

from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from retarget.errors import UsageError
from retarget.frames import BoolArray, Skeleton
from retarget.rotations import FloatArray
from retarget.sources.natnet_frame import BODY, SIZED_SINCE, FrameOfData, PoseGroup, read_frame
from retarget.sources.natnet_models import Definitions, read_definitions
from retarget.sources.natnet_names import NameTable
from retarget.sources.natnet_plan import PosePlan, compose_bones, plan_poses
from retarget.sources.natnet_skeleton import rest_skeleton
from retarget.sources.natnet_wire import MessageId, Version, read_server_info, split
from retarget.sources.pose_bounds import unusable
from retarget.sources.stream_axes import CONVENTIONS
from retarget.sources.stream_frame import MAX_DATAGRAM, MAX_POSES, Dropped, StreamFrame

__all__ = ["NatnetDecoder"]

TOO_LONG = "datagram longer than 64 KiB"
CUT_SHORT = "shorter than its header says"
STRANGE = "not a message of a NatNet server"
BAD_FRAME = "frame that fits no known version"
BAD_DEFINITIONS = "model definitions that fit no known version"
BAD_SERVER = "ServerInfo too short"
DOUBLED = "pose of a name that the frame had already"
TOO_MANY = "pose beyond the most that are taken"
NO_POSE = "pose that is not finite, not in a room, or not a rotation"
NO_PARENT = "bone whose parents are not known"

_OLDEST = Version(3, 0)
_SILENT = {
    MessageId.COMMAND_ANSWER,
    MessageId.ECHO_ANSWER,
    MessageId.TEXT,
    MessageId.DISCONNECT,
    MessageId.KEEP_ALIVE,
    MessageId.UNRECOGNISED,
}
"""What a server may send and what tells no pose."""
_AXES = {"y": CONVENTIONS["motive_y_up"], "z": CONVENTIONS["motive_z_up"]}
"""By Motive's up axis. The stream does not tell which is on."""
_WXYZ = np.array([6, 3, 4, 5])
"""Columns of the wire's x, y, z, qx, qy, qz, qw."""

_PlanKey = tuple[tuple[PoseGroup, ...], bytes]
"""What decides a plan: the groups, and the ids of their poses."""


class NatnetDecoder:
    """Of one Motive server. Frames before the first ServerInfo and definitions are decoded too, with less to tell.

    bones: how Motive streams skeletons (Settings, Streaming, Skeleton Coordinates): `global`, or `local` to the parent.
    up: its Up Axis. Raises UsageError for other options. stamp of a frame: mid-exposure in s of the server's clock; its
    f64 timestamp, another clock, while the frequency is not known or a frame has no ticks (playback).
    """

    def __init__(self, *, bones: Literal["global", "local"] = "global", up: Literal["y", "z"] = "y") -> None:
        if bones not in ("global", "local"):
            raise UsageError("unknown kind of NatNet bones", found=bones, allowed="global or local")
        if up not in _AXES:
            raise UsageError("unknown up axis of NatNet", found=up, allowed="y or z")
        self.dropped = Dropped()
        self._local = bones == "local"
        self._axes = _AXES[up]
        self._definitions = Definitions()
        self._version = _OLDEST
        self._clock_hz = 0
        self._table = NameTable()
        self._plan: tuple[_PlanKey, PosePlan] | None = None

    @property
    def names_missing(self) -> bool:
        """The last frame had ids that no definition names: a reason to ask for definitions."""
        return self._plan is not None and not self._plan[1].all_defined

    def rest(self, skeleton: str) -> Skeleton | None:
        """The T-pose of a skeleton by its name, as its definition tells it; None where it tells none that is known."""
        group = next((group for group in self._definitions.skeletons if group.name == skeleton), None)
        return None if group is None else rest_skeleton(group, self._axes)

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame, if it is one. ServerInfo and definitions are kept and give none."""
        if len(datagram) > MAX_DATAGRAM:
            return self._drop(TOO_LONG)
        parts = split(datagram)
        if parts is None:
            return self._drop(CUT_SHORT)
        kind, payload = parts
        if kind == MessageId.FRAME:
            frame = self._read(payload)
            return self._drop(BAD_FRAME) if frame is None else [self._frame(frame)]
        if kind == MessageId.SERVER_INFO:
            return self._server(payload)
        if kind == MessageId.DEFINITIONS:
            return self._define(payload)
        return [] if kind in _SILENT else self._drop(STRANGE)

    def _drop(self, reason: str) -> list[StreamFrame]:
        self.dropped.note(reason)
        return []

    def _count(self, reason: str, times: int) -> None:
        if times:
            self.dropped.reasons[reason] += times

    def _server(self, payload: bytes) -> list[StreamFrame]:
        info = read_server_info(payload)
        if info is None:
            return self._drop(BAD_SERVER)
        self._version = max(info.version, _OLDEST)
        self._clock_hz = info.clock_hz
        return []

    def _define(self, payload: bytes) -> list[StreamFrame]:
        definitions = read_definitions(payload, self._version)
        if definitions is None:
            return self._drop(BAD_DEFINITIONS)
        self._definitions = definitions
        self._table = NameTable(definitions)
        self._plan = None
        return []

    def _read(self, payload: bytes) -> FrameOfData | None:
        """The frame in the layout that uses up every byte: a pinned bitstream is older than the server's version."""
        frame = read_frame(payload, self._version)
        if frame is not None and frame.surplus == 0:
            return frame
        sized = self._version >= SIZED_SINCE
        other = read_frame(payload, _OLDEST if sized else SIZED_SINCE)
        if other is not None and other.surplus == 0:
            self._version = _OLDEST if sized else SIZED_SINCE
            return other
        # Blocks that tell their sizes let the suffix of a later version be longer than it is today.
        return frame if sized else None

    def _frame(self, frame: FrameOfData) -> StreamFrame:
        records = np.frombuffer(frame.poses, BODY)
        plan = self._planned(frame, records["id"])
        self._count(DOUBLED, plan.doubled)
        self._count(TOO_MANY, plan.surplus)
        if plan.rows is not None:
            records = records[plan.rows]
        tracked = (records["flags"] & 1).astype(np.bool_)
        # A signalling NaN of the wire is no reason for a warning.
        with np.errstate(invalid="ignore"):
            poses = records["pose"].astype(np.float64)
            position = self._axes.positions(poses[:, :3].copy())
            orientation = self._axes.orientations(poses.take(_WXYZ, axis=1))
        self._check(position, orientation, tracked)
        if self._local and (plan.bones or plan.lost):
            compose_bones(plan, position, orientation, tracked)
            self._count(NO_PARENT, len(plan.lost))
        return StreamFrame(plan.names, position, orientation, tracked, self._stamp(frame), frame.number)

    def _planned(self, frame: FrameOfData, ids: NDArray[np.int32]) -> PosePlan:
        """The plan of these ids; worked out again only when they change."""
        key = (frame.groups, ids.tobytes())
        if self._plan is None or self._plan[0] != key:
            self._plan = (key, plan_poses(self._table, frame.groups, ids.tolist(), limit=MAX_POSES))
        return self._plan[1]

    def _check(self, position: FloatArray, orientation: FloatArray, tracked: BoolArray) -> None:
        """Unit quaternions; NaN, and not vouched for, where a pose is none."""
        bad = unusable(position, orientation)
        norm = np.sqrt(np.einsum("ij,ij->i", orientation, orientation))
        if not bad.any():
            orientation /= norm[:, None]
            return
        # An untracked body may have no pose yet (all zeros): that is no damage.
        self._count(NO_POSE, int(np.count_nonzero(bad & tracked)))
        position[bad] = np.nan
        orientation[bad] = np.nan
        tracked &= ~bad
        orientation[~bad] /= norm[~bad, None]

    def _stamp(self, frame: FrameOfData) -> float | None:
        if self._clock_hz and frame.mid_exposure:
            return frame.mid_exposure / self._clock_hz
        return frame.timestamp if isfinite(frame.timestamp) else None
