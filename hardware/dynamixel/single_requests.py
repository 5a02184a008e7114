"""Requests to single servos: reads and writes by dynamixel-sdk over a `BytePort`, pings that find servos, refusals in
words.

The SDK's packet handlers send and receive. This module interprets the answers, since the SDK takes refusals for data
and alerts for errors. It does not stuff what it sends: a value whose bytes hold FF FF FD is refused by the servo.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

from dynamixel_sdk import COMM_SUCCESS, Protocol1PacketHandler, Protocol2PacketHandler

from hardware.dynamixel.codec import (
    BROADCAST,
    CODECS,
    MAX_ID,
    Error1,
    Error2,
    Instruction,
    Status,
    protocol1,
    protocol2,
)
from hardware.dynamixel.control_table import Register
from hardware.dynamixel.serial_port import BytePort, settle
from hardware.errors import BusError

SLACK = 0.004
"""[s] That this machine, the adapter's driver or the servo may be late."""

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
class FoundServo:
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
    return _ask(port, protocol, CODECS[protocol].ping(device), ping_time(port, protocol, wait), enough=2)


def ping_time(port: BytePort, protocol: int, wait: float) -> float:
    """Longest time, s, that a ping of one device takes, with a second answer; `wait`: see `ping_alone`."""
    answer = protocol1.STATUS_BYTES if protocol == 1 else PING_BYTES
    return 10 * (len(CODECS[protocol].ping(0)) + 2 * answer) / port.baud + SPREAD + wait


def found_by_ping(answer: Status, *, clash: bool = False) -> FoundServo:
    """The servo behind a 2.0 answer to a ping; a refusal carries no model."""
    known = len(answer.data) == 3
    return FoundServo(
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


# Refusals and missing answers, in words.

REFUSED1 = Error1.ANGLE_LIMIT | Error1.RANGE | Error1.CHECKSUM | Error1.INSTRUCTION
"""Error bits of protocol 1.0 that are about the instruction; the others show the servo's state."""
_WORDS2 = {
    Error2.RESULT_FAIL: "it could not carry the instruction out",
    Error2.INSTRUCTION: "this instruction is not supported, or Action without a registered write",
    Error2.CRC: "the instruction arrived damaged",
    Error2.DATA_RANGE: "the value is outside the register's range, or the bus watchdog has tripped",
    Error2.DATA_LENGTH: "the data are shorter than the register",
    Error2.DATA_LIMIT: "the value is beyond a limit set in the servo",
    Error2.ACCESS: "no such register, or it is read-only, or EEPROM is locked while torque is on",
}
_WORDS1 = {
    Error1.ANGLE_LIMIT: "the goal is outside its angle limits",
    Error1.RANGE: "the value is outside the register's range",
    Error1.CHECKSUM: "the instruction arrived damaged",
    Error1.INSTRUCTION: "this instruction is not supported, or Action without a registered write",
}
_NEXT2: dict[int, str] = {
    Error2.ACCESS: "Switch torque off before writing EEPROM",
    Error2.DATA_LIMIT: "Check the servo's limits",
}
LOOK_FOR_NOISE = "Look for a second servo with this id, for noise and for loose wires"
LOOK_FOR_POWER = "Check power, wiring, id, baud rate and protocol, or whether the host is too busy"


def refusal(protocol: int, error: int) -> int:
    """The part of an error byte that refuses the instruction: a number (2.0) or bits (1.0); 0: it was accepted."""
    return error & REFUSED1 if protocol == 1 else error & 0x7F


def state(protocol: int, error: int) -> int:
    """The part of an error byte about the servo itself: ALERT (2.0), or voltage, overheating, overload (1.0)."""
    return error & 0x7F & ~REFUSED1 if protocol == 1 else error & 0x80


def words(protocol: int, number: int) -> str:
    """A refusal in words."""
    if protocol == 1:
        texts = [text for bit, text in _WORDS1.items() if number & bit]
    else:
        texts = [_WORDS2[Error2(number)]] if number in _WORDS2 else []
    return ", ".join(texts) or f"error {number}, which the protocol does not define"


class ServoError(BusError):
    """A servo refused an instruction; or the request is impossible, and was not sent."""


class NoAnswer(BusError):
    """A servo gave no complete answer in all tries. damaged: tries in which bytes came nevertheless."""

    def __init__(self, what: str, *, where: str, found: str, then: str, damaged: int) -> None:
        super().__init__(what, where=where, found=found, then=then)
        self.damaged = damaged


# The port that dynamixel-sdk's packet handlers need, over a `BytePort`. The SDK's own port polls, waits 34 ms and more
# for an answer that does not come, and stays "in use" for ever after an exception.

SPARE_BYTES = 8
"""The SDK asks for the shortest answer's time; one that is stuffed is longer."""


class SdkPort:
    """The SDK's PortHandler as its packet handlers see it, for one request. Reads sleep; deadlines are of the port's
    own clock. wait: s added to the time of the bytes.

    Bytes equal to what was just sent are the echo of a half-duplex adapter: dropped.
    """

    is_using = False

    def __init__(self, port: BytePort, wait: float) -> None:
        self._port, self._wait = port, wait
        self._sent = b""
        self._arrived = bytearray()
        self._read = 0  # bytes of `_arrived` that were given out
        self._deadline = 0.0

    @property
    def echo(self) -> int:
        """Bytes of what was sent that came back: all or none."""
        return len(self._sent) if self._arrived.startswith(self._sent) else 0

    @property
    def answered(self) -> bool:
        """Whether bytes have arrived that are not the echo."""
        return len(self._arrived) > self.echo

    def clearPort(self) -> None:
        """Forget what has arrived."""
        self._port.drop()

    def writePort(self, packet: list[int]) -> int:
        """Send; the number of bytes."""
        self._sent = bytes(packet)
        self._port.write(self._sent)
        return len(self._sent)

    def readPort(self, length: int) -> bytes:
        """Read at most `length` bytes; waits for the first of them, until the deadline at most."""
        while length > 0 and (len(self._arrived) <= self._read or self._sent.startswith(self._arrived)):
            self._port.wait(self._deadline)
            late = self._port.now() >= self._deadline
            self._arrived += self._port.read()
            if late:
                break
        self._read = max(self._read, self.echo)
        begin, self._read = self._read, min(self._read + max(length, 0), len(self._arrived))
        return bytes(self._arrived[begin : self._read])

    def setPacketTimeout(self, packet_length: int) -> None:
        """Wait for an answer of so many bytes, to what was just sent."""
        count = len(self._sent) + packet_length + SPARE_BYTES
        self._deadline = self._port.now() + 10 * count / self._port.baud + self._wait

    def isPacketTimeout(self) -> bool:
        """Whether the deadline has passed."""
        return self._port.now() >= self._deadline


MODEL_BYTES = 3
"""Protocol 1.0: model number and firmware, from address 0."""
LONGEST_READ = 230
"""Bytes of one answer that the SDK takes in both protocols."""


class OneOff:
    """Requests to one servo at a time, on an open port.

    return_delay: s, the longest Return Delay Time on the line. retries: further tries after silence or damage. alerted:
    ids whose last answer reported a hardware error (2.0: ALERT; 1.0: voltage, overheating, overload). echoes: requests
    that the adapter gave back; a ping of 1.0 proves nothing, as its answer can equal it. Raises ServoError when a servo
    refuses, NoAnswer when it stays silent, BusError when the port is gone.
    """

    def __init__(self, port: BytePort, protocol: int, *, return_delay: float = 0.0005, retries: int = 2) -> None:
        assert protocol in (1, 2)
        self.port, self.protocol, self.retries = port, protocol, retries
        self._wait = return_delay + port.latency
        self._handler = Protocol1PacketHandler() if protocol == 1 else Protocol2PacketHandler()
        self.alerted: set[int] = set()
        self.echoes = 0

    def ping(self, device: int) -> FoundServo | None:
        """The servo with this id; None when no servo answers. If the last answer came damaged: found, with `clash`."""
        self._check_id(device)
        found = None
        for done in range(1 + self.retries):
            found = self.probe(device, SLACK * 2**done)
            if found is not None and not found.clash:
                break
        return found

    def scan(self, ids: Iterable[int], *, alone: Iterable[int] | None = None) -> list[FoundServo]:
        """The servos with these ids, and others that answer a broadcast ping (2.0), by id.

        Ids that do not answer the broadcast are pinged alone (only those of `alone`, where it is given); all of them,
        when some answer was damaged.
        """
        wanted = sorted(set(ids))
        quiet = wanted if alone is None else sorted(set(alone))
        for device in wanted:
            self._check_id(device)
        found: dict[int, FoundServo] = {}
        left = wanted
        if self.protocol == 2 and wanted:
            received = broadcast_ping(self.port, wanted[-1], SLACK)
            times = Counter(answer.id for answer in received.answers)
            for answer in received.answers:
                found.setdefault(answer.id, found_by_ping(answer, clash=times[answer.id] > 1))
            self.echoes += received.echoed
            for servo in found.values():
                self._note(servo.id, servo.alert)
            if not received.damaged:
                left = [device for device in quiet if device not in found]
        for device in left:
            one = self.probe(device, SLACK)
            if one is not None:
                clash = one.clash or (device in found and found[device].clash)
                found[device] = replace(one, clash=clash)
        return [found[device] for device in sorted(found)]

    def read(self, device: int, register: Register) -> int:
        """A register's value, in counts."""
        return register.decode(self.read_block(device, register.address, register.size, register.name))

    def read_block(self, device: int, address: int, length: int, register: str = "") -> bytes:
        """`length` bytes from `address`; register: its name in messages."""
        if not 1 <= length <= LONGEST_READ:
            raise self._impossible(device, f"read {length} bytes", f"1 to {LONGEST_READ}")
        codec = CODECS[self.protocol]
        params = codec.number(address) + codec.number(length)
        asked = f"read {length} bytes from {address}"
        return self._ask(device, Instruction.READ, params, asked=asked, register=register, size=length).data

    def write(self, device: int, register: Register, value: int, verify: bool = False) -> None:
        """Write counts. verify: read them back (also where the servo's Status Return Level excludes answers to
        writes)."""
        where = self._where(device, register.name)
        try:
            params = CODECS[self.protocol].number(register.address) + register.encode(value)
        except ValueError as error:
            raise ServoError(str(error), where=where) from error
        try:
            self._ask(device, Instruction.WRITE, params, asked=f"write {value}", register=register.name)
        except NoAnswer:
            if not verify:
                raise
        kept = self.read(device, register) if verify else value
        if kept != value:
            raise ServoError(f"the servo did not keep {value}", where=where, found=kept)

    def reboot(self, device: int) -> None:
        """Restart a servo; it stays silent for some 0.1 s. Protocol 2.0 only."""
        if self.protocol == 1:
            raise self._impossible(device, "reboot", "protocol 2.0 only")
        self._ask(device, Instruction.REBOOT, b"", asked="reboot")

    def _ask(
        self, device: int, code: Instruction, params: bytes, *, asked: str, register: str = "", size: int | None = None
    ) -> Status:
        """Send, and return the answer, with `size` bytes of data where that is known. Bounded tries, each waits
        longer."""
        self._check_id(device)
        damaged, tries, where = 0, 1 + self.retries, self._where(device, register)
        for done in range(tries):
            sdk = SdkPort(self.port, self._wait + SLACK * 2**done)
            answer = self._exchange(sdk, device, code, params)
            self.echoes += sdk.echo > 0
            fits = answer is not None and self._fits(answer, size)
            if done or not fits:
                settle(self.port)
            if answer is None or not fits:
                damaged += sdk.answered
                continue
            self._note(device, state(self.protocol, answer.error))
            number = refusal(self.protocol, answer.error)
            if number:
                then = _NEXT2.get(number, "") if self.protocol == 2 else ""
                found = f"error {number}: {words(self.protocol, number)}"
                raise ServoError(f"the servo refused {asked}", where=where, found=found, then=then)
            return answer
        found = f"{tries} tries, {damaged} damaged answers" if damaged else f"{tries} tries, silence"
        then = LOOK_FOR_NOISE if damaged else LOOK_FOR_POWER
        raise NoAnswer(f"no answer to {asked}", where=where, found=found, then=then, damaged=damaged)

    def _exchange(self, sdk: SdkPort, device: int, code: Instruction, params: bytes) -> Status | None:
        """Send one instruction through the SDK; None without a complete answer."""
        if self.protocol == 1:
            head, tail, at = [0, 0, device, len(params) + 2, code], 1, 2
        else:
            length = (len(params) + 3).to_bytes(2, "little")
            head, tail, at = [0, 0, 0, 0, device, *length, code], 2, 4
        received, result, _ = self._handler.txRxPacket(sdk, [*map(int, head), *params, *([0] * tail)])
        if result != COMM_SUCCESS or received is None or received[at] != device:
            return None
        frame = bytes(received)
        if self.protocol == 1:
            return Status(device, frame[4], frame[5 : frame[3] + 3]) if frame[3] >= 2 else None
        length2 = frame[5] | frame[6] << 8
        return Status(device, frame[8], frame[9 : length2 + 5]) if length2 >= 4 else None

    def _fits(self, answer: Status, size: int | None) -> bool:
        """Whether it is an answer to what was asked: not to a damaged instruction, nor a stale one of another size."""
        number = refusal(self.protocol, answer.error)
        garbled = number & Error1.CHECKSUM if self.protocol == 1 else number == Error2.CRC
        return not garbled and (bool(number) or size is None or len(answer.data) == size)

    def probe(self, device: int, slack: float) -> FoundServo | None:
        """Ping one id once, and wait for a second answer too; slack: s, see SLACK."""
        received = ping_alone(self.port, self.protocol, device, self._wait + slack)
        if received.damaged:
            settle(self.port)
        own = [answer for answer in received.answers if answer.id == device]
        if own:
            self._note(device, state(self.protocol, own[0].error))
        if self.protocol == 1 and (own or received.echoed):
            return self._found1(device, answered=bool(own), clash=len(own) > 1)
        if not own:
            return FoundServo(device, self.protocol, clash=True) if received.damaged else None
        return found_by_ping(own[0], clash=len(own) > 1)

    def _found1(self, device: int, *, answered: bool, clash: bool) -> FoundServo | None:
        """A 1.0 servo: a ping returns no model, so it is read; a servo may be set to answer pings only."""
        try:
            data = self.read_block(device, 0, MODEL_BYTES)
        except (ServoError, NoAnswer):
            return FoundServo(device, 1, alert=device in self.alerted, clash=clash) if answered else None
        model = data[0] | data[1] << 8
        return FoundServo(device, 1, model, data[2], device in self.alerted, clash)

    def _note(self, device: int, state: int) -> None:
        if state:
            self.alerted.add(device)
        else:
            self.alerted.discard(device)

    def _check_id(self, device: int) -> None:
        highest = CODECS[self.protocol].MOST_MEMBERS
        if not 0 <= device <= highest:
            raise self._impossible(device, f"id {device}", f"0 to {highest}, since only one servo can answer")

    def _impossible(self, device: int, what: str, allowed: str) -> ServoError:
        return ServoError(f"cannot do: {what}", where=self._where(device, ""), allowed=allowed)

    def _where(self, device: int, register: str) -> str:
        return f"{self.port.name}, id {device}" + (f", {register}" if register else "")
