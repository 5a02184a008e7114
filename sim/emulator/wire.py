"""Time on the wire: how long bytes take, when a servo begins to talk, when the host gets to see it."""

from dataclasses import dataclass
from typing import NamedTuple

BITS_PER_BYTE = 10.0
"""8N1: a start bit, eight bits, a stop bit."""
REAL_TIME_GAP = 20e-3
"""`Timing.gap` for clients in real time, s: a busy machine pauses a client for longer than any servo would wait."""


@dataclass(frozen=True, slots=True)
class Timing:
    """A line's times, in s.

    bits: per byte on the wire; 0: bytes take no time. return_delay: share of each servo's own Return Delay Time that
    passes before its status. turnaround: what a servo needs beside that. latency: how long the adapter keeps a byte
    that has arrived before the host sees it (FTDI: the latency timer). gap: longest pause between two bytes of one
    instruction frame; after a longer one servos drop what they have heard of it (e-Manual: 1.5 ms).
    """

    bits: float = BITS_PER_BYTE
    return_delay: float = 1.0
    turnaround: float = 20e-6
    latency: float = 1e-3
    gap: float = 1.5e-3

    @staticmethod
    def none() -> "Timing":
        """A line on which nothing takes time: for logic, and for what the host itself costs."""
        return Timing(bits=0.0, return_delay=0.0, turnaround=0.0, latency=0.0)

    @property
    def instant(self) -> bool:
        """Whether answers take no time on the wire."""
        return not (self.bits or self.return_delay or self.turnaround)

    def on_wire(self, count: int, baud: int) -> float:
        """Time of `count` bytes in s."""
        return self.bits * count / baud

    def before_status(self, return_delay: float) -> float:
        """Time in s from the end of what a servo waits for to its first bit; `return_delay`: its own, s."""
        return self.return_delay * return_delay + self.turnaround


class Chunk(NamedTuple):
    """Bytes that the host gets to see at `due`, s."""

    due: float
    data: bytes
