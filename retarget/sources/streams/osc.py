"""Open Sound Control 1.0 (opensoundcontrol.org/spec-1_0): the messages of one datagram, with bundles flattened."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import nan
from struct import Struct
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from retarget.sources.streams.stream_frame import MAX_DATAGRAM, TOO_LONG
from retarget.types import FloatArray

MAX_BUNDLE_DEPTH = 4
"""Most nested bundles, the outermost counted."""
MAX_MESSAGES = 512
"""Most messages of one datagram. SlimeVR sends 35; bones, fingers and expressions are 200."""
MAX_ARGUMENTS = 256
"""Most arguments of one message."""
MAX_ARGUMENTS_IN_ALL = 4096
"""Most arguments of one datagram. SlimeVR sends 266; 256 poses are 2,048."""

TOO_DEEP = "OSC bundles nested deeper than 4"
TOO_MANY = "more than 512 OSC messages in one datagram"
BAD_SIZE = "size of an OSC element does not fit its datagram"
NO_ADDRESS = "OSC message without an address"
NO_TAGS = "OSC message without type tags"
MANY_ARGUMENTS = "OSC message with more than 256 arguments"
TOO_MANY_ARGUMENTS = "more than 4096 OSC arguments in one datagram"
UNKNOWN_TAG = "OSC argument of an unknown type"
CUT_SHORT = "OSC message that ends before its arguments do"
NOT_TEXT = "OSC text that is not UTF-8"
UNKNOWN_ADDRESS = "OSC address that is not used"

_BUNDLE = b"#bundle\0"
_SIZE = Struct(">i")
_NUMBERS = dict(zip("ifcrmhdt", (4, 4, 4, 4, 4, 8, 8, 8), strict=True))
"""Bytes by tag of a number: int32, float32, character, colour, MIDI, int64, float64, time tag."""
_NO_BYTES = "TFNI[]"
"""Tags without bytes: true, false, nil, infinitum, the ends of an array."""
_READ = {"i": Struct(">i"), "f": Struct(">f"), "h": Struct(">q"), "d": Struct(">d")}
_TRUTH = {"T": 1.0, "F": 0.0}
"""Numbers by tag: senders without types send 0 and 1 as integers or booleans."""
MAX_NUMBER = float(np.finfo(np.float32).max)
"""Largest magnitude of a number: that of float32, so that squares stay finite."""

Number = tuple[str, int]
"""Tag of a number, and its first byte in the datagram."""


@dataclass(frozen=True, slots=True)
class OscMessage:
    """One message. tags: one letter per argument. at: first byte of each argument. text: the first text argument."""

    address: str
    tags: str
    at: tuple[int, ...]
    text: str = ""

    def numbers(self, first: int, count: int) -> tuple[Number, ...]:
        """The arguments first to first + count; none if there are fewer, or one is no number."""
        tags = self.tags[first : first + count]
        if len(tags) < count or not (_READ.keys() | _TRUTH.keys()).issuperset(tags):
            return ()
        return tuple(zip(tags, self.at[first : first + count], strict=True))


@dataclass(slots=True)
class OscPacket:
    """Content of one datagram.

    messages: in wire order. time_tags: first byte of the time tag of each bundle (known senders send "immediately").
    dropped: a constant reason for each unreadable part; if sizes do not fit or a limit is exceeded, there are no
    messages. arguments: number decoded.
    """

    messages: list[OscMessage] = field(default_factory=list)
    time_tags: list[int] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    arguments: int = field(default=0, compare=False)

    def variable(self) -> list[tuple[int, int]]:
        """Byte ranges [first, last) that may differ within one layout: numbers and time tags."""
        sent = [place for message in self.messages for place in zip(message.tags, message.at, strict=True)]
        numbers = [(at, at + _NUMBERS[tag]) for tag, at in sent if tag in _NUMBERS]
        return numbers + [(at, at + 8) for at in self.time_tags]


class _Unreadable(Exception):
    """The text is a constant reason."""


def read_osc(datagram: bytes) -> OscPacket:
    """The messages of one datagram. Never raises: see `OscPacket.dropped`."""
    packet = OscPacket()
    if len(datagram) > MAX_DATAGRAM:
        return OscPacket(dropped=[TOO_LONG])
    try:
        _element(datagram, 0, len(datagram), 1, packet)
    except _Unreadable as error:
        return OscPacket(dropped=[str(error)], arguments=packet.arguments)
    return packet


def _element(data: bytes, start: int, end: int, depth: int, packet: OscPacket) -> None:
    """Read a message, or a bundle: `#bundle`, a time tag, then elements, each after its size. Raises _Unreadable."""
    if end - start < 4 or (end - start) % 4:
        raise _Unreadable(BAD_SIZE)
    if not data.startswith(_BUNDLE, start, end):
        if len(packet.messages) + len(packet.dropped) >= MAX_MESSAGES:
            raise _Unreadable(TOO_MANY)
        try:
            packet.messages.append(_message(data, start, end, packet))
        except _Unreadable as error:
            packet.dropped.append(str(error))
        if packet.arguments > MAX_ARGUMENTS_IN_ALL:
            raise _Unreadable(TOO_MANY_ARGUMENTS)
        return
    if depth > MAX_BUNDLE_DEPTH:
        raise _Unreadable(TOO_DEEP)
    at = start + 16
    if at > end:
        raise _Unreadable(BAD_SIZE)
    packet.time_tags.append(start + 8)
    while at < end:
        size = _SIZE.unpack_from(data, at)[0]  # within the data: all sizes are multiples of four
        at += 4
        if not 0 < size <= end - at:
            raise _Unreadable(BAD_SIZE)
        _element(data, at, at + size, depth + 1, packet)
        at += size


def _message(data: bytes, start: int, end: int, packet: OscPacket) -> OscMessage:
    if data[start] != 0x2F:
        raise _Unreadable(NO_ADDRESS)
    address, at = _text(data, start, end)
    if at >= end or data[at] != 0x2C:
        raise _Unreadable(NO_TAGS)
    tags, at = _text(data, at, end)
    if len(tags) > MAX_ARGUMENTS + 1:
        raise _Unreadable(MANY_ARGUMENTS)
    packet.arguments += len(tags) - 1
    places: list[int] = []
    texts: list[str] = []
    for tag in tags[1:]:
        places.append(at)
        if tag in "sS":
            text, at = _text(data, at, end)
            texts.append(text)
        elif tag == "b":  # a blob: its size, then as many bytes, padded to four
            if at + 4 > end:
                raise _Unreadable(CUT_SHORT)
            size = _SIZE.unpack_from(data, at)[0]
            if not 0 <= size <= end - at - 4:
                raise _Unreadable(CUT_SHORT)
            at = (at + 4 + size + 3) & ~3
        elif tag in _NUMBERS or tag in _NO_BYTES:
            at += _NUMBERS.get(tag, 0)
            if at > end:
                raise _Unreadable(CUT_SHORT)
        else:
            raise _Unreadable(UNKNOWN_TAG)
    return OscMessage(address, tags[1:], tuple(places), next(iter(texts), ""))


def _text(data: bytes, at: int, end: int) -> tuple[str, int]:
    """A text with a NUL at its end, and the byte after its padding to four."""
    zero = data.find(b"\0", at, end)
    if zero < 0:
        raise _Unreadable(CUT_SHORT)
    try:
        text = data[at:zero].decode()
    except UnicodeDecodeError:
        raise _Unreadable(NOT_TEXT) from None
    return text, (zero + 4) & ~3  # within `end`, which is a multiple of four


def number_in(datagram: bytes, number: Number) -> float:
    """A number of any type; NaN beyond MAX_NUMBER."""
    tag, at = number
    if tag in _TRUTH:
        return _TRUTH[tag]
    value = float(_READ[tag].unpack_from(datagram, at)[0])
    return value if abs(value) <= MAX_NUMBER else nan


class OscNumbers:
    """Numbers of any type at known places of a datagram, read together."""

    def __init__(self, numbers: Iterable[Number]) -> None:
        self._numbers = tuple(numbers)
        self._words: NDArray[np.intp] | None = None
        """If all are float32: their indices among the 32-bit words of the datagram."""
        if all(tag == "f" for tag, _ in self._numbers):
            self._words = np.array([at // 4 for _, at in self._numbers], np.intp)

    def read(self, datagram: bytes) -> FloatArray:
        """The numbers (n,)."""
        if self._words is None:
            return np.array([number_in(datagram, number) for number in self._numbers])
        with np.errstate(invalid="ignore"):
            return np.frombuffer(datagram, ">f4").take(self._words).astype(np.float64)


MAX_REMEMBERED = 16_384
"""Bytes of the longest datagram whose layout is kept: all bones, fingers and expressions of an avatar."""
MAX_LENGTHS = 32
"""Most lengths of datagrams with kept layouts; one more clears all."""
MAX_ALIKE = 16
"""Most layouts of one length, the latest first: an avatar sent bone by bone has 10."""

Plan = TypeVar("Plan")


class OscLayouts(Generic[Plan]):
    """Cache of plans: datagrams that differ only in their numbers are parsed once. `plan` must not use the numbers."""

    def __init__(self, plan: Callable[[OscPacket], Plan]) -> None:
        self._make = plan
        self._known: dict[int, list[tuple[NDArray[np.uint32], bytes, Plan]]] = {}
        """By length: a mask of the bits that are no numbers, these bits, and the plan."""

    def of(self, datagram: bytes) -> Plan:
        """The plan of this datagram's layout."""
        length = len(datagram)
        for mask, fixed, plan in self._known.get(length, ()):
            if (np.frombuffer(datagram, np.uint32) & mask).tobytes() == fixed:
                return plan
        packet = read_osc(datagram)
        plan = self._make(packet)
        if packet.messages and length <= MAX_REMEMBERED:
            mask = np.full(length // 4, 0xFFFFFFFF, np.uint32)
            for start, end in packet.variable():
                mask[start // 4 : end // 4] = 0
            if length not in self._known and len(self._known) >= MAX_LENGTHS:
                self._known.clear()
            alike = self._known.setdefault(length, [])
            alike.insert(0, (mask, (np.frombuffer(datagram, np.uint32) & mask).tobytes(), plan))
            del alike[MAX_ALIKE:]
        return plan

    def __len__(self) -> int:
        return sum(len(alike) for alike in self._known.values())
