"""Every servo of the open ports, by the profile of the robot or as found."""

from collections.abc import Sequence
from dataclasses import replace

import typer

from hardware.bus_spec import BusSpec
from hardware.dynamixel.echo import ECHOES
from hardware.dynamixel.line_scan import LineScan, Sighting, Speed, scan_line
from hardware.dynamixel.looking import Look, as_bus, look
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.other_speeds import elsewhere_texts
from hardware.dynamixel.strangers import everybody
from hardware.errors import BusError, describe
from retarget.cli.progress import progress_bar
from retarget.cli.servo.places import Place, check_speed, chosen_speeds
from retarget.errors import UsageError


def look_at(
    places: Sequence[Place],
    *,
    protocol: int | None = None,
    baud: int | None = None,
    ids: Sequence[int] | None = None,
    strange_too: bool = False,
) -> list[Look]:
    """A look at each port. protocol, baud, ids (None: all): narrow the search where there is no profile.

    strange_too: servos of unknown models are worth a look by themselves. Raises BusError when nobody answers,
    UsageError for a speed beside a profile.
    """
    check_search(places, protocol, baud)
    looks: list[Look] = []
    for place in places:
        if place.spec is not None:
            looks.append(_known(place, place.spec))
            continue
        seen = _search(place, chosen_speeds(place, protocol, baud, everywhere=False), ids)
        if seen.sightings:
            first = sum(len(one.line.servos) for one in looks)
            found = look(place.port, *as_bus(place.port.name, seen.sightings, first=first), seen.sightings)
            looks.append(replace(found, notes=(*found.notes, *_echo_notes(seen.echoes))))
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


def check_search(places: Sequence[Place], protocol: int | None, baud: int | None) -> None:
    """Raise UsageError for a speed that no servo has, or that stands beside a profile."""
    check_speed(protocol, baud)
    if any(place.spec is not None for place in places) and (protocol is not None or baud is not None):
        raise UsageError(
            "the profile says the speed",
            where="--protocol, --baud",
            next_step="Leave them out, or leave --robot out",
        )


def _search(place: Place, speeds: Sequence[Speed], ids: Sequence[int] | None) -> LineScan:
    if ids is None and len(speeds) > 1:
        text = f"looking at {len(speeds)} speeds on {place.where}: up to a minute; --baud and --protocol shorten it"
        typer.echo(text, err=True)
    with progress_bar(f"looking on {place.where}", len(speeds)) as progress:
        return scan_line(place.port, speeds, ids=ids, progress=progress)


def _known(place: Place, spec: BusSpec) -> Look:
    """The bus of a profile; a few of those that are missing are looked for at other speeds."""
    port = place.port
    port.set_baud(spec.baud)
    client = OneOff(port, spec.protocol)
    everyone, told = everybody(port, client, spec)
    for note in told:
        typer.echo(f"note: {note}", err=True)
    seen = [Sighting(one, Speed(spec.protocol, spec.baud)) for one in everyone]
    found = look(port, spec, place.servos, seen)
    there = {one.id for one in everyone}
    named = {servo.id: servo.label for _, servo in place.servos}
    silent = [device for device in spec.ids if device not in there]
    notes = [*elsewhere_texts(port, spec, silent, named), *found.notes, *_echo_notes(client.echoes)]
    return replace(found, notes=tuple(notes))


def _echo_notes(echoes: bool) -> list[str]:
    return [ECHOES] if echoes else []


def names(look_: Look, ids: Sequence[int]) -> str:
    """Servos by joint and id; strange ones by id and model."""
    models = {one.found.id: one.model for one in look_.strange}
    servos = look_.line.servos
    return ", ".join(
        f"{servos[device].joint} (id {device})" if device in servos else f"id {device} ({models[device]})"
        for device in ids
    )
