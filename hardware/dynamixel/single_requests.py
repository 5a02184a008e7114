"""Single reads and writes of single servos: dynamixel-sdk's packet handlers over a `BytePort`, and refusals in words.

The SDK sends and receives. This module interprets the answers, since the SDK does so wrongly (models of error replies,
IndexErrors, alerts as errors).
"""

import threading
from collections.abc import Iterable

from dynamixel_sdk import COMM_SUCCESS, Protocol1PacketHandler, Protocol2PacketHandler

from hardware.dynamixel import exchange
from hardware.dynamixel.codec import MAX_ID, Error1, Error2, Instruction, Status, protocol2
from hardware.dynamixel.control_table import Register
from hardware.dynamixel.exchange import Found, settle
from hardware.dynamixel.serial_port import BytePort
from hardware.errors import BusError, describe

# The port that dynamixel-sdk's packet handlers need, over a `BytePort`; and its handlers, with stuffing fixed.  The
# SDK's own port polls, waits 34 ms and more for an answer that does not come, and stays "in use" for ever after an
# exception.

SLACK = 0.004
"""[s] That this machine, the adapter's driver or the servo may be late."""
SPARE_BYTES = 8
"""The SDK asks for the shortest answer's time; a ping's answer is longer."""
_LENGTH_AT, _BODY_AT = 5, 7


class SdkPort:
    """The SDK's PortHandler as its packet handlers see it. Reads sleep; deadlines are of the port's own clock.

    Bytes equal to what was just sent are the echo of a half-duplex adapter: dropped. (In protocol 1.0 a status can
    equal its instruction; `echoed` shows that this may have happened.)
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
        self.received = 0
        """Bytes that arrived since the last instruction, its echo left out."""

    @property
    def is_using(self) -> bool:
        """Never: the SDK's flag outlives exceptions and is no lock; callers that share a port lock it themselves."""
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
        self.echoed, self.received = False, 0
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
            self.received += len(arrived)
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
        """Whether the bytes held may be an echo: the beginning of one, or a whole one with nothing behind it."""
        if not self._unconfirmed or self._unconfirmed.startswith(self._held):
            return bool(self._unconfirmed)
        if self._held.startswith(self._unconfirmed):
            self._drop_echo()
        self._unconfirmed = b""
        return False

    def _drop_echo(self) -> None:
        del self._held[: len(self._unconfirmed)]
        self.received -= len(self._unconfirmed)
        self.echoed = True
        self._unconfirmed = b""


class PatchedProtocol2(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's handler, with byte stuffing that reaches the wire and removes exactly what was added."""

    def addStuffing(self, packet: list[int]) -> list[int]:
        """Stuff the packet in place (the SDK's caller ignores what is returned)."""
        return _with_body(packet, protocol2.stuff(_body(packet)))

    def removeStuffing(self, packet: list[int]) -> list[int]:
        """Undo it, in place."""
        return _with_body(packet, protocol2.unstuff(_body(packet)))


def packet_handler(protocol: int) -> Protocol1PacketHandler | PatchedProtocol2:
    """The SDK's packet handler of a protocol, 1 or 2."""
    return Protocol1PacketHandler() if protocol == 1 else PatchedProtocol2()


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
_NEXT2 = {Error2.ACCESS: "Switch torque off before writing EEPROM", Error2.DATA_LIMIT: "Check the servo's limits"}


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
    """A servo refused an instruction; or the request is impossible, and was not sent.

    id, register (its name; "" where none is meant), number: see `refusal`; 0 when nothing was sent.
    """

    def __init__(self, message: str, *, device: int, register: str = "", number: int = 0) -> None:
        super().__init__(message)
        self.id, self.register, self.number = device, register, number


class NoAnswer(BusError):
    """A servo gave no complete answer in all tries. damaged: tries in which bytes came nevertheless."""

    def __init__(self, message: str, *, device: int, tries: int, damaged: int) -> None:
        super().__init__(message)
        self.id, self.tries, self.damaged = device, tries, damaged


def refused(where: str, *, protocol: int, device: int, register: str, number: int, asked: str) -> ServoError:
    """The error for an answer that refuses."""
    message = describe(
        what=f"the servo refused {asked}",
        where=where,
        found=f"error {number}: {words(protocol, number)}",
        then=_NEXT2.get(Error2(number), "") if protocol == 2 and number in _WORDS2 else "",
    )
    return ServoError(message, device=device, register=register, number=number)


def unanswered(where: str, *, device: int, tries: int, damaged: int, asked: str) -> NoAnswer:
    """The error for silence, or for damaged answers only."""
    if damaged:
        found = f"{tries} tries, {damaged} damaged answers"
        then = "Look for a second servo with this id, for noise and for loose wires"
    else:
        found = f"{tries} tries, silence"
        then = "Check power, wiring, id, baud rate and protocol, or whether the host is too busy"
    message = describe(what=f"no answer to {asked}", where=where, found=found, then=then)
    return NoAnswer(message, device=device, tries=tries, damaged=damaged)


MODEL_BYTES = 3
"""Protocol 1.0: model number and firmware, from address 0."""
LONGEST_READ = 230
"""Bytes of one answer that the SDK takes in both protocols."""


class OneOff:
    """Requests to one servo at a time, on an open port. One caller at a time: others wait.

    return_delay: s, the longest Return Delay Time on the line. retries: further tries after silence or damage. Raises
    ServoError when a servo refuses, NoAnswer when it stays silent, BusError when the port is gone.
    """

    def __init__(self, port: BytePort, protocol: int, *, return_delay: float = 0.0005, retries: int = 2) -> None:
        assert protocol in (1, 2)
        self.port, self.protocol, self.retries = port, protocol, retries
        self._return_delay = return_delay
        self._sdk = SdkPort(port, return_delay=return_delay)
        self._handler = packet_handler(protocol)
        self._lock = threading.RLock()
        self._states: dict[int, int] = {}
        self.echoes = False
        """Whether the adapter gives back what is sent. A ping of 1.0 proves nothing: its answer can equal it."""

    @property
    def alerted(self) -> tuple[int, ...]:
        """Ids whose last answer reported a hardware error (2.0: ALERT; 1.0: voltage, overheating, overload)."""
        return tuple(sorted(device for device, state in self._states.items() if state))

    def ping(self, device: int) -> Found | None:
        """The servo with this id; None when no servo answers. If all answers came damaged: found, with `clash`."""
        try:
            answer = self._ask(device, Instruction.PING, b"", asked="ping")
        except ServoError as error:
            if not error.number:
                raise
            return Found(device, self.protocol, alert=device in self.alerted)
        except NoAnswer as silence:
            if self.protocol == 1 and self._sdk.echoed:
                return self._found1(device)
            return Found(device, self.protocol, clash=True) if silence.damaged == silence.tries else None
        return exchange.found_by_ping(answer) if self.protocol == 2 else self._found1(device, answered=True)

    def scan(self, ids: Iterable[int]) -> list[Found]:
        """The servos with these ids, and others that answer a broadcast ping (2.0), by id.

        Ids that do not answer the broadcast are pinged alone; all of them, when some answer was damaged.
        """
        wanted = sorted(set(ids))
        for device in wanted:
            self._check_id(device)
        found: dict[int, Found] = {}
        with self._lock:
            if self.protocol == 2 and wanted:
                received = exchange.broadcast_ping(self.port, wanted[-1], SLACK)
                found = {servo.id: servo for servo in exchange.found_by_broadcast(received)}
                doubtful = received.damaged > 0
                self.echoes = self.echoes or received.echoed
                for servo in found.values():
                    self._note(servo.id, 0x80 if servo.alert else 0)
            else:
                doubtful = True
            for device in wanted:
                if doubtful or device not in found:
                    alone = self._probe(device)
                    if alone is not None:
                        clash = alone.clash or (device in found and found[device].clash)
                        found[device] = Found(device, self.protocol, alone.model, alone.firmware, alone.alert, clash)
        return [found[device] for device in sorted(found)]

    def read(self, device: int, register: Register) -> int:
        """A register's value, in counts."""
        return register.decode(self._read(device, register.address, register.size, register.name))

    def read_block(self, device: int, address: int, length: int) -> bytes:
        """`length` bytes from `address`."""
        return self._read(device, address, length, "")

    def write(self, device: int, register: Register, value: int, verify: bool = False) -> None:
        """Write counts. verify: read them back (also where the servo's Status Return Level excludes answers to
        writes)."""
        try:
            data = register.encode(value)
        except ValueError as error:
            raise ServoError(
                describe(what=str(error), where=self._where(device, register.name)),
                device=device,
                register=register.name,
            ) from error
        address = bytes((register.address,)) if self.protocol == 1 else register.address.to_bytes(2, "little")
        asked = f"write {value}"
        try:
            self._ask(device, Instruction.WRITE, address + data, asked=asked, register=register.name)
        except NoAnswer:
            if not verify:
                raise
        if verify:
            kept = self.read(device, register)
            if kept != value:
                raise ServoError(
                    describe(
                        what=f"the servo did not keep {value}", where=self._where(device, register.name), found=kept
                    ),
                    device=device,
                    register=register.name,
                )

    def reboot(self, device: int) -> None:
        """Restart a servo; it stays silent for some 0.1 s. Protocol 2.0 only."""
        if self.protocol == 1:
            raise self._impossible(device, "reboot", "protocol 2.0 only")
        self._ask(device, Instruction.REBOOT, b"", asked="reboot")

    def _read(self, device: int, address: int, length: int, register: str) -> bytes:
        if not 1 <= length <= LONGEST_READ:
            raise self._impossible(device, f"read {length} bytes", f"1 to {LONGEST_READ}")
        if self.protocol == 1:
            params = bytes((address, length))
        else:
            params = address.to_bytes(2, "little") + length.to_bytes(2, "little")
        asked = f"read {length} bytes from {address}"
        return self._ask(device, Instruction.READ, params, asked=asked, register=register, size=length).data

    def _ask(
        self, device: int, code: Instruction, params: bytes, *, asked: str, register: str = "", size: int | None = None
    ) -> Status:
        """Send, and return the answer, with `size` bytes of data where that is known. Bounded tries, each waits
        longer."""
        self._check_id(device)
        damaged, tries = 0, 1 + self.retries
        with self._lock:
            for done in range(tries):
                self._sdk.slack = SLACK * 2**done
                answer = self._exchange(device, code, params)
                unfit = answer is None or not self._fits(answer, size)
                if (done or unfit) and (code is not Instruction.PING or self._sdk.received):
                    settle(self.port)
                if answer is None or unfit:
                    damaged += self._sdk.received > 0
                    continue
                self._note(device, state(self.protocol, answer.error))
                number = refusal(self.protocol, answer.error)
                if number:
                    raise refused(
                        self._where(device, register),
                        protocol=self.protocol,
                        device=device,
                        register=register,
                        number=number,
                        asked=asked,
                    )
                return answer
        where = self._where(device, register)
        raise unanswered(where, device=device, tries=tries, damaged=damaged, asked=asked)

    def _exchange(self, device: int, code: Instruction, params: bytes) -> Status | None:
        """Send one instruction through the SDK; None without a complete answer."""
        if self.protocol == 1:
            head, tail, at = [0, 0, device, len(params) + 2, code], 1, 2
        else:
            length = (len(params) + 3).to_bytes(2, "little")
            head, tail, at = [0, 0, 0, 0, device, *length, code], 2, 4
        received, result, _ = self._handler.txRxPacket(self._sdk, [*map(int, head), *params, *([0] * tail)])
        self.echoes = self.echoes or (self._sdk.echoed and code is not Instruction.PING)
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

    def _probe(self, device: int) -> Found | None:
        """Ping one id, and wait for a second answer too."""
        received = exchange.ping_alone(self.port, self.protocol, device, self._return_delay + self.port.latency + SLACK)
        own = [answer for answer in received.answers if answer.id == device]
        if not own:
            if self.protocol == 1 and received.echoed:
                return self._found1(device)
            return Found(device, self.protocol, clash=True) if received.damaged else None
        self._note(device, state(self.protocol, own[0].error))
        if self.protocol == 2:
            return exchange.found_by_ping(own[0], clash=len(own) > 1)
        return self._found1(device, answered=True, clash=len(own) > 1)

    def _found1(self, device: int, *, answered: bool = False, clash: bool = False) -> Found | None:
        """A 1.0 servo: a ping returns no model, so it is read; a servo may be set to answer pings only."""
        try:
            data = self.read_block(device, 0, MODEL_BYTES)
        except (ServoError, NoAnswer):
            return Found(device, 1, alert=device in self.alerted, clash=clash) if answered else None
        model = data[0] | data[1] << 8
        return Found(device, 1, model, data[2], device in self.alerted, clash)

    def _note(self, device: int, state: int) -> None:
        self._states[device] = state

    def _check_id(self, device: int) -> None:
        highest = MAX_ID if self.protocol == 2 else MAX_ID + 1
        if not 0 <= device <= highest:
            raise self._impossible(device, f"id {device}", f"0 to {highest}, since only one servo can answer")

    def _impossible(self, device: int, what: str, allowed: str) -> ServoError:
        return ServoError(
            describe(what=f"cannot do: {what}", where=self._where(device, ""), allowed=allowed), device=device
        )

    def _where(self, device: int, register: str) -> str:
        return f"{self.port.name}, id {device}" + (f", {register}" if register else "")
