"""Torque of all servos of a robot: registers are provisioned, torque rises slowly, and goes off confirmed; restarts."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hardware.arrays import BoolArray
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.control_table import Register
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.settings import (
    WAKING,
    differing,
    eeprom_settings,
    full_drive,
    ram_settings,
    read_image,
)
from hardware.dynamixel.single_requests import NoAnswer, ServoError
from hardware.errors import BusError, HardwareError
from hardware.servo import ServoSpec

CHECK_WIRING = "Check power and wiring, or whether the host is too busy"
CONFIRM_TRIES = 2  # a lost answer is no refusal


def register_of(line: BusLine, name: str) -> Register:
    """A register that all servos of a bus have in one place."""
    return next(iter(line.images.values())).table[name]


def read_from_all(line: BusLine, name: str, ids: Sequence[int]) -> dict[int, int]:
    """The counts of a register by id. Raises BusError naming those that do not answer."""
    found = line.read_all(register_of(line, name), ids)
    silent = [line.name_of(device) for device in ids if device not in found]
    if silent:
        raise BusError(f"no answer from {', '.join(silent)}", where=line.where, then=CHECK_WIRING)
    return found


def written(line: BusLine, register: Register, values: Mapping[int, int]) -> dict[int, int | None]:
    """Write counts by id to one register, read them back, and repeat lost ones. Return wrong counts by id, None without
    an answer."""
    left, kept = dict(values), dict[int, int]()
    for _ in range(CONFIRM_TRIES):
        if left:
            line.write_all(register, left.items())
            kept = line.read_all(register, list(left))
            left = {device: value for device, value in left.items() if kept.get(device) != value}
    return {device: kept.get(device) for device in left}


def write_and_read(line: BusLine, register: Register, values: Mapping[int, int]) -> None:
    """Write counts by id to one register and confirm them. Raises BusError."""
    wrong = written(line, register, values)
    if wrong:
        raise not_kept(line, register, values, wrong)


def not_kept(line: BusLine, register: Register, values: Mapping[int, int], wrong: Mapping[int, int | None]) -> BusError:
    """The error for unkept values."""
    found = ", ".join(
        f"{line.name_of(one)} " + ("silent" if kept is None else f"{kept} instead of {values[one]}")
        for one, kept in wrong.items()
    )
    then = (
        "Try again; where it stays, `retarget servo monitor` shows what they say, `retarget servo setup` their limits"
    )
    what = f"servos do not keep their {register.name.replace('_', ' ')}"
    return BusError(what, where=line.where, found=found, then=then)


GOAL_SLACK = 0.06
"""[rad] Tolerated motion of a limp shaft since its goal was set."""


def arm_watchdogs(line: BusLine) -> None:
    """Clear and set all bus watchdogs, and read them back. Raises BusError."""
    ids = _watched(line)
    if not ids:
        return
    register = line.images[ids[0]].table["bus_watchdog"]
    for value in (0, line.spec.watchdog_value):
        write_and_read(line, register, dict.fromkeys(ids, value))


def feed_watchdogs(lines: Sequence[BusLine]) -> None:
    """Write on every bus, so that no watchdog trips while another bus is busy."""
    for line in lines:
        watched = _watched(line)
        if watched:
            register = line.images[watched[0]].table["bus_watchdog"]
            line.write_all(register, [(device, line.spec.watchdog_value) for device in watched])


def check_still(line: BusLine, goals: dict[int, int]) -> None:
    """Check that every servo is at its goal (ticks by id). Raises BusError."""
    _refuse_moved(line, read_from_all(line, "present_position", list(goals)), goals)


def confirm_goals(line: BusLine, goals: dict[int, int]) -> None:
    """Send goals (ticks by id) until the servos' registers hold them, and check that no servo has moved.

    Torque moves a servo to the goal in its register. Goal and position are read in one request, so that no late answer
    is mistaken. Raises BusError.
    """
    goal, present = (register_of(line, name) for name in ("goal_position", "present_position"))
    left, kept = list(goals), dict[int, bytes]()
    for _ in range(CONFIRM_TRIES):
        line.write_all(goal, [(device, goals[device]) for device in left])
        kept |= line.read_span(goal.address, present.end - goal.address, left)
        left = [one for one in goals if one not in kept or goal.decode(kept[one][: goal.size]) != goals[one]]
        if not left:
            break
    if left:
        held = {one: goal.decode(kept[one][: goal.size]) if one in kept else None for one in left}
        raise not_kept(line, goal, goals, held)
    _refuse_moved(line, {one: present.decode(kept[one][-present.size :]) for one in goals}, goals)


def wake(line: BusLine, ids: Sequence[int]) -> None:
    """Write the WAKING registers. Raises BusError."""
    for name, value in WAKING.items():
        held = [device for device in ids if line.images[device].table.has(name)]
        if held:
            write_and_read(line, register_of(line, name), dict.fromkeys(held, value))


def enable(line: BusLine, ids: Sequence[int]) -> None:
    """Switch torque on, and read it back. Raises BusError with the reasons."""
    off = written(line, register_of(line, "torque_enable"), dict.fromkeys(ids, 1))
    if off:
        raise BusError(
            "servos do not switch their torque on",
            where=line.where,
            found=", ".join(_why_off(line, device, held) for device, held in off.items()),
            then="See `retarget servo monitor`; a latched error is cleared by `retarget servo reboot`",
        )


def not_limp(line: BusLine, ids: Iterable[int]) -> list[int]:
    """The servos with torque, and those that do not answer."""
    found: dict[int, int] = {}
    ids = list(ids)
    for register, own in line.places("torque_enable", ids).items():
        found |= line.read_all(register, own)
    return [device for device in ids if found.get(device) != 0]


def off_everywhere(buses: Mapping[BusLine, Collection[int]]) -> list[str]:
    """Switch the torque of servos (ids by bus) off. The command goes to all before any is read back.

    Returns those that did not confirm. An interrupt is raised at the end.
    """
    unsure: list[str] = []
    interrupt: BaseException | None = None
    reachable = dict(buses)
    for act in (_send_off, _send_off, _confirm_off):
        for line, ids in list(reachable.items()):
            try:
                unsure += act(line, ids)
            except BusError as error:
                unsure.append(f"all of {line.where} ({error})")
                del reachable[line]
            except BaseException as error:  # noqa: BLE001 - the robot's torque comes first
                interrupt = error
    if interrupt is not None:
        raise interrupt
    return unsure


def _send_off(line: BusLine, ids: Iterable[int]) -> list[str]:
    for register, own in line.places("torque_enable", ids).items():
        line.write_all(register, [(device, 0) for device in own])
    return []


def _confirm_off(line: BusLine, ids: Iterable[int]) -> list[str]:
    """Read torque back, repeat it if it is on, and clear the watchdogs of the others."""
    left = not_limp(line, ids)
    if left:
        _send_off(line, left)
        left = not_limp(line, left)
    watched = [device for device in _watched(line) if device not in left]
    if watched:
        line.write_all(line.images[watched[0]].table["bus_watchdog"], [(device, 0) for device in watched])
    return [line.name_of(device) for device in left]


def _refuse_moved(line: BusLine, present: dict[int, int], goals: dict[int, int]) -> None:
    slack = {device: GOAL_SLACK / line.servos[device].model.tick_rad for device in goals}
    far = [device for device in goals if abs(present[device] - goals[device]) > slack[device]]
    if far:
        raise BusError(
            "servos moved after their goals were set to their positions",
            where=line.where,
            found=", ".join(f"{line.name_of(one)} from {goals[one]} to {present[one]}" for one in far),
            allowed=f"{math.degrees(GOAL_SLACK):.1f} degrees",
            then="Torque was not switched on. Keep the robot still and try again",
        )


def _watched(line: BusLine) -> list[int]:
    return [device for device, image in line.images.items() if image.table.has("bus_watchdog")]


def _why_off(line: BusLine, device: int, held: int | None) -> str:
    name = line.name_of(device)
    if held is None:
        return f"{name} does not answer"
    bits = 0
    if line.images[device].has("hardware_error_status"):
        bits = line.read_all(register_of(line, "hardware_error_status"), [device]).get(device, 0)
    return f"{name} " + (f"has latched {alert_text(bits)}" if bits else "stays off")


FIRST_DRIVE = 0.1
"""Share of the full drive with which torque comes on."""


class BusDrive:
    """The drive limit of all servos of a bus. Limp ones begin with FIRST_DRIVE; others carry the robot and never get
    less than they have."""

    def __init__(self, line: BusLine, limp: Collection[int]) -> None:
        self._line = line
        self._full = {device: full_drive(servo, line.images[device]) for device, servo in line.servos.items()}
        self._least = {
            device: 1 if device in limp else min(line.images[device].value(full.register.name), full.value)
            for device, full in self._full.items()
        }

    @property
    def limited(self) -> bool:
        """True if a servo is below its full drive."""
        return any(self._least[device] < full.value for device, full in self._full.items())

    def send(self, share: float) -> None:
        """Allow a share of the full drive, without confirmation."""
        for register, values in self._values(share):
            self._line.write_all(register, values.items())

    def limit(self, share: float, driven: BoolArray) -> None:
        """Allow a share of the full drive, also to servos that carry the robot. driven (n,): servos with torque; others
        may have switched themselves off by this register."""
        self._least = dict.fromkeys(self._least, 1)
        for register, values in self._values(share):
            own = {one: value for one, value in values.items() if driven[self._line.index_of[one]]}
            self._line.write_all(register, own.items())

    def confirm(self, share: float) -> None:
        """Allow a share of the full drive, and read it back. Raises BusError."""
        for register, values in self._values(share):
            write_and_read(self._line, register, values)

    def _values(self, share: float) -> list[tuple[Register, dict[int, int]]]:
        found: dict[str, tuple[Register, dict[int, int]]] = {}
        for device, (register, full) in self._full.items():
            values = found.setdefault(register.name, (register, {}))[1]
            values[device] = max(round(share * full), self._least[device])
        return list(found.values())


def provision(line: BusLine, servo: ServoSpec, *, limp: bool) -> list[str]:
    """Write the profile's values into one servo where they differ. Return the changes.

    EEPROM comes first, since a change of mode resets RAM. limp: without torque; `wake` writes values that would switch
    it on. Raises NoAnswer or ServoError.
    """
    table = line.images[servo.id].table
    image = read_image(line.client, servo.id, table)
    changed = []
    eeprom = differing(eeprom_settings(servo, line.spec, table), image)
    for register, value in eeprom:
        # A servo with torque refuses.
        line.client.write(servo.id, register, value, verify=True)
        changed.append(f"{register.name} {image.value(register.name)} -> {value}")
    if eeprom:
        image = read_image(line.client, servo.id, table)
    for register, value in differing(ram_settings(servo, image), image):
        if limp and register.name in WAKING:
            continue
        line.client.write(servo.id, register, value, verify=True)
        if not limp:
            changed.append(f"{register.name} {image.value(register.name)} -> {value}")
    line.images[servo.id] = read_image(line.client, servo.id, table)
    return changed


RAMP_TIME = 0.5
"""[s] From the first drive to the full one."""
RAMP_STEP = 0.02
"""[s]"""


class Ready(NamedTuple):
    """One bus before torque. limp: servos without torque."""

    line: BusLine
    limp: tuple[int, ...]


def prepare(lines: Sequence[BusLine], notify: Callable[[str], object], *, limp_only: bool = False) -> list[Ready]:
    """Provision all servos: limp ones wholly, those with torque in RAM only (limp_only: not at all).

    notify: receives each change. Raises BusError with the value that a servo refuses, and those that others have taken.
    """
    found, changed = [], list[str]()
    for line in lines:
        on = read_from_all(line, "torque_enable", list(line.servos))
        limp = tuple(device for device in line.servos if not on[device])
        for device in limp if limp_only else line.servos:
            try:
                now = provision(line, line.servos[device], limp=device in limp)
            except HardwareError as error:
                raise BusError(f"{error} Written before that: {'; '.join(changed) or 'nothing'}.") from error
            if now:
                changed.append(f"servo {line.name_of(device)}: {', '.join(now)}")
                notify(changed[-1])
        line.adopt(line.images)
        found.append(Ready(line, limp))
    return found


def switch_on(ready: Sequence[Ready], goals: Sequence[dict[int, int]]) -> list[BusDrive]:
    """Send the goals of each bus (ticks by id), confirm them, and switch torque on with little drive.

    Call `check_still` on all buses before, since a goal wakes 1.0 servos. Returns the drive of each bus. Raises
    BusError.
    """
    drives = []
    for (line, limp), own in zip(ready, goals, strict=True):
        drives.append(BusDrive(line, limp))
        drives[-1].confirm(FIRST_DRIVE)
        if len(limp) < len(own):  # a servo that its watchdog has stopped takes no goal until that is cleared
            arm_watchdogs(line)
        confirm_goals(line, own)
    lines = [line for line, _ in ready]
    for line in lines:
        arm_watchdogs(line)
        feed_watchdogs(lines)
    for line, limp in ready:
        if limp:
            wake(line, limp)
            enable(line, limp)
            feed_watchdogs(lines)
    return drives


def raise_drive(lines: Sequence[BusLine], drives: Sequence[BusDrive], watch: Callable[[], None]) -> None:
    """Raise the drive to the full one within RAMP_TIME. watch: called at every step; its exception ends the ramp."""
    if any(drive.limited for drive in drives):
        port = lines[0].port
        begun, steps = port.now(), round(RAMP_TIME / RAMP_STEP)
        for step in range(1, steps + 1):
            share = FIRST_DRIVE + (1.0 - FIRST_DRIVE) * step / steps
            for drive in drives:
                drive.send(share)
            port.sleep_until(begun + step * RAMP_STEP)
            watch()
    for drive in drives:
        drive.confirm(1.0)


BOOT = 0.3
"""[s] Before the first ping."""
RESTART_TIMEOUT = 3.0
"""[s] After which a silent servo is abandoned."""
PING_PERIOD = 0.1
"""[s]"""


@dataclass(frozen=True)
class Restarted:
    """The ids that were restarted, in order, and the problems afterwards."""

    ids: tuple[int, ...]
    problems: tuple[str, ...]


def restart(line: BusLine, ids: Sequence[int], stop: Callable[[], bool] = lambda: False) -> Restarted:
    """Reboot servos (protocol 2.0), all before any is waited for. stop: polled before each."""
    restarted: list[int] = []
    problems: list[str] = []
    for device in ids:
        if stop():
            break
        restarted.append(device)
        try:
            line.client.reboot(device)
        except NoAnswer:
            continue  # whether it restarted is checked below
        except ServoError as error:
            problems.append(str(error))
    deadline = line.port.now() + RESTART_TIMEOUT
    if restarted:
        line.port.sleep_until(line.port.now() + BOOT)
    for device in restarted:
        name = f"{line.servos[device].joint} (id {device})"
        found = line.client.ping(device)
        while found is None and line.port.now() < deadline:
            line.port.sleep_until(line.port.now() + PING_PERIOD)
            found = line.client.ping(device)
        if found is None:
            problems.append(f"{name} has not come back: check its power and its wiring")
            continue
        table = line.tables[device]
        try:
            bits = line.client.read(device, table["hardware_error_status"])
            torque = line.client.read(device, table["torque_enable"])
        except (NoAnswer, ServoError) as error:
            problems.append(f"{name}: {error}")
            continue
        if bits:
            still = f"{name} still has {alert_text(bits)}"
            problems.append(f"{still}: fix the cause first (let it cool, check supply and load)")
        if torque:
            problems.append(
                f"{name} has its torque on again: it did not restart, or is set up to switch it on at start"
            )
    return Restarted(tuple(restarted), tuple(problems))
