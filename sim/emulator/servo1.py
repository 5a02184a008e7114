"""An emulated servo of the older layout: MX-28/64 and AX-12A with protocol 1.0, XL-320 with 2.0.

Source: e-Manual, both protocols, MX-28, MX-64, AX-12A and XL-320. Errors are not latched: they last as long as their
cause, an overload until torque or torque limit are written again. Protocol 1.0 sends them in every status, 2.0 the
alert bit. The e-Manual does not say whether an XL-320 latches them. Errors in Shutdown (18) switch torque off and set
Torque Limit to 0. There is no bus watchdog. The D gain has no effect here.

A write that reaches Goal Position (30) or Moving Speed (32) switches torque on. The e-Manual does not mention that; it
is public field knowledge of protocol 1.0 (vanadiumlabs/arbotix_ros #9, Luos-io/Pyluos #59, poppy-docs #36), not
verified on hardware, and assumed for the XL-320.
"""

from enum import Enum, auto
from math import inf
from typing import NamedTuple

from hardware.dynamixel.codec import ALERT, Error1, Error2, Instruction
from hardware.dynamixel.control_table import ControlTable
from hardware.servo import DEFAULT_P_GAIN, ServoModel, lag_of_gain
from sim.emulator.device import Answer
from sim.emulator.memory import Memory, RegisterWrite
from sim.emulator.servo2_registers import RESETS, factory_reset
from sim.emulator.servo_body import OVERLOAD_BIT, ServoBody, ServoBuild
from sim.emulator.shaft import Law, Shaft, path_by_velocity
from sim.servo_model import IDLE_CURRENT, LARGEST_CURRENT

FULL_TORQUE = 1023.0
"""Torque Limit (34) and Max Torque (14) that do not limit: 100 % (e-Manual)."""
DEFAULT_SLOPE = 32  # compliance slope of an AX-12A, and P gain of an MX
MOVING_SHARE = 0.01  # share of the top speed below which Moving (46) is 0
TORQUE_AMPERES = 4.5e-3  # [A] of a count of Goal Torque (71)


class Mode1(Enum):
    """Modes of a servo, by its angle limits (e-Manual, 6 and 8) or Control Mode (XL-320, 11)."""

    JOINT = auto()
    WHEEL = auto()
    MULTI_TURN = auto()


WHEEL_MODE = 1
"""Control Mode of an XL-320 that turns without end."""


def mode_of(memory: Memory) -> Mode1:
    """The mode that the registers define."""
    if memory.table.has("control_mode"):
        return Mode1.WHEEL if memory.value("control_mode") == WHEEL_MODE else Mode1.JOINT
    limits = memory.value("cw_angle_limit"), memory.value("ccw_angle_limit")
    if limits == (0, 0):
        return Mode1.WHEEL
    turns = memory.table.has("multi_turn_offset")
    return Mode1.MULTI_TURN if turns and limits == (4095, 4095) else Mode1.JOINT


def goal_bounds1(memory: Memory) -> tuple[int, int]:
    """The lowest and highest goal position that is accepted."""
    mode = mode_of(memory)
    if mode is Mode1.JOINT:
        return memory.value("cw_angle_limit"), memory.value("ccw_angle_limit")
    register = memory.table["goal_position"]
    return register.lowest or 0, register.highest or 0


def shown_position(memory: Memory, position: float, *, back: bool = False) -> float:
    """The register value of a shaft `position` (tick); back: the shaft position of a register value.

    Offset and divider count only in multi-turn mode (e-Manual, 20 and 22).
    """
    if mode_of(memory) is not Mode1.MULTI_TURN:
        return position
    offset, divider = memory.value("multi_turn_offset"), max(memory.value("resolution_divider"), 1)
    return (position - offset) * divider if back else position / divider + offset


def tune_loop1(shaft: Shaft, memory: Memory, model: ServoModel, supplied: float) -> None:
    """Set law, gains and limits of `shaft`; supplied: supply as a share of the nominal voltage.

    The default gain, or compliance slope, gives the loop that the mock bus has.
    """
    wheel = mode_of(memory) is Mode1.WHEEL
    shaft.law = Law.VELOCITY if wheel else Law.POSITION
    if memory.value_or("torque_ctrl_mode_enable", 0):
        shaft.law = Law.CURRENT
    shaft.full = model.no_load_speed / model.tick_rad * supplied
    shaft.drive_limit = memory.value("torque_limit") / FULL_TORQUE
    shaft.lag, shaft.integral = inf, 0.0
    gain = memory.value("p_gain") if memory.table.has("p_gain") else 0
    slope = memory.value_or("cw_compliance_slope", 0)
    softness = DEFAULT_SLOPE / gain if gain else max(slope, 1) / DEFAULT_SLOPE
    if supplied > 0.0 and (gain or not memory.table.has("p_gain")):
        shaft.lag = lag_of_gain(model, DEFAULT_P_GAIN) * softness / supplied
        shaft.integral = memory.value("i_gain") * 1000.0 / 2048.0 / (gain / 8.0) if gain else 0.0


class Refusals(NamedTuple):
    """Error numbers of a protocol: wrong parameters, an unknown instruction, a count out of range, a goal beyond the
    limits, a write to a locked register."""

    malformed: int
    unknown: int
    range: int
    limit: int
    locked: int


REFUSALS = {
    1: Refusals(Error1.INSTRUCTION, Error1.INSTRUCTION, Error1.RANGE, Error1.ANGLE_LIMIT, Error1.RANGE),
    2: Refusals(Error2.DATA_LENGTH, Error2.INSTRUCTION, Error2.DATA_RANGE, Error2.DATA_LIMIT, Error2.ACCESS),
}
"""By protocol (e-Manual, errors of a status packet)."""


class EmulatedServo1(ServoBody):
    """A servo with a table of the older layout, in the protocol of the table."""

    shown = 36, 52

    def __init__(self, table: ControlTable, model: ServoModel, build: ServoBuild) -> None:
        super().__init__(table, model, build)
        self._refusals = REFUSALS[table.protocol]
        self.malformed, self.unknown = self._refusals.malformed, self._refusals.unknown
        self._wrong = 0  # errors, bits of `servo_body`
        self._overload = False
        self._reset()

    def place(self, position: float) -> None:
        """Put the shaft where the present position reads `position` (tick); the goal register goes with it."""
        self.shaft.position = position
        self._set_goal(round(shown_position(self.memory, position)))
        self.tune()

    def answer(self, error: int = 0, data: bytes = b"") -> Answer:
        """An answer with the present errors; with protocol 2.0 with the alert bit only."""
        standing = self._wrong if self.protocol == 1 else ALERT * bool(self._wrong)
        return Answer(error | standing, data)

    def error_of(self, error: Error2) -> int:
        """An error of the memory; protocol 1.0 has one for every bad range."""
        return Error1.RANGE if self.protocol == 1 else error

    def live(self, now: float) -> dict[str, float]:
        """The values of the registers that show its state at `now` (s)."""
        shaft, electrics, tick = self.shaft, self.electrics, self.servo_model.tick_rad
        load = min(max(electrics.current - IDLE_CURRENT, 0.0) / LARGEST_CURRENT, 1.0)
        return {
            "present_position": shown_position(self.memory, shaft.position),
            "present_speed": shaft.velocity / ((self.table["present_speed"].scale or 1.0) / tick),
            "present_load": electrics.direction * FULL_TORQUE * load,
            "present_voltage": 10.0 * electrics.voltage,
            "present_temperature": electrics.warmth,
            "moving": abs(shaft.velocity) > MOVING_SHARE * shaft.full,
            "realtime_tick": self.realtime_tick(now),
        }

    def tune(self) -> None:
        """Apply every setting in the registers."""
        super().tune()
        tune_loop1(self.shaft, self.memory, self.servo_model, self.electrics.supplied)
        self.shaft.refresh()

    @property
    def barred(self) -> bool:
        """True if an error in Shutdown keeps torque off."""
        bits = self._wrong
        if self.table.has("hardware_error_status"):  # its bits are those of Shutdown
            bits = int.from_bytes(self.table["hardware_error_status"].encode(bits), "little")
        return bool(bits & self.memory.value("shutdown"))

    def note(self, wrong: int) -> None:
        """Keep errors as long as their cause lasts; those in Shutdown switch torque off."""
        self._overload = self._overload or bool(wrong & OVERLOAD_BIT)
        self._show_errors(wrong | (OVERLOAD_BIT if self._overload else 0))
        if self.barred and self.shaft.torque:
            self.memory.put("torque_limit", 0)
            self._set_torque(False)

    def _show_errors(self, wrong: int) -> None:
        self._wrong = wrong
        self.memory.put("hardware_error_status", wrong)

    def special(self, instruction: int, params: bytes, now: float) -> Answer:
        """Carry out a factory reset, or a restart (2.0)."""
        answer = self.answer()
        if instruction == Instruction.FACTORY_RESET and self.protocol == 1:
            self.defaults(0, self.table.eeprom_end)
        elif instruction == Instruction.FACTORY_RESET and params in RESETS:
            factory_reset(self.memory, params[0])
        elif instruction == Instruction.FACTORY_RESET:
            return self.answer(self._refusals.range if len(params) == 1 else self.malformed)
        elif instruction != Instruction.REBOOT or self.protocol == 1:
            return self.answer(self.unknown)
        self.reboot(now)
        return answer

    def refusal(self, part: RegisterWrite) -> int:
        """The error by which a register refuses a value, 0 if it is accepted."""
        register, value = part
        locked = self.shaft.torque if self.protocol == 2 else self.memory.value("lock") != 0
        if locked and (register.address < self.table.eeprom_end or (register.name == "lock" and not value)):
            return self._refusals.locked
        if not register.allows(value):
            return self._refusals.range
        low, high = goal_bounds1(self.memory) if register.name == "goal_position" else (value, value)
        return 0 if low <= value <= high else self._refusals.limit

    def react(self, names: set[str], now: float) -> None:
        """Apply the written registers `names`. A goal position or moving speed switches torque on (field knowledge)."""
        if {"torque_enable", "torque_limit"} & names:
            self._overload = False
            self.check()
        if {"cw_angle_limit", "ccw_angle_limit", "control_mode"} & names:
            self._set_goal(self.memory.value("goal_position"))
        self.tune()
        if "torque_enable" in names:
            self._set_torque(bool(self.memory.value("torque_enable")))
        if not self.shaft.torque and names & {"goal_position", "moving_speed"}:
            self._set_torque(True)
        if self.shaft.torque:
            self._aim(now)

    def _set_torque(self, on: bool) -> None:
        if self.switch(on):
            self.shaft.refresh()
            if self.shaft.torque:
                self.shaft.hold()

    def _aim(self, now: float) -> None:
        shaft, memory = self.shaft, self.memory
        unit = (self.table["moving_speed"].scale or 0.0) / self.servo_model.tick_rad  # [tick/s]
        moving_speed = memory.value("moving_speed") * unit
        has_rate = self.table.has("goal_acceleration")
        rate = memory.scaled("goal_acceleration") / self.servo_model.tick_rad if has_rate else 0.0
        if shaft.law is not Law.POSITION:
            current = memory.value_or("goal_torque", 0) * TORQUE_AMPERES
            shaft.speed = current if shaft.law is Law.CURRENT else moving_speed
            shaft.ramp = rate or inf
        else:
            goal = shown_position(memory, memory.value("goal_position"), back=True)
            if shaft.path is None or shaft.path.goal != goal:
                place, speed = shaft.trajectory() if shaft.path is not None else (shaft.position, shaft.velocity)
                top = min(abs(moving_speed) or shaft.full, shaft.full)
                shaft.path = None
                if (moving_speed or rate) and top > 0.0:
                    shaft.path = path_by_velocity(
                        goal, position=place, velocity=speed, top=top, acceleration=rate, now=now
                    )
            shaft.target = goal
        shaft.refresh()

    def _set_goal(self, count: int) -> None:
        low, high = goal_bounds1(self.memory)
        self.memory.put("goal_position", max(min(count, high), low))

    def _reset(self) -> None:
        """Bring RAM to its state after a start; a model with a whole turn counts within one turn again."""
        super()._reset()
        self._overload = False
        self._show_errors(0)
        self.memory.put("torque_limit", self.memory.value("max_torque"))
        if self._starting and mode_of(self.memory) is not Mode1.JOINT:
            self.shaft.position %= self.servo_model.ticks
        self._set_goal(round(shown_position(self.memory, self.shaft.position)))
        self.tune()
