"""Requests to single servos by dynamixel-sdk over a `BytePort`, pings that find servos, and refusals in words.

The SDK's packet handlers send and receive; this module interprets the answers, since the SDK takes refusals for data
and alerts for errors. The SDK does not stuff, so a servo refuses a value that holds FF FF FD.
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

ANSWER_SLACK = 0.004
"""[s] Delay of this machine, the driver or the servo."""

SLOT = 0.003
"""[s] Slot of each id in a broadcast ping, as in the SDK."""
BROADCAST_SETTLE = 0.016
"""[s] Time in addition to all slots, as in the SDK."""
PING_BYTES = protocol2.STATUS_BYTES + 3
SPREAD = 0.001
"""[s] Largest difference between the answers of two servos with one id."""
MAX_RECEIVED = 65_536  # bytes kept of a line that does not fall silent


@dataclass(frozen=True)
class FoundServo:
    """A servo on the line. alert: it reports an error. clash: probably two servos with this id."""

    id: int
    protocol: int
    model: int | None = None
    firmware: int | None = None
    alert: bool = False
    clash: bool = False


@dataclass(frozen=True)
class PingReplies:
    """Statuses in order. damaged: bytes of none. echoed: the adapter returned the request."""

    answers: tuple[Status, ...]
    damaged: int
    echoed: bool


def broadcast_ping(port: BytePort, highest: int, slack: float) -> PingReplies:
    """Ping all 2.0 devices, and wait for the slot of id `highest`, since an unknown device may be the last one: at most
    0.78 s at 4 Mbps; 20 ids: 0.08 s."""
    slots = min(highest, MAX_ID) + 1
    request = protocol2.ping(BROADCAST)
    window = (
        BROADCAST_SETTLE + slots * SLOT + 10 * (len(request) + slots * PING_BYTES) / port.baud + port.latency + slack
    )
    return _receive(port, 2, request, window)


def ping_alone(port: BytePort, protocol: int, device: int, wait: float) -> PingReplies:
    """Ping one device, and wait for a second answer. wait: s, in addition to the bytes."""
    return _receive(port, protocol, CODECS[protocol].ping(device), ping_time(port, protocol, wait), enough=2)


def ping_time(port: BytePort, protocol: int, wait: float) -> float:
    """The longest time, s, of such a ping."""
    answer = protocol1.STATUS_BYTES if protocol == 1 else PING_BYTES
    return 10 * (len(CODECS[protocol].ping(0)) + 2 * answer) / port.baud + SPREAD + wait


def found_by_ping(answer: Status, *, clash: bool = False) -> FoundServo:
    """The servo behind a 2.0 answer to a ping."""
    known = len(answer.data) == 3
    return FoundServo(
        id=answer.id,
        protocol=2,
        model=answer.data[0] | answer.data[1] << 8 if known else None,
        firmware=answer.data[2] if known else None,
        alert=bool(answer.error & 0x80),
        clash=clash,
    )


def _receive(port: BytePort, protocol: int, request: bytes, window: float, *, enough: int | None = None) -> PingReplies:
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
    echoed = received.startswith(request)
    codec = CODECS[protocol]
    parser = codec.parser()
    frames = parser.feed(received[len(request) :] if echoed else received)
    answers = [answer for frame in frames if (answer := codec.status_of(frame)) is not None]
    return PingReplies(tuple(answers), parser.skipped + len(parser.pending), echoed)


REFUSED1 = Error1.ANGLE_LIMIT | Error1.RANGE | Error1.CHECKSUM | Error1.INSTRUCTION
"""1.0 error bits about the instruction. The others are the servo's state."""
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
    """The refusal in an error byte: a number (2.0) or bits (1.0); 0: accepted."""
    return error & REFUSED1 if protocol == 1 else error & 0x7F


def state(protocol: int, error: int) -> int:
    """The part of an error byte about the servo itself."""
    return error & 0x7F & ~REFUSED1 if protocol == 1 else error & 0x80


def words(protocol: int, number: int) -> str:
    """A refusal in words."""
    if protocol == 1:
        texts = [text for bit, text in _WORDS1.items() if number & bit]
    else:
        texts = [_WORDS2[Error2(number)]] if number in _WORDS2 else []
    return ", ".join(texts) or f"error {number}, which the protocol does not define"


class ServoError(BusError):
    """A servo refused an instruction, or it was impossible."""


class NoAnswer(BusError):
    """No complete answer in all tries. damaged: tries in which bytes came."""

    def __init__(self, what: str, *, where: str, found: str, then: str, damaged: int) -> None:
        super().__init__(what, where=where, found=found, then=then)
        self.damaged = damaged


SPARE_BYTES = 8
"""The SDK expects the shortest answer. A stuffed one is longer."""


class SdkPort:
    """PortHandler of the SDK for one request over a `BytePort`; the SDK's own polls, waits 34 ms for a missing answer,
    and stays in use after an exception. wait: s, in addition to the bytes."""

    is_using = False

    def __init__(self, port: BytePort, wait: float) -> None:
        self._port, self._wait = port, wait
        self._sent = b""
        self._arrived = bytearray()
        self._read = 0  # bytes of `_arrived` that were given out
        self._deadline = 0.0

    @property
    def echo(self) -> int:
        """Bytes of the request that came back."""
        return len(self._sent) if self._arrived.startswith(self._sent) else 0

    @property
    def answered(self) -> bool:
        """True if bytes other than the echo have arrived."""
        return len(self._arrived) > self.echo

    def clearPort(self) -> None:
        """Drop the input."""
        self._port.drop()

    def writePort(self, packet: list[int]) -> int:
        """Send. Return the number of bytes."""
        self._sent = bytes(packet)
        self._port.write(self._sent)
        return len(self._sent)

    def readPort(self, length: int) -> bytes:
        """Return at most `length` bytes, after a wait for the first until the deadline."""
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
        """Set the deadline of an answer."""
        count = len(self._sent) + packet_length + SPARE_BYTES
        self._deadline = self._port.now() + 10 * count / self._port.baud + self._wait

    def isPacketTimeout(self) -> bool:
        """True after the deadline."""
        return self._port.now() >= self._deadline


MODEL_BYTES = 3
"""1.0: model number and firmware."""
LONGEST_READ = 230
"""Largest answer that the SDK accepts, bytes."""


class OneOff:
    """Requests to one servo at a time, on an open port. return_delay: longest on the line, s. alerted: ids whose last
    answer reported a hardware error. echoes: requests that the adapter returned. Raises ServoError for a refusal,
    NoAnswer for silence."""

    def __init__(self, port: BytePort, protocol: int, *, return_delay: float = 0.0005, retries: int = 2) -> None:
        assert protocol in (1, 2)
        self.port, self.protocol, self.retries = port, protocol, retries
        self._wait = return_delay + port.latency
        self._handler = Protocol1PacketHandler() if protocol == 1 else Protocol2PacketHandler()
        self.alerted: set[int] = set()
        self.echoes = 0

    def ping(self, device: int) -> FoundServo | None:
        """The servo with this id, or None; with `clash` if its last answer came damaged."""
        self._check_id(device)
        found = None
        for done in range(1 + self.retries):
            found = self.probe(device, ANSWER_SLACK * 2**done)
            if found is not None and not found.clash:
                break
        return found

    def scan(self, ids: Iterable[int], *, alone: Iterable[int] | None = None) -> list[FoundServo]:
        """The servos with these ids, and others that answer a broadcast ping (2.0), by id.

        Silent ids are pinged alone (only those of `alone`, if given); all are, if an answer was damaged.
        """
        expected = sorted(set(ids))
        quiet = expected if alone is None else sorted(set(alone))
        for device in expected:
            self._check_id(device)
        found: dict[int, FoundServo] = {}
        left = expected
        if self.protocol == 2 and expected:
            received = broadcast_ping(self.port, expected[-1], ANSWER_SLACK)
            times = Counter(answer.id for answer in received.answers)
            for answer in received.answers:
                found.setdefault(answer.id, found_by_ping(answer, clash=times[answer.id] > 1))
            self.echoes += received.echoed
            for servo in found.values():
                self._note(servo.id, servo.alert)
            if not received.damaged:
                left = [device for device in quiet if device not in found]
        for device in left:
            one = self.probe(device, ANSWER_SLACK)
            if one is not None:
                clash = one.clash or (device in found and found[device].clash)
                found[device] = replace(one, clash=clash)
        return [found[device] for device in sorted(found)]

    def read(self, device: int, register: Register) -> int:
        """A register's value, counts."""
        return register.decode(self.read_block(device, register.address, register.size, register.name))

    def read_block(self, device: int, address: int, length: int, register: str = "") -> bytes:
        """Return `length` bytes from `address`. register: its name in messages."""
        if not 1 <= length <= LONGEST_READ:
            raise self._impossible(device, f"read {length} bytes", f"1 to {LONGEST_READ}")
        codec = CODECS[self.protocol]
        params = codec.number(address) + codec.number(length)
        action = f"read {length} bytes from {address}"
        return self._request(device, Instruction.READ, params, action=action, register=register, size=length).data

    def write(self, device: int, register: Register, value: int, verify: bool = False) -> None:
        """Write counts. verify: read them back, also from a servo that does not answer writes."""
        where = self._where(device, register.name)
        try:
            params = CODECS[self.protocol].number(register.address) + register.encode(value)
        except ValueError as error:
            raise ServoError(str(error), where=where) from error
        try:
            self._request(device, Instruction.WRITE, params, action=f"write {value}", register=register.name)
        except NoAnswer:
            if not verify:
                raise
        kept = self.read(device, register) if verify else value
        if kept != value:
            raise ServoError(f"the servo did not keep {value}", where=where, found=kept)

    def reboot(self, device: int) -> None:
        """Restart a servo, which is silent for about 0.1 s. Protocol 2.0 only."""
        if self.protocol == 1:
            raise self._impossible(device, "reboot", "protocol 2.0 only")
        self._request(device, Instruction.REBOOT, b"", action="reboot")

    def _request(
        self, device: int, code: Instruction, params: bytes, *, action: str, register: str = "", size: int | None = None
    ) -> Status:
        """Send, and return the answer, with `size` bytes if given. Each try waits longer."""
        self._check_id(device)
        damaged, tries, where = 0, 1 + self.retries, self._where(device, register)
        for done in range(tries):
            sdk = SdkPort(self.port, self._wait + ANSWER_SLACK * 2**done)
            answer = self._exchange(sdk, device, code, params)
            self.echoes += sdk.echo > 0
            number = 0 if answer is None else refusal(self.protocol, answer.error)
            # An answer to a damaged instruction, or a stale one of another size, does not count.
            garbled = number & Error1.CHECKSUM if self.protocol == 1 else number == Error2.CRC
            sized = bool(number) or size is None or (answer is not None and len(answer.data) == size)
            fits = answer is not None and not garbled and sized
            if done or not fits:
                settle(self.port)
            if answer is None or not fits:
                damaged += sdk.answered
                continue
            self._note(device, state(self.protocol, answer.error))
            if number:
                then = _NEXT2.get(number, "") if self.protocol == 2 else ""
                found = f"error {number}: {words(self.protocol, number)}"
                raise ServoError(f"the servo refused {action}", where=where, found=found, then=then)
            return answer
        found = f"{tries} tries, {damaged} damaged answers" if damaged else f"{tries} tries, silence"
        then = LOOK_FOR_NOISE if damaged else LOOK_FOR_POWER
        raise NoAnswer(f"no answer to {action}", where=where, found=found, then=then, damaged=damaged)

    def _exchange(self, sdk: SdkPort, device: int, code: Instruction, params: bytes) -> Status | None:
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

    def probe(self, device: int, slack: float) -> FoundServo | None:
        """Ping one id once, and wait for a second answer. slack: s, see ANSWER_SLACK."""
        received = ping_alone(self.port, self.protocol, device, self._wait + slack)
        if received.damaged:
            settle(self.port)
        own = [answer for answer in received.answers if answer.id == device]
        if own:
            self._note(device, state(self.protocol, own[0].error))
        if self.protocol == 1 and (own or received.echoed):
            # A ping returns no model, so it is read. A servo may answer pings only.
            clash = len(own) > 1
            try:
                data = self.read_block(device, 0, MODEL_BYTES)
            except (ServoError, NoAnswer):
                return FoundServo(device, 1, alert=device in self.alerted, clash=clash) if own else None
            model = data[0] | data[1] << 8
            return FoundServo(device, 1, model, data[2], device in self.alerted, clash)
        if not own:
            return FoundServo(device, self.protocol, clash=True) if received.damaged else None
        return found_by_ping(own[0], clash=len(own) > 1)

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
