"""Servos that were found on a port, as a line that can be read, whatever is wrong with them. Nothing is written."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hardware.bus_spec import BusSpec
from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.line_scan import Sighting
from hardware.dynamixel.muted import answers_pings_only, muted_text
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.servo_error import NoAnswer, ServoError
from hardware.dynamixel.servo_image import ServoImage, read_image
from hardware.dynamixel.unread import is_controller
from hardware.errors import BusError, describe
from hardware.servo import ServoSpec, find_model

Placed = tuple[int, ServoSpec]
"""A servo and its place in the robot's order."""


@dataclass(frozen=True, eq=False)
class Look:
    """What was found. line: every servo that is expected; its `images` are of those that answered.

    missing: ids that did not answer, or not enough; strange: servos that the line does not have, or whose model is not
    known here; clashing: ids that two servos have; notes: what else is worth one, a line each.
    """

    line: BusLine
    missing: tuple[int, ...]
    strange: tuple[Sighting, ...]
    clashing: tuple[int, ...]
    notes: tuple[str, ...]


def look(port: BytePort, spec: BusSpec, servos: Sequence[Placed], sightings: Sequence[Sighting]) -> Look:
    """Read everybody who was sighted at the speed of the bus. Raises BusError when the port is gone."""
    port.set_baud(spec.baud)
    line = BusLine(spec, port, servos)
    seen = {one.found.id: one for one in sightings}
    notes, images = [], {}
    for device, servo in line.servos.items():
        if device not in seen:
            continue
        try:
            image = _image(line.client, seen[device])
        except (NoAnswer, ServoError) as error:
            mute = isinstance(error, NoAnswer) and answers_pings_only(line.client, device)
            notes.append(
                f"{servo.joint} (id {device}) {muted_text(spec, device)}" if mute else f"{servo.joint}: {error}"
            )
            continue
        if image is None:
            if seen[device].found.model is None and answers_pings_only(line.client, device):
                notes.append(f"{servo.joint} (id {device}) {muted_text(spec, device)}")
            continue
        if image.table.model != servo.model.name:
            notes.append(f"{servo.joint} (id {device}) is {image.table.model}, the profile says {servo.model.name}")
        images[device] = image
    line.adopt(images)
    strange = tuple(one for one in sightings if one.found.id not in images and _is_strange(one, line))
    for one in strange:
        if one.table is None:
            notes.append(f"{_called(line, one)} is a model that is not known here: {one.model}")
    strangers = [f"{one.found.id} ({one.model})" for one in strange if one.found.id not in line.servos and one.table]
    if strangers:
        notes.append(f"ids that the profile does not know: {', '.join(strangers)}")
    named = {one.found.id for one in strange}
    missing = tuple(device for device in line.servos if device not in images and device not in named)
    if missing:
        notes += _power_note(line)
    clashing = tuple(device for device, one in seen.items() if one.found.clash)
    return Look(line, missing, strange, clashing, tuple(notes))


def _is_strange(one: Sighting, line: BusLine) -> bool:
    """Whether a servo that was not read is one that nobody can name the registers of, or that nobody expects."""
    device = one.found.id
    if is_controller(one.found):
        return False
    if device in line.servos:
        return one.table is None and one.found.model is not None
    return device not in line.spec.ids  # a device of the bus is no servo


def _called(line: BusLine, one: Sighting) -> str:
    servo = line.servos.get(one.found.id)
    return f"{servo.joint} (id {one.found.id})" if servo is not None else f"id {one.found.id}"


def as_bus(name: str, sightings: Sequence[Sighting], *, first: int = 0) -> tuple[BusSpec, list[Placed]]:
    """A bus without a profile: the servos that answered, in order of their ids, from place `first` on.

    Those of unknown models are not among them. Raises BusError when there are several speeds.
    """
    speeds = sorted({one.speed for one in sightings})
    if len(speeds) != 1:
        raise BusError(
            describe(
                what="servos at several speeds",
                where=name,
                found="; ".join(map(str, speeds)) or None,
                allowed="one protocol and one baud rate",
                then="Name one with --protocol and --baud",
            )
        )
    known = [one for one in sightings if one.table is not None]
    spec = BusSpec(name, name, speeds[0].baud, speeds[0].protocol, tuple(one.found.id for one in known))
    return spec, [(first + place, _servo(one, name)) for place, one in enumerate(known)]


def _servo(sighting: Sighting, bus: str) -> ServoSpec:
    """A servo of which only the model is known: its angle is that of its shaft."""
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


def _image(client: OneOff, sighting: Sighting) -> ServoImage | None:
    return None if sighting.table is None else read_image(client, sighting.found.id, sighting.table)


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
