"""The registers of a 2.0 servo: position counting, writes that are refused, loop, goals, resets, the bus watchdog."""

from collections.abc import Callable
from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import answered, read_register, servo1, servo2, shown, write_register, wrote
from hardware.dynamixel.codec import Error2, Instruction
from hardware.dynamixel.control_table import Register, find_table
from hardware.servo import find_model
from sim.emulator.memory import Memory, RegisterWrite
from sim.emulator.servo1 import EmulatedServo1
from sim.emulator.servo2 import RESTORE, STORE, EmulatedServo
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
    REVERSE,
    TIME_BASED,
    TURN,
    VELOCITY,
    Condition,
    Encoder,
    aim,
    bound_goals,
    factory_reset,
    goal_bounds,
    path_to,
    refusal,
    reset_for_mode,
    restore_eeprom,
    tune_loop,
)
from sim.emulator.shaft import Law, Shaft

MODEL = find_model("XM430-W350")
TICK = MODEL.tick_rad
RPM = 4096 / 60  # [tick/s]
TABLE = servo2().table
positions = st.floats(-1e6, 1e6)
offsets = st.integers(-1_044_479, 1_044_479)


def memory(**values: int) -> Memory:
    """As delivered, but for these."""
    made = servo2().memory
    for name, value in values.items():
        made.put(name, value)
    return made


class Counted:
    """A shaft, and the registers that count its turns."""

    def __init__(self, mode: int, position: float = 0.0, offset: int = 0) -> None:
        self.memory = memory(operating_mode=mode, homing_offset=offset)
        self.shaft = Shaft(position, 1000.0)
        self.encoder = Encoder(self.memory, self.shaft)
        self.encoder.place(position)

    def follow(self, **values: int) -> float:
        """The position as it is counted with new registers."""
        for name, value in values.items():
            self.memory.put(name, value)
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
def test_an_offset_shifts_the_count_and_reverse_mode_mirrors_about_it(
    position: float, moves: list[int], offset: int
) -> None:
    one = Counted(EXTENDED, position, offset)
    for move in (*moves, offset):
        assert one.follow(homing_offset=move) - move == pytest.approx(position - offset, abs=1e-6)
    assert one.follow(drive_mode=REVERSE) - offset == pytest.approx(offset - position, abs=1e-6)
    assert one.encoder.reversed
    assert one.follow() == one.follow(drive_mode=REVERSE)  # nothing new, nothing done
    assert one.follow(drive_mode=0) == pytest.approx(position, abs=1e-6)


@settings(max_examples=60)
@given(turns=st.integers(-200, 200), place=st.integers(0, TURN - 1), ahead=st.integers(-300, 300))
def test_clearing_turns_takes_the_goal_along(turns: int, place: int, ahead: int) -> None:
    one = Counted(EXTENDED, float(turns * TURN + place))
    one.memory.put("goal_position", turns * TURN + place + ahead)
    one.encoder.clear_turns()
    assert (one.shaft.position, one.memory.value("goal_position")) == (place, place + ahead)
    bounded = Counted(POSITION, float(TURN + 100))
    bounded.memory.put("goal_position", 50)
    bounded.encoder.clear_turns()
    assert (bounded.shaft.position, bounded.memory.value("goal_position")) == (100, 0)


@settings(max_examples=60)
@given(
    mode=st.sampled_from((POSITION, EXTENDED)),
    low=st.integers(0, 2000),
    high=st.integers(2001, 4095),
    limits=st.tuples(st.integers(0, 885), st.integers(0, 1193), st.integers(0, 1023)),
    goals=st.tuples(*(st.integers(-most, most) for most in (885, 1193, 1023, 9999))),
)
def test_goals_are_pulled_to_the_nearest_bound_and_no_further(
    mode: int, low: int, high: int, limits: tuple[int, ...], goals: tuple[int, ...]
) -> None:
    one = memory(operating_mode=mode, min_position_limit=low, max_position_limit=high)
    for limit, value in zip(GOAL_LIMITS.values(), limits, strict=True):
        one.put(limit, value)
    names = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
    assert set(names) == GOALS
    for name, value in zip(names, goals, strict=True):
        one.put(name, value)
    bound_goals(one)
    for name, value in zip(names, goals, strict=True):
        least, most = goal_bounds(one, name)
        assert one.value(name) == max(least, min(value, most))


def test_a_new_mode_resets_gains_and_profile_and_opens_limits() -> None:
    one = memory(position_p_gain=1, position_d_gain=2, profile_velocity=3, goal_position=1234, led=1, bus_watchdog=9)
    for name, value in (("pwm_limit", 300), ("current_limit", 400), ("goal_velocity", 7)):
        one.put(name, value)
    before = {register.name: one.value(register.name) for register in TABLE.registers}
    reset_for_mode(one)
    changed = {name for name, value in before.items() if one.value(name) != value}
    assert changed == {"position_p_gain", "position_d_gain", "profile_velocity", "goal_pwm", "goal_current"}
    assert (one.value("goal_pwm"), one.value("goal_current")) == (300, 400)


def test_a_profile_begins_where_the_old_one_is_or_where_the_shaft_is_when_torque_is_fresh() -> None:
    shaft, one = Shaft(1000.0, 3000.0), memory(goal_position=3000, profile_velocity=100, profile_acceleration=10)
    shaft.torque = True
    aim(shaft, one, tick=TICK, now=0.0, fresh=False)
    shaft.advance(0.6)
    before = shaft.trajectory()
    one.put("goal_position", 500)
    aim(shaft, one, tick=TICK, now=0.6, fresh=False)
    assert shaft.trajectory() == pytest.approx(before) and before[1] > 0.0
    shaft.advance(60.0)
    assert shaft.position == pytest.approx(500, abs=0.5)
    one.put("goal_position", 3000)
    aim(shaft, one, tick=TICK, now=60.0, fresh=False)
    shaft.advance(60.6)
    shaft.position, shaft.velocity = 2222.0, 50.0  # moved by hand
    aim(shaft, one, tick=TICK, now=60.6, fresh=True)
    assert shaft.trajectory() == (2222.0, 0.0)


FIXED = {"model_number", "model_information", "firmware_version"}


def scrambled(seed: int) -> Memory:
    """A servo's memory in which every register is something else than delivered."""
    made = memory()
    for index, register in enumerate(TABLE.registers):
        if register.name not in FIXED:
            made.store(register, 1 + (seed + 7 * index) % 100)
    return made


def values(memory: Memory, *, eeprom: bool) -> dict[str, int]:
    return {one.name: memory.value(one.name) for one in TABLE.registers if (one.address < TABLE.eeprom_end) is eeprom}


@pytest.mark.parametrize(("option", "spared"), [(ALL, set()), (BUT_ID, {"id"}), (BUT_ID_AND_BAUD, {"id", "baud_rate"})])
def test_a_factory_reset_spares_what_its_option_says(option: int, spared: set[str]) -> None:
    one, delivered = scrambled(3), values(memory(), eeprom=True)
    before, ram = values(one, eeprom=True), values(one, eeprom=False)
    factory_reset(one, option)
    after = values(one, eeprom=True)
    assert after == {name: before[name] if name in spared | FIXED else delivered[name] for name in after}
    assert values(one, eeprom=False) == ram  # that goes with the start that follows


@settings(max_examples=30)
@given(first=st.integers(0, 99), second=st.integers(0, 99))
def test_a_restored_eeprom_is_that_of_the_backup_and_the_ram_stays(first: int, second: int) -> None:
    backup, one = scrambled(first), scrambled(second)
    backup.put("firmware_version", 1)  # of an older firmware: the servo's own stays
    ram, firmware = values(one, eeprom=False), one.value("firmware_version")
    restore_eeprom(one, bytes(backup.image))
    assert values(one, eeprom=True) == {**values(backup, eeprom=True), "firmware_version": firmware}
    assert values(one, eeprom=False) == ram


def test_the_registers_of_motion() -> None:
    servo = servo2(position=0.0)
    assert [read_register(servo, "realtime_tick", now) for now in (0.5, 32.7675, 32.7685)] == [500, 32767, 0]
    servo = servo2(position=0.0)
    wrote(servo, torque_enable=1, goal_position=4000)
    assert shown(servo, 0.5, "moving", "moving_status") == (1, 8)
    assert shown(servo, 5.0, "moving", "moving_status") == (0, 1)
    wrote(servo, 5.0, torque_enable=0, moving_threshold=1023)
    wrote(servo, 5.0, torque_enable=1, goal_position=0)
    assert read_register(servo, "moving", 5.5) == 0 and read_register(servo, "present_velocity", 5.5) < -150
    servo = servo2(position=0.0)
    wrote(servo, profile_velocity=100, torque_enable=1, goal_position=4000)
    ahead = read_register(servo, "position_trajectory", 1.0) - read_register(servo, "present_position", 1.0)
    assert 20 < ahead < 100 and shown(servo, 1.0, "velocity_trajectory", "moving_status") == (100, 2 | 1 << 4)


LIMP = Condition(torque=False, barred=False, tripped=False)
_registers = st.sampled_from([register for register in TABLE.registers if register.writable])
_conditions = st.builds(Condition, st.booleans(), st.booleans(), st.booleans())


@settings(max_examples=100)
@given(register=_registers, condition=_conditions, share=st.floats(0.0, 1.0))
def test_torque_locks_the_eeprom_and_conditions_only_ever_refuse_more(
    register: Register, condition: Condition, share: float
) -> None:
    part = RegisterWrite(register, register.narrowest + round(share * (register.widest - register.narrowest)))
    got = refusal(memory(), part, condition)
    assert (got is Error2.ACCESS) == (condition.torque and register.address < TABLE.eeprom_end)
    assert got is not Error2.NONE or register.allows(part.value)
    assert got is not Error2.NONE or refusal(memory(), part, LIMP) is Error2.NONE


NONE, LIMIT, RANGE = Error2.NONE, Error2.DATA_LIMIT, Error2.DATA_RANGE
TRIPPED, BARRED = LIMP._replace(tripped=True), LIMP._replace(barred=True)
POSITION_LIMITS = {"operating_mode": POSITION, "min_position_limit": 100, "max_position_limit": 200}
MANY_TURNS = POSITION_LIMITS | {"operating_mode": EXTENDED}


@pytest.mark.parametrize(
    ("registers", "condition", "name", "answers"),
    [
        *(({GOAL_LIMITS[name]: 50}, LIMP, name, {50: NONE, -50: NONE, 51: LIMIT, -51: LIMIT}) for name in GOAL_LIMITS),
        (POSITION_LIMITS, LIMP, "goal_position", {99: LIMIT, 100: NONE, 200: NONE, 201: LIMIT}),
        (MANY_TURNS, LIMP, "goal_position", {-1_048_575: NONE, 99: NONE, 1_048_575: NONE, 1_048_576: RANGE}),
        *(({}, TRIPPED, name, {0: RANGE}) for name in sorted(GOALS)),
        ({}, TRIPPED, "bus_watchdog", {5: RANGE, 0: NONE}),
        ({}, TRIPPED, "led", {1: NONE}),
        ({}, BARRED, "torque_enable", {1: Error2.RESULT_FAIL, 0: NONE}),
        ({}, BARRED, "goal_position", {2000: NONE}),
        ({}, LIMP, "operating_mode", {value: NONE if value in TABLE.modes else RANGE for value in range(256)}),
        ({}, LIMP, "drive_mode", {v: NONE if v in (0, 1, 4, 5, 8, 9, 12, 13) else RANGE for v in range(256)}),
        ({}, LIMP, "protocol_type", {1: RANGE, 2: NONE}),
        ({}, LIMP, "profile_velocity", {MAX_PROFILE_TIME + 1: NONE}),
        ({"drive_mode": TIME_BASED}, LIMP, "profile_velocity", {MAX_PROFILE_TIME: NONE, MAX_PROFILE_TIME + 1: RANGE}),
        ({"drive_mode": TIME_BASED}, LIMP, "profile_acceleration", {MAX_PROFILE_TIME + 1: RANGE}),
    ],
)
def test_each_value_is_taken_or_refused(
    registers: dict[str, int], condition: Condition, name: str, answers: dict[int, Error2]
) -> None:
    one = memory(**registers)
    assert {value: refusal(one, RegisterWrite(TABLE[name], value), condition) for value in answers} == answers


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
    assert shaft.law is law and shaft.drive_limit == pytest.approx(drive, rel=0.01)
    assert shaft.current_limit == pytest.approx(0.269 if limited else inf)


@settings(max_examples=40)
@given(goal=st.integers(-9000, 9000), top=st.integers(1, 400), ramp=st.integers(0, 200), limit=st.integers(1, 200))
def test_a_profile_ends_at_the_goal_within_the_velocity_limit_or_in_its_time(
    goal: int, top: int, ramp: int, limit: int
) -> None:
    one = memory(profile_velocity=top, profile_acceleration=ramp, velocity_limit=limit)
    path = path_to(goal, one, TICK, at=(100.0, 0.0), now=2.0)
    assert path is not None
    assert path.at(2.0).position == pytest.approx(100.0) or path.end == 2.0
    assert path.at(path.end).position == goal
    most = min(top, limit) * 0.229 * RPM
    speeds = [abs(path.at(2.0 + (path.end - 2.0) * share / 20).velocity) for share in range(21)]
    assert max(speeds) <= most * (1.0 + 1e-3)
    assert path.end - 2.0 >= abs(goal - 100) / most * (1.0 - 1e-3)
    one = memory(drive_mode=TIME_BASED, profile_velocity=10 * top, profile_acceleration=ramp)
    path = path_to(goal, one, TICK, at=(100.0, 0.0), now=2.0)
    assert path is not None and (path.end == pytest.approx(2.0 + 0.01 * top) or goal == 100)
    assert path_to(goal, memory(profile_acceleration=ramp), TICK, at=(100.0, 0.0), now=2.0) is None


def test_a_trip_stops_the_servo_where_it_was_then() -> None:
    servo = servo2(position=0.0)
    wrote(servo, profile_velocity=20, bus_watchdog=5, torque_enable=1, goal_position=4000)
    place, *others = shown(servo, 3.0, "present_position", "bus_watchdog", "torque_enable", "profile_velocity")
    assert 5 < place < 40 and others == [-1, 1, 0]  # no instruction was received since 0: 0.1 s of 4.6 rpm
    for name, value in (("goal_position", 3000), ("goal_velocity", 1), ("bus_watchdog", 5)):
        assert write_register(servo, name, value, 3.0) == Error2.DATA_RANGE
    servo.write(116, (3000).to_bytes(4, "little"), 3.0)
    assert read_register(servo, "goal_position", 3.0) == 4000
    wrote(servo, 3.0, bus_watchdog=0)
    assert read_register(servo, "present_position", 4.0) == place  # it does not go on by itself
    wrote(servo, 4.0, goal_position=3000)
    assert read_register(servo, "present_position", 6.0) == 3000
    old = servo2(firmware=37)
    assert servo2(firmware=40).table.has("bus_watchdog") and old.change(98, bytes((5,)), 0.0) == Error2.ACCESS


# Instructions of protocol 2.0 to one emulated servo.


def test_a_broadcast_is_obeyed_in_silence() -> None:
    servo = servo2()
    wrote(servo, id=9)
    assert servo.execute(Instruction.WRITE, bytes((65, 0, 1)), 0.0, broadcast=True) is None
    assert read_register(servo, "led") == 1
    assert servo.execute(Instruction.READ, bytes((65, 0, 1, 0)), 0.0, broadcast=True) is None
    servo.execute(Instruction.FACTORY_RESET, b"\xff", 0.0, broadcast=True)
    assert servo.id == 9  # since firmware 42
    old = servo2(firmware=41)
    old.execute(Instruction.FACTORY_RESET, b"\xff", 0.0, broadcast=True)
    servo.execute(Instruction.REBOOT, b"", 0.0, broadcast=True)
    assert old.booting(0.0) and servo.booting(0.0)


def test_a_secondary_id_reaches_the_ram_only() -> None:
    servo = servo2()
    assert servo2().secondary_id is None
    wrote(servo, secondary_id=5)
    assert servo.secondary_id == 5
    for code, params in (
        (Instruction.WRITE, bytes((65, 0, 1))),
        (Instruction.WRITE, bytes((7, 0, 8))),
        (Instruction.REBOOT, b""),
    ):
        assert servo.execute(code, params, 0.0, broadcast=False, secondary=True) is None
    servo.write(7, b"\x08", 0.0, secondary=True)
    assert read_register(servo, "led") == 1 and servo.id == 1 and not servo.booting(0.0)


def test_backup_and_restore() -> None:
    servo = servo2()

    def back_up(what: bytes) -> int:
        return answered(servo, Instruction.CONTROL_TABLE_BACKUP, what).error

    assert back_up(RESTORE) == Error2.RESULT_FAIL
    wrote(servo, startup_configuration=2, velocity_limit=50, position_p_gain=77)
    assert back_up(STORE) == 0 and read_register(servo, "backup_ready") == 1
    wrote(servo, velocity_limit=60, torque_enable=1)
    assert back_up(RESTORE) == Error2.RESULT_FAIL
    wrote(servo, torque_enable=0)
    assert back_up(RESTORE) == 0 and servo.booting(0.1)
    assert shown(servo, 1.0, "velocity_limit", "position_p_gain", "backup_ready") == (50, 77, 1)
    assert answered(servo2(firmware=44), Instruction.CONTROL_TABLE_BACKUP, STORE).error == Error2.INSTRUCTION


@pytest.mark.parametrize(
    ("code", "params", "error"),
    [
        *((code, b"\1\2\3\4", Error2.INSTRUCTION) for code in (0x00, 0x07, 0x55, 0x82, 0x8A, 0xFF)),
        (Instruction.READ, b"\x74\0\4", Error2.DATA_LENGTH),
        (Instruction.WRITE, b"\x74\0", Error2.DATA_LENGTH),
        (Instruction.REG_WRITE, b"", Error2.DATA_LENGTH),
        (Instruction.FACTORY_RESET, b"", Error2.DATA_LENGTH),
        (Instruction.FACTORY_RESET, b"\3", Error2.DATA_RANGE),
        (Instruction.CLEAR, b"\2ERCL", Error2.DATA_RANGE),
        (Instruction.CONTROL_TABLE_BACKUP, b"\3CTRL", Error2.DATA_RANGE),
    ],
)
def test_bad_instructions_and_parameters(code: int, params: bytes, error: Error2) -> None:
    servo = servo2()
    assert answered(servo, code, params).error == error and not servo.booting(0.0)


# The memory of an emulated device: access, holes, indirect addressing.


@pytest.mark.parametrize(("model", "first"), [("XM430-W350", 1), ("XM430-W350", 29), ("XL330-M288", 1)])
def test_indirect_data_stand_for_what_they_point_at(model: str, first: int) -> None:
    servo = servo2(model)
    for offset in range(4):
        assert write_register(servo, f"indirect_address_{first + offset}", 116 + offset) == 0
    assert write_register(servo, f"indirect_address_{first + 4}", 132) == 0
    data = servo.table[f"indirect_data_{first}"].address
    servo.write(data, (2100).to_bytes(4, "little"), 0.0)
    assert read_register(servo, "goal_position") == 2100
    assert servo.read(data, 5, 0.0).data == (2100).to_bytes(4, "little") + b"\0"  # low byte of 2048
    write_register(servo, "torque_enable", 1)
    assert servo.read(data + 4, 1, 3.0).data == (2100 & 0xFF).to_bytes(1, "little")
    assert servo.change(data, (4096).to_bytes(4, "little"), 3.0) == Error2.DATA_LIMIT
    assert servo.change(data, bytes(2), 3.0) == Error2.DATA_LENGTH
    assert servo.change(data + 4, bytes(1), 3.0) == Error2.ACCESS


@settings(max_examples=30, deadline=None)
@given(data=st.binary(min_size=1, max_size=28))
def test_indirect_data_that_point_at_themselves_are_storage(data: bytes) -> None:
    servo = servo2()
    assert servo.change(224, data, 0.0) == 0
    assert servo.read(224, len(data), 0.0).data == data


@settings(max_examples=60, deadline=None)
@given(address=st.integers(0, 700), length=st.integers(0, 700))
def test_what_is_readable_has_its_length(address: int, length: int) -> None:
    memory, end = Memory(find_table("XL330-M288", 2)), address + length
    covers = any(register.address < end and register.end > address for register in memory.table.registers)
    if memory.readable(address, length):
        assert len(memory.slice(address, length)) == length and covers
    else:
        assert length == 0 or end > memory.table.size or not covers


# The common part of emulated servos of both protocols: start and power.

Make = Callable[[], EmulatedServo | EmulatedServo1]
both = pytest.mark.parametrize("make", [servo2, servo1])


@both
@settings(max_examples=30)
@given(
    goal=st.integers(0, 4095),
    times=st.lists(st.floats(0.0, 3.0), max_size=12),
)
def test_the_number_of_reads_changes_no_motion(make: Make, goal: int, times: list[float]) -> None:
    watched, left = make(), make()
    for servo in (watched, left):
        servo.write(24 if servo.protocol == 1 else 64, b"\1", 0.0)
        size = 2 if servo.protocol == 1 else 4
        servo.write(30 if servo.protocol == 1 else 116, goal.to_bytes(size, "little"), 0.0)
    for now in (*sorted(times), 3.0):
        watched.catch_up(now)
    left.catch_up(3.0)
    assert watched.shaft.position == pytest.approx(left.shaft.position, abs=1e-3)
    assert left.shaft.position == pytest.approx(goal, abs=0.5)


@both
def test_power_is_there_only_when_nothing_takes_it(make: Make) -> None:
    servo = make()
    servo.power_cut(1.0)
    assert servo.booting(1e9) and servo.electrics.current == 0.0
    servo.supply(3.0, 2.0)  # a brown-out as well
    servo.power_back(3.0)
    assert servo.booting(1e9)
    servo.supply(12.0, 4.0)
    assert servo.booting(4.1) and not servo.booting(4.0 + servo.boot_time)
    servo.power_back(5.0)  # it has power: nothing happens
    servo.supply(11.0, 5.0)
    assert not servo.booting(5.0)
