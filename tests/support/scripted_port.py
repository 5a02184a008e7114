"""A port whose answers a test writes down: bytes in, bytes out, virtual time."""

from collections.abc import Callable

from hardware.clock import VirtualClock
from hardware.errors import BusError

Replies = list[tuple[float, bytes]]
"""What comes back, and when, s after the request."""


class ScriptedPort:
    """A `BytePort`; `answer` is called with every request and returns what it brings."""

    def __init__(self, answer: Callable[[bytes], Replies], *, baud: int = 1_000_000, latency: float = 0.001) -> None:
        self.clock = VirtualClock()
        self.sent: list[bytes] = []
        self.looks = 0
        self.name, self.baud, self.latency = "scripted", baud, latency
        self.broken = False
        self._answer = answer
        self._coming: Replies = []

    def open(self, baud: int) -> None:
        self.baud = baud

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def write(self, data: bytes) -> None:
        self._check()
        self.sent.append(data)
        self._coming += [(self.now() + delay, reply) for delay, reply in self._answer(data)]
        self._coming.sort(key=lambda item: item[0])

    def read(self) -> bytes:
        self._check()
        self.looks += 1
        data = b"".join(reply for due, reply in self._coming if due <= self.now())
        self._coming = [item for item in self._coming if item[0] > self.now()]
        return data

    def wait(self, deadline: float) -> bool:
        self._check()
        due = self._coming[0][0] if self._coming else deadline
        self.clock.sleep_until(min(due, deadline))
        return bool(self._coming) and due <= self.now()

    def drop(self) -> None:
        self.read()

    def now(self) -> float:
        return self.clock.now()

    def sleep_until(self, deadline: float) -> None:
        self.clock.sleep_until(deadline)

    def close(self) -> None:
        pass

    def feed(self, data: bytes, after: float = 0.0) -> None:
        """Bytes that arrive without a request."""
        self._coming.append((self.now() + after, data))
        self._coming.sort(key=lambda item: item[0])

    def _check(self) -> None:
        if self.broken:
            raise BusError("scripted: gone.")


def always(*replies: bytes, after: float = 0.0005) -> Callable[[bytes], Replies]:
    """The same answer to everything."""
    return lambda request: [(after, reply) for reply in replies]


def in_turn(*replies: bytes, after: float = 0.0005) -> Callable[[bytes], Replies]:
    """One answer to each request, silence where it is empty and after the last."""
    left = list(replies)
    return lambda request: [(after, left.pop(0))] if left else []
