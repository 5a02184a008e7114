"""One-off reads and writes of single servos, and who is there: dynamixel-sdk's packet handlers over a `BytePort`.

The SDK sends and receives; what it would make of the answer (models of error replies, IndexErrors, alerts as errors) is
decided here.
"""

import threading
from collections.abc import Iterable
from enum import IntEnum

from dynamixel_sdk import COMM_SUCCESS

from hardware.dynamixel import discovery, servo_error
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.exchange import settle
from hardware.dynamixel.packets import MAX_ID, Error1, Error2, Instruction, Status
from hardware.dynamixel.register import Register
from hardware.dynamixel.sdk_port import SLACK, SdkPort, packet_handler
from hardware.dynamixel.servo_error import NoAnswer, ServoError
from hardware.errors import describe

__all__ = ["Found", "NoAnswer", "OneOff", "ResetScope", "ServoError"]

MODEL_BYTES = 3
"""Protocol 1.0: model number and firmware, from address 0."""
LONGEST_READ = 230
"""Bytes of one answer that the SDK takes in both protocols."""
_CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"


class ResetScope(IntEnum):
    """What a factory reset leaves as it is."""

    NOTHING = 0xFF
    ID = 0x01
    ID_AND_BAUD = 0x02


class OneOff:
    """Exchanges with one servo at a time, on an open port. One caller at a time: others wait.

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
        """Whether the adapter gives back what is sent. A ping of 1.0 proves nothing: its answer can be its equal."""

    @property
    def alerted(self) -> tuple[int, ...]:
        """Ids whose last answer told of a hardware error (2.0: ALERT; 1.0: voltage, overheating, overload)."""
        return tuple(sorted(device for device, state in self._states.items() if state))

    def ping(self, device: int) -> Found | None:
        """Who has this id; None when nobody answers. Answers that all came damaged: found, with `clash`."""
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
        return discovery.found_by_ping(answer) if self.protocol == 2 else self._found1(device, answered=True)

    def scan(self, ids: Iterable[int]) -> list[Found]:
        """Who of these ids is there, and who else a broadcast ping (2.0) brings up, by id.

        Ids that the broadcast leaves open are pinged alone; all of them, when some answer was damaged.
        """
        wanted = sorted(set(ids))
        for device in wanted:
            self._check_id(device)
        found: dict[int, Found] = {}
        with self._lock:
            if self.protocol == 2 and wanted:
                heard = discovery.broadcast_ping(self.port, wanted[-1], SLACK)
                found = {servo.id: servo for servo in discovery.found_by_broadcast(heard)}
                doubtful = heard.damaged > 0
                self.echoes = self.echoes or heard.echoed
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
        """Write counts. verify: read them back (also where the servo's Status Return Level mutes answers to writes)."""
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
        """Start a servo anew; it stays silent for some 0.1 s. Protocol 2.0 only."""
        self._need_protocol2(device, "reboot")
        self._ask(device, Instruction.REBOOT, b"", asked="reboot")

    def factory_reset(self, device: int, scope: ResetScope = ResetScope.ID_AND_BAUD) -> None:
        """Bring the control table back to the maker's; 1.0 resets all of it, the id too."""
        if self.protocol == 1 and scope is not ResetScope.NOTHING:
            raise self._impossible(device, "factory reset that keeps the id", "protocol 1.0 resets everything")
        self._ask(device, Instruction.FACTORY_RESET, bytes((scope,)) if self.protocol == 2 else b"", asked="reset")

    def clear(self, device: int) -> None:
        """Forget whole turns of the present position. Protocol 2.0 only; refused while it moves."""
        self._need_protocol2(device, "clear")
        self._ask(device, Instruction.CLEAR, _CLEAR_TURNS, asked="clear")

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
        """Send, and have the answer: `size` bytes of data where that is known. Bounded tries, each more patient."""
        self._check_id(device)
        damaged, tries = 0, 1 + self.retries
        with self._lock:
            for done in range(tries):
                self._sdk.slack = SLACK * 2**done
                answer = self._exchange(device, code, params)
                unfit = answer is None or not self._fits(answer, size)
                if (done or unfit) and (code is not Instruction.PING or self._sdk.heard):
                    settle(self.port)
                if answer is None or unfit:
                    damaged += self._sdk.heard > 0
                    continue
                self._note(device, servo_error.state(self.protocol, answer.error))
                number = servo_error.refusal(self.protocol, answer.error)
                if number:
                    raise servo_error.refused(
                        self._where(device, register),
                        protocol=self.protocol,
                        device=device,
                        register=register,
                        number=number,
                        asked=asked,
                    )
                return answer
        where = self._where(device, register)
        raise servo_error.unanswered(where, device=device, tries=tries, damaged=damaged, asked=asked)

    def _exchange(self, device: int, code: Instruction, params: bytes) -> Status | None:
        """One instruction and the SDK's verdict; None without a whole answer."""
        if self.protocol == 1:
            head, tail, at = [0, 0, device, len(params) + 2, code], 1, 2
        else:
            length = (len(params) + 3).to_bytes(2, "little")
            head, tail, at = [0, 0, 0, 0, device, *length, code], 2, 4
        heard, result, _ = self._handler.txRxPacket(self._sdk, [*map(int, head), *params, *([0] * tail)])
        self.echoes = self.echoes or (self._sdk.echoed and code is not Instruction.PING)
        if result != COMM_SUCCESS or heard is None or heard[at] != device:
            return None
        frame = bytes(heard)
        if self.protocol == 1:
            return Status(device, frame[4], frame[5 : frame[3] + 3]) if frame[3] >= 2 else None
        length2 = frame[5] | frame[6] << 8
        return Status(device, frame[8], frame[9 : length2 + 5]) if length2 >= 4 else None

    def _fits(self, answer: Status, size: int | None) -> bool:
        """Whether it is an answer to what was asked: not to a damaged instruction, nor a stale one of another size."""
        number = servo_error.refusal(self.protocol, answer.error)
        garbled = number & Error1.CHECKSUM if self.protocol == 1 else number == Error2.CRC
        return not garbled and (bool(number) or size is None or len(answer.data) == size)

    def _probe(self, device: int) -> Found | None:
        """Ping one id and listen for a second answer."""
        heard = discovery.ping_alone(self.port, self.protocol, device, self._return_delay + self.port.latency + SLACK)
        own = [answer for answer in heard.answers if answer.id == device]
        if not own:
            if self.protocol == 1 and heard.echoed:
                return self._found1(device)
            return Found(device, self.protocol, clash=True) if heard.damaged else None
        self._note(device, servo_error.state(self.protocol, own[0].error))
        if self.protocol == 2:
            return discovery.found_by_ping(own[0], clash=len(own) > 1)
        return self._found1(device, answered=True, clash=len(own) > 1)

    def _found1(self, device: int, *, answered: bool = False, clash: bool = False) -> Found | None:
        """A 1.0 servo: a ping tells no model, so it is read; a servo may be set to answer pings only."""
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

    def _need_protocol2(self, device: int, what: str) -> None:
        if self.protocol == 1:
            raise self._impossible(device, what, "protocol 2.0 only")

    def _impossible(self, device: int, what: str, allowed: str) -> ServoError:
        return ServoError(
            describe(what=f"cannot do: {what}", where=self._where(device, ""), allowed=allowed), device=device
        )

    def _where(self, device: int, register: str) -> str:
        return f"{self.port.name}, id {device}" + (f", {register}" if register else "")
