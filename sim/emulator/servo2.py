"""An emulated servo of the X layout: working registers, and motion behind them.

Source: e-Manual, X series and protocol 2.0. Motion, current and heat: `sim.emulator.shaft` and `sim.emulator.power`.
"""

from math import inf
from struct import Struct

from hardware.dynamixel.codec import ALERT, Error2, Instruction
from hardware.dynamixel.control_table import ControlTable
from hardware.servo import FULL_PWM, ServoModel
from sim.emulator.device import Answer
from sim.emulator.memory import RegisterWrite
from sim.emulator.servo2_registers import (
    ALL,
    GOALS,
    POSITION,
    PROFILE,
    RESETS,
    BusWatchdog,
    Condition,
    Encoder,
    aim,
    bound_goals,
    factory_reset,
    goal_bounds,
    open_limits,
    put_goal,
    refusal,
    reset_for_mode,
    restore_eeprom,
    restore_ram,
    tune_loop,
)
from sim.emulator.servo_body import OVERLOAD_BIT, ServoBody, ServoBuild
from sim.emulator.shaft import Law
from sim.servo_model import IDLE_CURRENT, LARGEST_CURRENT

CLEAR_TURNS = bytes((0x01, 0x44, 0x58, 0x4C, 0x22))
STORE = bytes((0x01, 0x43, 0x54, 0x52, 0x4C))
RESTORE = bytes((0x02, 0x43, 0x54, 0x52, 0x4C))
_PARAMETERS: dict[int, tuple[bytes, ...]] = {
    Instruction.FACTORY_RESET: RESETS,
    Instruction.CLEAR: (CLEAR_TURNS,),
    Instruction.CONTROL_TABLE_BACKUP: (STORE, RESTORE),
}
"""Parameters of these instructions."""
_IGNORES_BROADCAST_RESET = 42  # first firmware that ignores a factory reset of everything that is broadcast
TORQUE_BY_GOAL = 0x08  # bit of Drive Mode (10)
TORQUE_AT_START = 0x01  # bit of Startup Configuration (60)
_GOAL, _GOAL_END = 116, 120  # goal position
ERRORS = 0x3F  # bits of Hardware Error Status (70) that Shutdown (63) masks

# The registers that show its state.

MOTION, MOTION_END = 126, 136
"""Addresses from and to which hosts read most: current or load, velocity, position (e-Manual)."""
IN_POSITION = 16  # [tick] not documented
FOLLOWING_ERROR = 512  # [tick] not documented
_SPEED_AND_POSITION = Struct("<ii")
_WRAP = 0x80000000  # positions are shown in 32 bits
_FULL_LOAD = 1000  # load register, 0.1 %


def _wrapped(position: float) -> int:
    return (round(position) + _WRAP & 2 * _WRAP - 1) - _WRAP


class EmulatedServo(ServoBody):
    """A servo with a table of the X layout."""

    shown = 120, 147

    def __init__(self, table: ControlTable, model: ServoModel, build: ServoBuild) -> None:
        super().__init__(table, model, build)
        self.backup: bytes | None = None
        self._watchdog = BusWatchdog()
        self._encoder = Encoder(self.memory, self.shaft)
        self._speed_unit = (table["present_velocity"].scale or 1.0) / model.tick_rad  # [tick/s]
        self._current_unit = (table["present_current"].scale or 1.0) if table.has("present_current") else 1.0  # [A]
        self._current_stuck = False
        self._latched = 0  # Hardware Error Status
        self._alert = 0
        self._threshold = 0.0  # [tick/s] of moving
        self._mode = 0  # operating mode that is tuned
        self._direct = range(0)  # goal positions that only have to become the target
        self._reset()
        self.place(build.position)
        self._measured()

    @property
    def tripped(self) -> bool:
        """True if the bus watchdog has stopped it."""
        return self._watchdog.tripped

    @property
    def moving(self) -> bool:
        """True if it turns faster than its moving threshold."""
        return abs(self.shaft.velocity) > self._threshold

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick); the goal register goes with it."""
        self._encoder.place(position)
        put_goal(self.memory, "goal_position", round(position))
        self.tune()

    def receive(self, now: float) -> None:
        """Note a valid instruction on the line: it feeds the bus watchdog."""
        watchdog = self._watchdog
        if watchdog.deadline != inf:
            if now > watchdog.deadline:
                self.catch_up(now)
            watchdog.feed(now)

    def read(self, address: int, length: int, now: float) -> Answer:
        """The bytes of a range, or its error. The motion, which hosts read every cycle, is quick."""
        end = address + length
        if MOTION <= address < end <= MOTION_END:
            self.catch_up(now)
            shaft = self.shaft
            motion = _SPEED_AND_POSITION.pack(round(shaft.velocity / self._speed_unit), _wrapped(shaft.position))
            whole = bytes(self.memory.image[MOTION : MOTION + 2]) + motion
            return Answer(self._alert, whole[address - MOTION : end - MOTION])
        return super().read(address, length, now)

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        """Carry out a write; a refused one is dropped. Goal positions, written every cycle, are quick."""
        if address == _GOAL and len(data) == 4 and now >= self._awake_at:
            self.catch_up(now)
            goal = int.from_bytes(data, "little", signed=True)
            if goal in self._direct:
                self.memory.image[_GOAL:_GOAL_END] = data
                self.shaft.target = goal
                return
        super().write(address, data, now, secondary=secondary)

    def live(self, now: float) -> dict[str, float]:
        """The registers that show its motion at `now` (s); the others change when it is checked."""
        shaft = self.shaft
        place, speed = shaft.trajectory() if shaft.path is not None else (shaft.target, 0.0)
        if not shaft.torque:
            place, speed = shaft.position, 0.0
        off = abs(place - shaft.position)
        status = off <= IN_POSITION if shaft.path is None else 2 | shaft.path.kind << 4
        return {
            "realtime_tick": self.realtime_tick(now),
            "moving": self.moving,
            "moving_status": status | 8 * (off > FOLLOWING_ERROR),
            "present_pwm": FULL_PWM * shaft.drive(),
            "present_velocity": shaft.velocity / self._speed_unit,
            "present_position": _wrapped(shaft.position),
            "velocity_trajectory": speed / self._speed_unit,
            "position_trajectory": _wrapped(place),
        }

    def _measured(self) -> None:
        electrics = self.electrics
        load = min(max((electrics.current - IDLE_CURRENT) / LARGEST_CURRENT, 0.0), 1.0)
        values = {
            "present_current": electrics.direction * electrics.current / self._current_unit,
            "present_load": electrics.direction * _FULL_LOAD * load,
            "present_input_voltage": 10.0 * electrics.voltage,
            "present_temperature": electrics.warmth,
        }
        if self._current_stuck:
            del values["present_current"]
        self.show_values(values)

    def hold_current(self, stuck: bool, now: float) -> None:
        """Keep the shown current, or show the true one again."""
        self.catch_up(now)
        self._current_stuck = stuck

    def answer(self, error: int = 0, data: bytes = b"") -> Answer:
        """An answer with the alert bit as it stands."""
        return Answer(error | self._alert, data)

    def refusal(self, part: RegisterWrite) -> int:
        """The error by which a register refuses a value."""
        condition = Condition(torque=self.shaft.torque, barred=self.barred, tripped=self.tripped)
        return refusal(self.memory, part, condition)

    def ignores_broadcast(self, instruction: int, params: bytes) -> bool:
        """Return whether it ignores a broadcast, as a reset of everything since firmware 42."""
        if instruction == Instruction.FACTORY_RESET and params[:1] == bytes((ALL,)):
            return self.memory.value("firmware_version") >= _IGNORES_BROADCAST_RESET
        return super().ignores_broadcast(instruction, params)

    def special(self, instruction: int, params: bytes, now: float) -> Answer:
        """Carry out a reset, a restart, the clearing of turns, or a backup."""
        alert = self._alert  # that of a latched error is still sent
        known = _PARAMETERS.get(instruction)
        backs_up = instruction == Instruction.CONTROL_TABLE_BACKUP
        error = Error2.NONE
        if instruction == Instruction.REBOOT:
            self.reboot(now)
        elif known is None or (backs_up and not self.table.has("backup_ready")):
            return Answer(self.unknown | alert, b"")
        elif params not in known:
            error = Error2.DATA_RANGE if len(params) == len(known[0]) else Error2.DATA_LENGTH
        elif instruction == Instruction.FACTORY_RESET:
            factory_reset(self.memory, params[0])
            self.reboot(now)
        elif instruction == Instruction.CLEAR and self.moving:
            error = Error2.RESULT_FAIL
        elif instruction == Instruction.CLEAR:
            # The position is folded to one turn; the goal is shifted by as much, so that nothing moves.
            self._encoder.clear_turns()
            if self.shaft.law is Law.POSITION:
                self.shaft.path = None
                self.shaft.target = self.shaft.position if self.tripped else self.memory.value("goal_position")
            self.tune()
        elif self.shaft.torque or (params == RESTORE and self.backup is None):
            error = Error2.RESULT_FAIL
        elif params == RESTORE and self.backup is not None:
            restore_eeprom(self.memory, self.backup)
            self.reboot(now)
        else:
            self.backup = bytes(self.memory.image)
            self.memory.put("backup_ready", 1)
        return Answer(error | alert, b"")

    def react(self, names: set[str], now: float) -> None:
        """Apply the written registers `names`."""
        memory = self.memory
        if not names <= GOALS:
            mode = memory.value("operating_mode")
            if mode != self._mode:
                reset_for_mode(memory)
            self._encoder.follow_settings()
            if "operating_mode" in names and mode == POSITION:
                self._encoder.fold()
            bound_goals(memory)
            if "bus_watchdog" in names:
                self._watchdog.tripped = self.tripped and memory.value("bus_watchdog") != 0
                self._watchdog.arm(memory.value("bus_watchdog"), now, torque=self.shaft.torque)
        self.tune()
        if "torque_enable" in names:
            self._set_torque(bool(memory.value("torque_enable")), now)
        if names & GOALS:
            if memory.flag("drive_mode", TORQUE_BY_GOAL) and not self.shaft.torque:
                self._set_torque(True, now)
            self._aim(now)
            self.tune()

    def pass_events(self, now: float) -> None:
        """Let time pass up to `now` (s); the bus watchdog may stop the servo meanwhile."""
        deadline = self._watchdog.deadline
        if now > deadline:
            super().pass_events(deadline)
            if self._watchdog.deadline == deadline:  # the bus has been silent for too long: it stops
                self._watchdog.trip()
                self.let_go(self.shaft.time)
                self.memory.put("bus_watchdog", -1)
                for name in PROFILE:
                    self.memory.put(name, 0)
                self.shaft.hold()
                self.tune()
        super().pass_events(now)
        self._eventless = min(self._eventless, self._watchdog.deadline)

    def tune(self) -> None:
        """Take every setting from the registers."""
        memory, shaft = self.memory, self.shaft
        super().tune()
        second = memory.value_or("secondary_id", 255)
        self.secondary_id = second if second <= 252 else None
        self._mode = memory.value("operating_mode")
        self._threshold = memory.value("moving_threshold") * self._speed_unit
        tune_loop(shaft, memory, self.servo_model, self.electrics.supplied)
        shaft.refresh()
        stepping = shaft.law is Law.POSITION and shaft.torque and shaft.path is None and not self.tripped
        low, high = goal_bounds(memory, "goal_position")
        self._direct = range(low, high + 1) if stepping and not memory.value("profile_velocity") else range(0)

    def note(self, wrong: int) -> None:
        """Latch new errors, bits."""
        self._measured()
        if wrong & ~self._latched:
            self._latch(wrong)

    def overload(self, now: float) -> None:
        """Latch an overload, as when `ServoElectrics` has counted to its end."""
        self.catch_up(now)
        if self._awake_at < inf and not self._starting:
            self._latch(OVERLOAD_BIT)

    def wake(self, now: float) -> None:
        """End a start: check for errors, and switch torque on if the startup configuration has that bit."""
        self.check()
        if self.memory.flag("startup_configuration", TORQUE_AT_START):
            self._set_torque(True, now)

    @property
    def barred(self) -> bool:
        """True if a latched error keeps torque off."""
        return bool(self._latched and self._latched & self.memory.value("shutdown") & ERRORS)

    def _latch(self, bits: int) -> None:
        """Keep hardware errors until the next start; those in the shutdown mask switch torque off."""
        self._latched |= bits
        self._alert = ALERT
        self.memory.put("hardware_error_status", self._latched)
        if self.barred:
            self._set_torque(False, self.shaft.time)

    def _set_torque(self, on: bool, now: float) -> None:
        shaft = self.shaft
        if self.switch(on):
            self._watchdog.arm(self.memory.value_or("bus_watchdog", 0), now, torque=shaft.torque)
            if shaft.torque and self.memory.value("operating_mode") == POSITION:
                self._encoder.fold()
            shaft.refresh()
            if shaft.torque:
                shaft.hold()
                self._aim(now, fresh=True)
        self.tune()

    def _aim(self, now: float, *, fresh: bool = False) -> None:
        """Go to the goal registers, unless the bus watchdog has stopped it."""
        if self.shaft.torque and not self.tripped:
            aim(self.shaft, self.memory, tick=self.servo_model.tick_rad, now=now, fresh=fresh)

    def _reset(self) -> None:
        """Bring RAM to its state after a start; the position is counted within one turn again."""
        super()._reset()
        self._latched = self._alert = 0
        self._watchdog = BusWatchdog()
        restore_ram(self.memory, self.backup)
        open_limits(self.memory)
        self._encoder.follow_settings()
        self._encoder.fold()
        put_goal(self.memory, "goal_position", round(self.shaft.position))
        self.tune()
