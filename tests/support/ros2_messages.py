"""A strict reader of `ros2msg` definitions and of CDR, written from the standards and from nothing of ours.

ROS 2 interface definitions: https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html. Plain CDR: OMG
DDS-XTypes 1.3, 7.4.3. Whatever is not exactly as they ask raises ValueError.
"""

import re
import struct
from dataclasses import dataclass
from typing import Any

SEPARATOR = "=" * 80
CODES = "bool? byteB charB int8b uint8B int16h uint16H int32i uint32I int64q uint64Q float32f float64d"
PRIMITIVES = {word[:-1]: word[-1] for word in CODES.split()}
NAME = re.compile(r"[a-z](?:_?[a-z0-9]+)*")
CONSTANT = re.compile(r"[A-Z](?:_?[A-Z0-9]+)*=-?\d+")
KIND = re.compile(r"(?P<base>[A-Za-z0-9_/]+)(?P<many>\[\])?")
COMPOUND = re.compile(r"[a-z][a-z0-9_]*/[A-Z][A-Za-z0-9]*")

Field = tuple[str, str, bool]
"""Name, type without brackets, whether there are many."""


@dataclass(frozen=True)
class Definition:
    """of: full name (pkg/msg/Name). types: of every message that it is made of, by pkg/Name."""

    of: str
    own: tuple[Field, ...]
    types: dict[str, tuple[Field, ...]]


def parsed(name: str, text: str) -> Definition:
    """A definition with all that it needs, and nothing else."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*", name):
        raise ValueError(f"no full name: {name}")
    if not text.endswith("\n") or "\r" in text or "\t" in text:
        raise ValueError("lines end in a line feed")
    first, *others = text.split(f"{SEPARATOR}\n")
    own, types = fields_of(first), {}
    for part in others:
        head, _, body = part.partition("\n")
        kind = head.removeprefix("MSG: ")
        if kind == head or not COMPOUND.fullmatch(kind) or kind in types:
            raise ValueError(f"no definition of its own: {head}")
        types[kind] = fields_of(body)
    needed, waiting = set[str](), list(own)
    while waiting:
        _, kind, _ = waiting.pop()
        if kind in PRIMITIVES or kind == "string" or kind in needed:
            continue
        needed.add(kind)
        waiting += types[kind] if kind in types else _missing(kind)
    if needed != set(types):
        raise ValueError(f"defined for nothing: {sorted(set(types) - needed)}")
    return Definition(name, own, types)


def fields_of(text: str) -> tuple[Field, ...]:
    """The fields of one message, without its constants."""
    fields: list[Field] = []
    for line in text.splitlines():
        kind, _, name = line.partition(" ")
        if "=" in name:
            if kind not in PRIMITIVES or not CONSTANT.fullmatch(name):
                raise ValueError(f"no constant: {line}")
            continue
        found = KIND.fullmatch(kind)
        if found is None or not NAME.fullmatch(name) or name in {field[0] for field in fields}:
            raise ValueError(f"no field: {line!r}")
        base = found["base"]
        if base not in PRIMITIVES and base != "string" and not COMPOUND.fullmatch(base):
            raise ValueError(f"no type: {line!r}")
        fields.append((name, base, found["many"] is not None))
    if not fields:
        raise ValueError("a message without fields")
    return tuple(fields)


def decoded(definition: Definition, data: bytes) -> dict[str, Any]:
    """A message, to its last byte. Padding has to be zero, texts to end in one zero."""
    if data[:4] != b"\x00\x01\x00\x00":
        raise ValueError("not plain CDR, little-endian")
    reader = _Reader(data[4:], definition.types)
    message = reader.message(definition.own)
    if reader.at != len(data) - 4:
        raise ValueError(f"{len(data) - 4 - reader.at} bytes too many")
    return message


class _Reader:
    def __init__(self, data: bytes, types: dict[str, tuple[Field, ...]]) -> None:
        self.at, self._data, self._types = 0, data, types

    def message(self, fields: tuple[Field, ...]) -> dict[str, Any]:
        return {name: self._many(kind) if many else self._one(kind) for name, kind, many in fields}

    def _many(self, kind: str) -> list[Any]:
        return [self._one(kind) for _ in range(self._number("I"))]

    def _one(self, kind: str) -> Any:
        if kind == "string":
            length = self._number("I")
            text = self._take(length)
            if not length or text[-1] or 0 in text[:-1]:
                raise ValueError("a text ends in one zero")
            return text[:-1].decode()
        if kind in PRIMITIVES:
            value = self._number(PRIMITIVES[kind])
            return bool(value) if kind == "bool" else value
        return self.message(self._types[kind])

    def _number(self, code: str) -> Any:
        size = struct.calcsize(code)
        if any(self._take(-self.at % size)):
            raise ValueError("padding that is not zero")
        value = self._take(size)
        if code == "?" and value not in (b"\0", b"\1"):
            raise ValueError("neither true nor false")
        return struct.unpack(f"<{code}", value)[0]

    def _take(self, count: int) -> bytes:
        if self.at + count > len(self._data):
            raise ValueError("ends early")
        self.at += count
        return self._data[self.at - count : self.at]


def _missing(kind: str) -> tuple[Field, ...]:
    raise ValueError(f"not defined: {kind}")
