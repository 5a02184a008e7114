"""Refusals and silence in words."""

import pytest

from hardware.dynamixel import servo_error
from hardware.dynamixel.packets import ALERT, Error1, Error2
from hardware.errors import BusError
from support.messages import shows


@pytest.mark.parametrize("number", [error for error in Error2 if error])
def test_every_number_of_protocol_2_is_explained(number: Error2) -> None:
    assert servo_error.refusal(2, ALERT | number) == number
    assert servo_error.state(2, ALERT | number) == ALERT
    shows(servo_error.words(2, number))


@pytest.mark.parametrize("bit", list(Error1))
def test_a_bit_of_protocol_1_is_about_the_instruction_or_the_servo(bit: Error1) -> None:
    about_servo = bit in (Error1.INPUT_VOLTAGE, Error1.OVERHEATING, Error1.OVERLOAD)
    assert bool(servo_error.state(1, bit)) == about_servo
    assert bool(servo_error.refusal(1, bit)) != about_servo
    if not about_servo:
        shows(servo_error.words(1, bit))


def test_several_bits_are_all_said() -> None:
    said = servo_error.words(1, Error1.RANGE | Error1.INSTRUCTION)
    shows(said)


def test_what_no_protocol_defines() -> None:
    assert servo_error.words(2, 99) == "error 99, which the protocol does not define"
    error = servo_error.refused("p, id 1", protocol=2, device=1, register="", number=99, asked="ping")
    shows(str(error), 99)


def test_locked_eeprom_is_explained() -> None:
    error = servo_error.refused("p, id 5, id", protocol=2, device=5, register="id", number=7, asked="write 6")
    assert (error.id, error.register, error.number) == (5, "id", 7)
    shows(str(error), "EEPROM")
    assert isinstance(error, BusError)


def test_silence_and_damage_differ() -> None:
    silent = servo_error.unanswered("p, id 5", device=5, tries=3, damaged=0, asked="ping")
    noisy = servo_error.unanswered("p, id 5", device=5, tries=3, damaged=2, asked="ping")
    shows(str(silent))
    shows(str(noisy), 2)
    assert "busy" not in str(noisy)
    assert (noisy.id, noisy.tries, noisy.damaged) == (5, 3, 2)
