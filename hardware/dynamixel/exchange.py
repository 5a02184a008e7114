"""Group reads: one request, the answers of several servos, and how long they may take. All of it without waiting idly.

The SDK's group reads throw away every answer when one is missing, and hide error bytes; here each answer counts by
itself.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.answers import Answers, side_by_side
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.fast_status import BEFORE_PARTS, PART_OVERHEAD, sound_parts
from hardware.dynamixel.packets import ALERT, Status
from hardware.dynamixel.parsers import parser1, parser2
from hardware.dynamixel.whole_reply import whole_frames, whole_reply

TURNAROUND = 100e-6
"""[s] That a servo may take, beside its return delay, before it answers."""
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

    def answers(self, heard: bytes) -> Answers:
        """The sound answers in what was heard so far, each servo at most once."""
        if self.kind is Kind.FAST:
            return whole_reply(heard, self.ids, self.size) or side_by_side(self._parts(heard))
        if self.kind is Kind.SYNC:
            whole = whole_frames(heard, self.ids, self.size)
            if whole is not None:
                return whole
        found: dict[int, Status] = {}
        parser = parser2() if self.kind is Kind.SYNC else parser1()
        status_of = protocol2.status_of if self.kind is Kind.SYNC else protocol1.status_of
        # What a damaged length had claimed is looked through as well.
        statuses = (status_of(frame) for frame in [*parser.feed(heard), *parser.flush()])
        for status in statuses:
            if status is not None and self._fits(status):
                found.setdefault(status.id, status)
        return side_by_side(list(found.values()))

    def _fits(self, status: Status) -> bool:
        """Whether it is an answer to this: no refusal, no echo, no stranger."""
        said_no = self.kind is Kind.SYNC and _refused(status)
        return len(status.data) == self.size and status.id in self.ids and not said_no

    def _parts(self, heard: bytes) -> list[Status]:
        """Parts of the fast reply, looked for at every header: an echo or a stale answer may precede it."""
        best: list[Status] = []
        at = heard.find(protocol2.HEADER)
        while at >= 0 and len(best) < len(self.ids):
            parts = sound_parts(heard[at:], (self.size,) * len(self.ids))
            asked = iter(self.ids)  # in this order; one that is missing may leave no gap
            sound = [part for part in parts if part.id in asked and not _refused(part)]
            best = max(best, sound, key=len)
            at = heard.find(protocol2.HEADER, at + 1)
        return best


def _refused(status: Status) -> bool:
    """Whether a 2.0 servo says no: what stands in place of its data means nothing."""
    return bool(status.error & ~ALERT)


class Heard(NamedTuple):
    """Sound answers, and whether there was more than them: something was said, and lost."""

    answers: Answers
    noise: bool


def collect(port: BytePort, ask: Ask, sent: float, timeouts: Timeouts) -> Heard:
    """The answers to what was sent at `sent`, s: all of them, or those that came before nothing more did.

    Raises BusError when the port is gone.
    """
    heard, enough = b"", ask.reply_bytes
    end = sent + timeouts.whole
    deadline = min(sent + timeouts.first, end)
    while port.wait(deadline):
        data = port.read()
        if data:
            heard += data
            now = port.now()
            if ask.kind is Kind.FAST and len(heard) < enough:
                data = _rest_of_frame(port, enough - len(heard), now, latest=now + timeouts.idle)
                heard += data
                now += 10 * len(data) / port.baud  # when the last of them came, at the earliest
            deadline = min(now + timeouts.idle, end)
        if len(heard) >= enough:
            answers = ask.answers(heard)
            if len(answers) == len(ask.ids):
                return Heard(answers, False)
            # All bytes are there: what is damaged comes no second time. (Stuffing makes other answers longer.)
            if ask.kind is Kind.FAST and len(_without_echo(heard, ask)) >= enough:
                return Heard(answers, True)
    answers = ask.answers(heard)
    return Heard(answers, len(_without_echo(heard, ask)) > ask.bytes_of(len(answers)))


def _rest_of_frame(port: BytePort, missing: int, now: float, *, latest: float) -> bytes:
    """What comes while all that is missing could come: one frame has no pauses, and who waits for each piece of it
    wakes once for each servo."""
    port.sleep_until(min(now + 10 * missing / port.baud, latest))
    return port.read()


def _without_echo(heard: bytes, ask: Ask) -> bytes:
    """An adapter may let the host hear itself."""
    return heard.removeprefix(ask.request())


def settle(port: BytePort) -> None:
    """Let an answer that is late pass, so that it answers nothing else: a status does not say what it is the answer to.

    Raises BusError when the port is gone.
    """
    deadline = port.now() + QUIET + port.latency
    while port.now() < deadline and port.wait(deadline):
        port.read()
