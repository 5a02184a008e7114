"""Servos as found on a line, faulty ones included: status return level 0, their registers, and torque off for all."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hardware.bus import BusSpec
from hardware.dynamixel.codec import BROADCAST, CODECS
from hardware.dynamixel.control_table import ControlTable, Register
from hardware.dynamixel.cyclic import BusLine
from hardware.dynamixel.line_scan import Sighting, Speed, speed_refused
from hardware.dynamixel.serial_port import BytePort
from hardware.dynamixel.settings import ANSWER_ALL, ServoImage, read_image, setup_command
from hardware.dynamixel.single_requests import NoAnswer, OneOff, ServoError
from hardware.dynamixel.torque import TORQUE_ENABLE
from hardware.errors import BusError
from hardware.servo import ServoSpec, find_model

# Servos whose Status Return Level is 0: they answer pings, and carry out everything else without an answer.

LEVEL = {
    1: Register("status_return_level", 16, 1, False, True, None, None, 0, 2, ANSWER_ALL),
    2: Register("status_return_level", 68, 1, False, True, None, None, 0, 2, ANSWER_ALL),
}
"""By protocol: all models have it at one address."""
PINGS_ONLY = "answers pings only (status return level 0)"


def answers_pings_only(client: OneOff, device: int) -> bool:
    """Whether a servo answers a ping, but no read. Raises BusError when the port is gone."""
    try:
        client.read(device, LEVEL[client.protocol])
    except NoAnswer as silence:
        found = client.ping(device)
        return not silence.damaged and found is not None and not found.clash
    except ServoError:  # that is an answer
        return False
    return False


def status_return_off_text(bus: BusSpec, device: int) -> str:
    """The problem, and the command that fixes it."""
    return f"{PINGS_ONLY}: {setup_command(bus, device, {LEVEL[bus.protocol].name: ANSWER_ALL})}"


def read_servo(client: OneOff, bus: BusSpec, device: int, table: ControlTable) -> ServoImage | str:
    """A servo's registers; or, where it does not answer every read, why: words to follow its name. Raises BusError when
    the port is gone."""
    try:
        return read_image(client, device, table)
    except NoAnswer as error:
        pings_only = not error.damaged and answers_pings_only(client, device)
        return f" {status_return_off_text(bus, device)}" if pings_only else f": {error}"
    except ServoError as error:
        return f": {error}"


CONTROLLERS = frozenset((0x7400,))
"""Model numbers of devices that are no servos: OpenCR."""


Placed = tuple[int, ServoSpec]
"""A servo and its place in the robot's order."""


@dataclass(frozen=True, eq=False)
class Look:
    """Result of a look at a bus. line: every servo that is expected; its `images` are of those that answered.

    missing: ids that did not answer, or did not answer every read; unknown: servos that the profile does not have, or
    whose model is not known here; clashing: ids that two servos have; notes: other findings, a line each.
    """

    line: BusLine
    missing: tuple[int, ...]
    unknown: tuple[Sighting, ...]
    clashing: tuple[int, ...]
    notes: tuple[str, ...]


def look(port: BytePort, spec: BusSpec, servos: Sequence[Placed], sightings: Sequence[Sighting]) -> Look:
    """Read all servos that were found at the speed of the bus. Raises BusError when the port is gone."""
    port.set_baud(spec.baud)
    line = BusLine(spec, port, servos)
    seen = {one.found.id: one for one in sightings}
    notes, images = [], {}
    for device, servo in line.servos.items():
        if device not in seen:
            continue
        table = seen[device].table
        if table is None:
            if seen[device].found.model is None and answers_pings_only(line.client, device):
                notes.append(f"{servo.label} {status_return_off_text(spec, device)}")
            continue
        image = read_servo(line.client, spec, device, table)
        if isinstance(image, str):
            notes.append(servo.label + image)
            continue
        if image.table.model != servo.model.name:
            notes.append(f"{servo.label} is {image.table.model}, the profile says {servo.model.name}")
        images[device] = image
    line.adopt(images)
    unknown = tuple(one for one in sightings if one.found.id not in images and _is_unknown(one, line))
    for one in unknown:
        if one.table is None:
            notes.append(f"{_called(line, one)} is a model that is not known here: {one.model}")
    unknown_ids = [f"{one.found.id} ({one.model})" for one in unknown if one.found.id not in line.servos and one.table]
    if unknown_ids:
        notes.append(f"ids that are not in the profile: {', '.join(unknown_ids)}")
    named = {one.found.id for one in unknown}
    missing = tuple(device for device in line.servos if device not in images and device not in named)
    if missing:
        notes += _power_note(line)
    clashing = tuple(device for device, one in seen.items() if one.found.clash)
    return Look(line, missing, unknown, clashing, tuple(notes))


def _is_unknown(one: Sighting, line: BusLine) -> bool:
    """Whether a servo that was not read is of a model without a table here, or not in the profile."""
    device = one.found.id
    if one.found.model in CONTROLLERS:
        return False
    if device in line.servos:
        return one.table is None and one.found.model is not None
    return device not in line.spec.ids  # a device of the bus is no servo


def _called(line: BusLine, one: Sighting) -> str:
    servo = line.servos.get(one.found.id)
    return f"id {one.found.id}" if servo is None else servo.label


def as_bus(name: str, sightings: Sequence[Sighting], *, first: int = 0) -> tuple[BusSpec, list[Placed]]:
    """A bus without a profile: the servos that answered, in order of their ids, from place `first` on.

    Servos of unknown models are left out. Raises BusError when there are several speeds.
    """
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
    return spec, [(first + place, _servo(one, name)) for place, one in enumerate(known)]


def _servo(sighting: Sighting, bus: str) -> ServoSpec:
    """A servo without a profile, of a known model: its angle is that of its shaft."""
    table = sighting.table
    assert table is not None
    model, device = find_model(table.model), sighting.found.id
    return ServoSpec(
        joint=f"servo {device}",
        id=device,
        model=model,
        bus=bus,
        direction=1,
        zero_tick=model.centre_tick,
        lower=-math.pi,
        upper=math.pi,
        max_velocity=model.no_load_speed,
        max_acceleration=model.no_load_speed,
    )


def _power_note(line: BusLine) -> list[str]:
    """Whether a device has the servos' power switched off."""
    switch = line.spec.power
    if switch is None:
        return []
    try:
        on = line.client.read_block(switch.id, switch.register, 1)[0] == switch.value
    except (NoAnswer, ServoError):
        return [f"device {switch.id}, which switches the servos' power, does not answer"]
    return [] if on else [f"device {switch.id} has the servos' power switched off"]


# Torque off by broadcasts at all speeds: quicker than any search, and no servo need be known.
#
# No servo confirms a broadcast. The caller looks for the servos afterwards, and asks each.

TIMES = 2
"""Times that each packet is sent: one may be lost."""
MARGIN = 0.002
"""[s] After the last byte, before the speed changes: what the adapter still holds would be spoiled."""


def broadcast_torque_off(port: BytePort, speeds: Sequence[Speed]) -> None:
    """Write torque off to all ids at each speed, in this order; no servo answers. Under 1 s for all speeds there are.

    The port is left at the last speed. A speed that the adapter does not have is left out. Raises BusError when the
    port is gone.
    """
    for speed in speeds:
        if speed_refused(port, speed.baud):
            continue
        data = _off(speed.protocol) * TIMES
        port.write(data)
        port.sleep_until(port.now() + 10 * len(data) / speed.baud + port.latency + MARGIN)
        port.drop()


def _off(protocol: int) -> bytes:
    register = TORQUE_ENABLE[protocol]
    return CODECS[protocol].write(BROADCAST, register.address, register.encode(0))
