"""Opening one bus: find its servos, compare them with the profile, time the adapter, and report every problem."""

from dataclasses import dataclass, field

from hardware.bus import RETURN_DELAY_STEP
from hardware.dynamixel.checks import complaints, needed_ticks, notes
from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.cyclic import BusLine, ReadKind, ReadRequest
from hardware.dynamixel.found_servos import is_powered, look_at_bus, switch_power_on
from hardware.dynamixel.serial_port import BytePort, settle
from hardware.dynamixel.single_requests import NoAnswer, ServoError
from hardware.errors import describe
from hardware.joint_map import JointMap

LOOKS = 5
"""Timed reads, of which the fastest counts."""
LOOK_TIMEOUT = 0.1
"""[s] Timeout of one of them."""


def answer_time(port: BytePort, request: ReadRequest) -> float | None:
    """The time, s, from sending to the first byte of a valid answer, without an echo; None if there was none.
    The line is silent before and after."""
    port.drop()
    packet, sent = request.packet(), port.now()
    port.write(packet)
    received, elapsed, whole = b"", None, False
    while port.now() < sent + LOOK_TIMEOUT and port.wait(sent + LOOK_TIMEOUT):
        received += port.read()
        if elapsed is None and received and not packet.startswith(received):
            elapsed = port.now() - sent
        whole = len(request.answers(received.removeprefix(packet))) == len(request.ids)
        if whole:
            break
    settle(port)
    return elapsed if whole else None


def too_slow(port: BytePort, table: ControlTable, device: int, return_delay: float) -> str:
    """The problem if even the fastest answer comes too late for a cycle, else "". return_delay: s."""
    position = table["present_position"]
    kind = ReadKind.SINGLE1 if table.protocol == 1 else ReadKind.SYNC
    request = ReadRequest(kind, (device,), position.address, position.size)
    allowed = request.timeouts(port, return_delay).first
    fastest = None
    for _ in range(LOOKS):
        elapsed = answer_time(port, request)
        if elapsed is not None:
            fastest = elapsed if fastest is None else min(fastest, elapsed)
            if fastest <= allowed:
                return ""
    if fastest is None:
        return ""  # `examine` reports a servo that does not answer
    return describe(
        what="the adapter, or a hub before it, is slower than a cycle allows: every answer would come too late",
        where=port.name,
        found=f"{1e3 * fastest:.1f} ms to the first byte at best",
        allowed=f"{1e3 * allowed:.1f} ms",
        then="Set its latency timer to 1 ms, plug it into the computer itself, or use another adapter",
    )


SLOW_LATENCY = 0.004
"""[s] Refused latency timer: two of them do not fit into 8 ms."""

BUSY = "; a host that is too busy receives no answers either"


@dataclass(eq=False)
class Opening:
    """Findings on one bus: problems, which keep the robot from being driven, and notes."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def examine(line: BusLine, joint_map: JointMap) -> Opening:
    """Examine all devices on an open port. Only the power switch is written. `line` adopts the servos as read.

    joint_map: of the whole robot.
    """
    bus = line.spec
    where = f"bus {bus.name} ({line.port.name}, {bus.baud} baud, protocol {bus.protocol}.0)"
    opening = Opening()
    switch = bus.power
    if switch is not None:
        try:
            if not is_powered(line.client, switch):
                switch_power_on(line.port, line.client, switch)
                opening.notes.append(f"bus {bus.name}: power switched on by device {switch.id}")
        except (NoAnswer, ServoError) as error:
            opening.problems.append(f"bus {bus.name}: device {switch.id} did not switch the servos' power on: {error}")
    seen = look_at_bus(line)
    opening.notes += [f"bus {bus.name}: {text}" for text in seen.notes]
    if len(seen.silent) == len(bus.ids):
        opening.problems.append(
            f"{where}: no servo answers: check the servos' power, the wiring, and that this is the right port{BUSY}"
        )
    elif seen.silent:
        names = ", ".join(map(line.name_of, seen.silent))
        opening.problems.append(
            f"{where}: {names} did not answer: check power, wiring and id (`retarget servo scan --all`){BUSY}"
        )
    opening.problems += [f"bus {bus.name}: {text}" for text in seen.wrong]
    needed = needed_ticks(joint_map)
    for device, image in line.images.items():
        servo = line.servos[device]
        if image.table.model == servo.model.name:
            found = complaints(servo, bus, image, needed[servo.joint])
            opening.problems += [f"servo {servo.label} {text}" for text in found]
            opening.notes += [f"servo {servo.label} {text}" for text in notes(servo, image)]
    port = line.port
    if port.latency >= SLOW_LATENCY:
        command = getattr(port, "latency_command", None)
        fix = f": {command}" if command else ""
        opening.problems.append(
            f"{port.name}: the adapter keeps bytes for up to {1e3 * port.latency:.0f} ms; allowed: 1 ms{fix}"
        )
    for device, image in list(line.images.items())[:1]:
        problem = too_slow(port, image.table, device, RETURN_DELAY_STEP * image.value("return_delay_time"))
        if problem:
            opening.problems.append(problem)
    unwatched = [str(device) for device, image in line.images.items() if not image.table.has("bus_watchdog")]
    if unwatched:
        opening.notes.append(
            f"bus {bus.name}: ids {', '.join(unwatched)} have no bus watchdog: they hold their last goal when the host "
            "goes silent"
        )
    return opening
