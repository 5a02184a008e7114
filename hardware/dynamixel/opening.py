"""Opening one bus: who is there, are they the right ones, may they be driven. Everything that is wrong, at once."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from hardware.bus_spec import RETURN_DELAY_STEP, BusSpec
from hardware.dynamixel.answer_time import too_slow
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.checks import complaints, notes
from hardware.dynamixel.control_table import find_table, table_of_number
from hardware.dynamixel.discovery import Found
from hardware.dynamixel.echo import ECHOES
from hardware.dynamixel.muted import answers_pings_only, muted_text
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.other_speeds import MOST, elsewhere_texts, heard_elsewhere, other_bauds
from hardware.dynamixel.register import Register
from hardware.dynamixel.servo_error import NoAnswer, ServoError
from hardware.dynamixel.servo_image import ServoImage, read_image
from hardware.dynamixel.setup_plan import setup_command
from hardware.dynamixel.strangers import everybody
from hardware.dynamixel.travel import Span, needed_ticks
from hardware.servo import ServoSpec

SLOW_LATENCY = 0.004
"""[s] From here on an adapter's latency timer is complained about: two of them do not fit into 8 ms."""

BUSY = "; a host that is too busy hears nobody either"


@dataclass(eq=False)
class Opening:
    """What was found on one bus. images: by id, of the servos that may be driven."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    images: dict[int, ServoImage] = field(default_factory=dict)


def examine(
    port: BytePort, client: OneOff, bus: BusSpec, servos: Sequence[ServoSpec], *, robot: Sequence[ServoSpec] = ()
) -> Opening:
    """Look at everything on an open port; nothing is written but the power switch. Raises BusError when it is gone.

    robot: the servos of all its buses, where a coupled pair is on two of them.
    """
    opening = Opening()
    where = _where(port, bus)
    _power_on(port, client, bus, opening)
    everyone, told = everybody(port, client, bus)
    opening.notes += told
    found = {one.id: one for one in everyone}
    if client.echoes:
        opening.notes.append(f"bus {bus.name}: {ECHOES}")
    if not found:
        opening.problems.append(f"{where}: no servo answers; {_other_speeds(port, bus)}")
        return opening
    _name_missing(port, bus, servos, found, opening)
    strangers = [f"{one.id} ({_model(one)})" for one in found.values() if one.id not in bus.ids]
    if strangers:
        opening.problems.append(f"{where}: ids that the profile does not know: {', '.join(strangers)}")
    needed = needed_ticks(robot or servos)
    for servo in servos:
        if servo.id in found:
            _look_at(servo, found[servo.id], client, bus, opening, needed.get(servo.joint))
    _look_at_adapter(port, opening)
    unwatched = [str(device) for device, image in opening.images.items() if not image.table.has("bus_watchdog")]
    if unwatched and (bus.watchdog or bus.protocol == 1):
        opening.notes.append(
            f"bus {bus.name}: ids {', '.join(unwatched)} have no bus watchdog: they hold their last goal when the host "
            "goes silent"
        )
    return opening


def _name_missing(
    port: BytePort, bus: BusSpec, servos: Sequence[ServoSpec], found: dict[int, Found], opening: Opening
) -> None:
    """Who did not answer; the first few are looked for at other speeds."""
    missing = [device for device in bus.ids if device not in found]
    if not missing:
        return
    named = {servo.id: f"servo {servo.joint} (id {servo.id})" for servo in servos}
    where = _where(port, bus)
    names = ", ".join(named.get(device, f"device {device}") for device in missing)
    opening.problems.append(
        f"{where}: {names} did not answer: check power, wiring and id (`retarget servo scan`){BUSY}"
    )
    opening.problems += elsewhere_texts(port, bus, missing, named)


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


def _other_speeds(port: BytePort, bus: BusSpec) -> str:
    """What else was tried where nobody answers."""
    ids = ", ".join(map(str, bus.ids[:MOST]))
    tried = f"ids {ids} were also tried at {', '.join(map(str, other_bauds(bus)))} baud"
    heard = heard_elsewhere(port, bus, bus.ids)
    if not heard:
        return f"{tried}: check the servos' power, the wiring, and that this is the right port{BUSY}"
    said = ", ".join(f"id {device} answers at {' and '.join(map(str, bauds))}" for device, bauds in heard.items())
    return f"{tried}; {said}: correct `baud`, or {setup_command(bus, next(iter(heard)), baud=bus.baud)}"


def _look_at(
    servo: ServoSpec, found: Found, client: OneOff, bus: BusSpec, opening: Opening, needed: Span | None
) -> None:
    where = f"servo {servo.joint} (id {servo.id})"
    if found.clash:
        opening.problems.append(
            f"{where} answers in several voices: two servos have this id; connect one at a time and "
            f"give it another: `retarget servo setup --port {bus.port} --id {servo.id} --new-id N`"
        )
        return
    expected = find_table(servo.model.name, bus.protocol, found.firmware)
    try:
        if found.model != expected.number:
            muted = found.model is None and answers_pings_only(client, servo.id)
            other = f"is {_model(found)}, the profile says {servo.model.name}"
            opening.problems.append(f"{where} {muted_text(bus, servo.id) if muted else other}")
            return
        image = read_image(client, servo.id, expected)
    except NoAnswer as error:
        muted = not error.damaged and answers_pings_only(client, servo.id)
        opening.problems.append(f"{where} {muted_text(bus, servo.id)}" if muted else f"{where}: {error}")
        return
    except ServoError as error:
        opening.problems.append(f"{where}: {error}")
        return
    opening.problems += [f"{where} {text}" for text in complaints(servo, bus, image, needed)]
    opening.notes += [f"{where} {text}" for text in notes(servo, image)]
    opening.images[servo.id] = image


def _look_at_adapter(port: BytePort, opening: Opening) -> None:
    if port.latency >= SLOW_LATENCY:
        command = getattr(port, "latency_command", None)
        cure = f": {command}" if command else ""
        opening.problems.append(
            f"{port.name}: the adapter keeps bytes for up to {1e3 * port.latency:.0f} ms; allowed: 1 ms{cure}"
        )
    for device, image in list(opening.images.items())[:1]:
        late = too_slow(port, image.table, device, RETURN_DELAY_STEP * image.value("return_delay_time"))
        if late:
            opening.problems.append(late)


def _where(port: BytePort, bus: BusSpec) -> str:
    return f"bus {bus.name} ({port.name}, {bus.baud} baud, protocol {bus.protocol}.0)"


def _model(found: Found) -> str:
    if found.model is None:
        return "a servo that does not say its model"
    table = table_of_number(found.model, found.firmware)
    return table.model if table is not None else f"model number {found.model}, which is not known here"
