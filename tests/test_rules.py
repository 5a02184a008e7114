"""What a 2.0 servo refuses to write, register by register."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo2
from hardware.dynamixel.control_table import Register
from hardware.dynamixel.packets import Error2
from sim.emulator.registers import Memory, Part
from sim.emulator.rules import (
    EXTENDED,
    GOAL_LIMITS,
    GOALS,
    MAX_PROFILE_TIME,
    POSITION,
    TIME_BASED,
    Condition,
    goal_bounds,
    refusal,
)

LIMP = Condition(torque=False, barred=False, tripped=False)
TABLE = servo2().table
_registers = st.sampled_from(TABLE.registers)
_conditions = st.builds(Condition, st.booleans(), st.booleans(), st.booleans())


def memory(**values: int) -> Memory:
    """As delivered, but for these."""
    made = servo2().memory
    for name, value in values.items():
        made.put(name, value)
    return made


def refused(one: Memory, name: str, value: int, condition: Condition = LIMP) -> Error2:
    return refusal(one, Part(TABLE[name], value), condition)


@settings(max_examples=100)
@given(register=_registers, condition=_conditions, share=st.floats(0.0, 1.0))
def test_the_lock_of_the_eeprom_and_of_what_is_read_only(
    register: Register, condition: Condition, share: float
) -> None:
    value = register.narrowest + round(share * (register.widest - register.narrowest))
    locked = condition.torque and register.address < TABLE.eeprom_end
    got = refusal(memory(), Part(register, value), condition)
    assert (got is Error2.ACCESS) == (locked or not register.writable)
    if got is Error2.NONE:
        assert register.allows(value)


@settings(max_examples=100)
@given(register=_registers, share=st.floats(0.0, 1.0))
def test_torque_and_latches_only_ever_refuse_more(register: Register, share: float) -> None:
    value = register.narrowest + round(share * (register.widest - register.narrowest))
    one = memory()
    if refusal(one, Part(register, value), LIMP):
        for condition in (Condition(True, False, False), Condition(False, True, True), Condition(True, True, True)):
            assert refusal(one, Part(register, value), condition)


@pytest.mark.parametrize(("name", "limit"), GOAL_LIMITS)
def test_a_goal_may_be_its_limit_both_ways_and_no_more(name: str, limit: str) -> None:
    one = memory(**{limit: 50})
    assert goal_bounds(one, name) == (-50, 50)
    for value, error in ((50, Error2.NONE), (-50, Error2.NONE), (51, Error2.DATA_LIMIT), (-51, Error2.DATA_LIMIT)):
        assert refused(one, name, value) is error


def test_position_limits_hold_in_position_mode_alone() -> None:
    one = memory(operating_mode=POSITION, min_position_limit=100, max_position_limit=200)
    wanted = {99: Error2.DATA_LIMIT, 100: Error2.NONE, 200: Error2.NONE, 201: Error2.DATA_LIMIT}
    assert {value: refused(one, "goal_position", value) for value in wanted} == wanted
    one.put("operating_mode", EXTENDED)
    assert {refused(one, "goal_position", value) for value in (-1_048_575, 99, 1_048_575)} == {Error2.NONE}
    assert refused(one, "goal_position", 1_048_576) is Error2.DATA_RANGE


def test_a_tripped_watchdog_bars_goals_until_it_is_cleared() -> None:
    one, tripped = memory(), LIMP._replace(tripped=True)
    assert {refused(one, name, 0, tripped) for name in GOALS} == {Error2.DATA_RANGE}
    assert refused(one, "bus_watchdog", 5, tripped) is Error2.DATA_RANGE
    assert refused(one, "bus_watchdog", 0, tripped) is Error2.NONE
    assert refused(one, "led", 1, tripped) is Error2.NONE


def test_a_latched_error_bars_torque_on_and_nothing_else() -> None:
    one, barred = memory(), LIMP._replace(barred=True)
    assert refused(one, "torque_enable", 1, barred) is Error2.RESULT_FAIL
    assert refused(one, "torque_enable", 0, barred) is Error2.NONE
    assert refused(one, "goal_position", 2000, barred) is Error2.NONE


def test_values_without_a_meaning_are_out_of_range() -> None:
    one = memory()
    modes = {value for value in range(256) if refused(one, "operating_mode", value) is Error2.NONE}
    assert modes == set(TABLE.modes)
    bits = {value for value in range(256) if refused(one, "drive_mode", value) is Error2.NONE}
    assert bits == {0, 1, 4, 5, 8, 9, 12, 13}
    assert [refused(one, "protocol_type", value) for value in (1, 2)] == [Error2.DATA_RANGE, Error2.NONE]


@pytest.mark.parametrize("name", ["profile_velocity", "profile_acceleration"])
def test_a_profile_in_time_has_a_longest_time(name: str) -> None:
    assert refused(memory(), name, MAX_PROFILE_TIME + 1) is Error2.NONE
    timed = memory(drive_mode=TIME_BASED)
    assert refused(timed, name, MAX_PROFILE_TIME) is Error2.NONE
    assert refused(timed, name, MAX_PROFILE_TIME + 1) is Error2.DATA_RANGE
