"""Every servo of the open ports, by the profile of the robot or as found."""

from collections.abc import Sequence

import typer

from hardware.bus_spec import BusSpec
from hardware.dynamixel.byte_port import BytePort
from hardware.dynamixel.line_scan import Sighting, Speed, scan_line
from hardware.dynamixel.looking import Look, as_bus, look
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.strangers import everybody
from hardware.errors import BusError, describe
from retarget.cli.progress import progress_bar
from retarget.cli.servo.places import Place, chosen_speeds
from retarget.errors import UsageError


def look_at(
    places: Sequence[Place], *, protocol: int | None = None, baud: int | None = None, strange_too: bool = False
) -> list[Look]:
    """A look at each port. protocol, baud: narrow the search where there is no profile.

    strange_too: servos of unknown models are worth a look by themselves. Raises BusError when nobody answers,
    UsageError for a speed beside a profile.
    """
    looks: list[Look] = []
    for place in places:
        if place.spec is not None and (protocol is not None or baud is not None):
            raise UsageError(
                "the profile says the speed",
                where="--protocol, --baud",
                next_step="Leave them out, or leave --robot out",
            )
        if place.spec is not None:
            looks.append(look(place.port, place.spec, place.servos, _everybody(place.port, place.spec)))
            continue
        speeds = chosen_speeds(place, protocol, baud, everywhere=False)
        with progress_bar(f"looking on {place.where}", len(speeds)) as progress:
            seen = scan_line(place.port, speeds, progress=progress)
        if seen.sightings:
            first = sum(len(one.line.servos) for one in looks)
            looks.append(look(place.port, *as_bus(place.port.name, seen.sightings, first=first), seen.sightings))
    if not any(one.line.images or (strange_too and one.strange) for one in looks):
        told = [note for one in looks for note in one.notes]
        raise BusError(
            describe(
                what="no servo answers",
                where=", ".join(place.where for place in places),
                found="; ".join(told) or None,
                then="Check power and wiring, and see `retarget servo scan`",
            )
        )
    for one in looks:
        for note in one.notes:
            typer.echo(f"note: bus {one.line.spec.name}: {note}", err=True)
    return looks


def _everybody(port: BytePort, spec: BusSpec) -> list[Sighting]:
    """Who answers at the speed of a bus, whether its profile knows them or not."""
    found, told = everybody(port, OneOff(port, spec.protocol), spec)
    for note in told:
        typer.echo(f"note: {note}", err=True)
    return [Sighting(one, Speed(spec.protocol, spec.baud)) for one in found]


def names(look_: Look, ids: Sequence[int]) -> str:
    """Servos by joint and id; strange ones by id and model."""
    models = {one.found.id: one.model for one in look_.strange}
    servos = look_.line.servos
    return ", ".join(
        f"{servos[device].joint} (id {device})" if device in servos else f"id {device} ({models[device]})"
        for device in ids
    )
