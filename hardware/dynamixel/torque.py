"""Torque of all servos of a bus: who has it, where their goals are, on and off, all of it confirmed."""

import math
from collections.abc import Sequence

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.confirm import TRIES, not_kept, read_everybody, register_of, write_and_read
from hardware.dynamixel.settings import WAKING, Setting
from hardware.errors import BusError, describe

GOAL_SLACK = 0.06
"""[rad] of the shaft that a limp joint may have moved since its goal was set where it was."""


def limp(line: BusLine) -> list[int]:
    """Servos of the bus without torque. Raises BusError with those that do not say."""
    found = read_everybody(line, "torque_enable", list(line.servos))
    return [device for device in line.servos if not found[device]]


def arm_watchdogs(line: BusLine) -> None:
    """Clear and set the bus watchdog of every servo that has one, and read it back. Raises BusError."""
    ids = _watched(line)
    if not ids:
        return
    register = line.images[ids[0]].table["bus_watchdog"]
    for value in (0, line.spec.watchdog_value):
        write_and_read(line, [(device, Setting(register, value)) for device in ids])


def feed_watchdogs(lines: Sequence[BusLine]) -> None:
    """Say something on every bus, to which nobody answers: while one is busy, the others must not seem dead.

    Raises BusError when a port is gone.
    """
    for line in lines:
        watched = _watched(line)
        if watched:
            register = line.images[watched[0]].table["bus_watchdog"]
            line.write_all(register, [(device, line.spec.watchdog_value) for device in watched])


def check_still(line: BusLine, goals: dict[int, int]) -> None:
    """See that every servo is there, and still where its goal (by id, ticks) is. Raises BusError."""
    _refuse_moved(line, read_everybody(line, "present_position", list(goals)), goals)


def confirm_goals(line: BusLine, goals: dict[int, int]) -> None:
    """Send goals (by id, ticks), and see that every register holds its own and every servo is still there.

    Nobody confirms a goal, and torque moves a servo to what is in its register. Goal and position are read in one
    piece: no late answer to another question can be taken for it. Raises BusError.
    """
    goal, present = (register_of(line, name) for name in ("goal_position", "present_position"))
    left, kept = list(goals), dict[int, bytes]()
    for _ in range(TRIES):
        line.write_all(goal, [(device, goals[device]) for device in left])
        kept |= line.read_span(goal.address, present.end - goal.address, left)
        left = [one for one in goals if one not in kept or goal.decode(kept[one][: goal.size]) != goals[one]]
        if not left:
            break
    if left:
        held = {one: goal.decode(kept[one][: goal.size]) for one in left if one in kept}
        raise not_kept(line, [(one, held.get(one), Setting(goal, goals[one])) for one in left])
    _refuse_moved(line, {one: present.decode(kept[one][-present.size :]) for one in goals}, goals)


def wake(line: BusLine, ids: Sequence[int]) -> None:
    """Write what switches torque on by itself (protocol 1.0), now that it may come. Raises BusError."""
    for name, value in WAKING.items():
        held = [device for device in ids if line.images[device].table.has(name) and line.spec.protocol == 1]
        if held:
            register = register_of(line, name)
            write_and_read(line, [(device, Setting(register, value)) for device in held])


def enable(line: BusLine, ids: Sequence[int]) -> None:
    """Switch torque on and see that it is. Raises BusError with those that refuse, and why."""
    register = register_of(line, "torque_enable")
    said: dict[int, int] = {}
    off = list(ids)
    for _ in range(TRIES):  # a packet may be lost
        line.write_all(register, [(device, 1) for device in off])
        said |= line.read_all(register, off)
        off = [device for device in ids if said.get(device) != 1]
        if not off:
            return
    raise BusError(
        describe(
            what="servos do not switch their torque on",
            where=line.where,
            found=", ".join(_why_off(line, device, said) for device in off),
            then="See `retarget servo monitor`; a latched error is cleared by `retarget servo reboot`",
        )
    )


def off_everywhere(lines: Sequence[BusLine]) -> list[str]:
    """Switch all torque of all buses off: everybody is told before anybody is asked.

    Returns what did not confirm it, a text each. An interrupt does not keep it from the buses that are left, and is
    raised at the end.
    """
    unsure: list[str] = []
    interrupt: BaseException | None = None
    told = [line for line in lines if line.images]
    unsure += [f"all of {line.where}" for line in lines if not line.images]
    for act in (_tell_off, _tell_off, _confirm_off):
        for line in list(told):
            try:
                unsure += act(line)
            except BusError as error:
                unsure.append(f"all of {line.where} ({error})")
                told.remove(line)
            except BaseException as error:  # noqa: BLE001 - the robot's torque comes first
                interrupt = error
    if interrupt is not None:
        raise interrupt
    return unsure


def _tell_off(line: BusLine) -> list[str]:
    line.write_all(register_of(line, "torque_enable"), [(device, 0) for device in line.images])
    return []


def _confirm_off(line: BusLine) -> list[str]:
    """Ask everybody, tell again who has not heard; and free the watchdogs of those that are off."""
    register = register_of(line, "torque_enable")
    said = line.read_all(register, list(line.images))
    left = [device for device in line.images if said.get(device) != 0]
    if left:
        line.write_all(register, [(device, 0) for device in left])
        said |= line.read_all(register, left)
        left = [device for device in left if said.get(device) != 0]
    watched = [device for device in _watched(line) if device not in left]
    if watched:
        line.write_all(line.images[watched[0]].table["bus_watchdog"], [(device, 0) for device in watched])
    return [line.name_of(device) for device in left]


def _refuse_moved(line: BusLine, present: dict[int, int], goals: dict[int, int]) -> None:
    """Raise BusError for servos that are not where their goals are."""
    slack = {device: GOAL_SLACK / line.servos[device].model.tick_rad for device in goals}
    far = [device for device in goals if abs(present[device] - goals[device]) > slack[device]]
    if far:
        raise BusError(
            describe(
                what="servos moved since their goals were set where they were",
                where=line.where,
                found=", ".join(f"{line.name_of(one)} from {goals[one]} to {present[one]}" for one in far),
                allowed=f"{math.degrees(GOAL_SLACK):.1f} degrees",
                then="Torque was not switched on. Keep the robot still and try again",
            )
        )


def _watched(line: BusLine) -> list[int]:
    """Servos with a bus watchdog: protocol 2.0, firmware 38 and later."""
    return [device for device, image in line.images.items() if image.table.has("bus_watchdog")]


def _why_off(line: BusLine, device: int, said: dict[int, int]) -> str:
    name = line.name_of(device)
    if device not in said:
        return f"{name} does not answer"
    if line.spec.protocol == 1:
        return f"{name} stays off"
    bits = line.read_all(register_of(line, "hardware_error_status"), [device]).get(device, 0)
    return f"{name} " + (f"has latched {alert_text(bits)}" if bits else "stays off")
