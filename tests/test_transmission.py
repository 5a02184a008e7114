"""Coupled pairs: ToddlerBot's waist by its published formula, random pairs by their invariants, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.coupling import Coupling
from hardware.errors import HardwareError
from hardware.joint_map import JointMap
from hardware.servo import ServoMode, ServoSpec, find_model
from hardware.transmission import coupled_pairs, coupling_problems
from servos import four_servos, waist_servos
from support.messages import refuses, shows

MAP = JointMap(waist_servos())
UNIT = 2.0 * math.pi / 4096  # [rad]


@given(st.floats(-0.52, 0.52), st.floats(-1.56, 1.56))
def test_the_waist_is_that_of_the_published_formula(roll: float, yaw: float) -> None:
    first = (-roll / 0.29166667 + yaw / 0.20833333) / 2.0
    second = (roll / 0.29166667 + yaw / 0.20833333) / 2.0
    ticks = MAP.to_ticks(np.array([0.0, roll, yaw, 0.0]))
    assert abs(ticks[1] - (2000 + first / UNIT)) <= 0.5 + 1e-6
    assert abs(ticks[2] - (2100 - second / UNIT)) <= 0.5 + 1e-6


def test_the_waist_needs_more_than_a_turn() -> None:
    first, last = MAP.tick_limits()
    assert last[1] - 2000 == math.floor(4.6676 / UNIT)  # published: 4.6775 with some reserve
    assert last[1] > 4095 and first[1] < 0
    pair = [replace(servo, mode=ServoMode.POSITION) for servo in waist_servos()[1:3]]
    problems = coupling_problems(pair)
    assert len(problems) == 2
    shows(problems[0], "roll", "yaw", -1043, 5043, 2, 0, 4095)


@st.composite
def pairs(draw: st.DrawFn) -> tuple[ServoSpec, ...]:
    """A random pair that can be driven."""
    angle = draw(st.floats(0.0, 6.28))
    angles = (angle, angle + draw(st.floats(0.4, 2.7)))  # of the rows: never nearly parallel
    rows = [(size * math.cos(at), size * math.sin(at)) for at in angles for size in [draw(st.floats(0.2, 2.0))]]
    coupling = Coupling(("p", "q"), (rows[0], rows[1]))
    small = find_model("XC330-T288")
    servos = []
    for index, joint in enumerate(("p", "q")):
        lower = draw(st.floats(-1.0, 0.5))
        servos.append(
            ServoSpec(
                joint,
                index,
                small,
                "main",
                draw(st.sampled_from((-1, 1))),
                draw(st.integers(-9000, 9000)),
                lower,
                lower + draw(st.floats(0.05, 2.0)),
                0.1,
                1.0,
                mode=ServoMode.EXTENDED_POSITION,
                coupling=coupling,
            )
        )
    return tuple(servos)


@settings(max_examples=150)
@given(pairs(), st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2))
def test_inside_the_limits_stays_inside_and_near(servos: tuple[ServoSpec, ...], share: list[float]) -> None:
    joint_map = JointMap(servos)
    asked = joint_map.lower + np.array(share) * (joint_map.upper - joint_map.lower)
    ticks = joint_map.to_ticks(asked)
    back = joint_map.to_radians(ticks)
    assert np.all((back >= joint_map.lower - 1e-9) & (back <= joint_map.upper + 1e-9))
    reach = joint_map.tick_rad / 2.0
    near = bool(np.any((asked - joint_map.lower < reach) | (joint_map.upper - asked < reach)))
    assert np.all(np.abs(back - asked) <= (2.0 if near else 1.0) * reach + 1e-9)
    exact = coupled_pairs(servos)[0].exact_ticks(asked)
    if not near:
        assert np.all(np.abs(ticks - exact) <= 0.5 + 1e-6)  # each servo to half a tick
    first, last = joint_map.tick_limits()
    assert np.all((ticks >= first) & (ticks <= last))


@settings(max_examples=100)
@given(pairs(), st.lists(st.integers(-20000, 20000), min_size=2, max_size=2))
def test_every_tick_survives(servos: tuple[ServoSpec, ...], ticks: list[int]) -> None:
    joint_map = JointMap(servos)
    angles = joint_map.to_radians(np.array(ticks))
    inside = bool(np.all((angles >= joint_map.lower) & (angles <= joint_map.upper)))
    outside = bool(np.all((angles < joint_map.lower) | (angles > joint_map.upper)))
    if inside or outside:  # with one joint inside and one beyond, the one inside keeps its limits
        assert joint_map.to_ticks(angles).tolist() == ticks


@given(pairs(), st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=2))
def test_speeds_are_the_rates_of_the_angles(servos: tuple[ServoSpec, ...], shaft_speed: list[float]) -> None:
    joint_map, dt = JointMap(servos), 1e3
    unit = np.array([servo.model.tick_rad for servo in servos])
    start = np.array([servo.zero_tick for servo in servos])
    ticks = start + np.rint(np.array(shaft_speed) * dt / unit).astype(np.int64)
    rate = (joint_map.to_radians(ticks) - joint_map.to_radians(start)) / dt
    np.testing.assert_allclose(joint_map.joint_velocity(np.array(shaft_speed)), rate, atol=1e-4)
    np.testing.assert_allclose(joint_map.turned(ticks - start), rate * dt, atol=1e-9)


def test_other_servos_of_the_robot_are_as_without_the_pair() -> None:
    alone = JointMap([waist_servos()[0], waist_servos()[3]])
    path = np.linspace(MAP.lower, MAP.upper, 50)
    ticks = MAP.to_ticks(path)
    assert ticks.shape == (50, 4)
    np.testing.assert_array_equal(ticks[:, [0, 3]], alone.to_ticks(path[:, [0, 3]]))
    np.testing.assert_array_equal(MAP.to_radians(ticks)[:, [0, 3]], alone.to_radians(ticks[:, [0, 3]]))
    one_by_one = np.array([MAP.to_ticks(row) for row in path])
    np.testing.assert_array_equal(ticks, one_by_one)


def test_one_joint_beyond_does_not_move_the_other_out() -> None:
    back = MAP.to_radians(MAP.to_ticks(np.array([0.0, 0.7, MAP.upper[2], 0.0])))
    assert back[1] == pytest.approx(0.7, abs=MAP.tick_rad[1])
    assert MAP.upper[2] - 2 * MAP.tick_rad[2] <= back[2] <= MAP.upper[2] + 1e-9


def test_a_number_that_is_none_is_told_of_its_own_joint() -> None:
    with refuses(HardwareError, "yaw", "3"):
        MAP.to_ticks(np.array([0.0, 0.0, math.nan, 0.0]))


def test_a_servo_that_is_silent_hides_both_joints() -> None:
    assert MAP.heard(np.array([True, False, True, True])).tolist() == [True, False, False, True]
    assert MAP.heard(np.array([False, True, True, True])).tolist() == [False, True, True, True]


def test_of_the_pair_the_worst_case_counts() -> None:
    slow = replace(waist_servos()[1], max_velocity=2.4)
    problems = coupling_problems([slow, waist_servos()[2]])
    shows(problems[0], "max_velocity", "roll", "yaw", "7.714", "rad/s", 2)
    narrow = replace(waist_servos()[1], lower=0.0, upper=0.0005)
    shows(coupling_problems([narrow, waist_servos()[2]])[0])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"coupling": None}, "yaw: its servo does not say that it is coupled"),
        ({"joint": "tail"}, "yaw: coupled, and no servo has it"),
        ({"gear": 2.0}, "a coupled servo has gear 1"),
    ],
)
def test_half_a_pair_is_refused(change: dict[str, object], text: str) -> None:
    knee, roll, yaw, neck = waist_servos()
    with pytest.raises(HardwareError) as refusal:
        JointMap([knee, roll, replace(yaw, **change), neck])  # type: ignore[arg-type]
    assert text in str(refusal.value)


def test_a_singular_pair_is_refused() -> None:
    flat = Coupling(("roll", "yaw"), ((0.5, 0.5), (0.5, 0.5)))
    knee, roll, yaw, neck = waist_servos()
    with refuses(HardwareError):
        JointMap([knee, replace(roll, coupling=flat), replace(yaw, coupling=flat), neck])


def test_a_robot_without_pairs_has_none() -> None:
    assert coupled_pairs(four_servos()) == () and coupling_problems(four_servos()) == []
