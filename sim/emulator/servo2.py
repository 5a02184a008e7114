"""An emulated servo of protocol 2.0: registers that work, and motion behind them.

Source: e-Manual, X series and protocol 2.0. Motion, current and heat: `sim.emulator.shaft` and `sim.emulator.power`.
"""

from collections.abc import Callable
from math import inf

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.packets import ALERT, Error2, Instruction
from hardware.servo import ServoModel
from sim.emulator.device import Answer
from sim.emulator.memory import Part
from sim.emulator.servo2_registers import (
    ALL,
    END,
    FIRST,
    GOALS,
    MOTION,
    MOTION_END,
    POSITION,
    BusWatchdog,
    Condition,
    Encoder,
    Live,
    aim,
    bound_goals,
    factory_reset,
    goal_bounds,
    goal_to_present,
    open_limits,
    refusal,
    reset_for_mode,
    restore_eeprom,
    restore_ram,
    tune_loop,
)
from sim.emulator.servo_body import ServoBody, ServoBuild
from sim.emulator.shaft import Law

# Instructions of protocol 2.0 for one servo, but group reads and writes: parameters in, answer out.
#
# Source: e-Manual, protocol 2.0.

CLEAR_TURNS = bytes((0x01, 0x44, 0x58, 0x4C, 0x22))
STORE = bytes((0x01, 0x43, 0x54, 0x52, 0x4C))
RESTORE = bytes((0x02, 0x43, 0x54, 0x52, 0x4C))
_IGNORES_BROADCAST_RESET = 42  # first firmware that ignores a factory reset of everything that is broadcast
_LEVEL: dict[int, int] = {
    Instruction.PING: 0,
    Instruction.READ: 1,
}  # status return level from which an answer comes, else 2
_OBEYED = frozenset((Instruction.WRITE, Instruction.REG_WRITE, Instruction.ACTION))  # through a secondary id


def carry_out(
    servo: "EmulatedServo", instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool
) -> Answer | None:
    """Carry out one instruction at `now` (s); None: no status follows."""
    if secondary:
        if instruction in _OBEYED:
            _HANDLERS[instruction](servo, params, now, True)
        return None
    if broadcast and instruction == Instruction.READ:
        return None
    everything = instruction == Instruction.FACTORY_RESET and params[:1] == bytes((ALL,))
    if broadcast and everything and servo.memory.value("firmware_version") >= _IGNORES_BROADCAST_RESET:
        return None
    handler = _HANDLERS.get(instruction)
    answer = servo.answer(Error2.INSTRUCTION) if handler is None else handler(servo, params, now, False)
    if broadcast and instruction != Instruction.PING:
        return None
    return answer if servo.memory.value("status_return_level") >= _LEVEL.get(instruction, 2) else None


def _ping(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    return servo.answer(0, bytes(servo.memory.image[0:2]) + bytes(servo.memory.image[6:7]))


def _read(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if len(params) != 4:
        return servo.answer(Error2.DATA_LENGTH)
    return servo.read(params[0] | params[1] << 8, params[2] | params[3] << 8, now)


def _write(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if len(params) < 3:
        return servo.answer(Error2.DATA_LENGTH)
    error = servo.change(params[0] | params[1] << 8, params[2:], now, ram_only=secondary)
    return servo.answer(error)


def _reg_write(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if len(params) < 3:
        return servo.answer(Error2.DATA_LENGTH)
    address = params[0] | params[1] << 8
    checked = servo.accepts(address, params[2:], ram_only=secondary)
    if isinstance(checked, Error2):
        return servo.answer(checked)
    servo.registered = (address, params[2:])
    servo.memory.put("registered_instruction", 1)
    return servo.answer()


def _action(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if servo.registered is None:
        return servo.answer(Error2.INSTRUCTION)
    address, data = servo.registered
    servo.registered = None
    servo.memory.put("registered_instruction", 0)
    return servo.answer(servo.change(address, data, now, ram_only=secondary))


def _factory_reset(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if len(params) != 1:
        return servo.answer(Error2.DATA_LENGTH)
    if not factory_reset(servo.memory, params[0]):
        return servo.answer(Error2.DATA_RANGE)
    answer = servo.answer()
    servo.reboot(now)
    return answer


def _reboot(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    answer = servo.answer()  # the alert of a latched error is still sent
    servo.reboot(now)
    return answer


def _clear(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if len(params) != len(CLEAR_TURNS):
        return servo.answer(Error2.DATA_LENGTH)
    if params != CLEAR_TURNS:
        return servo.answer(Error2.DATA_RANGE)
    if servo.moving:
        return servo.answer(Error2.RESULT_FAIL)
    servo.clear_turns(now)
    return servo.answer()


def _backup(servo: "EmulatedServo", params: bytes, now: float, secondary: bool) -> Answer:
    if not servo.table.has("backup_ready"):
        return servo.answer(Error2.INSTRUCTION)
    if len(params) != len(STORE):
        return servo.answer(Error2.DATA_LENGTH)
    if params not in (STORE, RESTORE):
        return servo.answer(Error2.DATA_RANGE)
    if servo.shaft.torque or (params == RESTORE and servo.backup is None):
        return servo.answer(Error2.RESULT_FAIL)
    answer = servo.answer()
    if params == STORE:
        servo.backup = bytes(servo.memory.image)
        servo.memory.put("backup_ready", 1)
    elif servo.backup is not None:
        restore_eeprom(servo.memory, servo.backup)
        servo.reboot(now)
    return answer


_HANDLERS: dict[int, Callable[["EmulatedServo", bytes, float, bool], Answer]] = {
    Instruction.PING: _ping,
    Instruction.READ: _read,
    Instruction.WRITE: _write,
    Instruction.REG_WRITE: _reg_write,
    Instruction.ACTION: _action,
    Instruction.FACTORY_RESET: _factory_reset,
    Instruction.REBOOT: _reboot,
    Instruction.CLEAR: _clear,
    Instruction.CONTROL_TABLE_BACKUP: _backup,
}


TORQUE_BY_GOAL = 0x08  # bit of Drive Mode (10)
TORQUE_AT_START = 0x01  # bit of Startup Configuration (60)
VOLTAGE, HEAT, SHOCK, OVERLOAD = 0x01, 0x04, 0x10, 0x20  # bits of Hardware Error Status (70)
ERRORS = 0x3F  # of them, those that Shutdown (63) masks
_GOAL, _GOAL_END = 116, 120  # goal position


class EmulatedServo(ServoBody):
    """A `sim.emulator.device.Device` (and `Faulty`) with the table of a 2.0 model."""

    def __init__(self, table: ControlTable, model: ServoModel, build: ServoBuild) -> None:
        super().__init__(table, model, build)
        self.registered: tuple[int, bytes] | None = None
        """Address and data of a Reg Write that waits for its Action."""
        self._watchdog = BusWatchdog()
        self._encoder = Encoder(self.memory, self.shaft)
        self._live = Live(table, model, self.shaft, self.electrics)
        self._latched = 0  # Hardware Error Status
        self._alert = 0
        self._threshold = 0.0  # [tick/s] of moving
        self._lowest = self._highest = 0  # bounds of the goal position
        self._direct = False  # a goal position only has to become the target
        self._fill_ram()
        self.place(build.position)

    @property
    def tripped(self) -> bool:
        """Whether the bus watchdog has stopped it."""
        return self._watchdog.tripped

    @property
    def moving(self) -> bool:
        """Whether it turns faster than its moving threshold."""
        return abs(self.shaft.velocity) > self._threshold

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick); the goal register goes with it."""
        self._encoder.place(position)
        goal_to_present(self.memory, position)
        self.tune()

    def receive(self, now: float) -> None:
        """Note a valid instruction on the line: it feeds the bus watchdog."""
        watchdog = self._watchdog
        if watchdog.deadline != inf:
            if now > watchdog.deadline:
                self.catch_up(now)
            watchdog.feed(now)

    def execute(
        self, instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool = False
    ) -> Answer | None:
        """Carry out an instruction; None: no status follows."""
        if now < self._awake_at:
            return None
        self.catch_up(now)
        return carry_out(self, instruction, params, now, broadcast=broadcast, secondary=secondary)

    def read(self, address: int, length: int, now: float) -> Answer:
        """Return the bytes of a range, or the error for it."""
        self.catch_up(now)
        end = address + length
        if MOTION <= address < end <= MOTION_END:
            return Answer(self._alert, self._live.motion()[address - MOTION : end - MOTION])
        memory = self.memory
        if not memory.readable(address, length):
            return self.answer(Error2.ACCESS if length else Error2.DATA_LENGTH)
        if memory.touches(address, length, FIRST, END):
            self._live.show(memory.image, uptime=now - self.started, threshold=self._threshold)
        return Answer(self._alert, memory.slice(address, length))

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        """Carry out a write; a refused one is dropped."""
        if now < self._awake_at:
            return
        if address == _GOAL and self._direct and len(data) == 4:
            goal = int.from_bytes(data, "little", signed=True)
            if self._lowest <= goal <= self._highest:
                self.catch_up(now)
                if self._direct:  # nothing has happened on the way
                    self.memory.image[_GOAL:_GOAL_END] = data
                    self.shaft.target = goal
                    return
        self.change(address, data, now, ram_only=secondary)

    def change(self, address: int, data: bytes, now: float, *, ram_only: bool = False) -> Error2:
        """Write registers, all or none; return the error."""
        self.catch_up(now)
        parts = self.accepts(address, data, ram_only=ram_only)
        if isinstance(parts, Error2):
            return parts
        mode = self.memory.value("operating_mode")
        for register, value in parts:
            self.memory.store(register, value)
        self._react({part.register.name for part in parts}, mode, now)
        return Error2.NONE

    def accepts(self, address: int, data: bytes, *, ram_only: bool = False) -> list[Part] | Error2:
        """Return what a write would set, or why it is refused as a whole. Nothing changes."""
        if ram_only and address < self.table.eeprom_end:
            return Error2.ACCESS
        parts = self.memory.parts(address, data)
        if isinstance(parts, Error2):
            return parts
        condition = Condition(torque=self.shaft.torque, barred=self._barred, tripped=self.tripped)
        refused = (refusal(self.memory, part, condition) for part in parts)
        return next((error for error in refused if error), None) or parts

    def answer(self, error: int = 0, data: bytes = b"") -> Answer:
        """Return an answer with the alert bit as it stands."""
        return Answer(error | self._alert, data)

    def clear_turns(self, now: float) -> None:
        """Fold the position to one turn; what it holds goes along, so that nothing moves."""
        self._encoder.clear_turns()
        if self.shaft.law is Law.POSITION:
            self.shaft.path = None
            self.shaft.target = self.shaft.position if self.tripped else self.memory.value("goal_position")
        self.tune()

    def pass_events(self, now: float) -> None:
        """Let time pass up to `now`; the bus watchdog stops the servo on the way."""
        deadline = self._watchdog.deadline
        if now > deadline:
            super().pass_events(deadline)
            if self._watchdog.deadline == deadline:  # not switched off on the way
                self._trip()
        super().pass_events(now)
        self._eventless = min(self._eventless, self._watchdog.deadline)

    def tune(self) -> None:
        """Take every setting from the registers."""
        memory, shaft = self.memory, self.shaft
        super().tune()
        second = memory.value_or("secondary_id", 255)
        self.secondary_id = second if second <= 252 else None
        self._lowest, self._highest = goal_bounds(memory, "goal_position")
        self._threshold = memory.value("moving_threshold") * self._live.speed_unit
        tune_loop(shaft, memory, self.servo_model, self.electrics.supplied)
        shaft.load = -self.load_share if self._encoder.reversed else self.load_share
        shaft.refresh()
        self._direct = (
            shaft.law is Law.POSITION
            and shaft.torque
            and shaft.path is None
            and not memory.value("profile_velocity")
            and not self.tripped
        )

    def check(self) -> None:
        """Latch what is wrong with voltage, temperature and effort."""
        image, electrics = self.memory.image, self.electrics
        self._live.take()
        if self._awake_at == inf or self._starting:
            return
        tenths = self._live.tenths
        wrong = OVERLOAD if electrics.overloaded else 0
        if tenths > image[32] | image[33] << 8 or tenths < image[34] | image[35] << 8:
            wrong |= VOLTAGE
        if electrics.warmth > image[31]:
            wrong |= HEAT
        if wrong & ~self._latched:
            self._latch(wrong)

    def shock(self, now: float) -> None:
        """Latch an electrical shock."""
        self.catch_up(now)
        if self._awake_at < inf and not self._starting:
            self._latch(SHOCK)

    def overload(self, now: float) -> None:
        """Latch an overload, as at the end of what `Electrics` counts."""
        self.catch_up(now)
        if self._awake_at < inf and not self._starting:
            self._latch(OVERLOAD)

    def wake(self, now: float) -> None:
        """End a start: see what is wrong, and switch torque on where the startup configuration says so."""
        self.check()
        if self.memory.value_or("startup_configuration", 0) & TORQUE_AT_START:
            self._set_torque(True, now)

    @property
    def _barred(self) -> bool:
        """Whether a latched error keeps torque off."""
        return bool(self._latched and self._latched & self.memory.value("shutdown") & ERRORS)

    def _latch(self, bits: int) -> None:
        """Keep hardware errors until the next start; those that the shutdown mask names switch torque off."""
        self._latched |= bits
        self._alert = ALERT
        self.memory.put("hardware_error_status", self._latched)
        if self._barred:
            self._set_torque(False, self.shaft.time)

    def _trip(self) -> None:
        """Stop: the bus has been silent for too long."""
        self._watchdog.trip()
        self.memory.put("bus_watchdog", -1)
        self.memory.put("profile_acceleration", 0)
        self.memory.put("profile_velocity", 0)
        self.shaft.hold()
        self.tune()

    def _set_torque(self, on: bool, now: float) -> None:
        """Switch torque; on, it goes to whatever the goal registers hold."""
        on = on and not self._barred
        self.memory.put("torque_enable", int(on))
        shaft = self.shaft
        if on != shaft.torque:
            shaft.torque = on
            shaft.path = None
            self._watchdog.arm(self.memory.value_or("bus_watchdog", 0), now, torque=on)
            if on and self.memory.value("operating_mode") == POSITION:
                self._encoder.fold()
            shaft.refresh()
            if on:
                shaft.hold()
                self._aim(now, fresh=True)
        self.tune()

    def _react(self, names: set[str], mode_before: int, now: float) -> None:
        """Let what has been written take effect."""
        memory = self.memory
        if not names <= GOALS:
            mode = memory.value("operating_mode")
            if mode != mode_before:
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
            if memory.value_or("drive_mode", 0) & TORQUE_BY_GOAL and not self.shaft.torque:
                self._set_torque(True, now)
            self._aim(now)
            self.tune()

    def _aim(self, now: float, *, fresh: bool = False) -> None:
        """Go to what the goal registers hold, unless the bus watchdog has stopped it."""
        if self.shaft.torque and not self.tripped:
            aim(self.shaft, self.memory, tick=self.servo_model.tick_rad, now=now, fresh=fresh)

    def _reset(self) -> None:
        """RAM after a start; the position is counted within one turn again."""
        self._latched = self._alert = 0
        self._watchdog = BusWatchdog()
        self.registered = None
        self._fill_ram()
        self._encoder.follow_settings()
        self._encoder.fold()
        self.shaft.path = None
        self.shaft.speed = 0.0
        goal_to_present(self.memory, self.shaft.position)
        self.tune()

    def _fill_ram(self) -> None:
        """Set the RAM area to its values after a start."""
        self.defaults(self.table.eeprom_end, self.table.size)
        restore_ram(self.memory, self.backup)
        open_limits(self.memory)
