"""Servo models and the checks of one servo."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_rig import four_servos
from emulated import answered, read_register, servo2, shown, write_register
from hardware.dynamixel.codec import ALERT, Error2, Instruction
from hardware.errors import HardwareError
from hardware.servo import (
    DEFAULT_P_GAIN,
    MAX_CONDITION,
    ServoCoupling,
    ServoGains,
    ServoMode,
    find_model,
    full_drive_error,
    loop_stiffness,
)
from hardware.servo_health import ExpectedRange
from messages import refuses

Matrix = tuple[tuple[float, float], tuple[float, float]]
numbers = st.floats(-10.0, 10.0)
matrices = st.tuples(st.tuples(numbers, numbers), st.tuples(numbers, numbers))


@given(matrices)
def test_condition_is_the_ratio_of_the_singular_values(matrix: Matrix) -> None:
    coupling = ServoCoupling(("a", "b"), matrix)
    largest, smallest = np.linalg.svd(np.array(matrix), compute_uv=False)
    if largest > 1e-3 and smallest > 1e-4 * largest:
        assert coupling.condition == pytest.approx(largest / smallest, rel=1e-6)
    elif largest > 1e-3:
        assert coupling.condition > 9e3 and coupling.problems()


@given(matrices)
def test_the_inverse_of_a_sound_coupling_undoes_it(matrix: Matrix) -> None:
    coupling = ServoCoupling(("a", "b"), matrix)
    if not coupling.problems():
        np.testing.assert_allclose(np.array(coupling.inverse) @ np.array(matrix), np.eye(2), atol=1e-9 * MAX_CONDITION)


@pytest.mark.parametrize(
    ("joints", "matrix", "text"),
    [
        (("a", "a"), ((1.0, 0.0), (0.0, 1.0)), "two different joints"),
        (("a", "b"), ((1.0, 2.0), (2.0, 4.0)), "singular"),
        (("a", "b"), ((0.0, 0.0), (0.0, 0.0)), "singular"),
        (("a", "b"), ((1.0, 1.0), (1.0, 1.0001)), "singular or nearly so"),
        (("a", "b"), ((1.0, math.nan), (0.0, 1.0)), "not finite"),
        (("a", "b"), ((1e200, 0.0), (0.0, 1e200)), "singular"),
    ],
)
def test_each_problem_is_found(joints: tuple[str, str], matrix: Matrix, text: str) -> None:
    (problem,) = ServoCoupling(joints, matrix).problems()
    assert text in problem


def test_torque_on_goes_to_the_old_goal_and_a_goal_switches_it_on_in_that_drive_mode_only() -> None:
    servo = servo2(position=1000.0)
    write_register(servo, "goal_position", 3000)
    assert read_register(servo, "present_position", 1.0) == 1000
    write_register(servo, "torque_enable", 1, 1.0)
    assert read_register(servo, "present_position", 3.0) == 3000
    for mode, torque in ((0, 0), (8, 1)):
        servo = servo2()
        write_register(servo, "drive_mode", mode)
        servo.write(116, (2100).to_bytes(4, "little"), 0.0)
        assert read_register(servo, "torque_enable") == torque


def test_many_turns_and_the_way_back_to_one() -> None:
    servo = servo2(position=1000.0)
    write_register(servo, "operating_mode", 4)
    write_register(servo, "torque_enable", 1)
    assert write_register(servo, "goal_position", 10000) == 0
    assert read_register(servo, "present_position", 20.0) == 10000
    assert answered(servo, Instruction.CLEAR, bytes.fromhex("0144584c22"), 20.0) == (0, b"")
    assert shown(servo, 21.0, "present_position", "goal_position") == (10000 - 2 * 4096,) * 2
    write_register(servo, "goal_position", 10000, 21.0)
    assert answered(servo, Instruction.CLEAR, bytes.fromhex("0144584c22"), 22.0).error == Error2.RESULT_FAIL
    read_register(servo, "present_position", 40.0)
    write_register(servo, "torque_enable", 0, 40.0)
    write_register(servo, "operating_mode", 3, 40.0)
    # The goal is pulled inside its limits.
    assert shown(servo, 40.0, "present_position", "goal_position") == (10000 - 2 * 4096, 4095)


def test_an_error_latches_until_reboot() -> None:
    servo = servo2()
    write_register(servo, "torque_enable", 1)
    servo.heat(81.0, 1.0)
    assert read_register(servo, "hardware_error_status", 1.0) == 4 and read_register(servo, "torque_enable", 1.0) == 0
    servo.heat(None, 2.0)
    assert write_register(servo, "torque_enable", 1, 2.0) == ALERT | Error2.RESULT_FAIL
    assert answered(servo, Instruction.PING, b"", 2.0).error == ALERT
    assert answered(servo, Instruction.REBOOT, b"", 2.0).error == ALERT
    assert servo.booting(2.1) and not servo.booting(2.21)
    assert servo.execute(Instruction.PING, b"", 2.1, broadcast=False) is None
    assert write_register(servo, "torque_enable", 1, 2.3) == 0


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
def test_servo_each_problem_is_found(change: dict[str, float], text: str) -> None:
    (problem,) = replace(four_servos()[0], **change).problems()  # type: ignore[arg-type]
    assert "shoulder" in problem and text in problem


def test_an_unknown_model_lists_the_known_ones() -> None:
    with refuses(HardwareError, "'XM430'", "XM430-W350"):
        find_model("XM430")


@pytest.mark.parametrize(
    ("mode", "text"),
    [
        (ServoMode.EXTENDED_POSITION, "AX-12A has no mode extended_position"),
        (ServoMode.CURRENT_BASED_POSITION, "AX-12A limits no current"),
    ],
)
def test_modes_that_a_model_has_not(mode: ServoMode, text: str) -> None:
    assert any(text in problem for problem in replace(four_servos()[3], mode=mode, current_limit=1.0).problems())


DT, LAG = 0.008, 0.045


def played(goals: list[int], positions: list[float]) -> list[float]:
    """How far one servo is off its expected, tick by tick: positions as read just before the next goal."""
    expected = ExpectedRange(np.array([LAG]))
    pairs = zip([goals[0], *goals[:-1]], positions, strict=True)
    return [
        float(expected.error(DT * k, np.array([goal]), np.array([round(at)]))[0]) for k, (goal, at) in enumerate(pairs)
    ]


@given(st.integers(0, 2**31))
def test_a_servo_that_follows_as_its_gain_lets_it_is_never_off(seed: int) -> None:
    rng = np.random.default_rng(seed)
    goals = np.cumsum(rng.integers(-40, 40, 80)).tolist()
    at, positions = float(goals[0]), []
    for goal in [goals[0], *goals[:-1]]:
        at += (goal - at) * (1.0 - np.exp(-DT / LAG))
        positions.append(at)
    assert max(map(abs, played(goals, positions))) <= 1.0  # rounding


def test_one_that_is_stuck_is_off_by_all_that_it_should_have_gone() -> None:
    goals = [0] * 5 + [200] * 60
    off = played(goals, [0.0] * len(goals))
    assert off[:6] == [0.0] * 6 and off[-1] == pytest.approx(-200.0, abs=0.1)
    assert off[6] == pytest.approx(-200.0 * (1.0 - np.exp(-DT / LAG)))
    expected = ExpectedRange(np.array([LAG]))
    expected.error(0.0, np.array([0]), np.array([0]))
    expected.forget()  # what is forgotten begins at its goal
    assert expected.error(1.0, np.array([400]), np.array([380])).tolist() == [-20.0]


def test_at_an_even_speed_it_may_be_anywhere_from_its_lag_to_the_goal() -> None:
    speed = 20
    goals = [speed * k for k in range(200)]
    for ahead in (0.0, 0.5, 1.0):
        positions = [goal - (1.0 - ahead) * speed * LAG / DT for goal in goals]
        assert abs(played(goals, positions)[-1]) <= speed  # what one tick makes


def test_a_shaft_is_as_stiff_as_its_gain() -> None:
    servo = four_servos()[0]
    usual = replace(servo, gains=ServoGains(position_p=DEFAULT_P_GAIN))
    twice = replace(servo, gains=ServoGains(position_p=2 * DEFAULT_P_GAIN))
    stiffness = servo.model.stiffness
    assert loop_stiffness(usual) == stiffness.nominal
    assert stiffness.nominal == pytest.approx(servo.model.stall_torque / full_drive_error(DEFAULT_P_GAIN))
    assert loop_stiffness(twice) == pytest.approx(2.0 * loop_stiffness(usual))
    assert loop_stiffness(replace(servo, gains=ServoGains())) == loop_stiffness(usual)
