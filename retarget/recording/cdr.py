"""ROS 2 messages of fixed size as NumPy rows, so that all messages of a topic are filled and read without a loop.

Names and counts of a message are constant within a recording. Its CDR encoding (OMG DDS-XTypes 1.3, 7.4.3, plain CDR,
little-endian) is then a structured dtype, which follows from the definition in `ros2_messages.txt`.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[Any]
"""A structured array with one row per message."""
Given = Mapping[str, int | str | tuple[str, ...]]
"""Constants of a message by field: the length of a sequence, a text, or element names."""

HEADER = b"\x00\x01\x00\x00"
"""Plain CDR, little-endian."""
CALLED = {"transform": "pose"}
"""Fields with another name in our layouts."""
_KEYS = ("names", "formats", "offsets", "itemsize")
_SIZES = {"bool": "?", "uint8": "u1", "int8": "i1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}

_LINE = "=" * 80 + "\n"
"""Separator of message definitions, as in ROS bags."""
_PARTS = files("retarget.recording").joinpath("ros2_messages.txt").read_text(encoding="utf-8").split(f"{_LINE}MSG: ")
_OWN = {name: text for name, _, text in (part.removeprefix("MSG: ").partition("\n") for part in _PARTS)}


def _fields(name: str) -> list[tuple[str, str]]:
    return [(kind, field) for kind, field in (line.split() for line in _OWN[name].splitlines()) if "=" not in field]


def _made_of(name: str) -> dict[str, None]:
    names = {name: None}
    for kind, _ in _fields(name):
        names |= _made_of(kind.removesuffix("[]")) if kind.removesuffix("[]") in _OWN else {}
    return names


def schema(name: str) -> str:
    """The definition of a message by its full name, followed by those of its parts."""
    own, *others = _made_of(name.replace("/msg/", "/"))
    return _OWN[own] + "".join(f"{_LINE}MSG: {other}\n{_OWN[other]}" for other in others)


@dataclass(frozen=True, eq=False)
class CdrLayout:
    """The bytes of one message. dtype: its fields; template: a message of zeros; description: the dtype as JSON, for
    readers of the file."""

    dtype: np.dtype[Any]
    template: bytes
    description: str

    def rows(self, count: int) -> Rows:
        """An array (count,) of messages to be filled."""
        return np.frombuffer(bytearray(self.template * count), dtype=self.dtype)


def layout_from(description: str) -> np.dtype[Any]:
    """The dtype of a layout's `description`. Raises ValueError, TypeError or KeyError."""
    fields = json.loads(description)
    made: np.dtype[Any] = np.dtype({key: fields[key] for key in _KEYS})  # type: ignore[call-overload]
    return made


def layout_of(message: str, given: Given) -> CdrLayout:
    """The layout of a message by its full name. Sequences and texts that are not given are empty.

    A nested field has the names of both, without that of a header; a field of an element begins with the element's
    name. A message of float64 alone, such as a pose, is one row of them.
    """
    draft = _Draft(given)
    draft.add_all(message.replace("/msg/", "/"), "")
    names, formats, offsets = (list(column) for column in zip(*draft.fields, strict=True))
    fields = {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(draft.data)}
    return CdrLayout(np.dtype(fields), bytes(draft.data), json.dumps(fields))  # type: ignore[call-overload]


def _numbers(kind: str) -> tuple[str, int]:
    """Format and count of a message of numbers of one kind; 0 for any other."""
    if kind in _SIZES:
        return _SIZES[kind], 1
    parts = [_numbers(part) for part, _ in _fields(kind)] if kind in _OWN else []
    return ("<f8", sum(width for _, width in parts)) if parts and {form for form, _ in parts} == {"<f8"} else ("", 0)


class _Draft:
    """A message in the making. fields: name, format and offset of each."""

    def __init__(self, given: Given) -> None:
        self.data, self.fields = bytearray(HEADER), list[tuple[str, str, int]]()
        self._given = given

    def add_all(self, message: str, before: str) -> None:
        for kind, name in _fields(message):
            self._add(kind.removesuffix("[]"), before + CALLED.get(name, name), many=kind.endswith("[]"), before=before)

    def _add(self, kind: str, name: str, *, many: bool, before: str) -> None:
        given = self._given.get(name, () if kind in _OWN or kind == "string" else 0)
        form, width = _numbers(kind)
        if width:
            sizes = [int(given or 0)] * many + [width] * (width > 1)  # type: ignore[arg-type]
            self._place(name, form, sizes, many=many)
        elif many:
            assert isinstance(given, tuple), "names of elements"
            self._length(len(given))
            for element in given:
                self._text(element) if kind == "string" else self.add_all(kind, f"{element}.")
        elif kind == "string":
            self._text(str(given or ""))
        else:
            self.add_all(kind, before if kind == "std_msgs/Header" else f"{name}.")

    def _place(self, name: str, form: str, sizes: list[int], *, many: bool) -> None:
        if many:
            self._length(sizes[0])
        if 0 in sizes:
            return
        size = np.dtype(form).itemsize
        self._align(size)
        shape = f"{tuple(sizes)}" if sizes else ""
        self.fields.append((name, shape + form, len(self.data)))
        self.data += bytes(size * math.prod(sizes))

    def _text(self, value: str) -> None:
        content = value.encode(errors="replace") + b"\0"
        self._length(len(content))
        self.data += content

    def _length(self, value: int) -> None:
        self._align(4)
        self.data += value.to_bytes(4, "little")

    def _align(self, size: int) -> None:
        """CDR aligns from the end of its header."""
        self.data += bytes(-(len(self.data) - len(HEADER)) % size)
