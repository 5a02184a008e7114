"""The replies of the devices on a line to an instruction, in order, without their times on the wire."""

import random
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from struct import iter_unpack
from typing import NamedTuple

from fastcrc.crc16 import umts

from hardware.dynamixel.codec import (
    BROADCAST,
    CODECS,
    STATUS,
    Instruction,
    WireFrame,
    fast_length,
    protocol2,
)
from sim.emulator.device import Answer, Device
from sim.emulator.servo2_registers import FedBy
from sim.emulator.servo_body import BOOT_TIME


class ReadItem(NamedTuple):
    """The part of one device in a group read."""

    id: int
    address: int
    length: int


class WriteItem(NamedTuple):
    """The part of one device in a group write."""

    id: int
    address: int
    data: bytes


GROUP_READS2 = frozenset(
    (Instruction.SYNC_READ, Instruction.BULK_READ, Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
)
"""Instructions of protocol 2.0 that several devices answer in turn."""
FAST_READS = frozenset((Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ))
"""Group reads that are answered by one common frame."""
GROUP_READS1 = frozenset((Instruction.BULK_READ,))
"""Group reads of protocol 1.0."""
GROUP_WRITES = frozenset((Instruction.SYNC_WRITE, Instruction.BULK_WRITE))
"""Instructions for several devices, without answers (bulk write: 2.0 only)."""
REQUESTS = 64
"""Read requests that are cached: a host repeats a few."""


@lru_cache(REQUESTS)
def reads2(code: int, params: bytes) -> tuple[ReadItem, ...]:
    """The parts of a group read of protocol 2.0, in order. A truncated part addresses no device."""
    if code in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        address, length = _word(params, 0), _word(params, 2)
        return tuple(ReadItem(device, address, length) for device in params[4:])
    ends = range(0, len(params) - 4, 5)
    return tuple(ReadItem(params[at], _word(params, at + 1), _word(params, at + 3)) for at in ends)


@lru_cache(REQUESTS)
def reads1(params: bytes) -> tuple[ReadItem, ...]:
    """The parts of a bulk read of protocol 1.0 (00, then length, id, address), in order."""
    return tuple(ReadItem(params[at + 1], params[at + 2], params[at]) for at in range(1, len(params) - 2, 3))


def writes2(code: int, params: bytes) -> list[WriteItem]:
    """The parts of a group write of protocol 2.0."""
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
    """The parts of a sync write of protocol 1.0."""
    return _same_registers(params[2:], params[0], params[1]) if len(params) >= 2 else []


def _same_registers(rest: bytes, address: int, length: int) -> list[WriteItem]:
    whole = rest[: len(rest) - len(rest) % (length + 1)]
    return [WriteItem(device, address, data) for device, data in iter_unpack(f"B{length}s", whole)]


def _word(params: bytes, at: int) -> int:
    return int.from_bytes(params[at : at + 2], "little")


class Gaps(Enum):
    """Effect of a missing servo on those behind it in a group read.

    Each waits for the status of its predecessor (e-Manual, protocol 1.0). Silence is inferred from that, not verified.
    """

    SILENCE = "silence"
    """All behind it are silent; a fast reply is truncated."""
    SKIP = "skip"
    """Those behind it answer as if it were not in the frame."""


@dataclass(frozen=True, slots=True)
class Conduct:
    """Behaviour of servos that the e-Manual leaves open, so that a host can be tested with each possibility.

    fed_by: packets that feed a bus watchdog (2.0). boot_time: s of a start.
    """

    gaps: Gaps = Gaps.SILENCE
    fed_by: FedBy = FedBy.ANY
    boot_time: float = BOOT_TIME


class Reply(NamedTuple):
    """Bytes of one device. return_delay: before they begin, s; None: they follow the previous ones at once."""

    id: int
    data: bytes
    return_delay: float | None


Turn = tuple[Sequence[Device], ReadItem]
"""The devices of the next id in a group read, and its part."""


class Conversation:
    """Replies of devices to the valid frames of a line. noise: generator of the bytes of a collision."""

    def __init__(self, *, conduct: Conduct | None = None, noise: random.Random | None = None) -> None:
        self._conduct = conduct or Conduct()
        self._noise = noise or random.Random(0)

    def answers(
        self, frame: WireFrame, listeners: Sequence[Device], now: float, *, silent: Collection[int] = ()
    ) -> list[Reply]:
        """Return all replies to `frame`, in order, and feed watchdogs.

        listeners: the devices that receive it, of one protocol. silent: ids that do not answer group reads.
        """
        to_all = frame.id == BROADCAST or self._conduct.fed_by is FedBy.ANY
        for device in listeners:
            if to_all or frame.id in (device.id, device.secondary_id):
                device.receive(now)
        if not listeners or (frame.code == STATUS and listeners[0].protocol == 2):
            return []
        if frame.id != BROADCAST:
            return self._addressed(frame, listeners, now)
        second = listeners[0].protocol == 2
        if frame.code in (GROUP_READS2 if second else GROUP_READS1):
            items = reads2(frame.code, frame.params) if second else reads1(frame.params)
            fast = second and frame.code in FAST_READS
            turns = self._turns(items, _able(listeners, frame.code, silent))
            if fast:
                return self._fast(items, turns, now)
            replies_in_turn: list[Reply] = []
            for devices, (own, address, length) in turns:
                replies_in_turn += self._together(own, [(one, one.read(address, length, now)) for one in devices])
            return replies_in_turn
        if frame.code in GROUP_WRITES:
            _write(writes2(frame.code, frame.params) if second else writes1(frame.params), listeners, now)
            return []
        # Only a ping to all is answered, in order of ids.
        replies: dict[int, list[tuple[Device, Answer]]] = {}
        for device in listeners:
            before = device.id
            answer = device.execute(frame.code, frame.params, now, broadcast=True)
            if answer is not None and frame.code == Instruction.PING:
                replies.setdefault(before, []).append((device, answer))
        return [reply for own in sorted(replies) for reply in self._together(own, replies[own])]

    def _addressed(self, frame: WireFrame, listeners: Sequence[Device], now: float) -> list[Reply]:
        """Carry out a frame for one id: its devices answer; those with this secondary id obey without an answer."""
        replies: list[tuple[Device, Answer]] = []
        for device in listeners:
            if device.id == frame.id:
                answer = device.execute(frame.code, frame.params, now, broadcast=False)
                if answer is not None:
                    replies.append((device, answer))
            elif device.secondary_id == frame.id:
                device.execute(frame.code, frame.params, now, broadcast=False, secondary=True)
        return self._together(frame.id, replies)

    def _together(self, device: int, replies: Sequence[tuple[Device, Answer]]) -> list[Reply]:
        """The bytes that arrive from the devices of one id: none, a status, or the mix of several."""
        frames = [CODECS[one.protocol].status(device, answer.error, answer.data) for one, answer in replies]
        if not frames:
            return []
        delay = min(one.return_delay for one, _ in replies)
        return [Reply(device, frames[0] if len(frames) == 1 else self._mixed(frames), delay)]

    def _mixed(self, frames: Sequence[bytes]) -> bytes:
        return self._noise.randbytes(max(map(len, frames)))

    def _fast(self, items: Sequence[ReadItem], turns: Sequence[Turn], now: float) -> list[Reply]:
        """Answer a fast sync or bulk read: all parts in one frame, not stuffed. The first device sends the header, and
        each closes its part with the CRC of all bytes so far (e-Manual, Fast Sync Read)."""
        whole = fast_length([item.length for item in items]) - protocol2.OVERHEAD
        if whole > 0xFFFF:
            return []
        head = protocol2.HEADER + bytes((BROADCAST,)) + whole.to_bytes(2, "little") + bytes((STATUS,))
        total, closing, replies = 0, b"", []
        for devices, (own, address, length) in turns:
            error, data = devices[0].read(address, length, now)
            if len(data) != length:
                data = data[:length].ljust(length, b"\0")
            body = head + bytes((error, own)) + data
            total = umts(closing + body, total)
            closing = total.to_bytes(2, "little")
            part = body + closing if len(devices) == 1 else self._mixed([body + closing])
            replies.append(Reply(own, part, devices[0].return_delay if head else None))
            head = b""
        return replies

    def _turns(self, items: Sequence[ReadItem], listeners: Sequence[Device]) -> list[Turn]:
        """The devices that answer a group read, up to the first silent one; an id counts once."""
        answering: dict[int, list[Device]] = {}
        for device in listeners:
            if device.answers_reads:
                answering.setdefault(device.id, []).append(device)
        turns: list[Turn] = []
        for item in items:
            devices = answering.pop(item.id, None)
            if devices is not None:
                turns.append((devices, item))
            elif self._conduct.gaps is Gaps.SILENCE:
                break
        return turns


def _able(listeners: Sequence[Device], code: int, silent: Collection[int]) -> list[Device]:
    """The devices that answer a group read: old firmware has no fast ones, an AX no bulk read."""
    if listeners[0].protocol == 1:
        able = [device for device in listeners if not device.model.startswith("AX-")]
    else:
        able = [device for device in listeners if device.fast_read] if code in FAST_READS else list(listeners)
    return [device for device in able if device.id not in silent] if silent else able


def _write(items: Sequence[WriteItem], listeners: Sequence[Device], now: float) -> None:
    """Carry out a group write: each device takes its own part, and that of its secondary id."""
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
