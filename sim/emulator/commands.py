"""Instructions of protocol 2.0 for one servo, but group reads and writes: parameters in, answer out.

Source: e-Manual, protocol 2.0.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hardware.dynamixel.packets import Error2, Instruction
from sim.emulator.device import Answer
from sim.emulator.keeping import ALL, factory_reset, restore_eeprom

if TYPE_CHECKING:
    from sim.emulator.servo import EmulatedServo

CLEAR_TURNS = bytes((0x01, 0x44, 0x58, 0x4C, 0x22))
STORE = bytes((0x01, 0x43, 0x54, 0x52, 0x4C))
RESTORE = bytes((0x02, 0x43, 0x54, 0x52, 0x4C))
_DEAF_TO_ALL = 42  # first firmware that ignores a factory reset of everything that is broadcast
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
    if broadcast and everything and servo.memory.value("firmware_version") >= _DEAF_TO_ALL:
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
    answer = servo.answer()  # the alert of a latched error is still said
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
