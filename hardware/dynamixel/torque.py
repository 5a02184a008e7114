"""Torque of all servos of one bus: on by a ramp, after everything it needs was written; off at once, and confirmed."""

from collections.abc import Sequence

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.register import Register
from hardware.dynamixel.settings import Setting, full_drive
from hardware.errors import BusError, describe

RAMP_TIME = 0.5
"""[s] From the first drive to the full one."""
RAMP_STEP = 0.02
"""[s] Between two steps of the ramp."""
FIRST_DRIVE = 0.1
"""Share of the full drive with which torque comes on."""
GOAL_SLACK = 40
"""Ticks that a limp joint may have moved since its goal was set where it was."""


def limp(line: BusLine) -> list[int]:
    """Servos of the bus without torque. Raises BusError with those that do not say."""
    found = _read(line, "torque_enable", list(line.servos))
    return [device for device in line.servos if not found[device]]


def arm_watchdogs(line: BusLine) -> None:
    """Clear and set the bus watchdog of every servo that has one, and read it back. Raises BusError."""
    ids = _watched(line)
    if not ids:
        return
    register = line.images[ids[0]].table["bus_watchdog"]
    for value in (0, line.spec.watchdog_value):
        _write_and_read(line, [(device, Setting(register, value)) for device in ids], "bus watchdog")


def check_still(line: BusLine, goals: dict[int, int]) -> None:
    """See that every servo is there, and still where its goal (by id, ticks) is. Raises BusError."""
    present = _read(line, "present_position", list(goals))
    far = [device for device in goals if abs(present[device] - goals[device]) > GOAL_SLACK]
    if far:
        raise BusError(
            describe(
                what="servos moved since their goals were set where they were",
                where=_where(line),
                found=", ".join(f"{_name(line, one)} from {goals[one]} to {present[one]}" for one in far),
                allowed=f"{GOAL_SLACK} ticks",
                then="Torque was not switched on. Keep the robot still and try again",
            )
        )


def confirm_goals(line: BusLine, goals: dict[int, int]) -> None:
    """See that every goal register holds the goal (by id, ticks) that was sent.

    Nobody confirms a goal, and torque moves a servo to what is in its register. Raises BusError.
    """
    register = _register(line, "goal_position")
    _write_and_read(line, [(device, Setting(register, goals[device])) for device in goals], "goal position")


def drive(line: BusLine, ids: Sequence[int], share: float) -> None:
    """Limit the drive of servos to a share of the full one; nobody confirms."""
    by_register: dict[str, list[tuple[int, Setting]]] = {}
    for device in ids:
        full = full_drive(line.servos[device], line.images[device])
        by_register.setdefault(full.register.name, []).append((device, full))
    for settings in by_register.values():
        line.write_all(
            settings[0][1].register, [(device, max(round(share * full.value), 1)) for device, full in settings]
        )


def confirm_drive(line: BusLine, ids: Sequence[int], share: float) -> None:
    """See that the drive is limited so. Raises BusError."""
    by_register: dict[str, list[tuple[int, Setting]]] = {}
    for device in ids:
        full = full_drive(line.servos[device], line.images[device])
        setting = Setting(full.register, max(round(share * full.value), 1))
        by_register.setdefault(full.register.name, []).append((device, setting))
    for name, settings in by_register.items():
        _write_and_read(line, settings, name.replace("_", " "))


def enable(line: BusLine, ids: Sequence[int]) -> None:
    """Switch torque on and see that it is. Raises BusError with those that refuse, and why."""
    register = _register(line, "torque_enable")
    line.write_all(register, [(device, 1) for device in ids])
    said = line.read_all(register, ids)
    off = [device for device in ids if said.get(device) != 1]
    if off:  # once more: the packet may have been lost
        line.write_all(register, [(device, 1) for device in off])
        said |= line.read_all(register, off)
        off = [device for device in ids if said.get(device) != 1]
    if off:
        raise BusError(
            describe(
                what="servos do not switch their torque on",
                where=_where(line),
                found=", ".join(_why_off(line, device, said) for device in off),
                then="See `retarget servo monitor`; a latched error is cleared by `retarget servo reboot`",
            )
        )


def disable(line: BusLine) -> list[str]:
    """Switch all torque off; names of the servos that did not confirm it. Raises BusError when the port is gone."""
    register = _register(line, "torque_enable")
    left = list(line.servos)
    for _ in range(2):
        line.write_all(register, [(device, 0) for device in left])
        said = line.read_all(register, left)
        left = [device for device in left if said.get(device) != 0]
        if not left:
            break
    watched = _watched(line)
    if watched:
        line.write_all(line.images[watched[0]].table["bus_watchdog"], [(device, 0) for device in watched])
    return [_name(line, device) for device in left]


def _watched(line: BusLine) -> list[int]:
    """Servos with a bus watchdog: protocol 2.0, firmware 38 and later."""
    return [device for device, image in line.images.items() if image.table.has("bus_watchdog")]


def _why_off(line: BusLine, device: int, said: dict[int, int]) -> str:
    if device not in said:
        return f"{_name(line, device)} does not answer"
    if line.spec.protocol == 1:
        return f"{_name(line, device)} stays off"
    register = _register(line, "hardware_error_status")
    bits = line.read_all(register, [device]).get(device, 0)
    return f"{_name(line, device)} " + (f"has latched {alert_text(bits)}" if bits else "stays off")


def _write_and_read(line: BusLine, wanted: Sequence[tuple[int, Setting]], what: str) -> None:
    """Write, read back, and once more what was lost. Raises BusError with what is still wrong."""
    left = list(wanted)
    kept: dict[int, int] = {}
    for _ in range(2):
        line.write_all(left[0][1].register, [(device, setting.value) for device, setting in left])
        kept = line.read_all(left[0][1].register, [device for device, _ in left])
        left = [(device, setting) for device, setting in left if kept.get(device) != setting.value]
        if not left:
            return
    found = ", ".join(f"{_name(line, device)} {kept.get(device, 'silent')}" for device, _ in left)
    allowed = ", ".join(str(value) for value in sorted({setting.value for _, setting in left}))
    raise BusError(describe(what=f"servos do not keep their {what}", where=_where(line), found=found, allowed=allowed))


def _read(line: BusLine, name: str, ids: list[int]) -> dict[int, int]:
    found = line.read_all(_register(line, name), ids)
    silent = [_name(line, device) for device in ids if device not in found]
    if silent:
        raise BusError(
            describe(what=f"no answer from {', '.join(silent)}", where=_where(line), then="Check power and wiring")
        )
    return found


def _register(line: BusLine, name: str) -> Register:
    """The servos of one bus keep these in one place."""
    return next(iter(line.images.values())).table[name]


def _name(line: BusLine, device: int) -> str:
    return f"{line.servos[device].joint} (id {device})"


def _where(line: BusLine) -> str:
    return f"bus {line.spec.name}"
