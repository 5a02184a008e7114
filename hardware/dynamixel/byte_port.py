"""A line of bytes to servos, and the way to it: a serial adapter, or an emulator in this process."""

from typing import Protocol


class BytePort(Protocol):
    """Half-duplex bytes with a clock. Every method raises BusError when the port is gone."""

    @property
    def name(self) -> str:
        """What a person calls it: the device's path."""
        ...

    @property
    def baud(self) -> int:
        """Bits per second; ten of them carry a byte."""
        ...

    @property
    def latency(self) -> float:
        """Longest time, s, that the adapter keeps what has arrived (FTDI: the latency timer)."""
        ...

    def open(self, baud: int) -> None:
        """Open it, for this process alone. Raises BusError: no such port, busy, not permitted, no such baud rate."""
        ...

    def set_baud(self, baud: int) -> None:
        """Change the speed; what had arrived is dropped."""
        ...

    def write(self, data: bytes) -> None:
        """Send; returns before the bytes are on the wire."""
        ...

    def read(self) -> bytes:
        """What has arrived, maybe nothing. Never waits."""
        ...

    def wait(self, deadline: float) -> bool:
        """Sleep until something has arrived (True) or until `deadline`, s on the clock."""
        ...

    def drop(self) -> None:
        """Forget what has arrived."""
        ...

    def now(self) -> float:
        """Monotonic s: the clock that deadlines are on."""
        ...

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, in s."""
        ...

    def close(self) -> None:
        """Close it; twice is allowed."""
        ...
