"""Whole turns after power-up: found where the limits allow one only, refused otherwise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.errors import HardwareError
from hardware.joint_map import JointMap
from hardware.servo import ServoMode, ServoSpec, find_model
from hardware.turns import SLACK, resolve_turns
from servos import four_servos, waist_servos
from support.messages import refuses, shows

WAIST = JointMap(waist_servos())
SMALL = find_model("XC330-T288")


def one(lower: float, upper: float, *, zero_tick: int = 2048, gear: float = 1.0, direction: int = 1) -> JointMap:
    many = ServoMode.EXTENDED_POSITION
    return JointMap(
        [ServoSpec("arm", 5, SMALL, "main", direction, zero_tick, lower, upper, 1.0, 9.0, gear=gear, mode=many)]
    )


@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4), st.lists(st.integers(-3, 3), min_size=4, max_size=4))
def test_any_whole_turns_are_undone(share: list[float], turns: list[int]) -> None:
    # Inside these limits every posture is alone on its turns: roll or yaw never come back within a turn of a servo.
    lower, upper = np.array([-1.0, -0.5, -0.98, -2.5]), np.array([1.0, 0.5, 0.98, 2.5])
    true = WAIST.to_ticks(lower + np.array(share) * (upper - lower))
    shift = 4096 * np.array([0, *turns[1:]])  # the first servo has one turn only
    np.testing.assert_array_equal(resolve_turns(WAIST, true - shift), shift)


@given(st.floats(-4.7, 4.7), st.sampled_from([-1, 1]), st.floats(0.3, 3.0), st.integers(-5000, 5000))
def test_found_or_refused_as_a_search_by_hand_says(angle: float, direction: int, gear: float, zero: int) -> None:
    joint_map = one(-4.7, 4.7, zero_tick=zero, gear=gear, direction=direction)
    true = joint_map.to_ticks(np.array([angle]))
    turn = 2.0 * math.pi / gear
    held = float(joint_map.to_radians(true)[0])
    possible = [k for k in range(-40, 41) if -4.7 - SLACK <= held + k * turn <= 4.7 + SLACK]
    if len(possible) == 1:
        np.testing.assert_array_equal(resolve_turns(joint_map, true % 4096) + true % 4096, true)
    else:
        with refuses(HardwareError, 5):
            resolve_turns(joint_map, true % 4096)


def test_a_limp_joint_may_lie_a_little_beyond_its_limit() -> None:
    joint_map = one(-1.0, 1.0, zero_tick=0)
    low = joint_map.to_ticks(np.array([-1.04])) + 4096
    assert resolve_turns(joint_map, low).tolist() == [-4096]
    with refuses(HardwareError):
        resolve_turns(joint_map, low, slack=0.01)


def test_all_joints_in_doubt_are_named_at_once() -> None:
    yaw_end = WAIST.to_ticks(np.array([0.0, 0.0, 1.4, 0.0]))  # 2.618 less is the same for the servos
    yaw_end[3] = WAIST.to_ticks(np.array([0.0, 0.0, 0.0, 2.618]))[3] - 170
    with pytest.raises(HardwareError) as refusal:
        resolve_turns(WAIST, yaw_end)
    text = str(refusal.value)
    shows(text, "roll", 2, "yaw", 3, "neck", 0)
    assert "1.400" in text and "-1.218" in text


def test_servos_of_one_turn_are_left_alone() -> None:
    joint_map = JointMap(four_servos())
    assert resolve_turns(joint_map, np.array([0, 4095, 0, 1023])).tolist() == [0, 0, 0, 0]
    mixed = JointMap([waist_servos()[0], replace(four_servos()[0], mode=ServoMode.EXTENDED_POSITION)])
    assert resolve_turns(mixed, np.array([4095, 2048 - 4096])).tolist() == [0, 4096]
