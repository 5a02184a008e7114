"""Joint radians <-> servo ticks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.errors import HardwareError
from hardware.joint_map import NO_SERVO, JointMap
from servos import four_servos
from support.messages import refuses, shows

MAP = JointMap(four_servos())
TICK = np.abs(1.0 / np.array([servo.ticks_per_rad for servo in MAP.servos]))  # (4,) joint angle of one tick [rad]


def test_directions_zeros_and_gears() -> None:
    quarter = np.array([math.pi / 2 - 0.1, 0.5, 0.25, 0.5])
    ticks = MAP.to_ticks(quarter)
    assert ticks.tolist() == [
        round(2048 + (math.pi / 2 - 0.1) * 2048 / math.pi),
        round(2100 - 0.5 * 2048 / math.pi),
        round(2048 + 2 * 0.25 * 2048 / math.pi),
        round(512 - 0.5 * 1024 / math.radians(300)),
    ]


@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
def test_round_trip_is_within_half_a_tick(share: list[float]) -> None:
    position = MAP.lower + np.array(share) * (MAP.upper - MAP.lower)
    back = MAP.to_radians(MAP.to_ticks(position))
    # Within half a tick of a limit the nearest tick may lie beyond it; then it is the one before.
    near = (position - MAP.lower < TICK / 2) | (MAP.upper - position < TICK / 2)
    assert np.all(np.abs(back - position) <= np.where(near, TICK, TICK / 2) + 1e-12)
    assert np.all((back >= MAP.lower - 1e-9) & (back <= MAP.upper + 1e-9))


@given(st.lists(st.integers(0, 1023), min_size=4, max_size=4))
def test_every_tick_survives(ticks: list[int]) -> None:
    # Beyond the limits too: a robot that lies limp may start there.
    assert MAP.to_ticks(MAP.to_radians(np.array(ticks))).tolist() == ticks


def test_a_limit_written_for_a_whole_tick_is_that_tick() -> None:
    servo = replace(four_servos()[0], lower=-1024 * math.pi / 2048, upper=1024 * math.pi / 2048)
    joint_map = JointMap([servo])
    assert joint_map.to_ticks(joint_map.lower).tolist() == [1024]
    assert joint_map.to_ticks(joint_map.upper).tolist() == [3072]


def test_leading_axes_pass_through() -> None:
    path = np.linspace(MAP.lower, MAP.upper, 7).reshape(7, 1, 4)
    assert MAP.to_ticks(path).shape == (7, 1, 4)
    assert MAP.to_radians(MAP.to_ticks(path)).shape == (7, 1, 4)


def test_velocity_follows_direction_and_gear() -> None:
    assert MAP.joint_velocity(np.ones(4)).tolist() == [1.0, -1.0, 0.5, -1.0]


@pytest.mark.parametrize("value", [math.nan, math.inf, 4.0, -4.0])
def test_what_a_servo_cannot_do_is_refused_by_name(value: float) -> None:
    position = np.zeros(4)
    position[1] = value
    with refuses(HardwareError, "elbow", "2", value, "-0.5000", "2.0000"):
        MAP.to_ticks(position)


def test_joints_without_a_servo_show_minus_one() -> None:
    spread = MAP.spread(("head", "tail", "shoulder"), np.array([[1, 2, 3, 4], [5, 6, 7, 8]]))
    assert spread.tolist() == [[4, NO_SERVO, 1], [8, NO_SERVO, 5]]


def test_everything_wrong_with_the_servos_is_said_at_once() -> None:
    first, second, *_ = four_servos()
    with pytest.raises(HardwareError) as refusal:
        JointMap([first, replace(second, joint="shoulder", id=1, direction=2)])
    text = str(refusal.value)
    shows(text, 2, "shoulder", 1, "'main'")
