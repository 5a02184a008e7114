"""Codes of both protocols."""

from hardware.dynamixel.codec import ALERT, BROADCAST, MAX_ID, STATUS, Error1, Error2, Frame, Instruction, Status


def test_codes_are_those_of_the_manual() -> None:
    assert [code.value for code in Instruction] == [
        *(0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x10, 0x20),
        *(0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A),
    ]
    assert STATUS not in [code.value for code in Instruction]
    assert (BROADCAST, MAX_ID) == (254, 252)


def test_an_alert_stands_beside_the_error_number() -> None:
    for error in Error2:
        assert (error | ALERT) & 0x7F == error
    assert len(Error2) == 8


def test_errors_of_the_first_protocol_are_bits() -> None:
    assert sum(Error1) == 0x7F
    assert Error1(0x24) == Error1.OVERHEATING | Error1.OVERLOAD


def test_frames_and_statuses_are_values() -> None:
    assert Frame(1, 2, b"\x03") == (1, 2, b"\x03")
    assert hash(Status(1, 0, b"")) == hash(Status(1, 0, b""))
