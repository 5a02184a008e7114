"""Datagrams of the MVN streamer, built from its specification field by field, apart from the code that reads them."""

import struct
from collections.abc import Iterable, Sequence

Segment = tuple[int, Sequence[float], Sequence[float]]
"""Id from 1, position, and the quaternion or the angles."""


def mvn(
    kind: str,
    payload: bytes,
    *,
    items: int = 0,
    sample: int = 7,
    counter: int = 0x80,
    time_ms: int = 1500,
    character: int = 0,
    size: int | None = None,
) -> bytes:
    head = b"MXTP" + kind.encode() + sample.to_bytes(4, "big") + bytes([counter, items])
    head += time_ms.to_bytes(4, "big") + bytes([character, 23, 0, 0]) + b"\0\0"
    return head + (len(payload) if size is None else size).to_bytes(2, "big") + payload


def _items(segments: Iterable[Segment]) -> bytes:
    return b"".join(
        struct.pack(">I", number) + b"".join(struct.pack(">f", value) for value in (*place, *turn))
        for number, place, turn in segments
    )


def quaternions(segments: Sequence[Segment], *, sample: int = 7, counter: int = 0x80, time_ms: int = 1500) -> bytes:
    return mvn("02", _items(segments), items=len(segments), sample=sample, counter=counter, time_ms=time_ms)


def euler(segments: Sequence[Segment], *, sample: int = 7) -> bytes:
    return mvn("01", _items(segments), items=len(segments), sample=sample)


def _text(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack(">I", len(encoded)) + encoded


def meta(text: str) -> bytes:
    return mvn("12", _text(text), items=1)


def scale(origins: Sequence[tuple[str, Sequence[float]]], *, points: int = 0) -> bytes:
    payload = struct.pack(">I", len(origins))
    payload += b"".join(_text(name) + struct.pack(">3f", *place) for name, place in origins)
    payload += struct.pack(">I", points)
    payload += b"".join(
        struct.pack(">HH", 1, n) + _text("pHub") + struct.pack(">I3f", 0, 0, 0, 0) for n in range(points)
    )
    return mvn("13", payload, items=len(origins))


def standing(scale_by: float = 1.0) -> list[Segment]:
    """23 segments at places of their own, each turned by itself (unit quaternions w, x, y, z)."""
    turns = ((1.0, 0.0, 0.0, 0.0), (0.6, 0.8, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0), (-0.6, 0.0, 0.0, 0.8))
    return [
        (
            number,
            (0.01 * number * scale_by, -0.02 * number * scale_by, (0.9 + 0.03 * number) * scale_by),
            turns[number % 4],
        )
        for number in range(1, 24)
    ]
