"""Group reads of several servos, registers as blocks, and pings that find the servos on a line.

Nothing waits longer than needed. The SDK's group reads throw away every answer when one is missing, and hide error
bytes; here each answer counts by itself.
"""

from collections import Counter
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hardware.dynamixel.codec import (
    ALERT,
    BEFORE_PARTS,
    BROADCAST,
    CODECS,
    MAX_ID,
    PART_OVERHEAD,
    Answers,
    Status,
    protocol1,
    protocol2,
    side_by_side,
    valid_parts,
    whole_frames,
    whole_reply,
)
from hardware.dynamixel.control_table import ControlTable, Register
from hardware.dynamixel.serial_port import BytePort

TURNAROUND = 100e-6
"""[s] That a servo may take, in addition to its return delay, before it answers."""
SLACK = 1e-3
"""[s] That this machine, or the adapter's driver, may be late."""
QUIET = 20e-3
"""[s] After an answer that did not come: what is later than this is not expected."""
MAX_IDS = 100
"""Servos asked in one request; their answers fit any adapter's buffer."""


class Timeouts(NamedTuple):
    """s: from sending to the first byte; between bytes; from sending to the last byte."""

    first: float
    idle: float
    whole: float


class Kind(Enum):
    """How several servos are asked at once."""

    FAST = "fast sync read"
    SYNC = "sync read"
    BULK1 = "bulk read, protocol 1.0"
    SINGLE1 = "read, protocol 1.0"
    """One servo: those that know no group read."""


@dataclass(frozen=True, slots=True)
class Ask:
    """A request for `size` bytes from `address` of each of the servos `ids`, in this order."""

    kind: Kind
    ids: tuple[int, ...]
    address: int
    size: int

    def request(self) -> bytes:
        """The bytes to send."""
        if self.kind is Kind.SINGLE1:
            return protocol1.read(self.ids[0], self.address, self.size)
        if self.kind is Kind.BULK1:
            return protocol1.bulk_read((device, self.address, self.size) for device in self.ids)
        return protocol2.sync_read(self.address, self.size, self.ids, fast=self.kind is Kind.FAST)

    @property
    def reply_bytes(self) -> int:
        """Bytes of all answers together, but for what stuffing adds."""
        return self.bytes_of(len(self.ids))

    def bytes_of(self, count: int) -> int:
        """Bytes of the first `count` answers."""
        if self.kind is Kind.FAST:
            return BEFORE_PARTS + count * (self.size + PART_OVERHEAD) if count else 0
        overhead = protocol2.STATUS_BYTES if self.kind is Kind.SYNC else protocol1.STATUS_BYTES
        return count * (overhead + self.size)

    @property
    def delays(self) -> int:
        """How many servos wait for their return delay, one after the other."""
        return 1 if self.kind is Kind.FAST else len(self.ids)

    def timeouts(self, port: BytePort, return_delay: float) -> "Timeouts":
        """How long the answers may take; return_delay: of each servo, s."""
        sending, coming = (10 * count / port.baud for count in (len(self.request()), self.reply_bytes))
        pause = return_delay + TURNAROUND
        # An adapter may hand over an answer in one piece, when it is whole.
        idle = pause + 10 * self.bytes_of(1) / port.baud + port.latency + SLACK
        return Timeouts(sending + idle, idle, sending + coming + (self.delays - 1) * pause + idle)

    def answers(self, received: bytes) -> Answers:
        """The valid answers in the bytes received so far, each servo at most once."""
        if self.kind is Kind.FAST:
            return whole_reply(received, self.ids, self.size) or side_by_side(self._parts(received))
        if self.kind is Kind.SYNC:
            whole = whole_frames(received, self.ids, self.size)
            if whole is not None:
                return whole
        found: dict[int, Status] = {}
        codec = CODECS[2 if self.kind is Kind.SYNC else 1]
        parser = codec.parser()
        # Frames inside one with a damaged length count as well.
        statuses = (codec.status_of(frame) for frame in [*parser.feed(received), *parser.flush()])
        for status in statuses:
            if status is not None and self._fits(status):
                found.setdefault(status.id, status)
        return side_by_side(list(found.values()))

    def _fits(self, status: Status) -> bool:
        """Whether it is an answer to this request: no refusal, no echo, no unknown id."""
        refused = self.kind is Kind.SYNC and _refused(status)
        return len(status.data) == self.size and status.id in self.ids and not refused

    def _parts(self, received: bytes) -> list[Status]:
        """Valid parts of the fast reply, searched at every header: an echo or a stale answer may precede it.

        Any order will do: a request is repeated in another one, and the answer to the first may still come.
        """
        best: list[Status] = []
        at = received.find(protocol2.HEADER)
        while at >= 0 and len(best) < len(self.ids):
            parts = valid_parts(received[at:], (self.size,) * len(self.ids))
            valid = [part for part in parts if part.id in self.ids and not _refused(part)]
            best = max(best, valid, key=len)
            at = received.find(protocol2.HEADER, at + 1)
        return best


def _refused(status: Status) -> bool:
    """Whether a 2.0 servo refuses: its data are then not valid."""
    return bool(status.error & ~ALERT)


class Received(NamedTuple):
    """Valid answers, and whether there were other bytes: a damaged answer."""

    answers: Answers
    noise: bool


def collect(port: BytePort, ask: Ask, sent: float, timeouts: Timeouts) -> Received:
    """Receive the answers to a request sent at `sent`, s: all of them, or those that came before the line was silent.

    Raises BusError when the port is gone.
    """
    received, enough = b"", ask.reply_bytes
    end = sent + timeouts.whole
    deadline = min(sent + timeouts.first, end)
    while port.wait(deadline):
        data = port.read()
        if data:
            received += data
            now = port.now()
            if ask.kind is Kind.FAST and len(received) < enough:
                data = _rest_of_frame(port, enough - len(received), now, latest=now + timeouts.idle)
                received += data
                now += 10 * len(data) / port.baud  # when the last of them came, at the earliest
            deadline = min(now + timeouts.idle, end)
        if len(received) >= enough:
            answers = ask.answers(received)
            if len(answers) == len(ask.ids):
                return Received(answers, False)
            # All bytes are there; damaged ones are not sent again. (Stuffing makes other answers longer.)
            if ask.kind is Kind.FAST and len(_without_echo(received, ask)) >= enough:
                return Received(answers, True)
    answers = ask.answers(received)
    return Received(answers, len(_without_echo(received, ask)) > ask.bytes_of(len(answers)))


def _rest_of_frame(port: BytePort, missing: int, now: float, *, latest: float) -> bytes:
    """Read after the time that the missing bytes take. One frame has no pauses, and waiting for each piece of it would
    wake this process once for each servo."""
    port.sleep_until(min(now + 10 * missing / port.baud, latest))
    return port.read()


def _without_echo(received: bytes, ask: Ask) -> bytes:
    """The bytes without the echo of the request, which some adapters give back."""
    return received.removeprefix(ask.request())


def settle(port: BytePort) -> None:
    """Drop an answer that comes late. A status does not say which request it answers, so it would be taken for the
    next.

    Raises BusError when the port is gone.
    """
    deadline = port.now() + QUIET + port.latency
    while port.now() < deadline and port.wait(deadline):
        port.read()


# Registers side by side that a group read fetches in one go, as named values.


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """`size` bytes from `address`. dtype: the registers in them by name, little-endian, at their offsets."""

    address: int
    size: int
    dtype: "np.dtype[np.void]"

    def unpack(self, answers: Answers) -> NDArray[np.void]:
        """A row (k,) of named values for each answer."""
        return np.frombuffer(answers.data, dtype=self.dtype)

    @property
    def layout(self) -> tuple[int, int, tuple[tuple[str, str], ...]]:
        """What makes two blocks the same: address, size, registers."""
        names = self.dtype.names or ()
        return self.address, self.size, tuple((name, str(self.dtype[name])) for name in names)


def block_of(table: ControlTable, first: str, last: str) -> Block:
    """The registers of a table from `first` to `last`. Raises HardwareError where the table does not have them."""
    begin, end = table[first], table[last]
    inside = [register for register in table.registers if begin.address <= register.address <= end.address]
    size = end.address + end.size - begin.address
    layout = {
        "names": [register.name for register in inside],
        "formats": [_format(register) for register in inside],
        "offsets": [register.address - begin.address for register in inside],
        "itemsize": size,
    }
    return Block(begin.address, size, np.dtype(layout))  # type: ignore[call-overload]


def _format(register: Register) -> str:
    """With a direction bit the count is no two's complement, and left as it is."""
    return f"<{'i' if register.signed and register.direction_bit is None else 'u'}{register.size}"


# Finding servos: a broadcast ping (2.0), and single pings that wait long enough to notice a second answer.

SLOT = 0.003
"""[s] In addition to its bytes, that the SDK allows each id when all devices answer a broadcast ping in order."""
SETTLE = 0.016
"""[s] That the SDK adds to all slots."""
PING_BYTES = protocol2.STATUS_BYTES + 3
SPREAD = 0.001
"""[s] Within which two servos with one id begin to answer: their return delays differ by half of it at most."""
MAX_RECEIVED = 65_536
"""Bytes after which a line that is never silent is given up."""


@dataclass(frozen=True)
class Found:
    """A servo on the line. model, firmware: None where it did not report them.

    alert: it reports a hardware error. clash: two answers came, or none was whole: most likely two servos with this id.
    """

    id: int
    protocol: int
    model: int | None = None
    firmware: int | None = None
    alert: bool = False
    clash: bool = False


@dataclass(frozen=True)
class PingReplies:
    """Status frames, in order; damaged: bytes that belong to none; echoed: the adapter gave back the request."""

    answers: tuple[Status, ...]
    damaged: int
    echoed: bool


def broadcast_ping(port: BytePort, highest: int, slack: float) -> PingReplies:
    """Ping all devices of protocol 2.0, and wait until the one with the id `highest` must have answered.

    Devices answer in order of their ids, each in its own slot: hence the window, and it cannot end sooner, since an
    unknown device may be the last one. At most 0.78 s at 4 Mbps, as the SDK's; 20 ids: 0.08 s.
    """
    slots = min(highest, MAX_ID) + 1
    request = protocol2.ping(BROADCAST)
    window = SETTLE + slots * SLOT + 10 * (len(request) + slots * PING_BYTES) / port.baud + port.latency + slack
    return _ask(port, 2, request, window)


def ping_alone(port: BytePort, protocol: int, device: int, wait: float) -> PingReplies:
    """Ping one device; `wait`: s that it may take in addition to the bytes. Waits for a second answer too."""
    request = CODECS[protocol].ping(device)
    answer = 10 * (protocol1.STATUS_BYTES if protocol == 1 else PING_BYTES) / port.baud
    window = 10 * len(request) / port.baud + 2 * answer + SPREAD + wait
    return _ask(port, protocol, request, window, enough=2)


def found_by_broadcast(received: PingReplies) -> list[Found]:
    """The servos of a broadcast ping, by id."""
    times = Counter(answer.id for answer in received.answers)
    first: dict[int, Status] = {}
    for answer in received.answers:
        first.setdefault(answer.id, answer)
    return [found_by_ping(first[device], clash=times[device] > 1) for device in sorted(first)]


def found_by_ping(answer: Status, *, clash: bool = False) -> Found:
    """The servo behind a 2.0 answer to a ping; a refusal carries no model."""
    known = len(answer.data) == 3
    return Found(
        id=answer.id,
        protocol=2,
        model=answer.data[0] | answer.data[1] << 8 if known else None,
        firmware=answer.data[2] if known else None,
        alert=bool(answer.error & 0x80),
        clash=clash,
    )


def _ask(port: BytePort, protocol: int, request: bytes, window: float, *, enough: int | None = None) -> PingReplies:
    """Send, and receive for `window` s or until there are `enough` answers."""
    port.drop()
    port.write(request)
    deadline = port.now() + window
    received = bytearray()
    while port.now() < deadline and len(received) < MAX_RECEIVED:
        port.wait(deadline)
        received += port.read()
        if enough is not None and len(_answers(protocol, request, bytes(received)).answers) >= enough:
            break
    return _answers(protocol, request, bytes(received))


def _answers(protocol: int, request: bytes, received: bytes) -> PingReplies:
    """The answers in the bytes; an echo of the request may precede them."""
    echoed = received.startswith(request)
    codec = CODECS[protocol]
    parser = codec.parser()
    frames = parser.feed(received[len(request) :] if echoed else received)
    answers = [answer for frame in frames if (answer := codec.status_of(frame)) is not None]
    return PingReplies(tuple(answers), parser.skipped + len(parser.pending), echoed)
