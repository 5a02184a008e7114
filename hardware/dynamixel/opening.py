"""Opening one bus: find its servos, compare them with the profile, time the adapter, and report every problem."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from hardware.bus import MAX_RETURN_DELAY, RETURN_DELAY_STEP, BusSpec
from hardware.dynamixel.checks import Span, complaints, needed_ticks, notes
from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.control_table import ControlTable, Register, find_table, table_of_number
from hardware.dynamixel.cyclic import Ask, Kind
from hardware.dynamixel.found_servos import answers_pings_only, read_servo, status_return_off_text
from hardware.dynamixel.line_scan import MOST, answering_elsewhere, elsewhere_texts, other_bauds
from hardware.dynamixel.serial_port import ECHOES, BytePort, settle
from hardware.dynamixel.settings import ServoImage, setup_command
from hardware.dynamixel.single_requests import Found, NoAnswer, OneOff, ServoError, ping_time
from hardware.errors import describe
from hardware.servo import ServoSpec

# All devices on a bus that answer, expected or not.

SLACK = 0.001
"""[s] That an unknown id's answer to a ping may be late."""
LONGEST = 2.0
"""[s] That the search for unknown ids of protocol 1.0 may take: about 1 s at 1 Mbps, 1.7 s at 57,600."""


def servos_on(port: BytePort, client: OneOff, bus: BusSpec) -> tuple[list[Found], list[str]]:
    """Return the servos that answer on an open port, by id; and notes. Raises BusError when the port is gone.

    2.0: one broadcast ping, received to its end, so that no late answer disturbs the next request. 1.0 has none: each
    id is pinged, unexpected ones once.
    """
    if bus.protocol == 2:
        answering = client.scan({*bus.ids, MAX_ID})  # the window is that of the highest id asked for
        return [one for one in answering if one.id in bus.ids or one.model is not None], []  # noise is no servo
    found = {one.id: one for one in client.scan(bus.ids)}
    others = [device for device in range(MAX_ID + 2) if device not in bus.ids]
    each = ping_time(port, 1, MAX_RETURN_DELAY + port.latency + SLACK)
    if len(others) * each > LONGEST:
        return [*found.values()], [f"bus {bus.name}: too slow to look for servos that are not in the profile"]
    for device in others:
        one = client.probe(device, SLACK)
        if one is not None and (one.model is not None or not one.clash):  # noise is no servo
            found[device] = one
    return [found[device] for device in sorted(found)], []


# The measured time of a servo's answer: an adapter or a hub may be slower than every timeout assumes.

LOOKS = 5
"""Reads of which the fastest counts."""
PATIENCE = 0.1
"""[s] After which one of them is given up."""


def answer_time(port: BytePort, ask: Ask) -> float | None:
    """Time in s from sending to the first byte that is not the request's echo, of an answer that is then
    complete and valid; None: there was none. The line is silent before and after."""
    port.drop()
    request, sent = ask.request(), port.now()
    port.write(request)
    received, took, whole = b"", None, False
    while port.now() < sent + PATIENCE and port.wait(sent + PATIENCE):
        received += port.read()
        if took is None and received and not request.startswith(received):
            took = port.now() - sent
        whole = len(ask.answers(received.removeprefix(request))) == len(ask.ids)
        if whole:
            break
    settle(port)
    return took if whole else None


def too_slow(port: BytePort, table: ControlTable, device: int, return_delay: float) -> str:
    """The problem where even the fastest answer comes later than a cycle waits for it; "" where there is none.

    return_delay: of that servo, s. Raises BusError when the port is gone.
    """
    position = table["present_position"]
    kind = Kind.SINGLE1 if table.protocol == 1 else Kind.SYNC
    ask = Ask(kind, (device,), position.address, position.size)
    allowed = ask.timeouts(port, return_delay).first
    fastest = None
    for _ in range(LOOKS):
        took = answer_time(port, ask)
        if took is not None:
            fastest = took if fastest is None else min(fastest, took)
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
"""[s] From here on an adapter's latency timer is refused: two of them do not fit into 8 ms."""

BUSY = "; a host that is too busy receives no answers either"


@dataclass(eq=False)
class Opening:
    """What was found on one bus. images: by id, of the servos that may be driven."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    images: dict[int, ServoImage] = field(default_factory=dict)


def examine(
    port: BytePort, client: OneOff, bus: BusSpec, servos: Sequence[ServoSpec], *, robot: Sequence[ServoSpec] = ()
) -> Opening:
    """Examine all devices on an open port; nothing is written but the power switch. Raises BusError when it is gone.

    robot: the servos of all its buses, where a coupled pair is on two of them.
    """
    opening = Opening()
    where = _where(port, bus)
    _power_on(port, client, bus, opening)
    answering, messages = servos_on(port, client, bus)
    opening.notes += messages
    found = {one.id: one for one in answering}
    if client.echoes:
        opening.notes.append(f"bus {bus.name}: {ECHOES}")
    if not found:
        opening.problems.append(f"{where}: no servo answers; {_other_speeds(port, bus)}")
        return opening
    _name_missing(port, bus, servos, found, opening)
    unknown_ids = [f"{one.id} ({_model(one)})" for one in found.values() if one.id not in bus.ids]
    if unknown_ids:
        opening.problems.append(f"{where}: ids that are not in the profile: {', '.join(unknown_ids)}")
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
    """Report devices that did not answer; the first few are looked for at other speeds."""
    missing = [device for device in bus.ids if device not in found]
    if not missing:
        return
    named = {servo.id: f"servo {servo.label}" for servo in servos}
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
    """The register of a power switch, whose device has no table here."""
    return Register("power", address, 1, False, True, None, None, 0, 255, None)


def _other_speeds(port: BytePort, bus: BusSpec) -> str:
    """The other speeds that were tried, and what answers there."""
    ids = ", ".join(map(str, bus.ids[:MOST]))
    tried = f"ids {ids} were also tried at {', '.join(map(str, other_bauds(bus)))} baud"
    elsewhere = answering_elsewhere(port, bus, bus.ids)
    if not elsewhere:
        return f"{tried}: check the servos' power, the wiring, and that this is the right port{BUSY}"
    said = ", ".join(f"id {device} answers at {' and '.join(map(str, bauds))}" for device, bauds in elsewhere.items())
    return f"{tried}; {said}: correct `baud`, or {setup_command(bus, next(iter(elsewhere)), baud=bus.baud)}"


def _look_at(
    servo: ServoSpec, found: Found, client: OneOff, bus: BusSpec, opening: Opening, needed: Span | None
) -> None:
    where = f"servo {servo.label}"
    if found.clash:
        opening.problems.append(
            f"{where} gives several different answers: two servos have this id; connect one at a time and "
            f"give it another: `retarget servo setup --port {bus.port} --id {servo.id} --new-id N`"
        )
        return
    expected = find_table(servo.model.name, bus.protocol, found.firmware)
    if found.model is None and answers_pings_only(client, servo.id):
        opening.problems.append(f"{where} {status_return_off_text(bus, servo.id)}")
        return
    if found.model != expected.number:
        opening.problems.append(f"{where} is {_model(found)}, the profile says {servo.model.name}")
        return
    image = read_servo(client, bus, servo.id, expected)
    if isinstance(image, str):
        opening.problems.append(where + image)
        return
    opening.problems += [f"{where} {text}" for text in complaints(servo, bus, image, needed)]
    opening.notes += [f"{where} {text}" for text in notes(servo, image)]
    opening.images[servo.id] = image


def _look_at_adapter(port: BytePort, opening: Opening) -> None:
    if port.latency >= SLOW_LATENCY:
        command = getattr(port, "latency_command", None)
        fix = f": {command}" if command else ""
        opening.problems.append(
            f"{port.name}: the adapter keeps bytes for up to {1e3 * port.latency:.0f} ms; allowed: 1 ms{fix}"
        )
    for device, image in list(opening.images.items())[:1]:
        problem = too_slow(port, image.table, device, RETURN_DELAY_STEP * image.value("return_delay_time"))
        if problem:
            opening.problems.append(problem)


def _where(port: BytePort, bus: BusSpec) -> str:
    return f"bus {bus.name} ({port.name}, {bus.baud} baud, protocol {bus.protocol}.0)"


def _model(found: Found) -> str:
    if found.model is None:
        return "a servo that does not say its model"
    table = table_of_number(found.model, found.firmware)
    return table.model if table is not None else f"model number {found.model}, which is not known here"
