"""Joint radians <-> servo ticks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus_rig import four_servos, waist_servos
from hardware.errors import HardwareError
from hardware.joint_map import LIMIT_SLACK, NO_SERVO, CoupledPair, JointMap, coupling_problems, resolve_turns
from hardware.servo import ServoCoupling, ServoSpec
from messages import refuses, shows

MAP = JointMap(four_servos())
TICK = np.abs(1.0 / np.array([servo.ticks_per_rad for servo in MAP.servos]))  # (4,) joint angle of one tick [rad]


def test_directions_zeros_and_gears() -> None:
    ticks = MAP.to_ticks(np.array([math.pi / 2 - 0.1, 0.5, 0.25, 0.5]))
    turned = np.array([math.pi / 2 - 0.1, -0.5, 2 * 0.25]) * 2048 / math.pi
    assert ticks[:3].tolist() == np.rint(np.array([2048, 2100, 2048]) + turned).tolist()
    assert ticks[3] == round(512 - 0.5 * 1024 / math.radians(300))


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
    with refuses(HardwareError, 2, "shoulder", 1, "'main'"):
        JointMap([first, replace(second, joint="shoulder", id=1, direction=2)])


WAIST = JointMap(waist_servos())
UNIT = 2.0 * math.pi / 4096  # [rad]


@given(st.floats(-0.52, 0.52), st.floats(-1.56, 1.56))
def test_the_waist_is_that_of_the_published_formula(roll: float, yaw: float) -> None:
    first = (-roll / 0.29166667 + yaw / 0.20833333) / 2.0
    second = (roll / 0.29166667 + yaw / 0.20833333) / 2.0
    ticks = WAIST.to_ticks(np.array([0.0, roll, yaw, 0.0]))
    assert abs(ticks[1] - (2000 + first / UNIT)) <= 0.5 + 1e-6
    assert abs(ticks[2] - (2100 - second / UNIT)) <= 0.5 + 1e-6


@st.composite
def pairs(draw: st.DrawFn) -> tuple[ServoSpec, ...]:
    """A random pair that can be driven."""
    angle = draw(st.floats(0.0, 6.28))
    angles = (angle, angle + draw(st.floats(0.4, 2.7)))  # of the rows: never nearly parallel
    rows = [(size * math.cos(at), size * math.sin(at)) for at in angles for size in [draw(st.floats(0.2, 2.0))]]
    either = replace(waist_servos()[1], max_velocity=0.1, coupling=ServoCoupling(("p", "q"), (rows[0], rows[1])))
    servos = []
    for index, joint in enumerate(("p", "q")):
        lower = draw(st.floats(-1.0, 0.5))
        upper, direction = lower + draw(st.floats(0.05, 2.0)), draw(st.sampled_from((-1, 1)))
        one = replace(either, joint=joint, id=index, direction=direction, zero_tick=draw(st.integers(-9000, 9000)))
        servos.append(replace(one, lower=lower, upper=upper))
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
    exact = CoupledPair(servos, (0, 1)).exact_ticks(asked)
    if not near:
        assert np.all(np.abs(ticks - exact) <= 0.5 + 1e-6)  # each servo to half a tick
    first, last = joint_map.tick_limits()
    assert np.all((ticks >= first) & (ticks <= last))


@settings(max_examples=100)
@given(pairs(), st.lists(st.integers(-20000, 20000), min_size=2, max_size=2))
def test_every_tick_of_a_pair_survives(servos: tuple[ServoSpec, ...], ticks: list[int]) -> None:
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


def test_a_servo_that_is_silent_hides_both_joints() -> None:
    assert WAIST.known_joints(np.array([True, False, True, True])).tolist() == [True, False, False, True]
    assert WAIST.known_joints(np.array([False, True, True, True])).tolist() == [False, True, True, True]


def test_of_the_pair_the_worst_case_counts() -> None:
    _, roll, yaw, _ = waist_servos()
    problems = coupling_problems([replace(roll, max_velocity=2.4), yaw])
    shows(problems[0], "max_velocity", "roll", "yaw", "7.714", "rad/s", 2)
    shows(coupling_problems([replace(roll, lower=0.0, upper=0.0005), yaw])[0])


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


def one(lower: float, upper: float, *, zero_tick: int = 2048, gear: float = 1.0, direction: int = 1) -> JointMap:
    arm = replace(waist_servos()[3], joint="arm", id=5, direction=direction, zero_tick=zero_tick, gear=gear)
    return JointMap([replace(arm, lower=lower, upper=upper, max_velocity=1.0)])


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
    possible = [k for k in range(-40, 41) if -4.7 - LIMIT_SLACK <= held + k * turn <= 4.7 + LIMIT_SLACK]
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
    shows(refusal.value, "roll", 2, "yaw", 3, "neck", 0, "1.400", "-1.218")
