"""Open Sound Control 1.0 (opensoundcontrol.org/spec-1_0): the messages of one datagram, bundles taken apart."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import nan
from struct import Struct
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from retarget.sources.streams.stream_frame import MAX_DATAGRAM
from retarget.types import FloatArray

MAX_DEPTH = 4
"""Bundles within bundles that are taken apart, the outermost counted."""
MAX_MESSAGES = 512
"""Messages of one datagram; one with more is dropped. SlimeVR sends 35; bones, fingers and expressions are 200."""
MAX_ARGUMENTS = 256
"""Arguments of one message; one with more is dropped."""
MAX_ARGUMENTS_IN_ALL = 4096
"""Arguments of one datagram; one with more is dropped. SlimeVR sends 266, 256 poses are 2,048."""

TOO_LONG = "datagram longer than 64 KiB"
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

_BUNDLE = b"#bundle\0"
_SIZE = Struct(">i")
_NUMBERS = dict(zip("ifcrmhdt", (4, 4, 4, 4, 4, 8, 8, 8), strict=True))
"""Bytes by tag of a number: int32, float32, character, colour, MIDI, int64, float64, time tag."""
_NO_BYTES = "TFNI[]"
"""Tags that take no bytes: true, false, nil, infinitum, the ends of an array."""
_READ = {"i": Struct(">i"), "f": Struct(">f"), "h": Struct(">q"), "d": Struct(">d")}
_TRUTH = {"T": 1.0, "F": 0.0}
"""Numbers by tag: libraries without types send 0 and 1 as integers or truths, and others as doubles."""
MAX_NUMBER = float(np.finfo(np.float32).max)
"""Largest magnitude of a number: that of a float32, so that squares stay finite."""

Number = tuple[str, int]
"""Tag of a number, and the byte of the datagram where it begins."""


@dataclass(frozen=True, slots=True)
class OscMessage:
    """One message. tags: one letter an argument, without the comma. at: where each argument begins in the datagram.
    text: the first argument that is one, "" without."""

    address: str
    tags: str
    at: tuple[int, ...]
    text: str = ""

    def numbers(self, first: int, count: int) -> tuple[Number, ...]:
        """The arguments first to first + count; none where there are fewer, or one is no number."""
        tags = self.tags[first : first + count]
        if len(tags) < count or not (_READ.keys() | _TRUTH.keys()).issuperset(tags):
            return ()
        return tuple(zip(tags, self.at[first : first + count], strict=True))


@dataclass(slots=True)
class OscPacket:
    """Content of one datagram.

    messages: in the order of the wire. time_tags: first byte of the time tag of each bundle (they carry no time: every
    known sender writes "immediately"). dropped: a constant reason for each part that could not be read. A datagram
    whose sizes do not fit, or that exceeds a limit, has no messages at all: a part of it may be missing. arguments: how
    many were decoded, dropped ones included.
    """

    messages: list[OscMessage] = field(default_factory=list)
    time_tags: list[int] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    arguments: int = field(default=0, compare=False)

    def variable(self) -> list[tuple[int, int]]:
        """Bytes of the datagram that may differ within one layout, numbers and time tags: the first byte of each, and
        the one after its last."""
        sent = [place for message in self.messages for place in zip(message.tags, message.at, strict=True)]
        numbers = [(at, at + _NUMBERS[tag]) for tag, at in sent if tag in _NUMBERS]
        return numbers + [(at, at + 8) for at in self.time_tags]


class _Unreadable(Exception):
    """This message, or the whole datagram, cannot be read; the reason is a constant."""


def read_osc(datagram: bytes) -> OscPacket:
    """Take one datagram apart. Never raises: see `OscPacket.dropped`."""
    packet = OscPacket()
    if len(datagram) > MAX_DATAGRAM:
        return OscPacket(dropped=[TOO_LONG])
    try:
        _element(datagram, 0, len(datagram), 1, packet)
    except _Unreadable as error:
        return OscPacket(dropped=[str(error)], arguments=packet.arguments)
    return packet


def _element(data: bytes, start: int, end: int, depth: int, packet: OscPacket) -> None:
    """A message or a bundle. Raises _Unreadable where sizes do not fit or a bound is passed."""
    if end - start < 4 or (end - start) % 4:
        raise _Unreadable(BAD_SIZE)
    if data.startswith(_BUNDLE, start, end):
        _bundle(data, start, end, depth, packet)
        return
    if len(packet.messages) + len(packet.dropped) >= MAX_MESSAGES:
        raise _Unreadable(TOO_MANY)
    try:
        packet.messages.append(_message(data, start, end, packet))
    except _Unreadable as error:
        packet.dropped.append(str(error))
    if packet.arguments > MAX_ARGUMENTS_IN_ALL:
        raise _Unreadable(TOO_MANY_ARGUMENTS)


def _bundle(data: bytes, start: int, end: int, depth: int, packet: OscPacket) -> None:
    """`#bundle`, a time tag, then elements, each behind its size."""
    if depth > MAX_DEPTH:
        raise _Unreadable(TOO_DEEP)
    at = start + 16
    if at > end:
        raise _Unreadable(BAD_SIZE)
    packet.time_tags.append(start + 8)
    while at < end:
        size = _SIZE.unpack_from(data, at)[0]  # four bytes are there: every size so far is a multiple of four
        at += 4
        if not 0 < size <= end - at:
            raise _Unreadable(BAD_SIZE)
        _element(data, at, at + size, depth + 1, packet)
        at += size


def _message(data: bytes, start: int, end: int, packet: OscPacket) -> OscMessage:
    """Address, type tags, arguments; what follows the last argument is not looked at."""
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
        else:
            at = _behind(data, at, end, tag)
    return OscMessage(address, tags[1:], tuple(places), next(iter(texts), ""))


def _behind(data: bytes, at: int, end: int, tag: str) -> int:
    """Where the argument behind a number, a blob (its size, and as many bytes, padded to four) or nothing begins."""
    if tag == "b":
        if at + 4 > end:
            raise _Unreadable(CUT_SHORT)
        size = _SIZE.unpack_from(data, at)[0]
        after = (at + 4 + size + 3) & ~3
        if not 0 <= size <= end - at - 4:
            raise _Unreadable(CUT_SHORT)
        return int(after)
    if tag not in _NUMBERS and tag not in _NO_BYTES:
        raise _Unreadable(UNKNOWN_TAG)
    after = at + _NUMBERS.get(tag, 0)
    if after > end:
        raise _Unreadable(CUT_SHORT)
    return after


def _text(data: bytes, at: int, end: int) -> tuple[str, int]:
    """A text that a zero ends, padded to four bytes."""
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
        """Where all are float32, as mostly: their indices among the 32-bit words of the datagram."""
        if all(tag == "f" for tag, _ in self._numbers):
            self._words = np.array([at // 4 for _, at in self._numbers], np.intp)

    def read(self, datagram: bytes) -> FloatArray:
        """Return them (n,). A signalling NaN raises no warning."""
        if self._words is None:
            return np.array([number_in(datagram, number) for number in self._numbers])
        with np.errstate(invalid="ignore"):
            return np.frombuffer(datagram, ">f4").take(self._words).astype(np.float64)


# Datagrams that differ in their numbers only are taken apart once: a sender's next one mostly looks like its last.

MAX_REMEMBERED = 16_384
"""Bytes of the longest datagram whose layout is remembered: all the bones, fingers and expressions of an avatar."""
MAX_LENGTHS = 32
"""Lengths of datagrams that are remembered; all are forgotten when one more comes."""
MAX_ALIKE = 16
"""Layouts remembered of one length, the latest first: of an avatar that is sent bone by bone, 10 are of one length."""

Plan = TypeVar("Plan")


class OscLayouts(Generic[Plan]):
    """Plans by the layout of a datagram: `plan` is asked once for each layout, and must not look at its numbers."""

    def __init__(self, plan: Callable[[OscPacket], Plan]) -> None:
        self._make = plan
        self._known: dict[int, list[tuple[NDArray[np.uint32], bytes, Plan]]] = {}
        """By length: which bits of a datagram are no numbers, these bits, and the plan of the layout."""

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
