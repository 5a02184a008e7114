"""Xsens MVN network streamer: datagrams of one character -> poses of its 23 body segments.

Used: type 02 (quaternions; the one to choose in MVN), type 01 (Euler angles, only while no quaternions come), 12 (the
performer's name) and 13 (the T-pose). All else is counted. Names of poses are MVN's own: "Pelvis", "L5", "RightForeArm"
(`mvn_wire.SEGMENTS`); props and fingers are left out. The stamp is the time code, the number the sample counter: a
sender may skip samples, and arrival is off by 15 ms, so samples belong where these say.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.frames import BoolArray, Skeleton
from retarget.rotations import FloatArray, from_euler
from retarget.sources.mvn_parts import SampleParts
from retarget.sources.mvn_roles import MVN_JOINTS
from retarget.sources.mvn_wire import (
    EULER,
    HEADER_BYTES,
    NAMES,
    QUATERNION,
    SCALE,
    SEGMENTS,
    STRIDES,
    MvnHeader,
    read_header,
    read_name,
    read_scale,
)
from retarget.sources.pose_bounds import unusable
from retarget.sources.stream_axes import CONVENTIONS
from retarget.sources.stream_frame import MAX_DATAGRAM, MAX_POSES, Dropped, StreamFrame

__all__ = ["MvnDecoder", "MvnRest"]

TALL = 10.0
"""A pelvis higher than this, or a T-pose taller, is in centimetres."""
TALL_SAMPLES = 5
"""So many samples in a row must say so: one damaged sample must not shrink the performer for good."""

CENTIMETRES = "MVN sends centimetres (pelvis above 10): taken as such"

_OTHER = {
    5: "type 05 (Unity poses): choose Position + Orientation (Quaternion) in MVN",
    20: "type 20 (joint angles)",
    21: "type 21 (linear segment kinematics)",
    22: "type 22 (angular segment kinematics)",
    23: "type 23 (motion trackers)",
    24: "type 24 (centre of mass)",
    25: "type 25 (time code)",
}


@dataclass(frozen=True, eq=False)
class MvnRest:
    """The T-pose that MVN measured: names (k) of segments and their origins, position (k, 3) m, facing x, z up."""

    names: tuple[str, ...]
    position: FloatArray

    def skeleton(self) -> Skeleton:
        """Its canonical joints, for limb lengths; only those whose segments were told. The pelvis must be there."""
        place = dict(zip(self.names, self.position, strict=True))
        joints = {joint: place[segment] for joint, segment in MVN_JOINTS.items() if segment in place}
        return Skeleton(tuple(joints), np.stack(list(joints.values())) - place["Pelvis"])


@dataclass(frozen=True, eq=False)
class _Layout:
    """Which items of a sample are used, found once for each list of ids. ids: as on the wire. error: a reason."""

    ids: bytes
    names: tuple[str, ...]
    columns: NDArray[np.intp] | slice
    pelvis: int | None
    error: str = ""


class MvnDecoder:
    """Implements StreamDecoder. character: its id in MVN; None takes the first that is seen and stays with it.

    rest: the T-pose, None until a type 13 datagram told it. name: of the performer, "" until a type 12 one did.
    types: datagrams by type. notes: what the user should know, each once.
    """

    def __init__(self, *, character: int | None = None) -> None:
        self.dropped = Dropped()
        self.character = character
        self.rest: MvnRest | None = None
        self.name = ""
        self.types: Counter[int] = Counter()
        self.notes: list[str] = []
        self._parts = {EULER: SampleParts(self.dropped), QUATERNION: SampleParts(self.dropped)}
        self._layout = _Layout(b"", (), slice(0), None, "no body segment")
        self._quaternions = False
        self._metres, self._tall = 1.0, 0

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The sample that this datagram holds or completes. See `StreamDecoder`."""
        header = read_header(datagram) if len(datagram) <= MAX_DATAGRAM else None
        if header is None or header.size != len(datagram) - HEADER_BYTES:
            self.dropped.note("not an MVN datagram" if header is None else "not of the size it tells")
            return []
        if self.character is None:
            self.character = header.character
        if header.character != self.character:
            self.dropped.note("another character")
            return []
        self.types[header.kind] += 1
        payload = datagram[HEADER_BYTES:]
        if header.kind in self._parts:
            frame = self._sample(header, payload)
            return [] if frame is None else [frame]
        if header.kind == SCALE:
            self._take_scale(payload)
        elif header.kind == NAMES:
            self._take_name(payload)
        else:
            self.dropped.note(_OTHER.get(header.kind, "type unknown"))
        return []

    def _sample(self, header: MvnHeader, payload: bytes) -> StreamFrame | None:
        whole: bytes | None = payload
        if header.items * STRIDES[header.kind] != header.size:
            self.dropped.note("items do not fill the datagram")
            return None
        if header.kind == EULER and self._quaternions:
            self.dropped.note("type 01 (Euler angles) beside quaternions")
            return None
        if header.part or not header.last:
            whole = self._parts[header.kind].add(header, payload)
        return None if whole is None else self._frame(header, whole)

    def _frame(self, header: MvnHeader, payload: bytes) -> StreamFrame | None:
        words = np.frombuffer(payload, ">u4").reshape(-1, STRIDES[header.kind] // 4)
        layout = self._lay_out(words[:, 0].tobytes())
        if layout.error:
            self.dropped.note(layout.error)
            return None
        self._quaternions |= header.kind == QUATERNION
        with np.errstate(invalid="ignore"):  # signalling NaNs from the wire
            values = words[:, 1:].view(">f4")[layout.columns].astype(float)
        position = values[:, :3]
        orientation = values[:, 3:] if header.kind == QUATERNION else _from_degrees(values[:, 3:])
        bad = unusable(position, orientation)
        if bad.any():
            self.dropped.note("pose that is no number or no rotation")
            position[bad], orientation[bad] = np.nan, np.nan
        orientation /= np.sqrt(np.einsum("ij,ij->i", orientation, orientation))[:, None]
        axes = CONVENTIONS["xsens" if header.kind == QUATERNION else "xsens_y_up"]
        position = axes.positions(position)
        if layout.pelvis is not None and not self._unit_is_clear(float(position[layout.pelvis, 2])):
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

    def _lay_out(self, ids: bytes) -> _Layout:
        """The layout for these ids: the last one, or a new one if they changed."""
        if ids != self._layout.ids:
            self._layout = _layout(ids)
        return self._layout

    def _unit_is_clear(self, height: float) -> bool:
        """Whether the unit fits a pelvis (sender's unit) at this height; changes it when several samples say so."""
        if self._metres != 1.0 or not height > TALL:
            self._tall = 0
            return True
        self._tall += 1
        if self._tall < TALL_SAMPLES:
            return False
        self._metres = 0.01
        self.notes.append(CENTIMETRES)
        return True

    def _take_scale(self, payload: bytes) -> None:
        scale = read_scale(payload)
        if scale is None:
            self.dropped.note("type 13 (scale) damaged")
            return
        names, origins = scale
        known = [index for index, name in enumerate(names) if name in SEGMENTS]
        if not known:  # points on the skin alone
            return
        names, origins = tuple(names[index] for index in known), origins[known]
        if len(set(names)) < len(names) or "Pelvis" not in names or not _sane(origins):
            self.dropped.note("type 13 (scale) with an impossible T-pose")
            return
        tall = float(np.ptp(origins[:, 2])) > TALL
        self.rest = MvnRest(names, origins * (0.01 if tall else 1.0))

    def _take_name(self, payload: bytes) -> None:
        name = read_name(payload)
        if name is None:
            self.dropped.note("type 12 (names) without a name")
        else:
            self.name = name


def _layout(ids: bytes) -> _Layout:
    """Columns of the body segments among ids (k u32, big-endian)."""
    numbers = np.frombuffer(ids, ">u4")
    columns = np.flatnonzero((numbers >= 1) & (numbers <= len(SEGMENTS)))
    used = numbers[columns]
    error = ""
    if numbers.size > MAX_POSES:
        error = "too many segments"
    elif columns.size == 0:
        error = "no body segment"
    elif len(set(used.tolist())) < used.size:
        error = "segment told twice"
    if error:
        return _Layout(ids, (), slice(0), None, error)
    names = tuple(SEGMENTS[number - 1] for number in used.tolist())
    pelvis = names.index("Pelvis") if "Pelvis" in names else None
    first = bool(np.array_equal(columns, np.arange(columns.size)))
    return _Layout(ids, names, slice(columns.size) if first else columns, pelvis)


def _from_degrees(angles: FloatArray) -> FloatArray:
    """Quaternions (k, 4) wxyz, in y-up axes, of MVN's angles (k, 3) degrees about x, y and z, applied in this order."""
    usable: BoolArray = np.abs(angles) < 1e4  # False for NaN, and it keeps the sine from warning of an infinity
    angles = np.where(usable, angles, np.nan)
    return from_euler(np.deg2rad(angles[:, ::-1]), "zyx")


def _sane(origins: FloatArray) -> bool:
    """Whether origins are finite and no larger than a person in centimetres."""
    return bool(np.all(np.abs(origins) < 1000.0))
