"""Xsens MVN network streamer: datagrams of one character -> poses of its 23 body segments.

Used are type 02 (quaternions, the one to choose in MVN), type 01 (Euler angles, only without quaternions) and 13 (the
T-pose). Names of poses are MVN's ("Pelvis", "L5"). The stamp is the time code, the number the sample counter: samples
may be skipped, and arrival times are off by 15 ms.

Big-endian. Source: MVN real-time network streaming protocol specification, revision N (2018).
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from retarget.frames import Skeleton
from retarget.rotations import from_euler
from retarget.sources.skeletons import TABLES, names_of_sides
from retarget.sources.streams.stream_frame import CONVENTIONS, MAX_DATAGRAM, MAX_POSES, Dropped, StreamFrame, make_unit
from retarget.types import BoolArray, FloatArray

SEGMENTS: tuple[str, ...] = tuple(TABLES["mvn_segments"])
"""Body segments in the order of their ids from 1; higher ids are props, then fingers."""

EULER, QUATERNION, UNITY, NAMES, SCALE = 1, 2, 5, 12, 13
STRIDES = {EULER: 28, QUATERNION: 32}
"""Bytes of one item by type of datagram."""
TYPES = {int(kind): content for kind, content in TABLES["mvn_types"].items()}

MAX_NAME_BYTES = 64
"""Bytes of the longest name of a segment."""
MAX_SEGMENTS = 255
"""Segments of a character: MVN counts them in a byte."""

_HEADER = struct.Struct(">4s2sIBBIBBBB2sH")
_COUNT = struct.Struct(">I")
_POINT = struct.Struct(">3f")
HEADER_BYTES = _HEADER.size


@dataclass(frozen=True, slots=True)
class MvnHeader:
    """kind: type of the datagram, 0 to 99. sample: counter, u32. part, last: of a sample split over datagrams. items:
    of the payload. time_ms: since the recording began, u32. size: bytes of the payload."""

    kind: int
    sample: int
    part: int
    last: bool
    items: int
    time_ms: int
    character: int
    size: int


def read_header(data: bytes) -> MvnHeader | None:
    """The header of a datagram, None if it has none. Before 2018 its size was zero: all bytes are then the payload."""
    if len(data) < HEADER_BYTES:
        return None
    magic, digits, sample, counter, items, time_ms, character, _, _, _, _, size = _HEADER.unpack_from(data)
    if magic != b"MXTP" or not digits.isdigit():
        return None
    return MvnHeader(
        int(digits),
        sample,
        counter & 0x7F,
        counter >= 0x80,
        items,
        time_ms,
        character,
        size or len(data) - HEADER_BYTES,
    )


def read_scale(payload: bytes) -> tuple[tuple[str, ...], FloatArray] | None:
    """Segment names (k) and their origins (k, 3) in the T-pose, sender's unit, of a type 13 payload; None if it is
    damaged.

    The payload is a u32 count, then for each segment its counted name and 3 floats, then points on the skin, which a
    sender also puts into datagrams of their own (count 0).
    """
    at, names, origins = _COUNT.size, [], []
    try:
        (count,) = _COUNT.unpack_from(payload)
        if count > MAX_SEGMENTS:
            return None
        for _ in range(count):
            (length,) = _COUNT.unpack_from(payload, at)
            end = at + _COUNT.size + length
            if length > MAX_NAME_BYTES:
                return None
            names.append(payload[at + _COUNT.size : end].decode("utf-8").rstrip("\0"))
            origins.append(_POINT.unpack_from(payload, end))
            at = end + _POINT.size
    except (struct.error, UnicodeDecodeError):
        return None
    return tuple(names), np.array(origins, float).reshape(count, 3)


class SampleParts:
    """The parts of the latest sample of one type, at most MAX_DATAGRAM bytes in 128 parts. A part of another sample
    discards them."""

    def __init__(self, dropped: Dropped) -> None:
        self._dropped = dropped
        self._sample: int | None = None
        self._parts: dict[int, bytes] = {}
        self._count: int | None = None

    def add(self, header: MvnHeader, payload: bytes) -> bytes | None:
        """The whole payload in order, if this part completes it; else None."""
        if header.sample != self._sample:
            if self._parts:
                self._dropped.note("sample with a part missing")
            self._clear()
            self._sample = header.sample
        if header.part in self._parts:
            self._dropped.note("part sent twice")
            return None
        self._parts[header.part] = payload
        if header.last:
            self._count = header.part + 1
        if sum(map(len, self._parts.values())) > MAX_DATAGRAM or max(self._parts) >= (self._count or 128):
            self._dropped.note("parts that make no sample")
            self._clear()
            return None
        if len(self._parts) != self._count:
            return None
        whole = b"".join(self._parts[part] for part in sorted(self._parts))
        self._clear()
        return whole

    def _clear(self) -> None:
        self._sample, self._count = None, None
        self._parts.clear()


MVN_JOINTS: Mapping[str, str] = MappingProxyType(names_of_sides(TABLES["mvn"]))
"""Canonical joint -> the segment whose origin it is."""

TALL = 10.0
"""A pelvis higher than this, or a T-pose taller, is in centimetres."""
LARGEST = 1000.0
"""Largest coordinate of an origin of a T-pose, even in centimetres."""
TALL_SAMPLES = 5
"""Tall samples in a row that change the unit: one may be damaged."""


@dataclass(frozen=True, eq=False)
class _Layout:
    """The items of a sample that are used, found once for each list of ids."""

    ids: bytes
    columns: NDArray[np.intp]
    names: tuple[str, ...]
    error: str = ""


class MvnDecoder:
    """Implements StreamDecoder. character: its id in MVN; None takes the first that arrives.

    rest: the canonical joints of the T-pose that MVN measured, facing x; None before the first type 13.
    """

    def __init__(self, *, character: int | None = None) -> None:
        self.dropped = Dropped()
        self.character = character
        self.rest: Skeleton | None = None
        self._parts = {EULER: SampleParts(self.dropped), QUATERNION: SampleParts(self.dropped)}
        self._layout = _layout(b"")
        self._quaternions = False
        self._metres, self._tall = 1.0, 0

    def rest_of(self, names: Sequence[str]) -> Skeleton | None:
        """The T-pose of MVN's own calibration, for any names."""
        return self.rest

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The sample that this datagram holds or completes. See `StreamDecoder`."""
        header = read_header(datagram) if len(datagram) <= MAX_DATAGRAM else None
        if header is None or header.size != len(datagram) - HEADER_BYTES:
            self.dropped.note("not an MVN datagram" if header is None else "not of the size in its header")
            return []
        if self.character is None:
            self.character = header.character
        if header.character != self.character:
            self.dropped.note("another character")
            return []
        payload = datagram[HEADER_BYTES:]
        if header.kind in self._parts:
            frame = self._frame(header, payload)
            return [] if frame is None else [frame]
        if header.kind == SCALE:
            self._take_scale(payload)
        elif header.kind != NAMES:
            step = ": choose Position + Orientation (Quaternion) in MVN" if header.kind == UNITY else ""
            known = header.kind in TYPES
            self.dropped.note(f"type {header.kind:02d} ({TYPES[header.kind]}){step}" if known else "type unknown")
        return []

    def _frame(self, header: MvnHeader, payload: bytes) -> StreamFrame | None:
        if header.items * STRIDES[header.kind] != header.size:
            self.dropped.note("items do not fill the datagram")
            return None
        if header.kind == EULER and self._quaternions:
            self.dropped.note("type 01 (Euler angles) beside quaternions")
            return None
        if header.part or not header.last:
            whole = self._parts[header.kind].add(header, payload)
            if whole is None:
                return None
            payload = whole
        words = np.frombuffer(payload, ">u4").reshape(-1, STRIDES[header.kind] // 4)
        ids = words[:, 0].tobytes()
        if ids != self._layout.ids:
            self._layout = _layout(ids)
        layout = self._layout
        if layout.error:
            self.dropped.note(layout.error)
            return None
        self._quaternions |= header.kind == QUATERNION
        with np.errstate(invalid="ignore"):  # signalling NaNs from the wire
            values = words[:, 1:].view(">f4")[layout.columns].astype(float)
        position = values[:, :3]
        orientation = values[:, 3:]
        if header.kind == EULER:  # degrees about x, y and z, applied in this order
            usable: BoolArray = np.abs(orientation) < 1e4  # False for NaN; the sine would warn of infinity
            orientation = from_euler(np.deg2rad(np.where(usable, orientation, np.nan)[:, ::-1]), "zyx")
        bad = make_unit(position, orientation)
        if bad.any():
            self.dropped.note("pose that is no number or no rotation")
        axes = CONVENTIONS["xsens" if header.kind == QUATERNION else "xsens_y_up"]
        position = axes.positions(position)
        if "Pelvis" in layout.names and not self._unit_is_clear(float(position[layout.names.index("Pelvis"), 2])):
            self.dropped.note("pelvis above 10 m")
            return None
        return StreamFrame(
            names=layout.names,
            position=np.ascontiguousarray(position * self._metres),
            orientation=np.ascontiguousarray(axes.orientations(orientation)),
            tracked=~bad,
            stamp=header.time_ms / 1000.0,
            number=header.sample,
        )

    def _unit_is_clear(self, height: float) -> bool:
        """True if the unit fits a pelvis at this height (sender's unit); TALL_SAMPLES in a row change the unit."""
        if self._metres != 1.0 or not height > TALL:
            self._tall = 0
            return True
        self._tall += 1
        if self._tall < TALL_SAMPLES:
            return False
        self._metres = 0.01
        return True

    def _take_scale(self, payload: bytes) -> None:
        scale = read_scale(payload)
        if scale is None:
            self.dropped.note("type 13 (scale) damaged")
            return
        sent = [(name, origin) for name, origin in zip(*scale, strict=True) if name in SEGMENTS]
        if not sent:  # points on the skin alone
            return
        places = dict(sent)
        origins = np.array([origin for _, origin in sent])
        if len(places) < len(sent) or "Pelvis" not in places or not np.all(np.abs(origins) < LARGEST):
            self.dropped.note("type 13 (scale) with an impossible T-pose")
            return
        metres = 0.01 if float(np.ptp(origins[:, 2])) > TALL else 1.0
        joints = {joint: places[segment] for joint, segment in MVN_JOINTS.items() if segment in places}
        self.rest = Skeleton(tuple(joints), (np.stack(list(joints.values())) - places["Pelvis"]) * metres)


def _layout(ids: bytes) -> _Layout:
    """Columns of the body segments among ids (k u32, big-endian)."""
    numbers = np.frombuffer(ids, ">u4")
    columns = np.flatnonzero((numbers >= 1) & (numbers <= len(SEGMENTS)))
    used = tuple(SEGMENTS[number - 1] for number in numbers[columns].tolist())
    error = ""
    if numbers.size > MAX_POSES:
        error = "too many segments"
    elif not used:
        error = "no body segment"
    elif len(set(used)) < len(used):
        error = "segment sent twice"
    return _Layout(ids, columns, used, error)
