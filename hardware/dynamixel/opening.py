"""Opening one bus: who is there, are they the right ones, may they be driven. Everything that is wrong, at once."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from hardware.bus_spec import BAUDS, BusSpec
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.checks import complaints
from hardware.dynamixel.control_table import find_table, table_of_number
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.register import Register
from hardware.dynamixel.servo_error import NoAnswer, ServoError
from hardware.dynamixel.servo_image import ServoImage, read_image
from hardware.errors import HardwareError
from hardware.servo import ServoSpec

SLOW_LATENCY = 0.004
"""[s] From here on an adapter's latency timer is complained about: two of them do not fit into 8 ms."""


@dataclass(eq=False)
class Opening:
    """What was found on one bus. images: by id, of the servos that may be driven."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    images: dict[int, ServoImage] = field(default_factory=dict)


def examine(port: BytePort, client: OneOff, bus: BusSpec, servos: Sequence[ServoSpec]) -> Opening:
    """Look at everything on an open port; nothing is written but the power switch. Raises BusError when it is gone."""
    opening = Opening()
    where = f"bus {bus.name} ({port.name}, {bus.baud} baud, protocol {bus.protocol}.0)"
    _power_on(port, client, bus, opening)
    found = {one.id: one for one in client.scan(bus.ids)}
    if not found:
        opening.problems.append(f"{where}: no servo answers; {_other_speeds(port, client, bus)}")
        return opening
    named = {servo.id: f"servo {servo.joint} (id {servo.id})" for servo in servos}
    missing = [named.get(device, f"device {device}") for device in bus.ids if device not in found]
    if missing:
        opening.problems.append(
            f"{where}: {', '.join(missing)} did not answer: check power, wiring and id (`retarget servo scan`)"
        )
    strangers = [f"{one.id} ({_model(one)})" for one in found.values() if one.id not in bus.ids]
    if strangers:
        opening.problems.append(f"{where}: ids that the profile does not know: {', '.join(strangers)}")
    for servo in servos:
        if servo.id in found:
            _look_at(servo, found[servo.id], client, bus, opening)
    _look_at_adapter(port, opening)
    unwatched = [str(device) for device, image in opening.images.items() if not image.table.has("bus_watchdog")]
    if unwatched and (bus.watchdog or bus.protocol == 1):
        opening.notes.append(
            f"bus {bus.name}: ids {', '.join(unwatched)} have no bus watchdog: they hold their last goal when the host "
            "goes silent"
        )
    return opening


def _power_on(port: BytePort, client: OneOff, bus: BusSpec, opening: Opening) -> None:
    """Switch the servos' power on where a device does that (OP3: its OpenCR)."""
    switch = bus.power
    if switch is None:
        return
    try:
        if client.read_block(switch.id, switch.register, 1)[0] == switch.value:
            return
        client.write(switch.id, _switch_register(switch.register), switch.value, verify=True)
        port.sleep_until(port.now() + switch.wait)
        opening.notes.append(f"bus {bus.name}: power switched on by device {switch.id}")
    except (NoAnswer, ServoError) as error:
        opening.problems.append(f"bus {bus.name}: device {switch.id} did not switch the servos' power on: {error}")


def _switch_register(address: int) -> Register:
    """Of a device without a table of ours."""
    return Register("power", address, 1, False, True, None, None, 0, 255, None)


def _other_speeds(port: BytePort, client: OneOff, bus: BusSpec) -> str:
    """What else was tried; the port is at the bus's speed again."""
    heard = []
    others = [baud for baud in BAUDS[bus.protocol] if baud != bus.baud]
    try:
        for baud in others:
            port.set_baud(baud)
            probe = client.ping(bus.ids[0])
            if probe is not None:
                heard.append(baud)
    except HardwareError:
        pass  # a speed that the adapter does not have
    finally:
        port.set_baud(bus.baud)
    tried = f"id {bus.ids[0]} was also tried at {', '.join(map(str, others))} baud"
    if heard:
        speeds = ", ".join(map(str, heard))
        return f"{tried} and answers at {speeds}: correct `baud`, or set it with `retarget servo setup`"
    return f"{tried}: check the servos' power, the wiring, and that this is the right port"


def _look_at(servo: ServoSpec, found: Found, client: OneOff, bus: BusSpec, opening: Opening) -> None:
    where = f"servo {servo.joint} (id {servo.id})"
    if found.clash:
        opening.problems.append(
            f"{where} answers in several voices: two servos have this id; connect one at a time and "
            "give it another with `retarget servo setup`"
        )
        return
    expected = find_table(servo.model.name, bus.protocol, found.firmware)
    if found.model != expected.number:
        opening.problems.append(f"{where} is {_model(found)}, the profile says {servo.model.name}")
        return
    try:
        image = read_image(client, servo.id, expected)
    except (NoAnswer, ServoError) as error:
        opening.problems.append(f"{where}: {error}")
        return
    opening.problems += [f"{where} {text}" for text in complaints(servo, bus, image)]
    opening.images[servo.id] = image


def _look_at_adapter(port: BytePort, opening: Opening) -> None:
    if port.latency < SLOW_LATENCY:
        return
    command = getattr(port, "latency_command", None)
    cure = f": {command}" if command else ""
    opening.problems.append(
        f"{port.name}: the adapter keeps bytes for up to {1e3 * port.latency:.0f} ms; allowed: 1 ms{cure}"
    )


def _model(found: Found) -> str:
    if found.model is None:
        return "a servo that does not say its model"
    table = table_of_number(found.model, found.firmware)
    return table.model if table is not None else f"model number {found.model}, which is not known here"
