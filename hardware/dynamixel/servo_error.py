"""What a servo refused or left unanswered, in words."""

from hardware.dynamixel.packets import Error1, Error2
from hardware.errors import BusError, describe

REFUSED1 = Error1.ANGLE_LIMIT | Error1.RANGE | Error1.CHECKSUM | Error1.INSTRUCTION
"""Error bits of protocol 1.0 that are about the instruction; the others tell of the servo's state."""
_WORDS2 = {
    Error2.RESULT_FAIL: "it could not carry the instruction out",
    Error2.INSTRUCTION: "it does not know this instruction, or Action without a registered write",
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
    Error1.INSTRUCTION: "it does not know this instruction, or Action without a registered write",
}
_NEXT2 = {Error2.ACCESS: "Switch torque off before writing EEPROM", Error2.DATA_LIMIT: "Check the servo's limits"}


def refusal(protocol: int, error: int) -> int:
    """What an error byte says against the instruction: the number (2.0) or the bits (1.0); 0: it was obeyed."""
    return error & REFUSED1 if protocol == 1 else error & 0x7F


def state(protocol: int, error: int) -> int:
    """What an error byte tells of the servo itself: ALERT (2.0), or voltage, overheating, overload (1.0)."""
    return error & 0x7F & ~REFUSED1 if protocol == 1 else error & 0x80


def words(protocol: int, number: int) -> str:
    """A refusal in words."""
    if protocol == 1:
        said = [text for bit, text in _WORDS1.items() if number & bit]
    else:
        said = [_WORDS2[Error2(number)]] if number in _WORDS2 else []
    return ", ".join(said) or f"error {number}, which the protocol does not define"


class ServoError(BusError):
    """A servo answered, and refused; or it was asked for something that it cannot have.

    id, register (its name; "" where none is meant), number: see `refusal`; 0 when nothing was sent.
    """

    def __init__(self, message: str, *, device: int, register: str = "", number: int = 0) -> None:
        super().__init__(message)
        self.id, self.register, self.number = device, register, number


class NoAnswer(BusError):
    """A servo gave no whole answer, however often it was asked. damaged: tries that brought bytes all the same."""

    def __init__(self, message: str, *, device: int, tries: int, damaged: int) -> None:
        super().__init__(message)
        self.id, self.tries, self.damaged = device, tries, damaged


def refused(where: str, *, protocol: int, device: int, register: str, number: int, asked: str) -> ServoError:
    """The error for an answer that says no."""
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
