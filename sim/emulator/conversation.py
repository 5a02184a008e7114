"""Who answers an instruction, with which bytes, in which order: the devices of a line, without any time of the wire."""

import random
from collections.abc import Collection, Sequence
from enum import Enum
from typing import NamedTuple

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.fast_status import fast_length
from hardware.dynamixel.packets import BROADCAST, STATUS, Frame, Instruction
from sim.emulator.damage import complaint
from sim.emulator.device import Answer, Device
from sim.emulator.group_request import (
    FAST_READS,
    GROUP_READS1,
    GROUP_READS2,
    GROUP_WRITES,
    ReadItem,
    WriteItem,
    reads1,
    reads2,
    writes1,
    writes2,
)
from sim.emulator.watchdog import FedBy


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
            device.hear(now)
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
