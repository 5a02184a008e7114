"""A half-duplex bus segment: bytes of the host in, bytes of its servos out, each at its time on the wire."""

import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hardware.dynamixel.codec import BROADCAST, CODECS, Parser, WireFrame, protocol2
from sim.emulator.conversation import GROUP_READS2, Conduct, Conversation, Reply
from sim.emulator.device import Device
from sim.emulator.fault_state import FaultState

BITS_PER_BYTE = 10.0
"""8N1: a start bit, eight bits, a stop bit."""
REAL_TIME_GAP = 20e-3
"""`LineTiming.gap` for clients in real time, which a busy machine pauses, s."""


@dataclass(frozen=True, slots=True)
class LineTiming:
    """Times of a line, s.

    bits: per byte; 0: bytes take no time. return_delay: share of a servo's Return Delay Time; turnaround: added to it.
    latency: of the adapter towards the host (FTDI: the latency timer). gap: longest pause inside an instruction frame;
    after a longer one servos drop its begin (e-Manual: 1.5 ms).
    """

    bits: float = BITS_PER_BYTE
    return_delay: float = 1.0
    turnaround: float = 20e-6
    latency: float = 1e-3
    gap: float = 1.5e-3

    @staticmethod
    def none() -> "LineTiming":
        """The timing of a line on which nothing takes time."""
        return LineTiming(bits=0.0, return_delay=0.0, turnaround=0.0, latency=0.0)

    @property
    def instant(self) -> bool:
        """True if answers take no time on the wire."""
        return not (self.bits or self.return_delay or self.turnaround)

    def on_wire(self, count: int, baud: int) -> float:
        """The time of `count` bytes, s."""
        return self.bits * count / baud


class Chunk(NamedTuple):
    """Bytes that reach the host at `due`, s."""

    due: float
    data: bytes


MAX_WAITING = 1 << 16
"""Most bytes that wait for a host which does not read; further ones are lost, as in a real adapter."""
BAUD_TOLERANCE = 0.03
"""Share by which two baud rates may differ and bytes are still decoded."""


class Line:
    """Devices on one pair of wires, and the adapter between them and the host.

    Frames are carried out when they are received, with the time of their last byte on the wire. connected: devices on
    the wires. baud: of the host's adapter, bits/s. servos_free: when the servos' last byte is on the wire, s. lost:
    bytes that were dropped because the host did not read.
    """

    def __init__(
        self,
        devices: Sequence[Device],
        *,
        baud: int = 57600,
        timing: LineTiming | None = None,
        conduct: Conduct | None = None,
        faults: FaultState | None = None,
        seed: int = 0,
    ) -> None:
        self.devices = tuple(devices)
        self.connected = self.devices
        self.faults = faults or FaultState(devices, seed=seed)
        self.baud = baud
        self.timing = timing or LineTiming()
        self.lost = 0
        self._noise = random.Random(seed)
        self._conversation = Conversation(conduct=conduct, noise=self._noise)
        self._parsers: dict[int, Parser] = {
            protocol: CODECS[protocol].parser() for protocol in {device.protocol for device in devices}
        }
        self._waiting: deque[Chunk] = deque()  # by due time
        self._size = 0  # bytes waiting
        self._host_free = float("-inf")  # [s] when the host's last byte is on the wire
        self._last_received = float("-inf")  # [s] when the last one reached the devices
        self.servos_free = float("-inf")

    @property
    def next_due(self) -> float | None:
        """Time at which the next bytes arrive at the host, s; None: no bytes are on the wire."""
        return self._waiting[0].due if self._waiting else None

    def last_due_within(self, span: float) -> float | None:
        """Return when the last bytes arrive that come within `span` s of the next ones, s."""
        if not self._waiting:
            return None
        first = self._waiting[0].due
        return max(chunk.due for chunk in self._waiting if chunk.due - first <= span)

    def take(self, now: float) -> bytes:
        """The bytes that have arrived at the host by `now` since the last call."""
        out = []
        while self._waiting and self._waiting[0].due <= now:
            out.append(self._waiting.popleft().data)
        data = b"".join(out)
        self._size -= len(data)
        return data

    def receive(self, data: bytes, now: float) -> None:
        """Put bytes on the wire that the host passes to its adapter at `now`, s."""
        start = max(now, self._host_free)
        for piece in pieces(data):
            self.faults.update(start)
            end = start + self.timing.on_wire(len(piece), self.baud)
            if self.faults.echo:
                self._arrive(piece, end + self.timing.latency)
            if self.faults.dead:
                self._arrive(self.faults.garbage(), end + self.timing.latency)
            elif start < self.servos_free:
                # The host sends while servos do: they do not receive it, and it gets noise from then on.
                for index, chunk in enumerate(self._waiting):
                    if chunk.due > start + self.timing.latency:
                        self._waiting[index] = Chunk(chunk.due, self._noise.randbytes(len(chunk.data)))
            else:
                end = max(end, self._carry(piece, start))
            start = end
        self._host_free = start

    def unplugged(self, now: float) -> bool:
        """Return whether the adapter is unplugged; then all bytes on the wire are lost."""
        self.faults.update(now)
        if self.faults.unplugged:
            self._waiting.clear()
            self._size = 0
            for parser in self._parsers.values():
                parser.reset()
        return self.faults.unplugged

    def _carry(self, piece: bytes, start: float) -> float:
        """Pass a piece with its faults to the devices, from `start` on; return its end, s."""
        at = start
        for part in self.faults.to_servos(piece):
            at += part.delay
            if at - self._last_received > self.timing.gap:
                for parser in self._parsers.values():
                    parser.reset()
            self._last_received = at = at + self.timing.on_wire(len(part.data), self.baud)
            for protocol, parser in self._parsers.items():
                for frame in parser.feed(part.data):
                    self._execute(protocol, frame, at)
        return at

    def _execute(self, protocol: int, frame: WireFrame, end: float) -> None:
        # Only devices that are awake and at the baud rate of the host receive it.
        lowest, highest = self.baud * (1.0 - BAUD_TOLERANCE), self.baud * (1.0 + BAUD_TOLERANCE)
        listeners = [
            device
            for device in self.connected
            if device.protocol == protocol and lowest <= device.baud <= highest and not device.booting(end)
        ]
        if frame.code in GROUP_READS2 and frame.id == BROADCAST:
            self.faults.count_cycle()
            self.faults.update(end)
        missing = self.faults.missing
        if missing:
            listeners = [device for device in listeners if device.id not in missing]
        replies = self._conversation.answers(frame, listeners, end, silent=self.faults.silent_tail)
        if replies:
            self._send_replies(replies, end)

    def _send_replies(self, replies: Sequence[Reply], end: float) -> None:
        timing, faults = self.timing, self.faults
        at = max(end, self.servos_free)
        if timing.instant and not faults.spoil:
            self.servos_free = at
            self._arrive(b"".join([reply.data for reply in replies]), at + timing.latency)
            return
        for reply in replies:
            if reply.return_delay is not None:
                at += timing.return_delay * reply.return_delay + timing.turnaround
            at += timing.on_wire(len(reply.data), self.baud)
            late = timing.latency
            if not faults.spoil:
                self._arrive(reply.data, at + late)
                continue
            for part in faults.to_host(reply.id, reply.data):
                late += part.delay
                self._arrive(part.data, at + late)
        self.servos_free = at

    def _arrive(self, data: bytes, due: float) -> None:
        if self._size + len(data) > MAX_WAITING or not data:
            self.lost += len(data)
            return
        if self._waiting:
            due = max(due, self._waiting[-1].due)  # bytes never overtake
        self._waiting.append(Chunk(due, data))
        self._size += len(data)


def pieces(data: bytes) -> list[bytes]:
    """Split before each header of protocol 2.0: stuffing keeps headers out of frames."""
    before, *framed = data.split(protocol2.HEADER)
    return ([before] if before or not framed else []) + [protocol2.HEADER + rest for rest in framed]
