"""Lines full of frames and noise, for the parsers; and what they may return at most."""

import random
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import more_frames
from hardware.dynamixel.codec import BROADCAST, STATUS, Parser, Status, WireFrame, protocol1, protocol2

HOT = (0xFF, 0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x00, 0x55, 0xFE, 0x01, 0x02, 0x03, 0x04, 0x05, 0x07, 0x83)


class Line(NamedTuple):
    """One protocol, as the tests of both parsers need it."""

    parser: Callable[[], Parser]
    frame: Callable[[int, int, bytes], bytes]
    longest: int
    stands_at: Callable[[bytes, int, WireFrame], int]
    """End of the frame if its bytes stand in the stream at this place; otherwise -1."""
    header: bytes


def stands_at_2(stream: bytes, at: int, frame: WireFrame) -> int:
    """By the e-Manual: header, id, length, CRC over all, then unstuffed."""
    end = at + 7 + int.from_bytes(stream[at + 5 : at + 7], "little")
    if len(stream) < end or stream[at + 4] != frame.id:
        return -1
    if more_frames.crc(stream[at : end - 2]) != int.from_bytes(stream[end - 2 : end], "little"):
        return -1
    body = stream[at + 7 : end - 2]
    if frame.id != BROADCAST or frame.code != STATUS:
        body = protocol2.unstuff(body)
    return end if body == bytes((frame.code,)) + frame.params else -1


def stands_at_1(stream: bytes, at: int, frame: WireFrame) -> int:
    """Our own bytes of the frame, found again: they are unique."""
    raw = protocol1.frame(*frame)
    return at + len(raw) if stream.startswith(raw, at) else -1


LINES = {
    1: Line(protocol1.parser, protocol1.frame, 4 + 255, stands_at_1, protocol1.HEADER),
    2: Line(protocol2.parser, protocol2.frame, 7 + protocol2.MAX_LENGTH, stands_at_2, protocol2.HEADER),
}


def bytes_of(line: Line, stream: bytes, frames: list[WireFrame]) -> int:
    """How many bytes of `stream` the frames are, in order and apart. Raises AssertionError for a false one."""
    at = used = 0
    for frame in frames:
        end = -1
        while end < 0:
            at = stream.find(line.header, at)
            assert at >= 0, f"no such bytes: {frame}"
            end = line.stands_at(stream, at, frame)
            at += 1
        used += end - at + 1
        at = end
    return used


def noise(random_: random.Random, longest: int = 24) -> bytes:
    """Bytes of which many mean something to the protocols."""
    return bytes(random_.choices(HOT, k=random_.randrange(longest)))


def some_frame(random_: random.Random) -> bytes:
    """A sound frame of either protocol, full of bytes that look like headers."""
    device, code, data = random_.choice((0, 1, 7, 252, BROADCAST)), random_.choice((1, 3, 0x55, 0xFF)), noise(random_)
    kind = random_.randrange(5)
    if kind == 0:
        return protocol1.frame(device, code, data)
    if kind == 1:
        return more_frames.fast_status([Status(device, 0, data), Status(3, 0x80, noise(random_))])
    if kind == 2:  # valid, but not stuffed (as dynamixel-sdk sends it)
        out = protocol2.HEADER + bytes((device, len(data) + 3, 0, code)) + data
        return out + more_frames.crc(out).to_bytes(2, "little")
    return protocol2.frame(device, code, data)


def stretch(random_: random.Random) -> bytes:
    """Noise, a frame, a damaged frame, or the beginning of one."""
    kind = random_.randrange(6)
    if kind < 2:
        return noise(random_)
    if kind < 4:
        return some_frame(random_)
    whole = some_frame(random_)
    at = random_.randrange(len(whole))
    if kind == 4:
        return whole[:at]
    return whole[:at] + bytes((whole[at] ^ random_.randrange(1, 256),)) + whole[at + 1 :]


def pieces(random_: random.Random, stream: bytes) -> list[bytes]:
    """The stream as it may arrive."""
    count = random_.randrange(1, 12)
    cuts = sorted(random_.randrange(len(stream) + 1) for _ in range(count))
    return [stream[begin:end] for begin, end in pairwise([0, *cuts, len(stream)])]
