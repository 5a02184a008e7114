"""One bus of a robot at work (`BusLine`), and the cyclic exchange on it: goals out, states in, bounded retries, error
rate.

A missing servo silences those that answer after it, so it is asked last from the next request on. After LOST_AFTER
cycles it is left out, and looked for every PROBE_PERIOD. Where no servo answers at all, the line is silent: that cycle
is short, and all servos are asked again in the next one.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray
from hardware.bus import BusSpec
from hardware.dynamixel.codec import (
    ALERT,
    BEFORE_PARTS,
    BROADCAST,
    CODECS,
    PART_OVERHEAD,
    Answers,
    Instruction,
    Status,
    protocol1,
    protocol2,
    side_by_side,
    valid_parts,
    whole_frames,
    whole_reply,
)
from hardware.dynamixel.control_table import ControlTable, Register, find_table
from hardware.dynamixel.readings import Names, Readings, names_of
from hardware.dynamixel.serial_port import BytePort, settle
from hardware.dynamixel.settings import ServoImage
from hardware.dynamixel.single_requests import NoAnswer, OneOff, ServoError
from hardware.servo import ServoSpec

# Group reads of several servos. Nothing waits longer than needed. The SDK throws away every answer of a group when one
# is missing, and hides error bytes; here each answer counts by itself.

TURNAROUND = 100e-6
"""[s] That a servo may take, in addition to its return delay, before it answers."""
SLACK = 1e-3
"""[s] That this machine, or the adapter's driver, may be late."""
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


# Goal positions of all servos of a port as one sync write: only the goals change from cycle to cycle.
#
# A goal switches the torque of a 1.0 servo on (field knowledge, in no manual). No goal is sent to one that is limp or
# may have restarted.


class HasPlace(Protocol):
    """A servo: where its goal stands in servo order, its id, its table."""

    @property
    def index(self) -> int: ...  # noqa: D102
    @property
    def id(self) -> int: ...  # noqa: D102
    @property
    def table(self) -> ControlTable: ...  # noqa: D102


class GoalPacket:
    """Makes the packets: one for each place where servos keep their goal position."""

    def __init__(self, servos: Sequence[HasPlace]) -> None:
        places: dict[tuple[int, int, int], list[HasPlace]] = {}
        for servo in servos:
            goal = servo.table["goal_position"]
            places.setdefault((servo.table.protocol, goal.address, goal.size), []).append(servo)
        self._parts = [_Part(*place, members) for place, members in places.items()]

    def packets(self, ticks: NDArray[np.int64], driven: BoolArray) -> Iterator[bytes]:
        """The packets for goals (n,) of the whole robot, in ticks. driven (n,): which servos have torque."""
        return (packet for part in self._parts if (packet := part.packet(ticks, driven)))


class _Part:
    """One sync write."""

    def __init__(self, protocol: int, address: int, size: int, servos: Sequence[HasPlace]) -> None:
        self._protocol = protocol
        self._who = np.array([servo.index for servo in servos])
        self._rows = np.zeros(len(servos), dtype=[("id", "u1"), ("goal", f"<i{size}")])
        self._rows["id"] = [servo.id for servo in servos]
        width = 1 if protocol == 1 else 2
        self._span = address.to_bytes(width, "little") + size.to_bytes(width, "little")

    def packet(self, ticks: NDArray[np.int64], driven: BoolArray) -> bytes:
        """The packet for goals (n,); empty when no servo is to get one."""
        self._rows["goal"] = ticks[self._who]
        if self._protocol == 2:
            return protocol2.frame(BROADCAST, Instruction.SYNC_WRITE, self._span + self._rows.tobytes())
        rows = self._rows[driven[self._who]]
        return protocol1.frame(BROADCAST, Instruction.SYNC_WRITE, self._span + rows.tobytes()) if rows.size else b""


RETRIES = 3
"""Times that a request without an answer is repeated in the same cycle."""
MOST_UNANSWERED = 3
"""Requests after which a cycle without any byte ends: silence must not take the time of the next cycle."""
LOST_AFTER = 3
"""Cycles without an answer after which a servo is no longer asked in every cycle."""
PROBE_PERIOD = 0.1
"""[s] Between two looks for lost servos."""
MAX_TRANSACTIONS = 1000
"""Requests that are kept ready-made."""
NOISY = 1.0
"""[s] For which goals are sent twice after a damaged answer."""
TWICE_WITHIN = 1.5e-3
"""[s] Goals are sent twice only if their packet takes no longer."""
STATUS_EVERY = 4
"""Cycles between two looks at one servo's torque, errors and watchdog, each servo in its turn."""


@dataclass(frozen=True, slots=True)
class Wired:
    """One servo on a port: its place in servo order, its id, its control table."""

    index: int
    id: int
    table: ControlTable


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Servos that can be asked in one request."""

    kind: Kind
    names: Names
    motion: Block
    wide: Block
    ids: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Transaction:
    """One request that is due, for a group's values or (names None) for the status of one servo.

    who: places in servo order of the servos that are asked. again: the block that is asked when an answer is missing.
    """

    ask: Ask
    who: NDArray[np.int64]
    request: bytes
    timeouts: Timeouts
    block: Block
    again: Block
    names: Names | None
    tries: int


class CyclicPort:
    """The servos on one open port. All servos of it have one `return_delay`, s."""

    def __init__(self, port: BytePort, servos: Sequence[Wired], *, return_delay: float) -> None:
        self.port = port
        self.servos = tuple(servos)
        self.retries = 0
        """Requests that had to be repeated, so far."""
        self.spoiled = 0
        """Requests whose answers came damaged, so far."""
        self._return_delay = return_delay
        self._goals = GoalPacket(servos)
        self._groups = _groups(servos)
        self._index_of = {servo.id: servo.index for servo in servos}
        self._kind = {servo.id: kind_of(servo.table) for servo in servos}
        self._status_block = {servo.id: status_block(servo.table) for servo in servos}
        self._strikes: dict[int, int] = {}  # cycles in a row without an answer, of silent servos
        self._missed: set[int] = set()  # of this cycle: the first that did not answer, each time
        self._unanswered = 0.0  # requests of this cycle without any byte; minus infinity once there was one
        self._silent = False  # no servo answered in the last cycle
        self._queue: deque[Transaction] = deque()
        self._sent = 0.0  # [s]
        self._line_free = -np.inf  # [s] when the last goals have left the wire
        self._noisy_until = -np.inf  # [s]
        self._cycle = 0
        self._probed = -np.inf
        self._transactions: dict[tuple[object, ...], Transaction] = {}
        self._usual: dict[bool, list[Transaction]] = {}
        """The requests of a cycle while no servo is missing: wide, and not."""

    def write(self, ticks: NDArray[np.int64], driven: BoolArray) -> None:
        """Send goals (n,), of all servos of the robot, ticks; driven (n,): which servos have torque. Raises
        BusError."""
        if self._strikes:  # a silent servo may have restarted
            driven = driven.copy()
            driven[[self._index_of[device] for device in self._strikes]] = False
        noisy = self.port.now() < self._noisy_until
        for packet in self._goals.packets(ticks, driven):
            self.post(packet)
            if noisy and 10 * len(packet) / self.port.baud < TWICE_WITHIN:
                self.post(packet)  # no answer would show that a goal was lost

    def post(self, packet: bytes) -> None:
        """Send a packet that no servo answers. Raises BusError."""
        self.port.write(packet)
        self._line_free = max(self.port.now(), self._line_free) + 10 * len(packet) / self.port.baud

    def ask(self, request: bytes) -> float:
        """Send a request. Return when it begins to be on the wire, s. Raises BusError."""
        self.port.drop()
        self.port.write(request)
        return max(self.port.now(), self._line_free)  # goals may still be on the wire

    def begin(self, *, wide: bool) -> None:
        """Begin a cycle. wide: voltage and temperature too."""
        self._cycle += 1
        self._queue.clear()
        self._missed.clear()
        self._unanswered = 0.0
        strikes, usual = self._strikes, self._usual.get(wide)
        if usual is not None and not strikes:
            self._queue.extend(usual)
        else:
            lost = self._probe()
            for group in self._groups:
                ids = group.ids
                if strikes:
                    first = [device for device in ids if device not in strikes]
                    late = [device for device in ids if device in strikes and (self._asked(device) or device == lost)]
                    ids = (*first, *sorted(late, key=strikes.__getitem__))
                self._enqueue(group.kind, ids, group.wide if wide else group.motion, group.motion, group.names)
            if not strikes:
                self._usual[wide] = list(self._queue)
        if self._cycle % STATUS_EVERY == 0:
            servo = self.servos[self._cycle // STATUS_EVERY % len(self.servos)]
            if servo.id not in strikes:
                self.ask_status([servo.id])

    @property
    def busy(self) -> bool:
        """Whether a request is due."""
        return bool(self._queue)

    def send(self) -> None:
        """Send the next request. Raises BusError."""
        self._sent = self.ask(self._queue[0].request)

    def collect(self, readings: Readings) -> None:
        """Wait for the answers to the last request, and keep them. Raises BusError."""
        transaction = self._queue.popleft()
        answers, noise = collect(self.port, transaction.ask, self._sent, transaction.timeouts)
        self._unanswered = -np.inf if answers or noise else self._unanswered + 1
        if answers and transaction.names is not None:
            self._keep(readings, transaction, answers)
        elif answers:
            self._keep_status(readings, transaction.block, answers)
        if len(answers) < len(transaction.ask.ids):
            self._again(transaction, answers, noise=noise)

    def ask_status(self, devices: Iterable[int]) -> None:
        """Let further requests be for the torque, errors and watchdog of servos."""
        groups: dict[tuple[Kind, object], list[int]] = {}
        for device in devices:
            groups.setdefault((self._kind[device], self._status_block[device].layout), []).append(device)
        for (kind, _), ids in groups.items():
            block = self._status_block[ids[0]]
            alone = Kind.SYNC if kind is Kind.FAST else Kind.SINGLE1 if kind is Kind.BULK1 else kind
            self._enqueue(kind if len(ids) > 1 else alone, tuple(ids), block, block, None)

    def end(self, readings: Readings) -> None:
        """End the cycle: count silent servos, and ask those that are back for their status."""
        if readings.complete and not self._strikes:
            self._silent = False
            return
        valid, strikes, back = readings.valid, self._strikes, list[int]()
        was_silent, self._silent = self._silent, not any(valid[index] for index in self._index_of.values())
        for device, index in self._index_of.items():
            if not valid[index]:
                if device in self._missed:
                    strikes[device] = strikes.get(device, 0) + 1
            elif device in strikes or was_silent:
                if strikes.pop(device, 0) >= LOST_AFTER:
                    readings.take_drive(index, False)  # until its status is read: it may have restarted
                back.append(device)
        self.ask_status(back)

    def _asked(self, device: int) -> bool:
        """Whether a servo that did not answer before is asked in this cycle."""
        return self._silent or self._strikes[device] < LOST_AFTER

    def _keep(self, readings: Readings, transaction: Transaction, answers: Answers) -> None:
        assert transaction.names is not None
        who = transaction.who if answers.ids == transaction.ask.ids else self._places(answers.ids)
        readings.take(who, transaction.block.unpack(answers), answers.errors, transaction.names, self.port.now())

    def _places(self, ids: Sequence[int]) -> NDArray[np.int64]:
        """Places of servos in servo order."""
        return np.array([self._index_of[device] for device in ids])

    def _keep_status(self, readings: Readings, block: Block, answers: Answers) -> None:
        for device, values in zip(answers.ids, block.unpack(answers), strict=True):
            index = self._index_of[device]
            status = dict(zip(block.dtype.names or (), values.item(), strict=True))
            tripped = status.get("bus_watchdog", 0) in (-1, 0xFF)
            readings.take_drive(index, bool(status["torque_enable"]) and not tripped)
            readings.take_alert(index, status.get("hardware_error_status", 0))

    def _again(self, transaction: Transaction, answers: Answers, *, noise: bool) -> None:
        """Ask those that did not answer once more, the first of them last: it may have silenced the rest.

        Without any byte they are asked in reverse, and that once: if there is none again, the line is silent. A single
        servo without any byte that was missed before is left to the next cycle.
        """
        self.spoiled += noise
        answered = set(answers.ids)
        silent = [device for device in transaction.ask.ids if device not in answered]
        nothing = not answers and not noise
        known = silent[0] in self._missed or silent[0] in self._strikes
        self._missed.add(silent[0])
        if self._unanswered >= MOST_UNANSWERED:
            self._queue.clear()
        if transaction.tries == RETRIES or self._unanswered > 1 or (len(silent) == 1 and not noise and known):
            return
        self.retries += 1
        if noise:
            self._noisy_until = self.port.now() + NOISY
        kind = transaction.ask.kind
        if kind is Kind.FAST and (answers or noise):
            kind = Kind.SYNC  # damage in a fast reply spoils all that follows; in single answers only that answer
        late = [device for device in silent if device in self._missed or device in self._strikes]
        order = [device for device in silent if device not in late]
        order = (order[::-1] if nothing else order) + late
        if transaction.names is not None:  # a status that is due can wait: this cycle takes long enough
            self._queue = deque(later for later in self._queue if later.names is not None)
        self._enqueue(
            kind, tuple(order), transaction.again, transaction.again, transaction.names, tries=transaction.tries + 1
        )

    def _probe(self) -> int | None:
        """The lost servo to look for in this cycle, in turn; or None."""
        lost = [device for device in self._index_of if self._strikes.get(device, 0) >= LOST_AFTER]
        now = self.port.now()
        if not lost or now < self._probed + PROBE_PERIOD:
            return None
        self._probed = now
        return lost[self._cycle % len(lost)]

    def _enqueue(
        self, kind: Kind, ids: tuple[int, ...], block: Block, again: Block, names: Names | None, *, tries: int = 0
    ) -> None:
        most = 1 if kind is Kind.SINGLE1 else MAX_IDS
        for at in range(0, len(ids), most):
            part = ids[at : at + most]
            key = (kind, part, block.address, block.size, tries)
            transaction = self._transactions.get(key)
            if transaction is None:
                if len(self._transactions) >= MAX_TRANSACTIONS:
                    self._transactions.clear()
                ask = Ask(kind, part, block.address, block.size)
                timeouts = ask.timeouts(self.port, self._return_delay)
                transaction = self._transactions[key] = Transaction(
                    ask, self._places(part), ask.request(), timeouts, block, again, names, tries
                )
            self._queue.append(transaction)


def status_block(table: ControlTable) -> Block:
    """The registers of a servo's torque, hardware errors and watchdog."""
    last = next(name for name in ("bus_watchdog", "hardware_error_status", "torque_enable") if table.has(name))
    return block_of(table, "torque_enable", last)


def kind_of(table: ControlTable) -> Kind:
    """How servos with this table are asked together."""
    if table.protocol == 2:
        return Kind.FAST if table.fast_read else Kind.SYNC
    return Kind.BULK1 if table.model.startswith("MX") else Kind.SINGLE1


def _groups(servos: Sequence[Wired]) -> list[Group]:
    """As few groups as possible: servos of one kind whose registers lie in the same places."""
    groups: dict[tuple[object, ...], Group] = {}
    for servo in servos:
        names, kind = names_of(servo.table), kind_of(servo.table)
        motion, wide = (block_of(servo.table, *ends) for ends in (names.motion, names.wide))
        key = (kind, names, motion.layout, wide.layout)
        group = groups.get(key) or Group(kind, names, motion, wide, ())
        groups[key] = replace(group, ids=(*group.ids, servo.id))
    return list(groups.values())


# The error rate of a bus: the share of the last cycles in which answers came damaged and requests were repeated.

WINDOW_S = 0.05
"""[s] Over which cycles are counted."""
FEWEST = 4
"""The window is taken to hold at least so many cycles."""


class ErrorRate:
    """Error rate of one bus. share: of bad cycles among the last, 0 to 1."""

    def __init__(self) -> None:
        self.share = 0.0
        self._cycles: deque[tuple[float, bool]] = deque()  # time, and whether it was a bad cycle
        self._bad = 0

    def note(self, now: float, *, retries: int, spoiled: int) -> None:
        """Note a cycle that ended at `now`, s. retries: repeated requests; spoiled: requests with damaged answers."""
        bad = retries >= RETRIES and spoiled > 0
        self._cycles.append((now, bad))
        self._bad += bad
        while self._cycles[0][0] < now - WINDOW_S:
            self._bad -= self._cycles.popleft()[1]
        self.share = self._bad / max(len(self._cycles), FEWEST)


TRIES = 3
"""Times that registers of a group are asked for."""


class BusLine:
    """One port and the servos on it. index_of: servo order of the robot, by id."""

    def __init__(self, spec: BusSpec, port: BytePort, servos: Sequence[tuple[int, ServoSpec]]) -> None:
        self.spec, self.port = spec, port
        self.servos = {servo.id: servo for _, servo in servos}
        self.index_of = {servo.id: index for index, servo in servos}
        self.client = OneOff(port, spec.protocol)
        self.images: dict[int, ServoImage] = {}
        """Registers as read last, by id."""
        self._expected = {servo.id: find_table(servo.model.name, spec.protocol) for servo in self.servos.values()}
        self._cyclic = self._wire(self._expected)

    @property
    def where(self) -> str:
        """The bus, in messages."""
        return f"bus {self.spec.name}"

    def name_of(self, device: int) -> str:
        """The servo with this id, in messages."""
        return self.servos[device].label

    @property
    def cyclic(self) -> CyclicPort:
        """The exchange of every cycle."""
        return self._cyclic

    def adopt(self, images: dict[int, ServoImage]) -> None:
        """Use the registers as read: the firmware of a servo chooses its table. Others keep the usual one."""
        before = self.tables, self.longest_delay
        self.images = images
        if (self.tables, self.longest_delay) != before:
            self._cyclic = self._wire(self.tables)

    @property
    def tables(self) -> dict[int, ControlTable]:
        """Control tables of all its servos, by id."""
        return self._expected | {device: image.table for device, image in self.images.items()}

    def write_all(self, register: Register, values: Iterable[tuple[int, int]]) -> None:
        """Send (id, counts) for one register; no servo answers. Raises BusError when the port is gone."""
        items = [(device, register.encode(value)) for device, value in values]
        if not items:
            return
        self._cyclic.post(CODECS[self.spec.protocol].sync_write(register.address, register.size, items))

    def read_all(self, register: Register, ids: Sequence[int]) -> dict[int, int]:
        """Counts of one register by id, of those that answer. Raises BusError when the port is gone."""
        said = self.read_span(register.address, register.size, ids)
        return {device: register.decode(data) for device, data in said.items()}

    def read_span(self, address: int, size: int, ids: Sequence[int]) -> dict[int, bytes]:
        """`size` bytes from `address` by id, of those that answer. Raises BusError when the port is gone."""
        found: dict[int, bytes] = {}
        if self.spec.protocol == 1:  # no group read that all models have
            for device in ids:
                with suppress(NoAnswer, ServoError):
                    found[device] = self.client.read_block(device, address, size)
            return found
        silent = list(ids)
        for _ in range(TRIES):
            if silent:
                found |= self._ask(Ask(Kind.SYNC, tuple(silent), address, size))
            silent = [device for device in silent if device not in found]
            # The first one silent may have silenced the rest: it is asked last.
            silent = [*silent[1:], *silent[:1]]
        for device in silent:  # one by one, a missing servo silences no other
            found |= self._ask(Ask(Kind.SYNC, (device,), address, size))
        return found

    def _ask(self, ask: Ask) -> dict[int, bytes]:
        sent = self._cyclic.ask(ask.request())
        answers, _ = collect(self.port, ask, sent, ask.timeouts(self.port, self.longest_delay))
        if len(answers) < len(ask.ids):
            settle(self.port)
        return {status.id: status.data for status in answers.statuses}

    @property
    def longest_delay(self) -> float:
        """Longest pause, s, of a servo before it answers: as read, else as it is to be."""
        read = [image.value("return_delay_time") * 2e-6 for image in self.images.values()]
        return max([*read, self.spec.return_delay])

    def _wire(self, tables: dict[int, ControlTable]) -> CyclicPort:
        wired = [Wired(self.index_of[device], device, table) for device, table in tables.items()]
        return CyclicPort(self.port, wired, return_delay=self.longest_delay)


# One cycle of several buses at once, for the bus that drives servos and for the one that only reads them.


def read_cycle(lines: Sequence[BusLine], readings: Readings, *, wide: bool) -> None:
    """Ask all servos, on all ports at once; then ask one with an alert on each bus for its status. wide: voltage and
    temperature too.

    Raises BusError when a port is gone.
    """
    readings.begin()
    for line in lines:
        line.cyclic.begin(wide=wide)
    _exchange(lines, readings)
    for line in lines:
        line.cyclic.end(readings)
    for line in lines if (alarmed := readings.alarmed()) else ():
        for device in [device for device, index in line.index_of.items() if index in alarmed][:1]:
            line.cyclic.ask_status([device])
    _exchange(lines, readings)


def _exchange(lines: Sequence[BusLine], readings: Readings) -> None:
    """Send a request on every port, then wait for each, until no port has a request left."""
    busy = [line.cyclic for line in lines if line.cyclic.busy]
    while busy:
        for cyclic in busy:
            cyclic.send()
        for cyclic in busy:
            cyclic.collect(readings)
        busy = [cyclic for cyclic in busy if cyclic.busy]
