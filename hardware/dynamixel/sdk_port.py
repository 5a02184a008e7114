"""What dynamixel-sdk's packet handlers need of a port, over a `BytePort`; and its handlers, with stuffing mended.

The SDK's own port polls, waits 34 ms and more for what never comes, and stays "in use" for ever after an exception.
"""

from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler

from hardware.dynamixel import protocol2
from hardware.dynamixel.byte_port import BytePort

SLACK = 0.004
"""[s] That this machine, the adapter's driver or the servo may be late."""
SPARE_BYTES = 8
"""The SDK asks for the shortest answer's time; a ping's answer is longer."""
_LENGTH_AT, _BODY_AT = 5, 7


class SdkPort:
    """The SDK's PortHandler as its packet handlers see it. Reads sleep; deadlines are of the port's own clock.

    Bytes equal to what was just sent are the echo of a half-duplex adapter: dropped. (In protocol 1.0 a status can
    equal its instruction; `echoed` tells that this may have happened.)
    """

    def __init__(self, port: BytePort, *, return_delay: float) -> None:
        self._port, self._return_delay = port, return_delay
        self._held = bytearray()
        self._sent = b""
        self._unconfirmed = b""
        self._deadline = 0.0
        self._last_look = False
        self.slack = SLACK
        """Time, s, added to what the bytes, the adapter and the servo need."""
        self.echoed = False
        """Whether what was last sent came back."""
        self.heard = 0
        """Bytes that arrived since the last instruction, its echo left out."""

    @property
    def is_using(self) -> bool:
        """Never: the SDK's flag outlives exceptions and is no lock; who shares a port locks it himself."""
        return False

    @is_using.setter
    def is_using(self, value: bool) -> None:
        pass

    def getBaudRate(self) -> int:
        """Bits per second."""
        return self._port.baud

    def clearPort(self) -> None:
        """Forget what has arrived."""
        self._held.clear()
        self._port.drop()

    def writePort(self, packet: list[int]) -> int:
        """Send; the number of bytes."""
        self._sent = self._unconfirmed = bytes(packet)
        self.echoed, self.heard = False, 0
        self._port.write(self._sent)
        return len(self._sent)

    def readPort(self, length: int) -> bytes:
        """At most `length` bytes; waits for the first of them, until the deadline at most."""
        if length <= 0:
            return b""
        while not self._held or self._may_be_echo():
            if self._last_look:
                break
            self._port.wait(self._deadline)
            self._last_look = self._port.now() >= self._deadline
            arrived = self._port.read()
            self._held += arrived
            self.heard += len(arrived)
        if self._unconfirmed and self._held == self._unconfirmed:
            self._drop_echo()
        data = bytes(self._held[:length])
        del self._held[:length]
        return data

    def setPacketTimeout(self, packet_length: int) -> None:
        """Wait for an answer of so many bytes, to what was just sent."""
        count = len(self._sent) + packet_length + SPARE_BYTES
        self._set_deadline(10 * count / self._port.baud + self._return_delay + self._port.latency + self.slack)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Wait for so many ms."""
        self._set_deadline(msec / 1000)

    def isPacketTimeout(self) -> bool:
        """Whether the deadline has passed."""
        return self._port.now() >= self._deadline

    def _set_deadline(self, duration: float) -> None:
        self._deadline = self._port.now() + duration
        self._last_look = False

    def _may_be_echo(self) -> bool:
        """Whether more bytes must tell what is held: an echo so far, or the whole echo and nothing behind it."""
        if not self._unconfirmed or self._unconfirmed.startswith(self._held):
            return bool(self._unconfirmed)
        if self._held.startswith(self._unconfirmed):
            self._drop_echo()
        self._unconfirmed = b""
        return False

    def _drop_echo(self) -> None:
        del self._held[: len(self._unconfirmed)]
        self.heard -= len(self._unconfirmed)
        self.echoed = True
        self._unconfirmed = b""


class MendedProtocol2(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's handler, with byte stuffing that reaches the wire and removes what was added, no more."""

    def addStuffing(self, packet: list[int]) -> list[int]:
        """Stuff the packet in place (the SDK's caller ignores what is returned)."""
        return _with_body(packet, protocol2.stuff(_body(packet)))

    def removeStuffing(self, packet: list[int]) -> list[int]:
        """Undo it, in place."""
        return _with_body(packet, protocol2.unstuff(_body(packet)))


def packet_handler(protocol: int) -> Protocol1PacketHandler | MendedProtocol2:
    """The SDK's packet handler of a protocol, 1 or 2."""
    return Protocol1PacketHandler() if protocol == 1 else MendedProtocol2()


def _body(packet: list[int]) -> bytes:
    """Instruction to last parameter."""
    length = packet[_LENGTH_AT] | packet[_LENGTH_AT + 1] << 8
    return bytes(packet[_BODY_AT : _BODY_AT + length - 2])


def _with_body(packet: list[int], body: bytes) -> list[int]:
    """The same list with another body and its LEN; the CRC's two bytes stay."""
    length = packet[_LENGTH_AT] | packet[_LENGTH_AT + 1] << 8
    packet[_BODY_AT : _BODY_AT + length - 2] = body
    packet[_LENGTH_AT:_BODY_AT] = (len(body) + 2).to_bytes(2, "little")
    return packet
