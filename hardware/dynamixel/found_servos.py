"""Servos as found on a line, faulty ones included: status return level 0, their registers, and torque off for all."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from hardware.bus import MAX_RETURN_DELAY, BusSpec, PowerSwitch
from hardware.dynamixel import opencr
from hardware.dynamixel.codec import BROADCAST, CODECS, MAX_ID
from hardware.dynamixel.control_table import ControlTable, Register, usual_table
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.line_scan import Sighting, Speed, elsewhere_texts, speed_refused
from hardware.dynamixel.serial_port import ECHOES, BytePort
from hardware.dynamixel.settings import ANSWER_ALL, ServoImage, read_image, setup_command
from hardware.dynamixel.single_requests import FoundServo, NoAnswer, OneOff, ServoError, ping_time
from hardware.errors import BusError
from hardware.servo import ServoSpec, find_model

LEVEL = "status_return_level"
"""Register of the status return level. At 0 a servo answers pings only."""
PINGS_ONLY = "answers pings only (status return level 0)"


def answers_pings_only(client: OneOff, device: int) -> bool:
    """True if a servo answers a ping, but no read."""
    try:
        client.read_block(device, 0, 2)  # the model number of every servo
    except NoAnswer as silence:
        found = client.ping(device)
        return not silence.damaged and found is not None and not found.clash
    except ServoError:  # that is an answer
        return False
    return False


Placed = tuple[int, ServoSpec]
PING_SLACK = 0.001
"""[s] Possible delay of an unknown id's answer to a ping."""
LONGEST_SEARCH = 2.0
"""[s] Bound of the search for unknown 1.0 ids. It takes 1 s at 1 Mbps, 1.7 s at 57,600."""


@dataclass(frozen=True, eq=False)
class Look:
    """Result of a look at a bus. silent: ids of the profile without an answer. missing: servos that did not answer
    every read. unknown: servos not in the profile, or of unknown models. wrong: findings that keep the robot from being
    driven."""

    line: BusLine
    silent: tuple[int, ...]
    missing: tuple[int, ...]
    unknown: tuple[Sighting, ...]
    wrong: tuple[str, ...]
    notes: tuple[str, ...]


def servos_on(line: BusLine) -> tuple[list[FoundServo], list[str]]:
    """The servos that answer on an open port, by id, and notes.

    2.0: one broadcast ping, received to its end, so that no late answer disturbs the next request. 1.0: each id is
    pinged.
    """
    client, expected = line.client, line.spec.ids
    if client.protocol == 2:
        answering = client.scan({*expected, MAX_ID})  # the window is that of the highest id
        return [one for one in answering if one.id in expected or one.model is not None], []  # noise is no servo
    found = {one.id: one for one in client.scan(expected)}
    others = [device for device in range(MAX_ID + 2) if device not in expected]
    each = ping_time(line.port, 1, MAX_RETURN_DELAY + line.port.latency + PING_SLACK)
    if len(others) * each > LONGEST_SEARCH:
        return [*found.values()], ["too slow to look for servos that are not in the profile"]
    for device in others:
        one = client.probe(device, PING_SLACK)
        if one is not None and (one.model is not None or not one.clash):  # noise is no servo
            found[device] = one
    return [found[device] for device in sorted(found)], []


def look_at_bus(line: BusLine) -> Look:
    """Find and read the servos of a bus. The first missing ones are looked for at other speeds."""
    spec = line.spec
    found, notes = servos_on(line)
    seen = look(line, [Sighting(one, Speed(spec.protocol, spec.baud)) for one in found])
    named = {device: servo.label for device, servo in line.servos.items()}
    elsewhere = elsewhere_texts(line.port, spec, seen.silent, named)
    return replace(seen, wrong=(*elsewhere, *seen.wrong), notes=(*notes, *seen.notes))


def look(line: BusLine, sightings: Sequence[Sighting]) -> Look:
    """Read all servos that were found at the speed of the bus, and adopt them."""
    seen = {one.found.id: one for one in sightings}
    wrong, images = [], {}
    for device, servo in line.servos.items():
        if device not in seen:
            continue
        text, image = _read(line, servo, seen[device])
        if text:
            wrong.append(f"{servo.label} {text}")
        if image is not None:
            images[device] = image
    line.adopt(images)
    line.seen = {device: one.table for device, one in seen.items() if one.table is not None}
    unknown = tuple(one for one in sightings if one.found.id not in images and _is_unknown(one, line))
    others = [one for one in unknown if one.found.id not in line.servos]
    wrong += [f"id {one.found.id} is a model that is not known here: {one.model}" for one in others if not one.table]
    unknown_ids = [f"{one.found.id} ({one.model})" for one in others if one.table]
    if unknown_ids:
        wrong.append(f"ids that are not in the profile: {', '.join(unknown_ids)}")
    named = {one.found.id for one in unknown}
    missing = tuple(device for device in line.servos if device not in images and device not in named)
    switch = line.spec.power
    if missing and switch is not None:
        try:
            if not is_powered(line.client, switch):
                wrong.append(f"device {switch.id} has the servos' power switched off")
        except (NoAnswer, ServoError):
            wrong.append(f"device {switch.id}, which switches the servos' power, does not answer")
    silent = tuple(device for device in line.spec.ids if device not in seen)
    notes = (ECHOES,) if line.client.echoes else ()
    return Look(line, silent, missing, unknown, tuple(wrong), notes)


def _read(line: BusLine, servo: ServoSpec, one: Sighting) -> tuple[str, ServoImage | None]:
    """The fault of a servo that answered, and its registers."""
    image, wrong = None, ""
    try:
        if one.table is None:
            wrong = f"is a model that is not known here: {one.model}"
        else:
            image = read_image(line.client, servo.id, one.table)
    except (NoAnswer, ServoError) as error:
        wrong = f"cannot be read: {error}"
    if one.found.clash:
        command = f"`retarget servo setup --port {line.spec.port} --id {servo.id} --new-id N`"
        wrong = f"gives several different answers: two servos have this id; connect one at a time: {command}"
    elif image is None and answers_pings_only(line.client, servo.id):
        wrong = f"{PINGS_ONLY}: {setup_command(line.spec, servo.id, {LEVEL: ANSWER_ALL})}"
    elif not wrong and one.model != servo.model.name:
        wrong = f"is {one.model}, the profile says {servo.model.name}"
    return wrong, image


def _is_unknown(one: Sighting, line: BusLine) -> bool:
    device = one.found.id
    if one.found.model == opencr.NUMBER:  # no servo
        return False
    if device in line.servos:
        return one.table is None and one.found.model is not None
    return device not in line.spec.ids  # a device of the bus is no servo


def as_bus(name: str, sightings: Sequence[Sighting], *, first: int = 0) -> tuple[BusSpec, list[Placed]]:
    """A bus without a profile: the servos that answered, by id, from place `first` on. Raises BusError for
    several speeds."""
    speeds = sorted({one.speed for one in sightings})
    if len(speeds) != 1:
        raise BusError(
            "servos at several speeds",
            where=name,
            found="; ".join(map(str, speeds)) or None,
            allowed="one protocol and one baud rate",
            then="Name one with --protocol and --baud",
        )
    known = [one for one in sightings if one.table is not None]
    spec = BusSpec(name, name, speeds[0].baud, speeds[0].protocol, tuple(one.found.id for one in known))
    servos: list[Placed] = []
    for place, one in enumerate(known):
        assert one.table is not None
        model, device = find_model(one.table.model), one.found.id
        servo = ServoSpec(
            joint=f"servo {device}",
            id=device,
            model=model,
            bus=name,
            direction=1,
            zero_tick=model.centre_tick,
            lower=-math.pi,
            upper=math.pi,
            max_velocity=model.no_load_speed,
            max_acceleration=model.no_load_speed,
            protocol=one.table.protocol,
        )
        servos.append((first + place, servo))
    return spec, servos


def is_powered(client: OneOff, switch: PowerSwitch) -> bool:
    """True if a device has the servos' power on. Raises NoAnswer or ServoError."""
    return client.read_block(switch.id, switch.register, 1)[0] == switch.value


def switch_power_on(port: BytePort, client: OneOff, switch: PowerSwitch) -> None:
    """Switch the servos' power on, and wait for their start. Raises NoAnswer or ServoError."""
    register = Register("power", switch.register, 1, False, True, None, None, 0, 255, None)
    client.write(switch.id, register, switch.value, verify=True)
    port.sleep_until(port.now() + switch.wait)


BROADCASTS = 2
MARGIN = 0.002
"""[s] Between the last byte and a change of speed."""


def broadcast_torque_off(port: BytePort, speeds: Sequence[Speed], known: Sequence[ControlTable] = ()) -> None:
    """Write torque off to all ids at each speed, in less than 1 s for all. No servo confirms.

    Only the usual tables of the protocols and the `known` ones are addressed, since an OpenCR has its power switch at
    the address of an XL-320's torque. Impossible speeds are skipped.
    """
    for speed in speeds:
        if speed_refused(port, speed.baud):
            continue
        there = [usual_table(speed.protocol), *(table for table in known if table.protocol == speed.protocol)]
        places, codec = dict.fromkeys(table["torque_enable"] for table in there), CODECS[speed.protocol]
        data = b"".join(codec.write(BROADCAST, one.address, one.encode(0)) for one in places) * BROADCASTS
        port.write(data)
        port.sleep_until(port.now() + 10 * len(data) / speed.baud + port.latency + MARGIN)
        port.drop()
