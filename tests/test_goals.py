"""Goal registers of a 2.0 servo: bounds, and the way into motion."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo2
from hardware.servo import find_model
from sim.emulator.goals import aim, bound_goals, goal_to_present, open_limits, reset_for_mode
from sim.emulator.motion import Law, Shaft
from sim.emulator.registers import Memory
from sim.emulator.rules import EXTENDED, GOALS, POSITION, VELOCITY, goal_bounds

TICK = find_model("XM430-W350").tick_rad


def memory(mode: int = POSITION, **values: int) -> Memory:
    """As delivered, but for these."""
    made = servo2().memory
    for name, value in (("operating_mode", mode), *values.items()):
        made.put(name, value)
    return made


@settings(max_examples=60)
@given(
    mode=st.sampled_from((POSITION, EXTENDED)),
    low=st.integers(0, 2000),
    high=st.integers(2001, 4095),
    limits=st.tuples(st.integers(0, 885), st.integers(0, 1193), st.integers(0, 1023)),
    goals=st.tuples(
        st.integers(-885, 885), st.integers(-1193, 1193), st.integers(-1023, 1023), st.integers(-9999, 9999)
    ),
)
def test_goals_are_pulled_to_the_nearest_bound_and_no_further(
    mode: int, low: int, high: int, limits: tuple[int, int, int], goals: tuple[int, int, int, int]
) -> None:
    pwm, current, velocity = limits
    one = memory(mode, min_position_limit=low, max_position_limit=high)
    for name, value in (("pwm_limit", pwm), ("current_limit", current), ("velocity_limit", velocity)):
        one.put(name, value)
    names = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
    assert set(names) == GOALS
    for name, value in zip(names, goals, strict=True):
        one.put(name, value)
    bound_goals(one)
    for name, value in zip(names, goals, strict=True):
        least, most = goal_bounds(one, name)
        assert one.value(name) == max(least, min(value, most))


@pytest.mark.parametrize(("position", "goal"), [(1500.4, 1500), (-3.0, 100), (9000.0, 4000)])
def test_the_goal_shows_where_the_servo_is_within_its_limits(position: float, goal: int) -> None:
    one = memory(min_position_limit=100, max_position_limit=4000)
    goal_to_present(one, position)
    assert one.value("goal_position") == goal


def test_limits_are_open_when_goals_are_their_limits() -> None:
    one = memory(pwm_limit=300, current_limit=400, goal_pwm=-5, goal_current=6, goal_velocity=7)
    open_limits(one)
    assert [one.value(name) for name in ("goal_pwm", "goal_current", "goal_velocity")] == [300, 400, 7]


def test_a_new_mode_resets_no_more_than_gains_profile_and_those_limits() -> None:
    one = memory(position_p_gain=1, position_d_gain=2, profile_velocity=3, goal_position=1234, led=1, bus_watchdog=9)
    before = {register.name: one.value(register.name) for register in one.table.registers}
    reset_for_mode(one)
    changed = {name for name, value in before.items() if one.value(name) != value}
    assert changed == {"position_p_gain", "position_d_gain", "profile_velocity"}


def _shaft(position: float = 1000.0) -> Shaft:
    shaft = Shaft(position, 3000.0)
    shaft.torque = True
    shaft.refresh()
    return shaft


def test_without_a_profile_the_goal_is_the_target() -> None:
    shaft = _shaft()
    aim(shaft, memory(goal_position=1500), tick=TICK, now=0.0, fresh=False)
    assert shaft.path is None and shaft.target == 1500


def test_a_goal_on_the_way_takes_over_the_profile_without_a_jump() -> None:
    shaft, one = _shaft(), memory(goal_position=3000, profile_velocity=100, profile_acceleration=10)
    aim(shaft, one, tick=TICK, now=0.0, fresh=False)
    shaft.advance(0.6)
    before = shaft.trajectory()
    one.put("goal_position", 500)
    aim(shaft, one, tick=TICK, now=0.6, fresh=False)
    assert shaft.trajectory() == pytest.approx(before) and before[1] > 0.0
    shaft.advance(60.0)
    assert shaft.position == pytest.approx(500, abs=0.5)


def test_fresh_torque_starts_a_profile_where_the_shaft_is_and_at_rest() -> None:
    shaft, one = _shaft(), memory(goal_position=3000, profile_velocity=100, profile_acceleration=10)
    aim(shaft, one, tick=TICK, now=0.0, fresh=False)
    shaft.advance(0.6)
    shaft.position, shaft.velocity = 2222.0, 50.0  # moved by hand
    aim(shaft, one, tick=TICK, now=0.6, fresh=True)
    assert shaft.trajectory() == (2222.0, 0.0)


def test_a_goal_velocity_ramps() -> None:
    shaft, one = _shaft(), memory(VELOCITY, goal_velocity=100, profile_acceleration=10)
    shaft.law = Law.VELOCITY
    aim(shaft, one, tick=TICK, now=0.0, fresh=False)
    assert shaft.path is None
    assert shaft.speed == pytest.approx(22.9 / 60 * 4096, rel=1e-6)  # 100 * 0.229 rpm
    assert shaft.ramp == pytest.approx(10 * 214.577 * 4096 / 3600, rel=1e-3)
