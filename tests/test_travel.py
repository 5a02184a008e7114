"""Ticks that joints need: none that the joint map sends is beyond them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bus_rig import spec
from hardware.dynamixel.travel import needed_ticks
from hardware.joint_map import JointMap
from hardware.servo import ServoSpec
from servos import four_servos, waist_servos


@pytest.mark.parametrize("servos", [four_servos(), waist_servos()])
def test_no_goal_inside_the_limits_is_beyond_the_needed_ticks_and_both_ends_are_met(
    servos: Sequence[ServoSpec],
) -> None:
    joint_map = JointMap(servos)
    corners = np.stack(np.meshgrid(*[[0.0, 0.37, 1.0]] * len(servos), indexing="ij"), axis=-1).reshape(-1, len(servos))
    ticks = joint_map.to_ticks(joint_map.lower + corners * (joint_map.upper - joint_map.lower))
    needed = needed_ticks(servos)
    low, high = np.array([needed[joint] for joint in joint_map.joints]).T
    assert (low <= ticks.min(axis=0)).all() and (ticks.max(axis=0) <= high).all()
    slack = 2 * np.array([servo.coupling is not None for servo in servos])  # corners that are moved in
    assert (ticks.min(axis=0) - low <= slack).all() and (high - ticks.max(axis=0) <= slack).all()


def test_half_a_pair_is_left_out() -> None:
    knee, roll, _, _ = waist_servos()
    assert list(needed_ticks([knee, roll])) == ["knee"]


def test_the_ends_of_the_servo_s_own_travel_are_never_passed() -> None:
    wide = replace(spec(1), zero_tick=977, lower=-1.4989, upper=1.5)
    assert needed_ticks([wide])["j1"].low == 0
