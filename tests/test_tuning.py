"""From registers to the numbers of the loop of a 2.0 servo."""

from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo2
from hardware.servo import find_model
from sim.emulator.motion import Law, Shaft
from sim.emulator.registers import Memory
from sim.emulator.rules import CURRENT, CURRENT_POSITION, EXTENDED, POSITION, PWM, TIME_BASED, VELOCITY
from sim.emulator.tuning import goal_speed, path_to, tune_loop, velocity_ramp

MODEL = find_model("XM430-W350")
TICK = MODEL.tick_rad
RPM = 4096 / 60  # [tick/s]


def memory(**values: int) -> Memory:
    """As delivered, but for these."""
    made = servo2().memory
    for name, value in values.items():
        made.put(name, value)
    return made


def tuned(supplied: float = 1.0, **values: int) -> Shaft:
    shaft = Shaft(0.0, 1000.0)
    tune_loop(shaft, memory(**values), MODEL, supplied)
    return shaft


@settings(max_examples=40)
@given(gain=st.integers(1, 8000), factor=st.floats(0.4, 1.5))
def test_the_lag_is_that_of_gain_times_supply(gain: int, factor: float) -> None:
    usual, other = tuned(), tuned(factor, position_p_gain=gain)
    assert other.lag * gain * factor == pytest.approx(usual.lag * 800, rel=1e-9)
    assert other.full == pytest.approx(usual.full * factor)


@pytest.mark.parametrize(("supplied", "gain"), [(1.0, 0), (0.0, 800)])
def test_without_gain_or_supply_nothing_pulls(supplied: float, gain: int) -> None:
    shaft = tuned(supplied, position_p_gain=gain, position_i_gain=100)
    assert shaft.lag == inf and shaft.integral == shaft.forward == 0.0


def test_a_d_gain_damps_and_i_and_feedforward_show() -> None:
    usual = tuned()
    assert usual.integral == usual.forward == 0.0
    assert tuned(position_d_gain=4000).lag > usual.lag
    assert tuned(position_i_gain=100).integral > 0.0 and tuned(feedforward_1st_gain=100).forward > 0.0


@pytest.mark.parametrize(
    ("mode", "law", "drive", "limited"),
    [
        (CURRENT, Law.CURRENT, 0.1, False),
        (VELOCITY, Law.VELOCITY, 0.1, False),
        (POSITION, Law.POSITION, 0.1, False),
        (EXTENDED, Law.POSITION, 0.1, False),
        (CURRENT_POSITION, Law.POSITION, 0.1, True),
        (PWM, Law.PWM, 0.5, False),
    ],
)
def test_the_mode_says_the_law_and_what_limits_it(mode: int, law: Law, drive: float, limited: bool) -> None:
    shaft = tuned(operating_mode=mode, goal_pwm=-88, pwm_limit=442, goal_current=-100)
    assert shaft.law is law
    assert shaft.drive_limit == pytest.approx(drive, rel=0.01)
    assert shaft.current_limit == pytest.approx(0.269 if limited else inf)


@pytest.mark.parametrize(("mode", "speed"), [(VELOCITY, -0.229 * 200 * RPM), (CURRENT, 0.269), (PWM, 177 / 885)])
def test_goals_of_the_other_laws_have_their_units(mode: int, speed: float) -> None:
    one = memory(operating_mode=mode, goal_velocity=-200, goal_current=100, goal_pwm=177)
    assert goal_speed(one, TICK) == pytest.approx(speed, rel=1e-3)


def test_a_ramp_is_a_rate_or_a_time() -> None:
    assert velocity_ramp(memory(), TICK, 500.0) == inf
    assert velocity_ramp(memory(profile_acceleration=10), TICK, 500.0) == pytest.approx(2145.77 * 4096 / 3600, rel=1e-3)
    timed = memory(drive_mode=TIME_BASED, profile_acceleration=250)
    assert velocity_ramp(timed, TICK, -500.0) == pytest.approx(500.0 / 0.25)


@settings(max_examples=40)
@given(
    goal=st.integers(-9000, 9000),
    top=st.integers(1, 400),
    ramp=st.integers(0, 200),
    limit=st.integers(1, 200),
)
def test_a_profile_ends_at_the_goal_and_minds_the_velocity_limit(goal: int, top: int, ramp: int, limit: int) -> None:
    one = memory(profile_velocity=top, profile_acceleration=ramp, velocity_limit=limit)
    path = path_to(goal, one, TICK, at=(100.0, 0.0), now=2.0)
    assert path is not None
    assert path.at(2.0).position == pytest.approx(100.0) or path.end == 2.0
    assert path.at(path.end).position == goal
    most = min(top, limit) * 0.229 * RPM
    speeds = [abs(path.at(2.0 + (path.end - 2.0) * share / 20).velocity) for share in range(21)]
    assert max(speeds) <= most * (1.0 + 1e-3)
    assert path.end - 2.0 >= abs(goal - 100) / most * (1.0 - 1e-3)


def test_a_timed_profile_takes_its_time_whatever_the_way() -> None:
    one = memory(drive_mode=TIME_BASED, profile_velocity=1500, profile_acceleration=300)
    for goal in (110, 5000, -20000):
        path = path_to(goal, one, TICK, at=(100.0, 0.0), now=2.0)
        assert path is not None and path.end == pytest.approx(3.5)


def test_no_profile_velocity_is_no_profile() -> None:
    assert path_to(3000, memory(profile_acceleration=50), TICK, at=(0.0, 0.0), now=0.0) is None
