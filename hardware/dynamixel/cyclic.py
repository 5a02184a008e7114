"""One bus of a robot at work (`BusLine`), and the cyclic exchange on it: goals out, states in, bounded retries, error
rate.

A missing servo silences those that answer after it, so it is polled last from then on. After LOST_AFTER cycles it is
left out, and probed every PROBE_PERIOD.
"""

from collections import deque
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

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
    whole_reply,
)
from hardware.dynamixel.control_table import ControlTable, Register, find_table, usual_table
from hardware.dynamixel.readings import Names, Readings, ReportedTorque, names_of
from hardware.dynamixel.serial_port import BytePort, settle
from hardware.dynamixel.settings import ServoImage
from hardware.dynamixel.single_requests import NoAnswer, OneOff, ServoError
from hardware.servo import Layout, ServoSpec

# Group reads of several servos. Unlike in the SDK, each answer counts by itself, with its error byte.

TURNAROUND = 100e-6
"""[s] Beyond the return delay."""
HOST_SLACK = 1e-3
"""[s] Delay of this machine or the driver."""
MAX_IDS = 100
"""Servos per request, whose answers fit any adapter's buffer."""


class Timeouts(NamedTuple):
    """[s] From sending to the first byte; between bytes; to the last byte."""

    first: float
    idle: float
    whole: float


class ReadKind(Enum):
    """Instructions that read servos."""

    FAST = "fast sync read"
    SYNC = "sync read"
    BULK1 = "bulk read, protocol 1.0"
    SINGLE1 = "read, protocol 1.0"
    """One servo, of a model without group reads."""
    SINGLE2 = "read, protocol 2.0"
    """A device that is no servo."""


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """A request for `size` bytes from `address` of the servos `ids`, in this order."""

    kind: ReadKind
    ids: tuple[int, ...]
    address: int
    size: int

    @property
    def protocol(self) -> int:
        """Protocol, 1 or 2."""
        return 1 if self.kind in (ReadKind.BULK1, ReadKind.SINGLE1) else 2

    def packet(self) -> bytes:
        """The bytes to send."""
        if self.kind is ReadKind.SINGLE1:
            return protocol1.read(self.ids[0], self.address, self.size)
        if self.kind is ReadKind.BULK1:
            return protocol1.bulk_read((device, self.address, self.size) for device in self.ids)
        if self.kind is ReadKind.SINGLE2:
            return protocol2.read(self.ids[0], self.address, self.size)
        return protocol2.sync_read(self.address, self.size, self.ids, fast=self.kind is ReadKind.FAST)

    def bytes_of(self, count: int) -> int:
        """The bytes of the first `count` answers, without stuffing."""
        if self.kind is ReadKind.FAST:
            return BEFORE_PARTS + count * (self.size + PART_OVERHEAD) if count else 0
        overhead = CODECS[self.protocol].STATUS_BYTES
        return count * (overhead + self.size)

    def timeouts(self, port: BytePort, return_delay: float) -> Timeouts:
        """The timeouts. return_delay: of each servo, s."""
        sending, coming = (10 * count / port.baud for count in (len(self.packet()), self.bytes_of(len(self.ids))))
        pause = return_delay + TURNAROUND
        # An adapter may hand over an answer in one piece, when it is whole.
        idle = pause + 10 * self.bytes_of(1) / port.baud + port.latency + HOST_SLACK
        waits = 0 if self.kind is ReadKind.FAST else len(self.ids) - 1  # return delays of servos, one after the other
        return Timeouts(sending + idle, idle, sending + coming + waits * pause + idle)

    def answers(self, received: bytes) -> Answers:
        """The valid answers in the bytes so far, one per servo."""
        if self.kind is ReadKind.FAST:
            return whole_reply(received, self.ids, self.size) or side_by_side(self._parts(received))
        found: dict[int, Status] = {}
        codec = CODECS[self.protocol]
        parser = codec.parser()
        # Frames inside one with a damaged length count as well.
        statuses = (codec.status_of(frame) for frame in [*parser.feed(received), *parser.flush()])
        for status in statuses:
            # An answer to this request is no refusal, no echo, and of no unknown id.
            if status is None or len(status.data) != self.size or status.id not in self.ids:
                continue
            if self.protocol == 1 or not _refused(status):
                found.setdefault(status.id, status)
        return side_by_side(list(found.values()))

    def _parts(self, received: bytes) -> list[Status]:
        """The valid parts of a fast reply in any order, since that to an earlier request may come. Every header
        is tried: an echo or a stale answer may precede it."""
        best: list[Status] = []
        at = received.find(protocol2.HEADER)
        while at >= 0 and len(best) < len(self.ids):
            parts = valid_parts(received[at:], (self.size,) * len(self.ids))
            valid = [part for part in parts if part.id in self.ids and not _refused(part)]
            best = max(best, valid, key=len)
            at = received.find(protocol2.HEADER, at + 1)
        return best


def _refused(status: Status) -> bool:
    return bool(status.error & ~ALERT)


class Received(NamedTuple):
    """Valid answers. noise: there were other bytes, of a damaged answer."""

    answers: Answers
    noise: bool


def collect(port: BytePort, request: ReadRequest, sent: float, timeouts: Timeouts) -> Received:
    """Receive the answers to a request sent at `sent`, s, until they are complete or the line is silent."""
    received, enough = b"", request.bytes_of(len(request.ids))
    end = sent + timeouts.whole
    deadline = min(sent + timeouts.first, end)
    while port.wait(deadline):
        data = port.read()
        if data:
            received += data
            now = port.now()
            if request.kind is ReadKind.FAST and len(received) < enough:
                # One frame has no pauses: waiting for each piece would wake this process once for each servo.
                coming = 10 * (enough - len(received)) / port.baud
                port.sleep_until(min(now + coming, now + timeouts.idle))
                data = port.read()
                received += data
                now += 10 * len(data) / port.baud  # when the last of them came, at the earliest
            deadline = min(now + timeouts.idle, end)
        if len(received) >= enough:
            answers = request.answers(received)
            if len(answers) == len(request.ids):
                return Received(answers, False)
            # All bytes are there; damaged ones are not sent again. (Stuffing makes other answers longer.)
            if request.kind is ReadKind.FAST and len(_without_echo(received, request)) >= enough:
                return Received(answers, True)
    answers = request.answers(received)
    return Received(answers, len(_without_echo(received, request)) > request.bytes_of(len(answers)))


def _without_echo(received: bytes, request: ReadRequest) -> bytes:
    return received.removeprefix(request.packet())


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Adjacent registers, `size` bytes from `address`. dtype: of the registers by name, at their offsets."""

    address: int
    size: int
    dtype: "np.dtype[np.void]"

    @property
    def layout(self) -> tuple[int, "np.dtype[np.void]"]:
        """Key of equal blocks."""
        return self.address, self.dtype

    def unpack(self, answers: Answers) -> NDArray[np.void]:
        """A row (k,) of named values per answer."""
        return np.frombuffer(answers.data, dtype=self.dtype)


def block_of(table: ControlTable, first: str, last: str) -> Block:
    """The registers from `first` to `last`. Raises HardwareError for a missing one."""
    begin, end = table[first], table[last]
    inside = [register for register in table.registers if begin.address <= register.address <= end.address]
    size = end.address + end.size - begin.address
    names = [register.name for register in inside]
    # With a direction bit the count is no two's complement, and left as it is.
    signed = [register.signed and register.direction_bit is None for register in inside]
    formats = [f"<{'i' if sign else 'u'}{register.size}" for sign, register in zip(signed, inside, strict=True)]
    offsets = [register.address - begin.address for register in inside]
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
    return Block(begin.address, size, dtype)


@dataclass(frozen=True, slots=True)
class Wired:
    """A servo on a port: its index in servo order, its id, its control table."""

    index: int
    id: int
    table: ControlTable


class GoalPacket:
    """A sync write to servos with equal goal registers. wakes: a goal may switch their torque on (1.0: field knowledge,
    in no manual; assumed for the older layout), so limp servos get none."""

    def __init__(self, protocol: int, address: int, size: int, wakes: bool, servos: Sequence[Wired]) -> None:
        self._codec, self._wakes = CODECS[protocol], wakes
        self._columns = np.array([servo.index for servo in servos])
        self._rows = np.zeros(len(servos), dtype=[("id", "u1"), ("goal", f"<i{size}")])
        self._rows["id"] = [servo.id for servo in servos]
        self._span = self._codec.number(address) + self._codec.number(size)

    def packet(self, ticks: NDArray[np.int64], driven: BoolArray) -> bytes:
        """The packet for goals (n,) of the whole robot, ticks, or b"". driven (n,): servos with torque."""
        rows = self._rows
        rows["goal"] = ticks[self._columns]
        if self._wakes:
            rows = rows[driven[self._columns]]
        return self._codec.frame(BROADCAST, Instruction.SYNC_WRITE, self._span + rows.tobytes()) if rows.size else b""


def goal_packets(servos: Sequence[Wired]) -> list[GoalPacket]:
    """A packet per place of a goal register."""
    places: dict[tuple[int, int, int, bool], list[Wired]] = {}
    for servo in servos:
        goal, wakes = servo.table["goal_position"], servo.table.layout is Layout.OLDER
        places.setdefault((servo.table.protocol, goal.address, goal.size, wakes), []).append(servo)
    return [GoalPacket(*place, members) for place, members in places.items()]


RETRIES = 3
MOST_UNANSWERED = 3
"""Unanswered requests after which a cycle without any byte ends."""
LOST_AFTER = 3
"""Silent cycles after which a servo is no longer polled."""
PROBE_PERIOD = 0.1
"""[s] Between two probes for lost servos."""
MAX_TRANSACTIONS = 1000
NOISY = 1.0
"""[s] Time after a damaged answer in which goals are sent twice."""
TWICE_WITHIN = 1.5e-3
"""[s] Longest goal packet that is sent twice."""
STATUS_EVERY = 4
"""Cycles between two status reads."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Servos of one request."""

    kind: ReadKind
    names: Names
    motion: Block
    wide: Block
    ids: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Transaction:
    """A due request, for a group's values or (names None) for a status. columns: in servo order. again: the block
    requested after a missing answer."""

    request: ReadRequest
    columns: NDArray[np.int64]
    packet: bytes
    timeouts: Timeouts
    block: Block
    again: Block
    names: Names | None
    tries: int


class Wire:
    """Sends on one port. requested_at: start of the last request on the wire, s."""

    def __init__(self, port: BytePort) -> None:
        self.port = port
        self.requested_at = -np.inf
        self._free = -np.inf  # [s] when the last packets without an answer have left the wire
        self._noisy_until = -np.inf  # [s]

    def post(self, packet: bytes) -> None:
        """Send a packet without an answer."""
        self.port.write(packet)
        self._free = max(self.port.now(), self._free) + 10 * len(packet) / self.port.baud

    def post_goals(self, packet: bytes) -> None:
        """Send goals, twice after a damaged answer, since no answer would show a lost goal."""
        self.post(packet)
        if self.port.now() < self._noisy_until and 10 * len(packet) / self.port.baud < TWICE_WITHIN:
            self.post(packet)

    def request(self, packet: bytes) -> None:
        """Send a request."""
        self.port.drop()
        self.port.write(packet)
        self.requested_at = max(self.port.now(), self._free)  # goals may still be on the wire

    def note_damage(self) -> None:
        """Note a damaged answer."""
        self._noisy_until = self.port.now() + NOISY


class MissingServos:
    """The silent servos of a port. strikes: consecutive silent cycles, by id. first: ids that were the first silent one
    of a request in this cycle."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._ids = tuple(ids)
        self._line_is_silent = False  # in the last cycle
        self._probed = -np.inf  # [s]
        self.strikes: dict[int, int] = {}
        self.first: set[int] = set()

    def __contains__(self, device: int) -> bool:
        return device in self.first or device in self.strikes

    def late(self, now: float, cycle: int) -> list[int]:
        """The silent servos to poll last in this cycle, the newest first, with a lost one in turn every
        PROBE_PERIOD. now: s."""
        lost = [device for device in self._ids if self.strikes.get(device, 0) >= LOST_AFTER]
        probe = None
        if lost and now >= self._probed + PROBE_PERIOD:
            self._probed, probe = now, lost[cycle % len(lost)]
        due = [
            device
            for device in self._ids
            if device in self.strikes and (self._line_is_silent or self.strikes[device] < LOST_AFTER or device == probe)
        ]
        return sorted(due, key=self.strikes.__getitem__)

    def end(self, answered: Collection[int]) -> tuple[list[int], list[int]]:
        """End a cycle. Return servos that are back, and those of them that were lost."""
        strikes, back, restarted = self.strikes, list[int](), list[int]()
        was_silent, self._line_is_silent = self._line_is_silent, not answered
        for device in self._ids:
            if device not in answered:
                if device in self.first:
                    strikes[device] = strikes.get(device, 0) + 1
            elif device in strikes or was_silent:
                back.append(device)
                if strikes.pop(device, 0) >= LOST_AFTER:
                    restarted.append(device)
        return back, restarted


class CyclicPort:
    """The servos on one open port. return_delay: of all, s."""

    def __init__(self, port: BytePort, servos: Sequence[Wired], *, return_delay: float) -> None:
        self.wire = Wire(port)
        self.servos = tuple(servos)
        self.errors = ErrorRate()
        self._return_delay = return_delay
        self._goals = goal_packets(servos)
        self._groups = _groups(servos)
        self._index_of = {servo.id: servo.index for servo in servos}
        self._tables = {servo.id: servo.table for servo in servos}
        self._status: dict[int, tuple[ReadKind, Block]] = {}
        for servo in servos:
            names = [name for name in STATUS_REGISTERS if servo.table.has(name)]
            self._status[servo.id] = (kind_of(servo.table), block_of(servo.table, names[0], names[-1]))
        self._missing = MissingServos(list(self._index_of))
        self._unanswered = 0.0  # requests of this cycle without any byte; minus infinity once there was one
        self._queue: deque[Transaction] = deque()
        self._cycle = 0
        self._transaction = lru_cache(MAX_TRANSACTIONS)(self._make_transaction)

    def write(self, ticks: NDArray[np.int64], driven: BoolArray) -> None:
        """Send goals (n,), ticks. driven (n,): servos with torque."""
        if self._missing.strikes:  # a silent servo may have restarted
            driven = driven.copy()
            driven[[self._index_of[device] for device in self._missing.strikes]] = False
        for goals in self._goals:
            packet = goals.packet(ticks, driven)
            if packet:
                self.wire.post_goals(packet)

    def begin(self, *, wide: bool) -> None:
        """Begin a cycle. wide: with voltage and temperature."""
        self._cycle += 1
        self._queue.clear()
        self._missing.first.clear()
        self._unanswered = 0.0
        strikes = self._missing.strikes
        late = self._missing.late(self.wire.port.now(), self._cycle) if strikes else []
        for group in self._groups:
            first = [device for device in group.ids if device not in strikes]
            ids = (*first, *[device for device in late if device in group.ids])
            self._enqueue(group.kind, ids, group.wide if wide else group.motion, group.motion, group.names)
        if self._cycle % STATUS_EVERY == 0:
            servo = self.servos[self._cycle // STATUS_EVERY % len(self.servos)]
            if servo.id not in strikes:
                self.request_status([servo.id])

    @property
    def busy(self) -> bool:
        """True if a request is due."""
        return bool(self._queue)

    def send(self) -> None:
        """Send the next request."""
        self.wire.request(self._queue[0].packet)

    def collect(self, readings: Readings) -> None:
        """Receive and keep the answers to the last request."""
        transaction = self._queue.popleft()
        answers, noise = collect(self.wire.port, transaction.request, self.wire.requested_at, transaction.timeouts)
        self._unanswered = -np.inf if answers or noise else self._unanswered + 1
        if answers and transaction.names is not None:
            columns = transaction.columns if answers.ids == transaction.request.ids else self._places(answers.ids)
            rows = transaction.block.unpack(answers)
            readings.take(columns, rows, answers.errors, transaction.names, self.wire.port.now())
        elif answers:
            self._keep_status(readings, transaction.block, answers)
        if len(answers) < len(transaction.request.ids):
            self._again(transaction, answers, noise=noise)

    def request_status(self, devices: Iterable[int]) -> None:
        """Queue reads of torque, errors and watchdog of servos."""
        groups: dict[tuple[ReadKind, object], list[int]] = {}
        for device in devices:
            kind, block = self._status[device]
            groups.setdefault((kind, block.layout), []).append(device)
        for (kind, _), ids in groups.items():
            block = self._status[ids[0]][1]
            alone = ReadKind.SYNC if kind is ReadKind.FAST else ReadKind.SINGLE1 if kind is ReadKind.BULK1 else kind
            self._enqueue(kind if len(ids) > 1 else alone, tuple(ids), block, block, None)

    def end(self, readings: Readings) -> None:
        """End the cycle: count silent servos, and request the status of those that are back."""
        if readings.complete and not self._missing.strikes:
            return
        valid = readings.valid
        back, restarted = self._missing.end({device for device, index in self._index_of.items() if valid[index]})
        for device in restarted:
            readings.drive[self._index_of[device]] = ReportedTorque.UNKNOWN  # it may have restarted: status is read
        self.request_status(back)

    def _places(self, ids: Sequence[int]) -> NDArray[np.int64]:
        return np.array([self._index_of[device] for device in ids])

    def _keep_status(self, readings: Readings, block: Block, answers: Answers) -> None:
        for status in answers.statuses:
            index, table = self._index_of[status.id], self._tables[status.id]
            parts = [table[name] for name in STATUS_REGISTERS if table.has(name)]
            places = [(one, one.address - block.address) for one in parts]
            values = {one.name: one.decode(status.data[at : at + one.size]) for one, at in places}
            tripped = values.get("bus_watchdog", 0) == -1
            driven = ReportedTorque.HELD if tripped else ReportedTorque.ON
            readings.drive[index] = driven if values["torque_enable"] else ReportedTorque.OFF
            readings.take_alert(index, values.get("hardware_error_status", 0))

    def _again(self, transaction: Transaction, answers: Answers, *, noise: bool) -> None:
        """Repeat the request to the silent servos, the first of them last, since it may have silenced the rest.

        Without any byte it is repeated once, in reverse; another silence means a silent line. A single servo that was
        missing before waits for the next cycle.
        """
        self.errors.spoiled += noise
        answered = set(answers.ids)
        silent = [device for device in transaction.request.ids if device not in answered]
        nothing = not answers and not noise
        known = silent[0] in self._missing
        self._missing.first.add(silent[0])
        if self._unanswered >= MOST_UNANSWERED:
            self._queue.clear()
        if transaction.tries == RETRIES or self._unanswered > 1 or (len(silent) == 1 and not noise and known):
            return
        self.errors.retries += 1
        if noise:
            self.wire.note_damage()
        kind = transaction.request.kind
        if kind is ReadKind.FAST and (answers or noise):
            kind = ReadKind.SYNC  # damage in a fast reply spoils all that follows; in single answers only that answer
        late = [device for device in silent if device in self._missing]
        order = [device for device in silent if device not in late]
        order = (order[::-1] if nothing else order) + late
        if transaction.names is not None:  # a status that is due can wait: this cycle takes long enough
            self._queue = deque(later for later in self._queue if later.names is not None)
        again, tries = transaction.again, transaction.tries + 1
        self._enqueue(kind, tuple(order), again, again, transaction.names, tries)

    def _enqueue(
        self, kind: ReadKind, ids: tuple[int, ...], block: Block, again: Block, names: Names | None, tries: int = 0
    ) -> None:
        most = 1 if kind is ReadKind.SINGLE1 else MAX_IDS
        for at in range(0, len(ids), most):
            self._queue.append(self._transaction(kind, ids[at : at + most], block, again, names, tries))

    def _make_transaction(
        self, kind: ReadKind, ids: tuple[int, ...], block: Block, again: Block, names: Names | None, tries: int
    ) -> Transaction:
        request = ReadRequest(kind, ids, block.address, block.size)
        timeouts = request.timeouts(self.wire.port, self._return_delay)
        return Transaction(request, self._places(ids), request.packet(), timeouts, block, again, names, tries)


STATUS_REGISTERS = ("torque_enable", "hardware_error_status", "bus_watchdog")
"""Registers of torque, errors and watchdog, ascending by address."""


def kind_of(table: ControlTable) -> ReadKind:
    """The instruction that reads such servos together."""
    if table.protocol == 2:
        return ReadKind.FAST if table.fast_read else ReadKind.SYNC
    return ReadKind.BULK1 if table.model.startswith("MX") else ReadKind.SINGLE1


def _groups(servos: Sequence[Wired]) -> list[Group]:
    groups: dict[tuple[object, ...], Group] = {}
    for servo in servos:
        names, kind = names_of(servo.table), kind_of(servo.table)
        motion, wide = (block_of(servo.table, *ends) for ends in (names.motion, names.wide))
        key = (kind, names, motion.layout, wide.layout)
        group = groups.get(key) or Group(kind, names, motion, wide, ())
        groups[key] = replace(group, ids=(*group.ids, servo.id))
    return list(groups.values())


WINDOW_S = 0.05
"""[s] Window of the error rate."""
FEWEST = 4  # cycles by which the rate is divided at least: one bad cycle alone is no rate


class ErrorRate:
    """Error rate of one bus. retries, spoiled: repeated requests, and damaged answers, so far. share: of bad cycles in
    the window."""

    def __init__(self) -> None:
        self.retries, self.spoiled = 0, 0
        self.share = 0.0
        self._noted = (0, 0)  # retries and spoiled at the last note
        self._cycles: deque[tuple[float, bool]] = deque()  # time, and whether it was a bad cycle
        self._bad = 0

    def note(self, now: float) -> int:
        """Note a cycle that ended at `now`, s. Return its repeated requests."""
        retries, spoiled = self.retries - self._noted[0], self.spoiled - self._noted[1]
        self._noted = self.retries, self.spoiled
        bad = retries >= RETRIES and spoiled > 0
        self._cycles.append((now, bad))
        self._bad += bad
        while self._cycles[0][0] < now - WINDOW_S:
            self._bad -= self._cycles.popleft()[1]
        self.share = self._bad / max(len(self._cycles), FEWEST)
        return retries


GROUP_TRIES = 3  # requests of one group in a cycle


class BusLine:
    """One port and the servos on it. index_of: servo order of the robot, by id. images: registers as read last, by id.
    seen: tables of all servos found on the bus, by id. cyclic: the exchange of every cycle."""

    def __init__(self, spec: BusSpec, port: BytePort, servos: Sequence[tuple[int, ServoSpec]]) -> None:
        self.spec, self.port = spec, port
        self.servos = {servo.id: servo for _, servo in servos}
        self.index_of = {servo.id: index for index, servo in servos}
        self.client = OneOff(port, spec.protocol)
        self.images: dict[int, ServoImage] = {}
        self.seen: dict[int, ControlTable] = {}
        self._expected = {servo.id: find_table(servo.model.name, spec.protocol) for servo in self.servos.values()}
        self.cyclic = self._wire(self._expected)

    @property
    def where(self) -> str:
        """Its name in messages."""
        return f"bus {self.spec.name}"

    def name_of(self, device: int) -> str:
        """A servo's name in messages."""
        return self.servos[device].label if device in self.servos else f"id {device}"

    def adopt(self, images: dict[int, ServoImage]) -> None:
        """Use the registers as read; firmware chooses the table."""
        before = self.tables, self.longest_delay
        self.images = images
        if (self.tables, self.longest_delay) != before:
            self.cyclic = self._wire(self.tables)

    @property
    def tables(self) -> dict[int, ControlTable]:
        """Control tables of all its servos, by id."""
        return self._expected | {device: image.table for device, image in self.images.items()}

    def places(self, name: str, ids: Iterable[int]) -> dict[Register, list[int]]:
        """Return ids by the register of that name. Unknown models are assumed to have the protocol's usual layout."""
        known = self._expected | self.seen | {device: image.table for device, image in self.images.items()}
        usual, found = usual_table(self.spec.protocol), dict[Register, list[int]]()
        for device in ids:
            found.setdefault(known.get(device, usual)[name], []).append(device)
        return found

    def write_all(self, register: Register, values: Iterable[tuple[int, int]]) -> None:
        """Send (id, counts) for one register, without answers."""
        items = [(device, register.encode(value)) for device, value in values]
        if not items:
            return
        self.cyclic.wire.post(CODECS[self.spec.protocol].sync_write(register.address, register.size, items))

    def read_all(self, register: Register, ids: Sequence[int]) -> dict[int, int]:
        """The counts of one register by id, of those that answer."""
        found = self.read_span(register.address, register.size, ids)
        return {device: register.decode(data) for device, data in found.items()}

    def read_span(self, address: int, size: int, ids: Sequence[int]) -> dict[int, bytes]:
        """Return `size` bytes from `address` by id, of those that answer."""
        found: dict[int, bytes] = {}
        if self.spec.protocol == 1:  # no group read that all models have
            for device in ids:
                with suppress(NoAnswer, ServoError):
                    found[device] = self.client.read_block(device, address, size)
            return found
        silent = list(ids)
        for _ in range(GROUP_TRIES):
            if silent:
                found |= self._read_group(silent, address, size)
            silent = [device for device in silent if device not in found]
            # The first silent one may have silenced the rest, so it comes last.
            silent = [*silent[1:], *silent[:1]]
        for device in silent:  # one by one, a missing servo silences no other
            found |= self._read_group([device], address, size)
        return found

    def _read_group(self, ids: Sequence[int], address: int, size: int) -> dict[int, bytes]:
        request, wire = ReadRequest(ReadKind.SYNC, tuple(ids), address, size), self.cyclic.wire
        wire.request(request.packet())
        timeouts = request.timeouts(self.port, self.longest_delay)
        answers, _ = collect(self.port, request, wire.requested_at, timeouts)
        if len(answers) < len(ids):
            settle(self.port)
        return {status.id: status.data for status in answers.statuses}

    @property
    def longest_delay(self) -> float:
        """Longest return delay of its servos, s."""
        read = [image.value("return_delay_time") * 2e-6 for image in self.images.values()]
        return max([*read, self.spec.return_delay])

    def _wire(self, tables: dict[int, ControlTable]) -> CyclicPort:
        wired = [Wired(self.index_of[device], device, table) for device, table in tables.items()]
        return CyclicPort(self.port, wired, return_delay=self.longest_delay)


def read_cycle(lines: Sequence[BusLine], readings: Readings, *, wide: bool, status: bool = False) -> None:
    """Read all servos on all ports in parallel, then one servo with an alert on each bus. wide: with voltage and
    temperature. status: of all that answered."""
    readings.begin()
    for line in lines:
        line.cyclic.begin(wide=wide)
    _exchange(lines, readings)
    for line in lines:
        line.cyclic.end(readings)
    alarmed = readings.alarmed()
    valid = readings.valid if status else ()
    for line in lines if alarmed or status else ():
        due = [device for device, index in line.index_of.items() if index in alarmed][:1]
        if status:
            due = [device for device, index in line.index_of.items() if valid[index]]
        line.cyclic.request_status(due)
    _exchange(lines, readings)


def _exchange(lines: Sequence[BusLine], readings: Readings) -> None:
    """Send a request on every port, then collect from each, until none is due."""
    busy = [line.cyclic for line in lines if line.cyclic.busy]
    while busy:
        for cyclic in busy:
            cyclic.send()
        for cyclic in busy:
            cyclic.collect(readings)
        busy = [cyclic for cyclic in busy if cyclic.busy]
