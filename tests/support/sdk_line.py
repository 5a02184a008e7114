"""The SDK's own port over a line in memory."""

import itertools

import pytest
from dynamixel_sdk import PortHandler


class FakeLine:
    """The pyserial object behind the SDK's own port: one answer to each request."""

    def __init__(self, *answers: bytes) -> None:
        self.answers = list(answers)
        self.sent: list[bytes] = []
        self.coming = b""
        self.reads = self.drained = 0
        self.broken = False

    def write(self, packet: list[int]) -> int:
        if self.broken:
            raise OSError(5, "Input/output error")
        self.sent.append(bytes(packet))
        self.coming += self.answers.pop(0) if self.answers else b""
        return len(packet)

    def read(self, length: int) -> bytes:
        self.reads += 1
        data, self.coming = self.coming[:length], self.coming[length:]
        return data

    def reset_input_buffer(self) -> None:
        self.coming = b""

    def flush(self) -> None:
        self.drained += 1


def sdk_over(line: FakeLine, monkeypatch: pytest.MonkeyPatch, *, tick_ms: float = 0.05) -> PortHandler:
    """The SDK's own port over a fake line; every look at its clock takes `tick_ms`."""
    port = PortHandler("fake")
    port.ser, port.is_open, port.tx_time_per_byte = line, True, 10_000.0 / 1_000_000
    ticks = itertools.count()
    monkeypatch.setattr(port, "getCurrentTime", lambda: next(ticks) * tick_ms)
    return port
