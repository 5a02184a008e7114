"""Servos started anew, to clear their latched errors; and whether they are back, well and limp."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.servo_error import NoAnswer, ServoError

BOOT = 0.3
"""[s] Before a restarted servo is first asked."""
PATIENCE = 3.0
"""[s] After which a servo that has not answered is given up."""
STEP = 0.1
"""[s] Between two looks for it."""


@dataclass(frozen=True)
class Restarted:
    """Who was restarted, by id, in order; and what is wrong with them afterwards, a line each."""

    ids: tuple[int, ...]
    problems: tuple[str, ...]


def restart(line: BusLine, ids: Sequence[int], stop: Callable[[], bool] = lambda: False) -> Restarted:
    """Reboot servos (protocol 2.0), all before any is waited for. stop: asked before each; True leaves the rest alone.

    Raises BusError when the port is gone.
    """
    told: list[int] = []
    problems: list[str] = []
    for device in ids:
        if stop():
            break
        told.append(device)
        try:
            line.client.reboot(device)
        except NoAnswer:
            continue  # whether it heard is seen below
        except ServoError as error:
            problems.append(str(error))
    deadline = line.port.now() + PATIENCE
    if told:
        line.port.sleep_until(line.port.now() + BOOT)
    for device in told:
        problems += _afterwards(line, device, deadline)
    return Restarted(tuple(told), tuple(problems))


def _afterwards(line: BusLine, device: int, deadline: float) -> list[str]:
    name = f"{line.servos[device].joint} (id {device})"
    found = line.client.ping(device)
    while found is None and line.port.now() < deadline:
        line.port.sleep_until(line.port.now() + STEP)
        found = line.client.ping(device)
    if found is None:
        return [f"{name} has not come back: check its power and its wiring"]
    table = line.tables[device]
    try:
        bits = line.client.read(device, table["hardware_error_status"])
        torque = line.client.read(device, table["torque_enable"])
    except (NoAnswer, ServoError) as error:
        return [f"{name}: {error}"]
    wrong = []
    if bits:
        wrong.append(f"{name} still has {alert_text(bits)}: mend the cause first (let it cool, check supply and load)")
    if torque:
        wrong.append(f"{name} has its torque on again: it did not restart, or is set up to switch it on at start")
    return wrong
