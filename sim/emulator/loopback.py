"""A line of emulated devices as a port of this process: a host's own driver talks to it on any clock, without a pty."""

from hardware.clock import Clock
from hardware.errors import BusError, describe
from sim.emulator.line import Line


class EmulatedPort:
    """A `hardware.dynamixel.byte_port.BytePort` on a given clock. On a virtual one waiting takes no time, and several
    ports may share it; on a real one waiting sleeps."""

    def __init__(self, line: Line, clock: Clock, *, name: str = "emulator") -> None:
        self._line, self._clock, self._name = line, clock, name
        self._open = False

    @property
    def name(self) -> str:
        """What it was called."""
        return self._name

    @property
    def baud(self) -> int:
        """Bits per second of the host's side."""
        return self._line.baud

    @property
    def latency(self) -> float:
        """Time in s that the emulated adapter keeps what has arrived."""
        return self._line.timing.latency

    def open(self, baud: int) -> None:
        """Open it. Raises BusError when it is open already."""
        if self._open:
            raise BusError(
                describe(what="the port is busy", where=self._name, then="Close what else uses it, then try again")
            )
        self._require_plugged()
        self._open = True
        self._line.baud = _checked(baud, self._name)
        self.drop()

    def set_baud(self, baud: int) -> None:
        """Change the host's speed; the devices keep theirs."""
        self._require("set the baud rate")
        self._line.baud = _checked(baud, self._name)
        self.drop()

    def write(self, data: bytes) -> None:
        """Send; the line hears it now."""
        self._require("write")
        if data:
            self._line.hear(data, self._clock.now())

    def read(self) -> bytes:
        """What has arrived by now."""
        self._require("read")
        return self._line.take(self._clock.now())

    def wait(self, deadline: float) -> bool:
        """Sleep until something has arrived (True) or until `deadline`."""
        self._require("wait")
        due = self._line.next_due
        self._clock.sleep_until(deadline if due is None else min(due, deadline))
        self._require("wait")
        return due is not None and due <= self._clock.now()

    def drop(self) -> None:
        """Forget what has arrived."""
        self._require("drop")
        self._line.take(self._clock.now())

    def now(self) -> float:
        """The clock, s."""
        return self._clock.now()

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`."""
        self._clock.sleep_until(deadline)

    def close(self) -> None:
        """Close it; twice is allowed."""
        self._open = False

    def _require(self, what: str) -> None:
        if not self._open:
            raise BusError(describe(what=f"cannot {what}: the port is closed", where=self._name, then="Open it first"))
        self._require_plugged()

    def _require_plugged(self) -> None:
        if self._line.unplugged(self._clock.now()):
            self._open = False
            raise BusError(
                describe(what="there is no such port", where=self._name, then="Check the adapter and its cable")
            )


def _checked(baud: int, name: str) -> int:
    if baud <= 0:
        raise BusError(describe(what="no such baud rate", where=name, found=baud, allowed="above 0"))
    return baud
