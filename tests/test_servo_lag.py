"""How far a shaft may be behind its goal, and when it is off its way."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.servo import ServoGains
from hardware.servo_lag import DEFAULT_P_GAIN, ExpectedWay, full_drive_error, loop_lag, loop_stiffness
from servos import four_servos

DT, LAG = 0.008, 0.045


def played(goals: list[int], positions: list[float]) -> list[float]:
    """How far one servo is off its way, tick by tick: positions as read just before the next goal."""
    way = ExpectedWay(np.array([LAG]))
    pairs = zip([goals[0], *goals[:-1]], positions, strict=True)
    return [float(way.off(DT * k, np.array([goal]), np.array([round(at)]))[0]) for k, (goal, at) in enumerate(pairs)]


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


def test_at_an_even_speed_it_may_be_anywhere_from_its_lag_to_the_goal() -> None:
    speed = 20
    goals = [speed * k for k in range(200)]
    for ahead in (0.0, 0.5, 1.0):
        positions = [goal - (1.0 - ahead) * speed * LAG / DT for goal in goals]
        assert abs(played(goals, positions)[-1]) <= speed  # what one tick makes


def test_one_that_is_pushed_is_off_at_once_on_either_side() -> None:
    assert played([0] * 4, [0.0, 0.0, 150.0, -150.0]) == [0.0, 0.0, 150.0, -150.0]


def test_without_lag_it_is_the_distance_to_the_goal() -> None:
    way = ExpectedWay(np.zeros(2))
    way.off(0.0, np.array([0, 0]), np.array([0, 0]))
    assert way.off(DT, np.array([10, -10]), np.array([3, 0])).tolist() == [-7.0, 10.0]


def test_what_is_forgotten_begins_at_its_goal() -> None:
    way = ExpectedWay(np.array([LAG]))
    way.off(0.0, np.array([0]), np.array([0]))
    way.forget()
    assert way.off(1.0, np.array([400]), np.array([380])).tolist() == [-20.0]


def test_a_stiffer_loop_lags_less() -> None:
    servo = four_servos()[0]
    soft, stiff = (loop_lag(replace(servo, gains=ServoGains(position_p=gain))) for gain in (800, 1600))
    assert soft == pytest.approx(2.0 * stiff)
    assert soft == pytest.approx(full_drive_error(servo.model, 800) / servo.model.no_load_speed)


def test_a_shaft_is_as_stiff_as_its_gain() -> None:
    servo = four_servos()[0]
    usual = replace(servo, gains=ServoGains(position_p=DEFAULT_P_GAIN))
    twice = replace(servo, gains=ServoGains(position_p=2 * DEFAULT_P_GAIN))
    model = servo.model
    assert loop_stiffness(usual) == pytest.approx(model.stall_torque / full_drive_error(model, DEFAULT_P_GAIN))
    assert loop_stiffness(twice) == pytest.approx(2.0 * loop_stiffness(usual))
    assert loop_stiffness(replace(servo, gains=ServoGains())) == loop_stiffness(usual)
