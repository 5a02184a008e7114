"""An emulated servo of protocol 1.0: MX-28/64 and AX-12A.

Source: e-Manual, protocol 1.0, MX-28, MX-64 and AX-12A. Its errors are not latched: they stand in every status as long
as the cause lasts (an overload: until torque or torque limit are written again). What Shutdown (18) names takes the
torque and sets Torque Limit (34) to 0. There is no bus watchdog. The D gain has no effect here.

A write that reaches Goal Position (30) or Moving Speed (32) switches torque on by itself. The e-Manual is silent on
that; it is public field knowledge (vanadiumlabs/arbotix_ros #9, Luos-io/Pyluos #59, poppy-docs #36), not verified on
hardware.
"""

from math import inf

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.packets import Error1, Error2, Instruction
from hardware.servo import ServoModel
from sim.emulator.body import ServoBody, ServoBuild
from sim.emulator.device import Answer
from sim.emulator.motion import Law
from sim.emulator.profile_path import path_by_velocity
from sim.emulator.registers import Part
from sim.emulator.settings1 import Mode1, goal_bounds1, live1, mode_of, shown_position, tune_loop1

_LEVEL: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}  # status return level from which it answers, else 2
_LIVE_FIRST, _LIVE_END = 36, 52
_MOVERS = frozenset(("goal_position", "moving_speed"))  # a write to them switches torque on


class EmulatedServo1(ServoBody):
    """A `sim.emulator.device.Device` (and `Faulty`) with the table of a 1.0 model.

    torque_by_goal: whether a goal position or moving speed switches torque on (field knowledge, not verified).
    """

    def __init__(
        self, table: ControlTable, model: ServoModel, build: ServoBuild, *, torque_by_goal: bool = True
    ) -> None:
        super().__init__(table, model, build)
        self.torque_by_goal = torque_by_goal
        self.registered: tuple[int, bytes] | None = None
        self._wrong = Error1(0)  # as every status says it
        self._overload = False
        self._reset()

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick); the goal register goes with it."""
        self.shaft.position = position
        self._goal_to_present()
        self.tune()

    def hear(self, now: float) -> None:
        """Nothing: these servos have no bus watchdog."""

    def execute(
        self, instruction: int, params: bytes, now: float, *, broadcast: bool, secondary: bool = False
    ) -> Answer | None:
        """Carry out an instruction; None: no status follows."""
        if now < self._awake_at or secondary or (broadcast and instruction == Instruction.READ):
            return None
        self.catch_up(now)
        answer = self._carry_out(instruction, params, now)
        if broadcast and instruction != Instruction.PING:
            return None
        return answer if self.memory.value("status_return_level") >= _LEVEL.get(instruction, 2) else None

    def read(self, address: int, length: int, now: float) -> Answer:
        """Return the bytes of a range, or a range error."""
        self.catch_up(now)
        if not self.memory.readable(address, length):
            return self._answer(Error1.RANGE)
        if self.memory.touches(address, length, _LIVE_FIRST, _LIVE_END):
            live1(self.memory, self.shaft, self.electrics, self.servo_model, uptime=now - self.started)
        return self._answer(Error1(0), self.memory.slice(address, length))

    def write(self, address: int, data: bytes, now: float, *, secondary: bool = False) -> None:
        """Take a write; what is refused is lost."""
        if now >= self._awake_at and not secondary:
            self.catch_up(now)
            self._change(address, data, now)

    def tune(self) -> None:
        """Take every setting from the registers."""
        super().tune()
        tune_loop1(self.shaft, self.memory, self.servo_model, self.electrics.supplied)
        self.shaft.load = self.load_share
        self.shaft.refresh()

    def check(self) -> None:
        """See what is wrong with voltage, temperature and effort; what Shutdown names takes the torque."""
        if self._awake_at == inf or self._starting:
            return
        memory, electrics = self.memory, self.electrics
        tenths = round(10.0 * electrics.voltage)
        self._overload = self._overload or electrics.overloaded
        wrong = Error1.OVERLOAD if self._overload else Error1(0)
        if not memory.value("min_voltage_limit") <= tenths <= memory.value("max_voltage_limit"):
            wrong |= Error1.INPUT_VOLTAGE
        if electrics.warmth > memory.value("temperature_limit"):
            wrong |= Error1.OVERHEATING
        self._wrong = wrong
        if wrong & memory.value("shutdown") and self.shaft.torque:
            self.memory.put("torque_limit", 0)
            self._set_torque(False)

    def shock(self, now: float) -> None:
        """Nothing: protocol 1.0 has no such error."""

    def _carry_out(self, instruction: int, params: bytes, now: float) -> Answer:
        """Carry out an instruction for this servo."""
        if instruction == Instruction.PING:
            return self._answer()
        if instruction == Instruction.READ and len(params) == 2:
            return self.read(params[0], params[1], now)
        if instruction == Instruction.WRITE and len(params) >= 2:
            return self._answer(self._change(params[0], params[1:], now))
        if instruction == Instruction.REG_WRITE and len(params) >= 2:
            return self._answer(self._register(params[0], params[1:]))
        if instruction == Instruction.ACTION and self.registered is not None:
            address, data = self.registered
            self.registered = None
            self.memory.put("registered", 0)
            return self._answer(self._change(address, data, now))
        if instruction == Instruction.FACTORY_RESET:
            answer = self._answer()
            self.defaults(0, self.table.eeprom_end)
            self.reboot(now)
            return answer
        return self._answer(Error1.INSTRUCTION)

    def _register(self, address: int, data: bytes) -> Error1:
        """Keep a write for the Action that follows."""
        parts = self._accepts(address, data)
        if isinstance(parts, Error1):
            return parts
        self.registered = (address, data)
        self.memory.put("registered", 1)
        return Error1(0)

    def _change(self, address: int, data: bytes, now: float) -> Error1:
        """Write registers, all or none; return why not."""
        parts = self._accepts(address, data)
        if isinstance(parts, Error1):
            return parts
        mode = mode_of(self.memory)
        for register, value in parts:
            self.memory.store(register, value)
        names = {part.register.name for part in parts}
        if {"torque_enable", "torque_limit"} & names:
            self._overload = False
            self.check()
        if mode_of(self.memory) is not mode or {"cw_angle_limit", "ccw_angle_limit"} & names:
            self._bound_goal()
        self.tune()
        if "torque_enable" in names:
            self._set_torque(bool(self.memory.value("torque_enable")))
        if self.torque_by_goal and not self.shaft.torque and names & _MOVERS:
            self._set_torque(True)
        self._aim(now)
        return Error1(0)

    def _accepts(self, address: int, data: bytes) -> list[Part] | Error1:
        """Return what a write would set, or why it is refused as a whole. Nothing changes."""
        parts = self.memory.parts(address, data)
        if isinstance(parts, Error2):
            return Error1.RANGE
        locked = self.memory.value("lock") != 0
        for register, value in parts:
            if not register.writable or not register.allows(value):
                return Error1.RANGE
            if locked and (register.address < self.table.eeprom_end or (register.name == "lock" and not value)):
                return Error1.RANGE
            if register.name == "goal_position":
                low, high = goal_bounds1(self.memory)
                if not low <= value <= high:
                    return Error1.ANGLE_LIMIT
        return parts

    def _set_torque(self, on: bool) -> None:
        """Switch torque; on, it goes to whatever the goal registers hold."""
        on = on and not self._wrong & self.memory.value("shutdown")
        self.memory.put("torque_enable", int(on))
        if on != self.shaft.torque:
            self.shaft.torque = on
            self.shaft.path = None
            self.shaft.refresh()
            self.shaft.hold()

    def _aim(self, now: float) -> None:
        """Go to what the goal registers hold."""
        shaft, memory = self.shaft, self.memory
        if not shaft.torque:
            return
        unit = (self.table["moving_speed"].scale or 0.0) / self.servo_model.tick_rad  # [tick/s]
        asked = memory.value("moving_speed") * unit
        tick_rate = self.table["goal_acceleration"].scale if self.table.has("goal_acceleration") else 0.0
        rate = memory.value_or("goal_acceleration", 0) * (tick_rate or 0.0) / self.servo_model.tick_rad
        if shaft.law is not Law.POSITION:
            torque = memory.value_or("goal_torque", 0) * 4.5e-3
            shaft.speed = torque if shaft.law is Law.CURRENT else asked
            shaft.ramp = rate or inf
        else:
            goal = shown_position(memory, memory.value("goal_position"), back=True)
            if shaft.path is None or shaft.path.goal != goal:
                place, speed = shaft.trajectory() if shaft.path is not None else (shaft.position, shaft.velocity)
                top = min(abs(asked) or shaft.full, shaft.full)
                shaft.path = None
                if (asked or rate) and top > 0.0:
                    shaft.path = path_by_velocity(
                        goal, position=place, velocity=speed, top=top, acceleration=rate, now=now
                    )
            shaft.target = goal
        shaft.refresh()

    def _answer(self, error: Error1 = Error1(0), data: bytes = b"") -> Answer:  # noqa: B008
        return Answer(int(error | self._wrong), data)

    def _bound_goal(self) -> None:
        """Pull the goal register inside limits that have moved."""
        low, high = goal_bounds1(self.memory)
        self.memory.put("goal_position", max(min(self.memory.value("goal_position"), high), low))

    def _goal_to_present(self) -> None:
        """Let the goal register show where the servo is, within its limits."""
        low, high = goal_bounds1(self.memory)
        shown = round(shown_position(self.memory, self.shaft.position))
        self.memory.put("goal_position", max(min(shown, high), low))

    def _reset(self) -> None:
        """RAM after a start; the position is counted within one turn again where the model has a whole turn."""
        super()._reset()
        self._overload = False
        self._wrong = Error1(0)
        self.registered = None
        self.memory.put("torque_limit", self.memory.value("max_torque"))
        if self._starting and mode_of(self.memory) is not Mode1.JOINT:
            self.shaft.position %= self.servo_model.ticks
        self.shaft.path = None
        self.shaft.speed = 0.0
        self._goal_to_present()
        self.tune()
