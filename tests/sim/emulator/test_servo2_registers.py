"""The registers of a 2.0 servo: position counting, writes that are refused, loop, goals, resets, the bus watchdog."""

from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import read_register, servo2, write_register
from hardware.dynamixel.codec import Error2
from hardware.dynamixel.control_table import Register, find_table
from hardware.servo import find_model
from sim.emulator.memory import Memory, Part
from sim.emulator.servo2_registers import (
    ALL,
    BUT_ID,
    BUT_ID_AND_BAUD,
    CURRENT,
    CURRENT_POSITION,
    EXTENDED,
    GOAL_LIMITS,
    GOALS,
    MAX_PROFILE_TIME,
    POSITION,
    PWM,
    RAM_RESTORE,
    REVERSE,
    TIME_BASED,
    TURN,
    VELOCITY,
    BusWatchdog,
    Condition,
    Encoder,
    aim,
    bound_goals,
    factory_reset,
    goal_bounds,
    goal_speed,
    goal_to_present,
    open_limits,
    path_to,
    refusal,
    reset_for_mode,
    restore_eeprom,
    restore_ram,
    tune_loop,
    velocity_ramp,
)
from sim.emulator.shaft import Law, Shaft

positions = st.floats(-1e6, 1e6)
offsets = st.integers(-1_044_479, 1_044_479)


class Counted:
    """A shaft, and the registers that define how it is counted."""

    def __init__(self, mode: int, position: float = 0.0, offset: int = 0) -> None:
        self.memory = Memory(find_table("XM430-W350", 2))
        self.memory.put("max_position_limit", 4095)
        self.shaft = Shaft(position, 1000.0)
        self.encoder = Encoder(self.memory, self.shaft)
        self.set(operating_mode=mode, homing_offset=offset)
        self.encoder.place(position)

    def set(self, **values: int) -> None:
        for name, value in values.items():
            self.memory.put(name, value)

    def follow(self, **values: int) -> float:
        """The position as it is counted with new registers."""
        self.set(**values)
        self.encoder.follow_settings()
        return self.shaft.position


@settings(max_examples=60)
@given(mode=st.sampled_from((POSITION, EXTENDED)), position=positions, offset=offsets)
def test_folding_takes_whole_turns_and_only_once(mode: int, position: float, offset: int) -> None:
    one = Counted(mode, position, offset)
    one.encoder.fold()
    honoured = 0 if mode == POSITION and abs(offset) > 1024 else offset
    assert 0.0 <= one.shaft.position - honoured <= TURN
    turns = (one.shaft.position - position) / TURN
    assert turns == pytest.approx(round(turns), abs=1e-6)
    folded = one.shaft.position
    one.encoder.fold()
    assert (one.shaft.position - folded) % TURN == pytest.approx(0.0, abs=1e-6)


@settings(max_examples=60)
@given(position=positions, moves=st.lists(offsets, min_size=1, max_size=6), offset=offsets)
def test_an_offset_shifts_the_count_and_never_the_shaft(position: float, moves: list[int], offset: int) -> None:
    one = Counted(EXTENDED, position, offset)
    for move in moves:
        assert one.follow(homing_offset=move) - move == pytest.approx(position - offset, abs=1e-6)


@settings(max_examples=60)
@given(position=positions, offset=offsets)
def test_reverse_mode_mirrors_about_the_offset_and_twice_is_never(position: float, offset: int) -> None:
    one = Counted(EXTENDED, position, offset)
    assert one.follow(drive_mode=REVERSE) - offset == pytest.approx(offset - position, abs=1e-6)
    assert one.encoder.reversed
    assert one.follow() == one.follow(drive_mode=REVERSE)  # nothing new, nothing done
    assert one.follow(drive_mode=0) == pytest.approx(position, abs=1e-6)
    assert not one.encoder.reversed


@pytest.mark.parametrize(
    ("mode", "offset", "honoured"),
    [(POSITION, 1024, 1024), (POSITION, -1025, 0), (EXTENDED, -1025, -1025), (EXTENDED, 40000, 40000)],
)
def test_an_offset_out_of_reach_is_ignored_in_position_mode(mode: int, offset: int, honoured: int) -> None:
    assert Counted(mode, 2000.0).follow(homing_offset=offset) == 2000 + honoured


@settings(max_examples=60)
@given(turns=st.integers(-200, 200), place=st.integers(0, TURN - 1), ahead=st.integers(-300, 300))
def test_clearing_turns_takes_the_goal_along(turns: int, place: int, ahead: int) -> None:
    one = Counted(EXTENDED, float(turns * TURN + place))
    one.set(goal_position=turns * TURN + place + ahead)
    one.encoder.clear_turns()
    assert one.shaft.position == place
    assert one.memory.value("goal_position") == place + ahead


def test_a_goal_that_goes_along_stays_within_its_limits() -> None:
    one = Counted(POSITION, float(TURN + 100))
    one.set(goal_position=50)
    one.encoder.clear_turns()
    assert one.shaft.position == 100 and one.memory.value("goal_position") == 0


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


FIXED = {"model_number", "model_information", "firmware_version"}


def scrambled(seed: int) -> Memory:
    """A servo's memory in which every register is something else than delivered."""
    memory = servo2().memory
    for index, register in enumerate(memory.table.registers):
        if register.name not in FIXED:
            memory.store(register, 1 + (seed + 7 * index) % 100)
    return memory


def values(memory: Memory, *, eeprom: bool) -> dict[str, int]:
    end = memory.table.eeprom_end
    return {one.name: memory.value(one.name) for one in memory.table.registers if (one.address < end) is eeprom}


@pytest.mark.parametrize(("option", "spared"), [(ALL, set()), (BUT_ID, {"id"}), (BUT_ID_AND_BAUD, {"id", "baud_rate"})])
def test_a_factory_reset_spares_what_its_option_says(option: int, spared: set[str]) -> None:
    memory, delivered = scrambled(3), values(servo2().memory, eeprom=True)
    before, ram = values(memory, eeprom=True), values(memory, eeprom=False)
    assert factory_reset(memory, option)
    after = values(memory, eeprom=True)
    assert after == {name: before[name] if name in spared | FIXED else delivered[name] for name in after}
    assert after["model_number"] == 1020 and after["firmware_version"] > 0
    assert values(memory, eeprom=False) == ram  # that goes with the start that follows


@settings(max_examples=30)
@given(option=st.integers(0, 255).filter(lambda option: option not in (ALL, BUT_ID, BUT_ID_AND_BAUD)))
def test_an_unknown_option_changes_nothing(option: int) -> None:
    memory = scrambled(3)
    before = bytes(memory.image)
    assert not factory_reset(memory, option)
    assert bytes(memory.image) == before


@settings(max_examples=30)
@given(first=st.integers(0, 99), second=st.integers(0, 99))
def test_a_restored_eeprom_is_that_of_the_backup_and_the_ram_stays(first: int, second: int) -> None:
    backup, memory = scrambled(first), scrambled(second)
    backup.put("firmware_version", 1)  # of an older firmware: the servo's own stays
    ram, firmware = values(memory, eeprom=False), memory.value("firmware_version")
    restore_eeprom(memory, bytes(backup.image))
    assert values(memory, eeprom=True) == {**values(backup, eeprom=True), "firmware_version": firmware}
    assert values(memory, eeprom=False) == ram


def _comes_back(register: Register) -> bool:
    profile = register.name in ("profile_acceleration", "profile_velocity")
    return profile or register.name.endswith("_gain") or register.name.startswith("indirect_address_")


def test_a_start_brings_back_gains_profile_and_indirect_addresses_alone() -> None:
    backup, memory = scrambled(5), scrambled(40)
    memory.put("startup_configuration", RAM_RESTORE)
    before = values(memory, eeprom=False)
    restore_ram(memory, bytes(backup.image))
    wanted = {name: backup.value(name) if _comes_back(memory.table[name]) else value for name, value in before.items()}
    assert values(memory, eeprom=False) == {**wanted, "backup_ready": 1}
    assert wanted != before


@pytest.mark.parametrize(("startup", "stored"), [(0, True), (1, True), (RAM_RESTORE, False)])
def test_without_the_setting_or_a_backup_nothing_comes_back(startup: int, stored: bool) -> None:
    memory = scrambled(40)
    memory.put("startup_configuration", startup)
    before = values(memory, eeprom=False)
    restore_ram(memory, bytes(scrambled(5).image) if stored else None)
    assert values(memory, eeprom=False) == {**before, "backup_ready": int(stored)}


def test_the_realtime_tick_wraps() -> None:
    servo = servo2()
    assert read_register(servo, "realtime_tick", 0.5) == 500
    assert read_register(servo, "realtime_tick", 32.7675) == 32767
    assert read_register(servo, "realtime_tick", 32.7685) == 0


def test_moving_and_its_threshold() -> None:
    servo = servo2(position=0.0)
    write_register(servo, "torque_enable", 1)
    write_register(servo, "goal_position", 4000)
    assert (read_register(servo, "moving", 0.5), read_register(servo, "moving_status", 0.5)) == (1, 8)
    assert (read_register(servo, "moving", 5.0), read_register(servo, "moving_status", 5.0)) == (0, 1)
    write_register(servo, "torque_enable", 0, 5.0)
    write_register(servo, "moving_threshold", 1023, 5.0)
    write_register(servo, "torque_enable", 1, 5.0)
    write_register(servo, "goal_position", 0, 5.0)
    assert read_register(servo, "moving", 5.5) == 0 and read_register(servo, "present_velocity", 5.5) < -150


def test_the_trajectory_is_ahead_of_the_shaft() -> None:
    servo = servo2(position=0.0)
    write_register(servo, "profile_velocity", 100)
    write_register(servo, "torque_enable", 1)
    write_register(servo, "goal_position", 4000)
    ahead = read_register(servo, "position_trajectory", 1.0) - read_register(servo, "present_position", 1.0)
    assert 20 < ahead < 100 and read_register(servo, "velocity_trajectory", 1.0) == 100
    assert read_register(servo, "moving_status", 1.0) == 2 | 1 << 4


def test_a_load_register_where_there_is_no_current() -> None:
    servo = servo2("XL430-W250")
    write_register(servo, "torque_enable", 1)
    servo.jam(True, 0.0)
    write_register(servo, "goal_position", 2048 + 90)  # 141 ticks ask for full drive
    assert 500 < read_register(servo, "present_load", 0.5) < 800


LIMP = Condition(torque=False, barred=False, tripped=False)
TABLE = servo2().table
_registers = st.sampled_from([register for register in TABLE.registers if register.writable])
_conditions = st.builds(Condition, st.booleans(), st.booleans(), st.booleans())


def rules_memory(**values: int) -> Memory:
    """As delivered, but for these."""
    made = servo2().memory
    for name, value in values.items():
        made.put(name, value)
    return made


def refused(one: Memory, name: str, value: int, condition: Condition = LIMP) -> Error2:
    return refusal(one, Part(TABLE[name], value), condition)


@settings(max_examples=100)
@given(register=_registers, condition=_conditions, share=st.floats(0.0, 1.0))
def test_the_lock_of_the_eeprom(register: Register, condition: Condition, share: float) -> None:
    value = register.narrowest + round(share * (register.widest - register.narrowest))
    locked = condition.torque and register.address < TABLE.eeprom_end
    got = refusal(rules_memory(), Part(register, value), condition)
    assert (got is Error2.ACCESS) == locked
    if got is Error2.NONE:
        assert register.allows(value)


@settings(max_examples=100)
@given(register=_registers, share=st.floats(0.0, 1.0))
def test_torque_and_latches_only_ever_refuse_more(register: Register, share: float) -> None:
    value = register.narrowest + round(share * (register.widest - register.narrowest))
    one = rules_memory()
    if refusal(one, Part(register, value), LIMP):
        for condition in (Condition(True, False, False), Condition(False, True, True), Condition(True, True, True)):
            assert refusal(one, Part(register, value), condition)


@pytest.mark.parametrize(("name", "limit"), GOAL_LIMITS)
def test_a_goal_may_be_its_limit_both_ways_and_no_more(name: str, limit: str) -> None:
    one = rules_memory(**{limit: 50})
    assert goal_bounds(one, name) == (-50, 50)
    for value, error in ((50, Error2.NONE), (-50, Error2.NONE), (51, Error2.DATA_LIMIT), (-51, Error2.DATA_LIMIT)):
        assert refused(one, name, value) is error


def test_position_limits_hold_in_position_mode_alone() -> None:
    one = rules_memory(operating_mode=POSITION, min_position_limit=100, max_position_limit=200)
    wanted = {99: Error2.DATA_LIMIT, 100: Error2.NONE, 200: Error2.NONE, 201: Error2.DATA_LIMIT}
    assert {value: refused(one, "goal_position", value) for value in wanted} == wanted
    one.put("operating_mode", EXTENDED)
    assert {refused(one, "goal_position", value) for value in (-1_048_575, 99, 1_048_575)} == {Error2.NONE}
    assert refused(one, "goal_position", 1_048_576) is Error2.DATA_RANGE


def test_a_tripped_watchdog_bars_goals_until_it_is_cleared() -> None:
    one, tripped = rules_memory(), LIMP._replace(tripped=True)
    assert {refused(one, name, 0, tripped) for name in GOALS} == {Error2.DATA_RANGE}
    assert refused(one, "bus_watchdog", 5, tripped) is Error2.DATA_RANGE
    assert refused(one, "bus_watchdog", 0, tripped) is Error2.NONE
    assert refused(one, "led", 1, tripped) is Error2.NONE


def test_a_latched_error_bars_torque_on_and_nothing_else() -> None:
    one, barred = rules_memory(), LIMP._replace(barred=True)
    assert refused(one, "torque_enable", 1, barred) is Error2.RESULT_FAIL
    assert refused(one, "torque_enable", 0, barred) is Error2.NONE
    assert refused(one, "goal_position", 2000, barred) is Error2.NONE


def test_values_without_a_meaning_are_out_of_range() -> None:
    one = rules_memory()
    modes = {value for value in range(256) if refused(one, "operating_mode", value) is Error2.NONE}
    assert modes == set(TABLE.modes)
    bits = {value for value in range(256) if refused(one, "drive_mode", value) is Error2.NONE}
    assert bits == {0, 1, 4, 5, 8, 9, 12, 13}
    assert [refused(one, "protocol_type", value) for value in (1, 2)] == [Error2.DATA_RANGE, Error2.NONE]


@pytest.mark.parametrize("name", ["profile_velocity", "profile_acceleration"])
def test_a_profile_in_time_has_a_longest_time(name: str) -> None:
    assert refused(rules_memory(), name, MAX_PROFILE_TIME + 1) is Error2.NONE
    timed = rules_memory(drive_mode=TIME_BASED)
    assert refused(timed, name, MAX_PROFILE_TIME) is Error2.NONE
    assert refused(timed, name, MAX_PROFILE_TIME + 1) is Error2.DATA_RANGE


MODEL = find_model("XM430-W350")
TUNING_TICK = MODEL.tick_rad
RPM = 4096 / 60  # [tick/s]


def tuning_memory(**values: int) -> Memory:
    """As delivered, but for these."""
    made = servo2().memory
    for name, value in values.items():
        made.put(name, value)
    return made


def tuned(supplied: float = 1.0, **values: int) -> Shaft:
    shaft = Shaft(0.0, 1000.0)
    tune_loop(shaft, tuning_memory(**values), MODEL, supplied)
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
    one = tuning_memory(operating_mode=mode, goal_velocity=-200, goal_current=100, goal_pwm=177)
    assert goal_speed(one, TUNING_TICK) == pytest.approx(speed, rel=1e-3)


def test_a_ramp_is_a_rate_or_a_time() -> None:
    assert velocity_ramp(tuning_memory(), TUNING_TICK, 500.0) == inf
    assert velocity_ramp(tuning_memory(profile_acceleration=10), TUNING_TICK, 500.0) == pytest.approx(
        2145.77 * 4096 / 3600, rel=1e-3
    )
    timed = tuning_memory(drive_mode=TIME_BASED, profile_acceleration=250)
    assert velocity_ramp(timed, TUNING_TICK, -500.0) == pytest.approx(500.0 / 0.25)


@settings(max_examples=40)
@given(
    goal=st.integers(-9000, 9000),
    top=st.integers(1, 400),
    ramp=st.integers(0, 200),
    limit=st.integers(1, 200),
)
def test_a_profile_ends_at_the_goal_and_minds_the_velocity_limit(goal: int, top: int, ramp: int, limit: int) -> None:
    one = tuning_memory(profile_velocity=top, profile_acceleration=ramp, velocity_limit=limit)
    path = path_to(goal, one, TUNING_TICK, at=(100.0, 0.0), now=2.0)
    assert path is not None
    assert path.at(2.0).position == pytest.approx(100.0) or path.end == 2.0
    assert path.at(path.end).position == goal
    most = min(top, limit) * 0.229 * RPM
    speeds = [abs(path.at(2.0 + (path.end - 2.0) * share / 20).velocity) for share in range(21)]
    assert max(speeds) <= most * (1.0 + 1e-3)
    assert path.end - 2.0 >= abs(goal - 100) / most * (1.0 - 1e-3)


def test_a_timed_profile_takes_its_time_whatever_the_way() -> None:
    one = tuning_memory(drive_mode=TIME_BASED, profile_velocity=1500, profile_acceleration=300)
    for goal in (110, 5000, -20000):
        path = path_to(goal, one, TUNING_TICK, at=(100.0, 0.0), now=2.0)
        assert path is not None and path.end == pytest.approx(3.5)


def test_no_profile_velocity_is_no_profile() -> None:
    assert path_to(3000, tuning_memory(profile_acceleration=50), TUNING_TICK, at=(0.0, 0.0), now=0.0) is None


def test_it_runs_with_torque_only() -> None:
    watchdog = BusWatchdog()
    watchdog.arm(10, 1.0, torque=False)
    assert watchdog.deadline == inf
    watchdog.arm(10, 1.0, torque=True)
    assert watchdog.deadline == 1.2
    watchdog.feed(1.1)
    assert watchdog.deadline > 1.29
    watchdog.arm(0, 1.1, torque=True)
    assert watchdog.deadline == inf


def test_a_trip_stops_the_servo_where_it_was_then() -> None:
    servo = servo2(position=0.0)
    write_register(servo, "profile_velocity", 20)
    write_register(servo, "bus_watchdog", 5)
    write_register(servo, "torque_enable", 1)
    write_register(servo, "goal_position", 4000)
    place = read_register(servo, "present_position", 3.0)  # no instruction was received since 0
    assert 5 < place < 40  # 0.1 s of 4.6 rpm
    assert read_register(servo, "bus_watchdog", 3.0) == -1 and read_register(servo, "torque_enable", 3.0) == 1
    assert read_register(servo, "profile_velocity", 3.0) == 0
    assert write_register(servo, "goal_position", 3000, 3.0) == Error2.DATA_RANGE
    assert write_register(servo, "goal_velocity", 1, 3.0) == Error2.DATA_RANGE
    assert write_register(servo, "bus_watchdog", 5, 3.0) == Error2.DATA_RANGE
    servo.write(116, (3000).to_bytes(4, "little"), 3.0)
    assert read_register(servo, "goal_position", 3.0) == 4000
    assert write_register(servo, "bus_watchdog", 0, 3.0) == 0
    assert read_register(servo, "present_position", 4.0) == place  # it does not go on by itself
    assert write_register(servo, "goal_position", 3000, 4.0) == 0
    assert read_register(servo, "present_position", 6.0) == 3000


def test_old_firmware_has_none() -> None:
    assert servo2(firmware=40).table.has("bus_watchdog")
    assert not servo2(firmware=37).table.has("bus_watchdog")
    old = servo2(firmware=37)
    assert old.change(98, bytes((5,)), 0.0) == Error2.ACCESS
