"""VMC protocol 3.1 (github.com/sh-akira/VirtualMotionCaptureProtocol), the receiving side: poses over OSC and UDP.

Names of a frame: the serial of a device, as it is told (`human://HEAD`), whether it comes as a headset, controller or
tracker; `local://SERIAL` for its raw pose (address with `/Local`); `bone://LeftUpperArm` in Unity's spelling;
`root://root`. Devices are world poses. Bones are relative to their parent, with the T-pose as identity.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retarget.frames import BoolArray
from retarget.rotations import FloatArray
from retarget.sources.osc import OscMessage, OscPacket
from retarget.sources.osc_layout import OscLayouts
from retarget.sources.pose_bounds import unusable
from retarget.sources.stream_frame import MAX_POSES, Dropped, StreamFrame
from retarget.sources.unity import poses_from_unity
from retarget.sources.vmc_names import bone_name, device_name

__all__ = ["VmcDecoder"]

UNKNOWN_ADDRESS = "OSC address that is not used"
WRONG_ARGUMENTS = "VMC message with too few arguments or of the wrong types"
UNKNOWN_BONE = "bone that Unity's humanoid does not have"
BAD_SERIAL = "serial that is empty, too long, not printable, or reserved"
TOLD_TWICE = "pose told twice in one datagram"
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
"""Addresses of the protocol that tell no pose (expressions, camera, light, keys): not used, and no fault either."""
_FLOAT = Struct(">f")
_INT = Struct(">i")


class _State(NamedTuple):
    """Where /VMC/Ext/OK has its numbers, in bytes; None for what it does not tell."""

    loaded: int
    calibration: int | None
    mode: int | None
    tracking: int | None


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """Where one layout of a datagram has its poses.

    words (k, 7): index of each number among the datagram's 32-bit words. bones (k,). vouched, doubted (k,): all True
    and all False. stamp: byte of the time.
    """

    names: tuple[str, ...]
    words: NDArray[np.intp]
    bones: BoolArray
    vouched: BoolArray
    doubted: BoolArray
    stamp: int | None
    state: _State | None
    reasons: Counter[str]


class VmcDecoder:
    """One sender's datagrams into frames.

    Nothing is carried over from one datagram to the next but what `/VMC/Ext/OK` told: `loaded` (the sender has a
    model), `calibration` (0 not done, 1 waiting, 2 under way, 3 done), `calibration_mode` and `tracking`; None until
    told. While the sender says that nothing is loaded, or that tracking is bad, no pose is `tracked`. `time` is the
    last /VMC/Ext/T, s: a frame's stamp is that of its own datagram only.

    The position of a bone that is exactly zero is NaN: SlimeVR without an avatar file, iFacialMocap and others send
    zeros for what they do not know, and no bone of a body lies in its parent's joint. A pose that is not finite, out of
    any room or without a unit quaternion keeps its name, is NaN and not tracked.
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

    @property
    def work(self) -> float:
        """Microseconds, about, that datagrams have cost beyond their length."""
        return self._layouts.work

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The frame of one datagram; none if it tells no pose."""
        plan = self._layouts.of(datagram)
        if plan.reasons:
            self.dropped.reasons.update(plan.reasons)
        if plan.state is not None:
            self._told(datagram, plan.state)
        stamp = None if plan.stamp is None else self._stamp(datagram, plan.stamp)
        if not plan.names:
            return []
        if plan.names != self._names:
            self._names = plan.names
        vouched = self.loaded is not False and self.tracking is not False
        position, orientation, tracked = self._poses(datagram, plan, vouched)
        return [StreamFrame(self._names, position, orientation, tracked, stamp)]

    def _poses(self, datagram: bytes, plan: _Plan, vouched: bool) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Position (k, 3), orientation (k, 4) and tracked (k,) by the plan."""
        poses = _numbers(datagram, plan.words)
        bad = unusable(poses[:, :3], poses[:, 3:])
        tracked = plan.vouched if vouched else plan.doubted
        if bad.any():
            self.dropped.reasons[BAD_POSE] += int(np.count_nonzero(bad))
            poses[bad] = np.nan
            tracked = tracked & ~bad
        position, orientation = poses_from_unity(poses)
        position[plan.bones & ~position.any(axis=1)] = np.nan
        norm = np.sqrt(np.einsum("ij,ij->i", orientation, orientation))
        return position, orientation / norm[:, None], tracked

    def _told(self, datagram: bytes, state: _State) -> None:
        """What /VMC/Ext/OK says, kept until it says otherwise."""
        self.loaded = _INT.unpack_from(datagram, state.loaded)[0] != 0
        if state.calibration is not None and state.mode is not None:
            self.calibration = _INT.unpack_from(datagram, state.calibration)[0]
            self.calibration_mode = _INT.unpack_from(datagram, state.mode)[0]
        if state.tracking is not None:
            self.tracking = _INT.unpack_from(datagram, state.tracking)[0] != 0

    def _stamp(self, datagram: bytes, at: int) -> float | None:
        """Seconds of the sender's clock; None, and counted, if they are not finite."""
        stamp = float(_FLOAT.unpack_from(datagram, at)[0])
        if not np.isfinite(stamp):
            self.dropped.note(BAD_STAMP)
            return None
        self.time = stamp
        return stamp


def _numbers(datagram: bytes, words: NDArray[np.intp]) -> FloatArray:
    """The float32 at these words, as float64. A signalling NaN is a NaN like others here."""
    with np.errstate(invalid="ignore"):
        return np.frombuffer(datagram, ">f4").take(words).astype(np.float64)


def _plan(packet: OscPacket) -> _Plan:
    """Where the poses are, and what is dropped; it looks at no number."""
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
    vouched, doubted = np.ones(count, bool), np.zeros(count, bool)
    vouched.flags.writeable = doubted.flags.writeable = False
    bones = np.array([name.startswith("bone://") for name in places], bool)
    return _Plan(tuple(places), first + np.arange(7), bones, vouched, doubted, stamp, state, reasons)


def _place(message: OscMessage, places: dict[str, int]) -> str:
    """Note the first word of a pose by its name; the last of a name counts. The reason if it is not used."""
    kind = _POSES.get(message.address)
    if kind is None:
        known = message.address.startswith(_UNUSED) and message.address not in ("/VMC/Ext/T", "/VMC/Ext/OK")
        return "" if known else WRONG_ARGUMENTS if message.address.startswith("/VMC/Ext/") else UNKNOWN_ADDRESS
    if not message.tags.startswith("sfffffff"):
        return WRONG_ARGUMENTS
    told = str(message.arguments[0])
    name = "root://root" if kind == _ROOT else bone_name(told) if kind == _BONE else device_name(told)
    if name is None:
        return UNKNOWN_BONE if kind == _BONE else BAD_SERIAL
    if kind == _RAW:
        name = f"local://{name}"
    again = name in places
    if not again and len(places) >= MAX_POSES:
        return TOO_MANY_POSES
    places[name] = message.at[1] // 4
    return TOLD_TWICE if again else ""


def _state(message: OscMessage) -> _State:
    """Three forms: loaded; with calibration state and mode (2.5); with tracking as well (2.7)."""
    at = message.at
    calibrated = message.tags.startswith("iii")
    return _State(
        at[0],
        at[1] if calibrated else None,
        at[2] if calibrated else None,
        at[3] if message.tags.startswith("iiii") else None,
    )
