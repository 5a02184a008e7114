"""OSC datagrams for tests, built from values."""

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
