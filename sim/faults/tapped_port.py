"""A port of the emulator whose host can be killed, or can no longer write; what the host sends is kept."""

from hardware.clock import Clock
from hardware.errors import BusError
from sim.emulator.line import Line
from sim.emulator.loopback import EmulatedPort
from sim.faults.wire_packets import READS, Sent, packets


class Killed(BaseException):
    """The host is gone, as by SIGKILL: nothing of it may do anything any more."""


class TappedPort(EmulatedPort):
    """Keeps what the host sends, with the time. mute: writes raise, and what only asks passes; dead: nothing does."""

    def __init__(self, line: Line, clock: Clock, *, name: str, sent: list[Sent]) -> None:
        super().__init__(line, clock, name=name)
        self.mute = self.dead = False
        self._sent = sent

    def write(self, data: bytes) -> None:
        """Send, and keep."""
        self._alive()
        one = Sent(self.now(), data)
        if self.mute and any(packet.instruction not in READS for packet in packets([one])):
            raise BusError("the adapter does not take what is written")
        self._sent.append(one)
        super().write(data)

    def read(self) -> bytes:
        """What has arrived by now."""
        self._alive()
        return super().read()

    def wait(self, deadline: float) -> bool:
        """Sleep until something has arrived (True) or until `deadline`."""
        self._alive()
        return super().wait(deadline)

    def _alive(self) -> None:
        if self.dead:
            raise Killed
