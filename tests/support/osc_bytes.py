"""OSC datagrams for tests: built from values, and damaged."""

import random
import struct

Value = int | float | str | bytes

CODES = {"i": ">i", "f": ">f", "h": ">q", "d": ">d", "c": ">I", "r": ">I", "m": ">I", "t": ">Q"}
IMMEDIATELY = 1
POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def text(value: str) -> bytes:
    raw = value.encode() + b"\0"
    return raw + bytes(-len(raw) % 4)


def message(address: str, tags: str, *values: Value) -> bytes:
    """A message; tags that take no bytes have no value."""
    out = text(address) + text("," + tags)
    left = list(values)
    for tag in tags:
        if tag in CODES:
            out += struct.pack(CODES[tag], left.pop(0))
        elif tag in "sS":
            out += text(str(left.pop(0)))
        elif tag == "b":
            blob = left.pop(0)
            assert isinstance(blob, bytes)
            out += struct.pack(">i", len(blob)) + blob + bytes(-len(blob) % 4)
    assert not left
    return out


def bundle(*elements: bytes, time_tag: int = IMMEDIATELY) -> bytes:
    head = b"#bundle\0" + struct.pack(">Q", time_tag)
    return head + b"".join(struct.pack(">i", len(element)) + element for element in elements)


def pose(address: str, name: str, *numbers: float) -> bytes:
    """A pose of VMC; Unity's axes."""
    return message(address, "sfffffff", name, *(numbers or POSE))


def damaged(source: random.Random, datagram: bytes) -> bytes:
    """A few bytes changed, cut out, doubled or added; sometimes nothing but noise."""
    kind = source.randrange(8)
    if kind == 0:
        return source.randbytes(source.randrange(200))
    if kind == 1:
        return b"#bundle\0" + source.randbytes(source.randrange(0, 200, 4))
    data = bytearray(datagram)
    for _ in range(source.randrange(1, 6)):
        at = source.randrange(len(data) + 1)
        span = source.choice((1, 2, 4, 8, 80))
        if kind == 2:
            del data[at : at + span]
        elif kind == 3:
            data[at:at] = data[at : at + span]
        elif kind == 4:
            data[at : at + 4] = source.choice(
                (b"\x7f\x80\0\0", b"\xff\xc0\0\0", b"\x7f\xa0\0\1", bytes(4), b"\x7f\x7f\xff\xff")
            )
        elif kind == 5:
            word = at & ~3
            data[word : word + 4] = source.choice((b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\4", b"\0\0\0\0"))
        else:
            data[at : at + 1] = source.randbytes(1)
    return bytes(data)
