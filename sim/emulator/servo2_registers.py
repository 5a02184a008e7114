"""The registers of a 2.0 servo at work: writes that are refused, the control loop, goals, resets, position counting and
the bus watchdog.

Units that the e-Manual leaves open are taken as PWM counts per tick of error
(P), per tick and ms (I), per tick/ms (D and first feedforward). The default D gain belongs to the loop that the P gain
alone describes, as in the mock bus; only what is set beyond it damps. The second feedforward gain and the velocity
gains have no effect on a motor without inertia.
"""

from enum import Enum
from math import inf
from typing import NamedTuple

from hardware.dynamixel.codec import Error2
from hardware.dynamixel.control_table import Register
from hardware.servo import FULL_PWM, GAIN_UNIT, HOMING_REACH, ServoModel, lag_of_gain
from sim.emulator.memory import Memory, RegisterWrite
from sim.emulator.shaft import Law, ProfilePath, Shaft, path_by_time, path_by_velocity

# What a servo of protocol 2.0 refuses to write, register by register (facts of the e-Manual's control tables).

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
"""Values of Operating Mode (11)."""
GOALS = frozenset(("goal_pwm", "goal_current", "goal_velocity", "goal_position"))
GOAL_LIMITS = (("goal_pwm", "pwm_limit"), ("goal_current", "current_limit"), ("goal_velocity", "velocity_limit"))
"""Goals, and the registers that bound their magnitude."""
TIME_BASED = 0x04  # bit of Drive Mode (10)
MAX_PROFILE_TIME = 32737  # [ms] of 108 and 112 with a time-based profile
_BITS = frozenset(("drive_mode", "startup_configuration"))  # their `highest` is a mask
_LIMIT_OF = dict(GOAL_LIMITS)


class Condition(NamedTuple):
    """What else a write depends on: torque is on; torque is refused since an error is latched; the bus watchdog has
    tripped."""

    torque: bool
    barred: bool
    tripped: bool


def refusal(memory: Memory, part: RegisterWrite, condition: Condition) -> Error2:
    """Return why `part` cannot be written now, Error2.NONE when it can."""
    register, value = part
    name = register.name
    if condition.torque and register.address < memory.table.eeprom_end:
        return Error2.ACCESS
    if not register.allows(value) or not _known(memory, name, value):
        return Error2.DATA_RANGE
    if name in GOALS:
        if condition.tripped:
            return Error2.DATA_RANGE
        low, high = goal_bounds(memory, name)
        return Error2.NONE if low <= value <= high else Error2.DATA_LIMIT
    if name == "bus_watchdog" and condition.tripped and value:
        return Error2.DATA_RANGE
    if name == "torque_enable" and value and condition.barred:
        return Error2.RESULT_FAIL
    return Error2.NONE


def goal_bounds(memory: Memory, name: str) -> tuple[int, int]:
    """Return the lowest and highest counts that a goal register takes with the present limits and mode."""
    limit = _LIMIT_OF.get(name)
    if limit is not None:
        most = memory.value(limit)
        return -most, most
    if memory.value("operating_mode") == POSITION:
        return memory.value("min_position_limit"), memory.value("max_position_limit")
    register = memory.table["goal_position"]
    return register.lowest or 0, register.highest or 0


def _known(memory: Memory, name: str, value: int) -> bool:
    """Whether a value inside the register's range is one that has a meaning."""
    if name == "operating_mode":
        return value in memory.table.modes
    if name in _BITS:
        return not value & ~(memory.table[name].highest or 0)
    if name in ("profile_velocity", "profile_acceleration") and memory.value_or("drive_mode", 0) & TIME_BASED:
        return value <= MAX_PROFILE_TIME
    if name == "protocol_type":
        # Protocol 1.0 and the radio protocols over the X tables are not emulated: the servo stays with 2.0.
        return value == 2
    return True


_LAWS = {CURRENT: Law.CURRENT, VELOCITY: Law.VELOCITY, PWM: Law.PWM}


def tune_loop(shaft: Shaft, memory: Memory, model: ServoModel, supplied: float) -> None:
    """Set law, gains and limits of `shaft`; supplied: supply as a share of the nominal voltage."""
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
    shaft.current_limit = inf
    if mode == CURRENT_POSITION:
        shaft.current_limit = abs(memory.value("goal_current")) * (memory.table["goal_current"].scale or 0.0)


def goal_speed(memory: Memory, tick: float) -> float:
    """Return the goal of the laws other than position: tick/s, A or share of full drive; `tick` rad."""
    mode = memory.value("operating_mode")
    if mode == CURRENT:
        return memory.value("goal_current") * (memory.table["goal_current"].scale or 0.0)
    if mode == PWM:
        return memory.value("goal_pwm") / FULL_PWM
    return memory.value("goal_velocity") * (memory.table["goal_velocity"].scale or 0.0) / tick


def velocity_ramp(memory: Memory, tick: float, change: float) -> float:
    """Return the acceleration, tick/s^2, towards a goal velocity that is `change` tick/s away; inf: at once."""
    value = memory.value("profile_acceleration")
    if not value:
        return inf
    if memory.value_or("drive_mode", 0) & TIME_BASED:
        return max(abs(change), 1.0) / (1e-3 * value)
    return value * (memory.table["profile_acceleration"].scale or 0.0) / tick


def path_to(goal: int, memory: Memory, tick: float, *, at: tuple[float, float], now: float) -> ProfilePath | None:
    """Return the profile to `goal` from `at` (tick, tick/s), None where Profile Velocity says step; `tick` rad."""
    top, ramp = memory.value("profile_velocity"), memory.value("profile_acceleration")
    if not top:
        return None
    position, velocity = at
    if memory.value_or("drive_mode", 0) & TIME_BASED:
        return path_by_time(goal, position=position, velocity=velocity, total=1e-3 * top, ramp=1e-3 * ramp, now=now)
    speed = min(top, max(memory.value("velocity_limit"), 1)) * (memory.table["profile_velocity"].scale or 0.0) / tick
    rate = ramp * (memory.table["profile_acceleration"].scale or 0.0) / tick
    return path_by_velocity(goal, position=position, velocity=velocity, top=speed, acceleration=rate, now=now)


# Goal registers of a 2.0 servo: what resets them, what bounds them, and how they become motion.


def reset_for_mode(memory: Memory) -> None:
    """Reset what a change of the operating mode resets: gains, profile, goal PWM and goal current (e-Manual, 11)."""
    for register in memory.table.registers:
        if register.name.endswith("_gain"):
            memory.store(register, register.initial or 0)
    memory.put("profile_acceleration", 0)
    memory.put("profile_velocity", 0)
    open_limits(memory)


def open_limits(memory: Memory) -> None:
    """Goal PWM and goal current := their limits."""
    for goal, limit in GOAL_LIMITS[:2]:
        memory.put(goal, memory.value_or(limit, 0))


def bound_goals(memory: Memory) -> None:
    """Pull goal registers inside limits that have moved."""
    for name in GOALS:
        if memory.table.has(name):
            _put_within(memory, name, memory.value(name))


def goal_to_present(memory: Memory, position: float) -> None:
    """Set the goal position register to the present position (tick), within its limits."""
    _put_within(memory, "goal_position", round(position))


def _put_within(memory: Memory, name: str, value: int) -> None:
    """Set a goal register, within its limits."""
    low, high = goal_bounds(memory, name)
    memory.put(name, max(min(value, high), low))


def aim(shaft: Shaft, memory: Memory, *, tick: float, now: float, fresh: bool) -> None:
    """Send the shaft to what the goal registers hold. tick: rad; fresh: torque has just come on, so that a profile
    starts where the shaft is, and at rest."""
    if shaft.law is Law.POSITION:
        goal = memory.value("goal_position")
        shaft.path = path_to(goal, memory, tick, at=_here(shaft, fresh), now=now)
        shaft.target = goal
    else:
        shaft.path = None
        shaft.speed = goal_speed(memory, tick)
        if shaft.law is Law.VELOCITY:
            shaft.ramp = velocity_ramp(memory, tick, shaft.speed - shaft.trajectory()[1])
    shaft.refresh()


def _here(shaft: Shaft, fresh: bool) -> tuple[float, float]:
    """Where a new profile begins, (tick, tick/s): on the old one, or where the loop holds, or where the shaft is."""
    if fresh:
        return shaft.position, 0.0
    if shaft.path is not None or abs(shaft.target - shaft.position) < shaft.lag * shaft.full:
        return shaft.trajectory()
    return shaft.position, shaft.velocity


# What a 2.0 servo's memory holds after a start, a factory reset and a restore of its backup.
#
# Source: e-Manual, protocol 2.0 (06 Factory Reset, 20 Control Table Backup), Startup Configuration (60).

RAM_RESTORE = 0x02  # bit of Startup Configuration
ALL, BUT_ID, BUT_ID_AND_BAUD = 0xFF, 0x01, 0x02
"""Options of a factory reset."""
RESETS = tuple(bytes((option,)) for option in (ALL, BUT_ID, BUT_ID_AND_BAUD))
"""What stands behind the instruction."""
_FIXED = frozenset(("model_number", "model_information", "firmware_version"))
_SPARED = {ALL: frozenset[str](), BUT_ID: frozenset(("id",)), BUT_ID_AND_BAUD: frozenset(("id", "baud_rate"))}
_PROFILE = frozenset(("profile_acceleration", "profile_velocity"))


def factory_reset(memory: Memory, option: int) -> None:
    """Set the EEPROM area to the maker's values, what the option (ALL, BUT_ID, BUT_ID_AND_BAUD) spares apart."""
    for register in memory.table.registers:
        if register.address < memory.table.eeprom_end and register.name not in _SPARED[option] | _FIXED:
            memory.store(register, register.initial or 0)


def restore_eeprom(memory: Memory, backup: bytes) -> None:
    """Set the EEPROM area to what the backup holds."""
    for register in memory.table.registers:
        if register.address < memory.table.eeprom_end and register.name not in _FIXED:
            _copy(memory, backup, register)


def restore_ram(memory: Memory, backup: bytes | None) -> None:
    """Set gains, profile and indirect addresses to what the backup holds, where the startup configuration says so."""
    memory.put("backup_ready", int(backup is not None))
    if backup is None or not memory.value_or("startup_configuration", 0) & RAM_RESTORE:
        return
    for register in memory.table.registers:
        name = register.name
        if name.endswith("_gain") or name in _PROFILE or name.startswith("indirect_address_"):
            _copy(memory, backup, register)


def _copy(memory: Memory, backup: bytes, register: Register) -> None:
    memory.image[register.address : register.end] = backup[register.address : register.end]


# How a 2.0 servo counts its position: homing offset, reverse mode, folding to one turn.
#
# Source: e-Manual, Present Position (132), Homing Offset (20), Drive Mode (10).

TURN = 4096  # [ticks] of one turn in position mode
REVERSE = 0x01  # bit of Drive Mode


class Encoder:
    """Keeps the position of `shaft` counted as the registers in `memory` say: actual position plus offset."""

    def __init__(self, memory: Memory, shaft: Shaft) -> None:
        self._memory = memory
        self._shaft = shaft
        self._offset = 0  # part of the position
        self.reversed = False

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick) with the present settings."""
        self._offset = self._honoured()
        self.reversed = self._reverse()
        self._shaft.position = position

    def fold(self) -> None:
        """Count the actual position within one turn again."""
        actual = (self._shaft.position - self._offset) % TURN
        self._offset = self._honoured()
        self._shaft.position = actual + self._offset

    def follow_settings(self) -> None:
        """Count anew when offset or direction have changed; the offset keeps its sign in reverse mode."""
        if self._reverse() != self.reversed:
            self.reversed = not self.reversed
            self._shaft.position = 2 * self._offset - self._shaft.position
            if self._memory.value("operating_mode") == POSITION:
                self.fold()
        offset = self._honoured()
        self._shaft.position += offset - self._offset
        self._offset = offset

    def clear_turns(self) -> None:
        """Fold to one turn; the goal register goes along as far as its limits let it."""
        before = self._shaft.position
        self.fold()
        goal = self._memory.value("goal_position") + round(self._shaft.position - before)
        _put_within(self._memory, "goal_position", goal)

    def _reverse(self) -> bool:
        return bool(self._memory.value_or("drive_mode", 0) & REVERSE)

    def _honoured(self) -> int:
        offset = self._memory.value("homing_offset")
        ignored = self._memory.value("operating_mode") == POSITION and abs(offset) > HOMING_REACH
        return 0 if ignored else offset


# The bus watchdog of a 2.0 servo (register 98, 20 ms steps): when the bus has been silent for too long.

STEP = 0.02  # [s] of register 98


class FedBy(Enum):
    """The valid instructions that feed the watchdog. The e-Manual says 'all instruction packets', and not whether those
    for other ids count."""

    ANY = "any"
    """All on the line."""
    OWN = "own"
    """Those to the servo's id or secondary id, and broadcasts (group reads and writes are, whatever ids they name)."""


class BusWatchdog:
    """A watchdog that runs only while armed. `tripped`: it has stopped the servo; register 98 is not cleared yet."""

    def __init__(self) -> None:
        self.deadline = inf
        """When it trips unless an instruction is received, s."""
        self.tripped = False
        self._period = 0.0

    def arm(self, value: int, now: float, *, torque: bool) -> None:
        """Begin to count at `now` (s) for register value `value`; a value of 0 or less, or no torque: off."""
        self._period = max(value, 0) * STEP
        self.deadline = now + self._period if self._period and torque and not self.tripped else inf

    def feed(self, now: float) -> None:
        """Note an instruction at `now` (s), before the deadline."""
        if self.deadline < inf:
            self.deadline = max(self.deadline, now + self._period)

    def trip(self) -> None:
        """Note that it has stopped the servo."""
        self.deadline = inf
        self.tripped = True
