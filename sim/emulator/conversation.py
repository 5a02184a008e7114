"""Who answers an instruction, with which bytes, in which order: the devices of a line, without any time of the wire."""

import random
from collections.abc import Collection, Sequence
from enum import Enum
from functools import lru_cache
from struct import iter_unpack
from typing import NamedTuple

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import BROADCAST, STATUS, Error1, Error2, Frame, Instruction
from hardware.dynamixel.protocol2 import fast_length
from sim.emulator.device import Answer, Device
from sim.emulator.servo2_registers import FedBy

# What a group instruction asks of each device, read from its parameters; what is cut short asks of nobody.


class ReadItem(NamedTuple):
    """One device's part of a group read."""

    id: int
    address: int
    length: int


class WriteItem(NamedTuple):
    """One device's part of a group write."""

    id: int
    address: int
    data: bytes


GROUP_READS2 = frozenset(
    (Instruction.SYNC_READ, Instruction.BULK_READ, Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
)
"""Instructions of protocol 2.0 that many answer in turn."""
FAST_READS = frozenset((Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ))
"""Those of them that are answered by one frame."""
GROUP_READS1 = frozenset((Instruction.BULK_READ,))
"""As GROUP_READS2, of protocol 1.0."""
GROUP_WRITES = frozenset((Instruction.SYNC_WRITE, Instruction.BULK_WRITE))
"""Instructions that many obey and nobody answers (bulk write: 2.0 only)."""
REQUESTS = 64
"""Different read requests that are remembered: a host repeats a few."""


@lru_cache(REQUESTS)
def reads2(code: int, params: bytes) -> tuple[ReadItem, ...]:
    """Parts of a group read of protocol 2.0, in the order of the frame."""
    if code in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        address, length = _word(params, 0), _word(params, 2)
        return tuple(ReadItem(device, address, length) for device in params[4:])
    ends = range(0, len(params) - 4, 5)
    return tuple(ReadItem(params[at], _word(params, at + 1), _word(params, at + 3)) for at in ends)


@lru_cache(REQUESTS)
def reads1(params: bytes) -> tuple[ReadItem, ...]:
    """Parts of a bulk read of protocol 1.0 (00, then length, id, address), in the order of the frame."""
    return tuple(ReadItem(params[at + 1], params[at + 2], params[at]) for at in range(1, len(params) - 2, 3))


def writes2(code: int, params: bytes) -> list[WriteItem]:
    """Parts of a group write of protocol 2.0."""
    if len(params) < 4:
        return []
    if code == Instruction.SYNC_WRITE:
        return _same_registers(params[4:], _word(params, 0), _word(params, 2))
    items, at = [], 0
    while at + 5 <= len(params):
        begin = at + 5
        end = begin + _word(params, at + 3)
        if end > len(params):
            break
        items.append(WriteItem(params[at], _word(params, at + 1), params[begin:end]))
        at = end
    return items


def writes1(params: bytes) -> list[WriteItem]:
    """Parts of a sync write of protocol 1.0."""
    return _same_registers(params[2:], params[0], params[1]) if len(params) >= 2 else []


def _same_registers(rest: bytes, address: int, length: int) -> list[WriteItem]:
    whole = rest[: len(rest) - len(rest) % (length + 1)]
    return [WriteItem(device, address, data) for device, data in iter_unpack(f"B{length}s", whole)]


def _word(params: bytes, at: int) -> int:
    return int.from_bytes(params[at : at + 2], "little")


# Damaged instructions: what a parser drops without a word, though header and length were sound.


def damaged_address(protocol: int, heard: bytes) -> int | None:
    """Return the id that a frame was for which ends `heard` whole, but with a wrong CRC (2.0) or checksum (1.0)."""
    return _address2(heard) if protocol == 2 else _address1(heard)


def complaint(device: Device, now: float) -> Answer | None:
    """Return what a device says of a damaged instruction: the error, beside those that stand in all it says (as in its
    answer to a ping). None at status return level 0, where it answers pings alone."""
    answer = device.execute(Instruction.PING, b"", now, broadcast=False)
    if answer is None or not device.answers_reads:
        return None
    return Answer(answer.error | (Error2.CRC if device.protocol == 2 else Error1.CHECKSUM), b"")


def _address2(heard: bytes) -> int | None:
    at = heard.rfind(protocol2.HEADER)  # stuffing keeps headers out of frames: the last one begins the last frame
    frame = heard[at:] if at >= 0 else b""
    if len(frame) < protocol2.OVERHEAD + 3 or len(frame) != protocol2.OVERHEAD + int.from_bytes(frame[5:7], "little"):
        return None
    return frame[4] if umts(frame[:-2], 0) != int.from_bytes(frame[-2:], "little") else None


def _address1(heard: bytes) -> int | None:
    at = heard.find(protocol1.HEADER)
    frame = heard[at:] if at >= 0 else b""
    if len(frame) < protocol1.OVERHEAD + 2 or len(frame) != protocol1.OVERHEAD + frame[3]:
        return None
    return frame[2] if protocol1.checksum(frame[2:-1]) != frame[-1] else None


class Gaps(Enum):
    """What a missing servo does to those behind it in a group read.

    Each listens for its predecessor's status before it talks (e-Manual, protocol 1.0 bulk read; of 2.0 it only says
    'in order'), so silence is what is inferred, and not verified on hardware.
    """

    SILENCE = "silence"
    """All behind it stay silent; a fast reply stays cut short."""
    SKIP = "skip"
    """Those behind it talk as if it were not in the frame."""


class Spoken(NamedTuple):
    """Bytes of one device. return_delay: its own, s, before it talks; None: it goes on where the last one ended."""

    id: int
    data: bytes
    return_delay: float | None


Turn = tuple[Sequence[Device], ReadItem]
"""Who talks next in a group read (several: of one id), and what it is asked."""


class Conversation:
    """Answers of devices to the sound frames of a line. `noise` makes what two talking at once sound like."""

    def __init__(
        self, *, gaps: Gaps = Gaps.SILENCE, fed_by: FedBy = FedBy.ANY, noise: random.Random | None = None
    ) -> None:
        self._gaps = gaps
        self._fed_by = fed_by
        self._noise = noise or random.Random(0)

    def answers(
        self, frame: Frame, listeners: Sequence[Device], now: float, *, cut: Collection[int] = ()
    ) -> list[Spoken]:
        """All that is said to `frame`, in order. `listeners`: those that hear it, of one protocol; whose watchdogs it
        feeds are told so.

        cut: devices that do not get to talk in group reads.
        """
        everybody = frame.id == BROADCAST or self._fed_by is FedBy.ANY
        for device in listeners if everybody else _of_id(frame.id, listeners):
            device.receive(now)
        if not listeners or (frame.code == STATUS and listeners[0].protocol == 2):
            return []
        if frame.id != BROADCAST:
            return self._addressed(frame, listeners, now)
        second = listeners[0].protocol == 2
        if frame.code in (GROUP_READS2 if second else GROUP_READS1):
            items = reads2(frame.code, frame.params) if second else reads1(frame.params)
            fast = second and frame.code in FAST_READS
            turns = self._turns(items, _able(listeners, frame.code, cut))
            return self._fast(items, turns, now) if fast else self._in_turn(turns, now)
        if frame.code in GROUP_WRITES:
            _write(writes2(frame.code, frame.params) if second else writes1(frame.params), listeners, now)
            return []
        return self._to_all(frame, listeners, now)

    def complaints(self, own: int, listeners: Sequence[Device], now: float) -> list[Spoken]:
        """What devices of id `own` say to an instruction that came damaged."""
        answers = [(device, complaint(device, now)) for device in listeners if device.id == own]
        return self._together(own, [(device, answer) for device, answer in answers if answer is not None])

    def _addressed(self, frame: Frame, listeners: Sequence[Device], now: float) -> list[Spoken]:
        """A frame for one id: its devices answer, those whose secondary id it is obey in silence."""
        said: list[tuple[Device, Answer]] = []
        for device in listeners:
            if device.id == frame.id:
                answer = device.execute(frame.code, frame.params, now, broadcast=False)
                if answer is not None:
                    said.append((device, answer))
            elif device.secondary_id == frame.id:
                device.execute(frame.code, frame.params, now, broadcast=False, secondary=True)
        return self._together(frame.id, said)

    def _to_all(self, frame: Frame, listeners: Sequence[Device], now: float) -> list[Spoken]:
        """A frame for everybody; only a ping is answered, in order of ids."""
        said: dict[int, list[tuple[Device, Answer]]] = {}
        for device in listeners:
            before = device.id
            answer = device.execute(frame.code, frame.params, now, broadcast=True)
            if answer is not None and frame.code == Instruction.PING:
                said.setdefault(before, []).append((device, answer))
        return [spoken for device in sorted(said) for spoken in self._together(device, said[device])]

    def _together(self, device: int, said: Sequence[tuple[Device, Answer]]) -> list[Spoken]:
        """What is heard of all devices of one id: nothing, a status, or the mix of several."""
        frames = [_status(who.protocol, device, answer) for who, answer in said]
        if not frames:
            return []
        delay = min(who.return_delay for who, _ in said)
        return [Spoken(device, frames[0] if len(frames) == 1 else self._mixed(frames), delay)]

    def _mixed(self, frames: Sequence[bytes]) -> bytes:
        """Frames sent at the same time: neither keeps its bytes."""
        longest = max(map(len, frames))
        return self._noise.randbytes(longest)

    def _in_turn(self, turns: Sequence[Turn], now: float) -> list[Spoken]:
        """Sync and bulk read: one status each, in the order of the frame."""
        said: list[Spoken] = []
        for devices, (own, address, length) in turns:
            said += self._together(own, [(who, who.read(address, length, now)) for who in devices])
        return said

    def _fast(self, items: Sequence[ReadItem], turns: Sequence[Turn], now: float) -> list[Spoken]:
        """Fast sync and bulk read: all parts in one frame, not stuffed; the first to talk sends its header, each
        closes its part with the CRC of everything so far (e-Manual, Fast Sync Read)."""
        whole = fast_length([item.length for item in items]) - protocol2.OVERHEAD
        if whole > 0xFFFF:
            return []
        head = protocol2.HEADER + bytes((BROADCAST,)) + whole.to_bytes(2, "little") + bytes((STATUS,))
        total, closing, said = 0, b"", []
        for devices, (own, address, length) in turns:
            error, data = devices[0].read(address, length, now)
            if len(data) != length:
                data = data[:length].ljust(length, b"\0")
            body = head + bytes((error, own)) + data
            total = umts(closing + body, total)
            closing = total.to_bytes(2, "little")
            part = body + closing if len(devices) == 1 else self._mixed([body + closing])
            said.append(Spoken(own, part, devices[0].return_delay if head else None))
            head = b""
        return said

    def _turns(self, items: Sequence[ReadItem], listeners: Sequence[Device]) -> list[Turn]:
        """Who talks in a group read, up to the first device that says nothing; an id counts once."""
        talkers: dict[int, list[Device]] = {}
        for device in listeners:
            if device.answers_reads:
                talkers.setdefault(device.id, []).append(device)
        turns: list[Turn] = []
        for item in items:
            devices = talkers.pop(item.id, None)
            if devices is not None:
                turns.append((devices, item))
            elif self._gaps is Gaps.SILENCE:
                break
        return turns


def _able(listeners: Sequence[Device], code: int, cut: Collection[int]) -> list[Device]:
    """Those who know a group read (old firmware has no fast ones, an AX no bulk read) and get to talk."""
    if listeners[0].protocol == 1:
        able = [who for who in listeners if not who.model.startswith("AX-")]
    else:
        able = [who for who in listeners if who.fast_read] if code in FAST_READS else list(listeners)
    return [who for who in able if who.id not in cut] if cut else able


def _of_id(own: int, listeners: Sequence[Device]) -> list[Device]:
    """Those who have an id as their first or second."""
    return [device for device in listeners if own in (device.id, device.secondary_id)]


def _write(items: Sequence[WriteItem], listeners: Sequence[Device], now: float) -> None:
    """A group write: each device takes its own part; a secondary id's is obeyed as well."""
    parts: dict[int, list[WriteItem]] = {}
    for item in items:
        parts.setdefault(item.id, []).append(item)
    for device in listeners:
        for _, address, data in parts.get(device.id, ()):
            device.write(address, data, now)
        second = device.secondary_id
        if second is not None and second != device.id:
            for _, address, data in parts.get(second, ()):
                device.write(address, data, now, secondary=True)


def _status(protocol: int, device: int, answer: Answer) -> bytes:
    status = protocol2.status if protocol == 2 else protocol1.status
    return status(device, answer.error, answer.data)
