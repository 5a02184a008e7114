"""Servo models and the checks of one servo."""

import math
from dataclasses import replace

import pytest

from hardware.errors import HardwareError
from hardware.servo import SERVO_MODELS, ServoMode, ServoSpec, find_model
from servos import four_servos
from support.messages import refuses


def test_the_numbers_of_an_xm430() -> None:
    model = find_model("XM430-W350")
    assert model.ticks == 4096
    assert model.centre_tick == 2048
    assert model.tick_rad == pytest.approx(0.00153398, abs=1e-8)  # e-Manual, unit of Present Position
    assert model.no_load_speed == pytest.approx(4.817, abs=1e-3)  # 46 rpm


def test_an_ax_turns_300_degrees() -> None:
    model = find_model("AX-12A")
    assert math.degrees(model.tick_rad) == pytest.approx(0.293, abs=1e-3)


@pytest.mark.parametrize("suffix", ["", "-T", "-R"])
def test_a_connector_suffix_is_accepted(suffix: str) -> None:
    assert find_model("XM430-W350" + suffix) is SERVO_MODELS["XM430-W350"]


def test_an_unknown_model_lists_the_known_ones() -> None:
    with refuses(HardwareError, "'XM430'", "XM430-W350"):
        find_model("XM430")


@pytest.mark.parametrize("servo", four_servos(), ids=lambda servo: servo.joint)
def test_sound_servos_have_no_problems(servo: ServoSpec) -> None:
    assert servo.problems() == ()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"id": 254}, "id 254"),
        ({"direction": 0}, "direction 0"),
        ({"gear": 0.0}, "gear"),
        ({"lower": 1.6}, "ascending"),
        ({"upper": math.nan}, "finite"),
        ({"max_velocity": math.inf}, "finite"),
        ({"max_acceleration": -1.0}, "above 0"),
        ({"upper": 3.5}, "need ticks 1070 to 4330"),
        ({"max_velocity": 5.0}, "no-load speed 4.817"),
        ({"homing_offset": -1025}, "homing_offset -1025"),
        ({"homing_offset": 1024, "zero_tick": 2000}, "allowed: 1024 to 4095"),
        ({"homing_offset": -1024, "zero_tick": 2100}, "allowed: 0 to 3071"),
        ({"mode": ServoMode.EXTENDED_POSITION, "zero_tick": 1048000}, "allowed: -1048575 to 1048575"),
        ({"mode": ServoMode.CURRENT_BASED_POSITION}, "needs a current"),
    ],
)
def test_each_problem_is_found(change: dict[str, float], text: str) -> None:
    (problem,) = replace(four_servos()[0], **change).problems()  # type: ignore[arg-type]
    assert "shoulder" in problem
    assert text in problem


def test_the_gear_counts_against_the_servos_speed() -> None:
    (problem,) = replace(four_servos()[2], max_velocity=2.5).problems()
    assert "2.409" in problem  # 46 rpm through a gear of 2


def test_a_mode_of_many_turns_reaches_beyond_one() -> None:
    far = replace(four_servos()[0], mode=ServoMode.EXTENDED_POSITION, lower=-20.0, upper=20.0, homing_offset=-9000)
    assert far.problems() == ()
    assert (far.lowest_tick, far.highest_tick) == (-1048575, 1048575)


@pytest.mark.parametrize(
    ("column", "mode", "text"),
    [
        (3, ServoMode.EXTENDED_POSITION, "AX-12A has no mode extended_position"),
        (3, ServoMode.CURRENT_BASED_POSITION, "AX-12A limits no current"),
    ],
)
def test_modes_that_a_model_has_not(column: int, mode: ServoMode, text: str) -> None:
    problems = replace(four_servos()[column], mode=mode, current_limit=1.0).problems()
    assert any(text in problem for problem in problems)
