"""ROS 2 messages of fixed size as numpy rows: all messages of a topic are filled and read at once, without a loop.

Within one recording a message never changes its size: names and counts stand still. Its CDR encoding (OMG DDS-XTypes
1.3, 7.4.3, plain CDR, little-endian) is then a structured dtype, in which lengths, names and padding are constants.
"""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[Any]
"""A structured array: one row per message."""

HEADER = b"\x00\x01\x00\x00"
"""Plain CDR, little-endian."""
_KEYS = ("names", "formats", "offsets", "itemsize")
_SIZES = {"bool": "?", "uint8": "u1", "int8": "i1", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8"}


@dataclass(frozen=True, eq=False)
class CdrLayout:
    """The bytes of one message. dtype: its fields where they stand; template: a message in which all fields are 0.

    description: the dtype as JSON, as `numpy.dtype` takes it, which the file holds for its reader.
    """

    dtype: np.dtype[Any]
    template: bytes
    description: str

    def rows(self, count: int) -> Rows:
        """So many messages, (count,), to be filled."""
        return np.frombuffer(bytearray(self.template * count), dtype=self.dtype)


def layout_from(description: str) -> np.dtype[Any]:
    """The dtype of a layout's `description`. Raises ValueError, TypeError or KeyError for what is none."""
    fields = json.loads(description)
    made: np.dtype[Any] = np.dtype({key: fields[key] for key in _KEYS})  # type: ignore[call-overload]
    return made


@dataclass(eq=False)
class CdrBuilder:
    """Lays out a message, field by field, in the order of its definition."""

    _bytes: bytearray = field(default_factory=lambda: bytearray(HEADER))
    _fields: list[tuple[str, str, int]] = field(default_factory=list)

    def text(self, value: str) -> "CdrBuilder":
        """A string that is the same in every message."""
        data = value.encode(errors="replace") + b"\0"
        self._constant(len(data))
        self._bytes += data
        return self

    def texts(self, values: tuple[str, ...]) -> "CdrBuilder":
        """A sequence of such strings."""
        self._constant(len(values))
        for value in values:
            self.text(value)
        return self

    def time(self, name: str = "stamp") -> "CdrBuilder":
        """A builtin_interfaces/Time: fields `name`.sec and `name`.nanosec."""
        return self.scalar(f"{name}.sec", "int32").scalar(f"{name}.nanosec", "uint32")

    def header(self, frame: str) -> "CdrBuilder":
        """A std_msgs/Header."""
        return self.time().text(frame)

    def scalar(self, name: str, kind: str) -> "CdrBuilder":
        """One number of a kind, such as float64."""
        self._place(name, _SIZES[kind], 1)
        return self

    def fixed(self, name: str, kind: str, count: int) -> "CdrBuilder":
        """So many numbers, without a length before them."""
        if count:
            self._place(name, _SIZES[kind], count, shape=f"({count},)")
        return self

    def sequence(self, name: str, kind: str, count: int) -> "CdrBuilder":
        """So many numbers, after their count."""
        self._constant(count)
        return self.fixed(name, kind, count)

    def poses(self, name: str, count: int) -> "CdrBuilder":
        """A sequence of geometry_msgs/Pose: rows of x y z and qx qy qz qw."""
        self._constant(count)
        if count:
            self._place(name, "<f8", 7 * count, shape=f"({count}, 7)")
        return self

    def count(self, value: int) -> "CdrBuilder":
        """The length of a sequence whose elements follow, one by one."""
        self._constant(value)
        return self

    def build(self) -> CdrLayout:
        """The finished layout."""
        fields = {
            "names": [name for name, _, _ in self._fields],
            "formats": [form for _, form, _ in self._fields],
            "offsets": [offset for _, _, offset in self._fields],
            "itemsize": len(self._bytes),
        }
        return CdrLayout(np.dtype(fields), bytes(self._bytes), json.dumps(fields))  # type: ignore[call-overload]

    def _constant(self, value: int) -> None:
        self._align(4)
        self._bytes += value.to_bytes(4, "little")

    def _place(self, name: str, form: str, count: int, *, shape: str = "") -> None:
        size = np.dtype(form).itemsize
        self._align(size)
        self._fields.append((name, shape + form, len(self._bytes)))
        self._bytes += bytes(size * count)

    def _align(self, size: int) -> None:
        """CDR counts from behind its header."""
        self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % size)
