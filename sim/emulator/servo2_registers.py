"""The registers of a 2.0 servo: refused writes, control loop, goals, resets, position counting, bus watchdog.

Source: e-Manual, X series and protocol 2.0. Open units are taken as PWM counts per tick of error (P), per tick and ms
(I), per tick/ms (D and first feedforward). Only a D gain beyond the default damps. The second feedforward gain and the
velocity gains have no effect on a motor without inertia.
"""

from enum import Enum
from math import inf
from typing import NamedTuple

from hardware.dynamixel.codec import Error2
from hardware.servo import FULL_PWM, GAIN_UNIT, HOMING_REACH, ServoModel, lag_of_gain
from sim.emulator.memory import Memory, RegisterWrite
from sim.emulator.shaft import Law, ProfilePath, Shaft, path_by_time, path_by_velocity

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
"""Values of Operating Mode (11)."""
GOAL_LIMITS = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}
"""Goals, and the registers that bound their magnitude."""
GOALS = frozenset((*GOAL_LIMITS, "goal_position"))
REVERSE, TIME_BASED = 0x01, 0x04
"""Bits of Drive Mode (10)."""
MAX_PROFILE_TIME = 32737  # [ms] of 108 and 112 with a time-based profile
RAM_RESTORE = 0x02  # bit of Startup Configuration (60)
PROFILE = ("profile_acceleration", "profile_velocity")
_LAWS = {CURRENT: Law.CURRENT, VELOCITY: Law.VELOCITY, PWM: Law.PWM}


class Condition(NamedTuple):
    """The state on which a write depends: torque is on; a latched error bars torque; the bus watchdog has tripped."""

    torque: bool
    barred: bool
    tripped: bool


def refusal(memory: Memory, part: RegisterWrite, condition: Condition) -> Error2:
    """The error by which `part` is refused now, Error2.NONE if it is accepted."""
    register, value = part
    if condition.torque and register.address < memory.table.eeprom_end:
        return Error2.ACCESS
    # Values inside the range of a register may still have no meaning.
    known = register.allows(value)
    match register.name:
        case "operating_mode":
            known &= value in memory.table.modes
        case "drive_mode" | "startup_configuration":  # their `highest` is a mask
            known &= not value & ~(register.highest or 0)
        case "profile_velocity" | "profile_acceleration" if memory.flag("drive_mode", TIME_BASED):
            known &= value <= MAX_PROFILE_TIME
        case "protocol_type":  # protocol 1.0 and the radio protocols over the X tables are not emulated
            known &= value == 2
        case "bus_watchdog":
            known &= not (condition.tripped and value)
        case name if name in GOALS:
            known &= not condition.tripped
            low, high = goal_bounds(memory, name)
            if known and not low <= value <= high:
                return Error2.DATA_LIMIT
        case "torque_enable" if known and value and condition.barred:
            return Error2.RESULT_FAIL
    return Error2.NONE if known else Error2.DATA_RANGE


def goal_bounds(memory: Memory, name: str) -> tuple[int, int]:
    """The lowest and highest counts of a goal register with the present limits and mode."""
    if name in GOAL_LIMITS:
        most = memory.value(GOAL_LIMITS[name])
        return -most, most
    if memory.value("operating_mode") == POSITION:
        return memory.value("min_position_limit"), memory.value("max_position_limit")
    register = memory.table["goal_position"]
    return register.lowest or 0, register.highest or 0


def tune_loop(shaft: Shaft, memory: Memory, model: ServoModel, supplied: float) -> None:
    """Set law, gains and limits of `shaft`. supplied: supply as a share of the nominal voltage."""
    mode = memory.value("operating_mode")
    gain = memory.value("position_p_gain")
    shaft.law = _LAWS.get(mode, Law.POSITION)
    shaft.full = model.no_load_speed / model.tick_rad * supplied
    shaft.lag = inf
    shaft.integral = shaft.forward = 0.0
    if gain and supplied > 0.0:
        damping = max(memory.value("position_d_gain") - (memory.table["position_d_gain"].initial or 0), 0) / 16.0
        per_tick = gain / GAIN_UNIT  # PWM counts
        shaft.lag = lag_of_gain(model, gain) / supplied + 1e-3 * damping / per_tick
        shaft.integral = 1e3 * memory.value("position_i_gain") / 65536.0 / per_tick
        shaft.forward = 1e-3 * memory.value("feedforward_1st_gain") / 4.0 / per_tick
    share = abs(memory.value("goal_pwm")) / FULL_PWM
    shaft.drive_limit = memory.value("pwm_limit") / FULL_PWM if mode == PWM else share
    shaft.current_limit = abs(memory.scaled("goal_current")) if mode == CURRENT_POSITION else inf


def path_to(goal: int, memory: Memory, tick: float, *, at: tuple[float, float], now: float) -> ProfilePath | None:
    """The profile to `goal` from `at` (tick, tick/s), None where Profile Velocity is 0: a step. tick: rad."""
    top, ramp = memory.value("profile_velocity"), memory.value("profile_acceleration")
    if not top:
        return None
    position, velocity = at
    if memory.flag("drive_mode", TIME_BASED):
        return path_by_time(goal, position=position, velocity=velocity, total=1e-3 * top, ramp=1e-3 * ramp, now=now)
    speed = min(top, max(memory.value("velocity_limit"), 1)) * (memory.table["profile_velocity"].scale or 0.0) / tick
    rate = memory.scaled("profile_acceleration") / tick
    return path_by_velocity(goal, position=position, velocity=velocity, top=speed, acceleration=rate, now=now)


def aim(shaft: Shaft, memory: Memory, *, tick: float, now: float, fresh: bool) -> None:
    """Send the shaft to the goal registers. tick: rad; fresh: torque has just come on, so that a profile starts at
    rest at the position of the shaft."""
    if shaft.law is Law.POSITION:
        # A new profile begins on the old one, or where the loop holds, or at the shaft.
        here = shaft.position, 0.0 if fresh else shaft.velocity
        holds = shaft.path is not None or abs(shaft.target - shaft.position) < shaft.lag * shaft.full
        goal = memory.value("goal_position")
        shaft.path = path_to(goal, memory, tick, at=shaft.trajectory() if holds and not fresh else here, now=now)
        shaft.target = goal
    else:
        shaft.path = None
        if shaft.law is Law.CURRENT:
            shaft.speed = memory.scaled("goal_current")
        elif shaft.law is Law.PWM:
            shaft.speed = memory.value("goal_pwm") / FULL_PWM
        else:
            shaft.speed = memory.scaled("goal_velocity") / tick
            acceleration = memory.value("profile_acceleration")
            if not acceleration:
                shaft.ramp = inf
            elif memory.flag("drive_mode", TIME_BASED):
                shaft.ramp = max(abs(shaft.speed - shaft.trajectory()[1]), 1.0) / (1e-3 * acceleration)
            else:
                shaft.ramp = memory.scaled("profile_acceleration") / tick
    shaft.refresh()


# Resets of goals and other registers.


def reset_for_mode(memory: Memory) -> None:
    """Reset gains, profile, goal PWM and goal current with the operating mode (e-Manual, 11)."""
    for register in memory.table.registers:
        if register.name.endswith("_gain"):
            memory.store(register, register.initial or 0)
    for name in PROFILE:
        memory.put(name, 0)
    open_limits(memory)


def open_limits(memory: Memory) -> None:
    """Set goal PWM and goal current to their limits."""
    for goal in ("goal_pwm", "goal_current"):
        memory.put(goal, memory.value_or(GOAL_LIMITS[goal], 0))


def bound_goals(memory: Memory) -> None:
    """Bring goal registers inside limits that have changed."""
    for name in GOALS:
        if memory.table.has(name):
            put_goal(memory, name, memory.value(name))


def put_goal(memory: Memory, name: str, value: int) -> None:
    """Set a goal register, within its limits."""
    low, high = goal_bounds(memory, name)
    memory.put(name, max(min(value, high), low))


ALL, BUT_ID, BUT_ID_AND_BAUD = 0xFF, 0x01, 0x02
"""Options of a factory reset (e-Manual, protocol 2.0, 06)."""
RESETS = tuple(bytes((option,)) for option in (ALL, BUT_ID, BUT_ID_AND_BAUD))
"""Parameters of the instruction."""
_FIXED = frozenset(("model_number", "model_information", "firmware_version"))
_SPARED = {ALL: _FIXED, BUT_ID: _FIXED | {"id"}, BUT_ID_AND_BAUD: _FIXED | {"id", "baud_rate"}}


def factory_reset(memory: Memory, option: int) -> None:
    """Set the EEPROM area to the maker's values, except for the registers that the option spares."""
    for register in memory.table.registers:
        if register.address < memory.table.eeprom_end and register.name not in _SPARED[option]:
            memory.store(register, register.initial or 0)


def restore_eeprom(memory: Memory, backup: bytes) -> None:
    """Set the EEPROM area to a backup (e-Manual, protocol 2.0, 20)."""
    for register in memory.table.registers:
        if register.address < memory.table.eeprom_end and register.name not in _FIXED:
            memory.image[register.address : register.end] = backup[register.address : register.end]


def restore_ram(memory: Memory, backup: bytes | None) -> None:
    """Set gains, profile and indirect addresses to a backup, if the startup configuration has that bit."""
    memory.put("backup_ready", int(backup is not None))
    if backup is None or not memory.flag("startup_configuration", RAM_RESTORE):
        return
    for register in memory.table.registers:
        name = register.name
        if name.endswith("_gain") or name in PROFILE or name.startswith("indirect_address_"):
            memory.image[register.address : register.end] = backup[register.address : register.end]


TURN = 4096  # [ticks] of one turn in position mode


class Encoder:
    """Counts the position of `shaft`: the actual position, in one turn or many, plus the homing offset.

    Source: e-Manual, Present Position (132), Homing Offset (20), Drive Mode (10).
    """

    def __init__(self, memory: Memory, shaft: Shaft) -> None:
        self._memory = memory
        self._shaft = shaft
        self._offset = 0  # part of the position
        self.reversed = False

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick) with the present settings."""
        self._offset = self._active_offset()
        self.reversed = self._memory.flag("drive_mode", REVERSE)
        self._shaft.position = position

    def fold(self) -> None:
        """Count the actual position within one turn again."""
        actual = (self._shaft.position - self._offset) % TURN
        self._offset = self._active_offset()
        self._shaft.position = actual + self._offset

    def follow_settings(self) -> None:
        """Apply a change of offset or direction; the offset keeps its sign in reverse mode."""
        if self._memory.flag("drive_mode", REVERSE) != self.reversed:
            self.reversed = not self.reversed
            self._shaft.position = 2 * self._offset - self._shaft.position
            if self._memory.value("operating_mode") == POSITION:
                self.fold()
        offset = self._active_offset()
        self._shaft.position += offset - self._offset
        self._offset = offset

    def clear_turns(self) -> None:
        """Fold to one turn, and shift the goal register by as much, within its limits."""
        before = self._shaft.position
        self.fold()
        goal = self._memory.value("goal_position") + round(self._shaft.position - before)
        put_goal(self._memory, "goal_position", goal)

    def _active_offset(self) -> int:
        """The homing offset; position mode ignores a large one."""
        offset = self._memory.value("homing_offset")
        ignored = self._memory.value("operating_mode") == POSITION and abs(offset) > HOMING_REACH
        return 0 if ignored else offset


WATCHDOG_STEP = 0.02  # [s] of register 98


class FedBy(Enum):
    """The instructions that feed the watchdog: the e-Manual does not say whether those for other ids count."""

    ANY = "any"
    """All on the line."""
    OWN = "own"
    """Those to the servo's id or secondary id, and broadcasts, which include group reads and writes."""


class BusWatchdog:
    """The bus watchdog (98) of a servo. deadline: when it trips unless an instruction is received, s. tripped: it has
    stopped the servo, and register 98 is not cleared yet."""

    def __init__(self) -> None:
        self.deadline = inf
        self.tripped = False
        self._period = 0.0

    def arm(self, value: int, now: float, *, torque: bool) -> None:
        """Begin to count at `now` (s); a value of 0 or less, or no torque, switches it off."""
        self._period = max(value, 0) * WATCHDOG_STEP
        self.deadline = now + self._period if self._period and torque and not self.tripped else inf

    def feed(self, now: float) -> None:
        """Note an instruction at `now` (s), before the deadline."""
        if self.deadline < inf:
            self.deadline = max(self.deadline, now + self._period)

    def trip(self) -> None:
        """Note that it has stopped the servo."""
        self.deadline = inf
        self.tripped = True
