"""Bytes of the Xsens MVN network streamer: the header of every datagram, and the small texts beside the poses.

Big-endian. Source: MVN real-time network streaming protocol specification, revision N (2018).
"""

import struct
from dataclasses import dataclass

import numpy as np

from retarget.rotations import FloatArray

__all__ = [
    "EULER",
    "HEADER_BYTES",
    "NAMES",
    "QUATERNION",
    "SCALE",
    "SEGMENTS",
    "STRIDES",
    "MvnHeader",
    "read_header",
    "read_name",
    "read_scale",
]

SEGMENTS: tuple[str, ...] = (
    *("Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head"),
    *("RightShoulder", "RightUpperArm", "RightForeArm", "RightHand"),
    *("LeftShoulder", "LeftUpperArm", "LeftForeArm", "LeftHand"),
    *("RightUpperLeg", "RightLowerLeg", "RightFoot", "RightToe"),
    *("LeftUpperLeg", "LeftLowerLeg", "LeftFoot", "LeftToe"),
)
"""Body segments in the order of their ids, which begin at 1. Higher ids are props, then fingers."""

EULER, QUATERNION, UNITY, NAMES, SCALE = 1, 2, 5, 12, 13
STRIDES = {EULER: 28, QUATERNION: 32, UNITY: 32}
"""Bytes of one item, by type of datagram, where all items are alike."""

MAX_NAME = 64
"""Bytes of the longest name that is looked at."""
MAX_SEGMENTS = 255
"""A header counts segments in one byte."""

_HEADER = struct.Struct(">4s2sIBBIBBBB2sH")
_COUNT = struct.Struct(">I")
_ORIGIN = struct.Struct(">3f")
HEADER_BYTES = _HEADER.size


@dataclass(frozen=True, slots=True)
class MvnHeader:
    """kind: type of the datagram, 0 to 99. sample: counts captured samples, u32. part, last: of a sample that is split
    over several datagrams. items: of the payload. time_ms: since the recording began, u32. character: id. size: bytes
    of the payload."""

    kind: int
    sample: int
    part: int
    last: bool
    items: int
    time_ms: int
    character: int
    size: int


def read_header(data: bytes | bytearray, offset: int = 0) -> MvnHeader | None:
    """The header at `offset`, or None if there is none."""
    if len(data) - offset < HEADER_BYTES:
        return None
    magic, digits, sample, counter, items, time_ms, character, _, _, _, _, size = _HEADER.unpack_from(data, offset)
    if magic != b"MXTP" or not digits.isdigit():
        return None
    return MvnHeader(int(digits), sample, counter & 0x7F, counter >= 0x80, items, time_ms, character, size)


def read_name(payload: bytes) -> str | None:
    """The performer's name in a type 12 payload: one counted text of lines `key:value`; None if there is none."""
    text = _text(payload, 0, limit=len(payload))
    if text is None:
        return None
    for line in text[0].split("\n"):
        key, colon, value = line.partition(":")
        if colon and key == "name" and value.isprintable():
            return value[:MAX_NAME]
    return None


def read_scale(payload: bytes) -> tuple[tuple[str, ...], FloatArray] | None:
    """Segment names (k) and their origins (k, 3) in the T-pose, sender's unit, of one type 13 payload.

    A payload is u32 count of segments, then for each its counted name and 3 floats; what follows are points on the
    skin, which a sender also puts alone into further datagrams (count 0). None if the payload is damaged.
    """
    if len(payload) < _COUNT.size:
        return None
    (count,) = _COUNT.unpack_from(payload)
    if count > MAX_SEGMENTS:
        return None
    at, names, origins = _COUNT.size, [], []
    for _ in range(count):
        named = _text(payload, at, limit=MAX_NAME)
        if named is None or len(payload) - named[1] < _ORIGIN.size:
            return None
        name, at = named
        names.append(name)
        origins.append(_ORIGIN.unpack_from(payload, at))
        at += _ORIGIN.size
    return tuple(names), np.array(origins, float).reshape(count, 3)


def _text(payload: bytes, at: int, *, limit: int) -> tuple[str, int] | None:
    """A text that its u32 length precedes, and where it ends; None if it is longer than the limit or the payload."""
    if len(payload) - at < _COUNT.size:
        return None
    (length,) = _COUNT.unpack_from(payload, at)
    begin, end = at + _COUNT.size, at + _COUNT.size + length
    if length > limit or end > len(payload):
        return None
    try:
        return payload[begin:end].decode("utf-8").rstrip("\0"), end
    except UnicodeDecodeError:
        return None
