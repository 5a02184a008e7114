"""`retarget servo scan`: who answers on a port, at any speed, in either protocol."""

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from hardware.dynamixel.line_scan import LineScan, Sighting, Speed, scan_line
from hardware.errors import BusError, describe
from retarget.cli.progress import progress_bar
from retarget.cli.servo.places import (
    Baud,
    DryRun,
    Faults,
    Place,
    Port,
    Protocol,
    Robot,
    chosen_speeds,
    find_places,
    opened,
)
from retarget.errors import UsageError

HIGHEST_ID = 253
CHECK = "Check the servos' power, the wiring (data, ground), and that this is the right port; one servo alone says more"


def scan(
    robot: Robot = None,
    port: Port = None,
    baud: Baud = None,
    protocol: Protocol = None,
    ids: Annotated[str, typer.Option(help="Only these ids.", metavar="1,2,5-9")] = "",
    faults: Faults = None,
    dry_run: DryRun = False,
) -> None:
    """Find every servo on a port: all speeds, both protocols. Nothing is written to a servo.

    With --robot the ids of its profile are compared with what answers.
    """
    wanted = ids_of(ids)
    places = find_places(robot, port, faults=faults)
    speeds = [chosen_speeds(place, protocol, baud, everywhere=True) for place in places]
    if dry_run:
        for place, some in zip(places, speeds, strict=True):
            typer.echo(f"would ping {_ids_text(wanted)} on {place.where} at {_speeds_text(some)}; nothing is written")
        return
    with opened(places):
        scans = [_scan(place, some, wanted) for place, some in zip(places, speeds, strict=True)]
    _show(places, scans)
    if not any(one.sightings for one in scans):
        tried = "; ".join(
            f"{_ids_text(wanted)} on {place.where} at {_speeds_text(one.tried)}"
            for place, one in zip(places, scans, strict=True)
        )
        raise BusError(describe(what="no servo answers", where="servo scan", found=f"silence of {tried}", then=CHECK))


def ids_of(text: str) -> list[int] | None:
    """The ids that `1,2,5-9` means; None for an empty text. Raises UsageError."""
    if not text:
        return None
    found: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        ends = [end.strip() for end in (first, last or first)]
        if not all(end.isascii() and end.isdigit() and len(end) <= 3 and int(end) <= HIGHEST_ID for end in ends):
            raise UsageError(
                "these are no ids", where="--ids", found=repr(text[:80]), allowed="such as 1,2,5-9; 0 to 253"
            )
        found |= set(range(int(ends[0]), int(ends[1]) + 1))
    if not found:
        raise UsageError("no id is meant", where="--ids", found=repr(text[:80]), allowed="such as 1,2,5-9")
    return sorted(found)


def _scan(place: Place, speeds: Sequence[Speed], ids: Sequence[int] | None) -> LineScan:
    with progress_bar(f"looking on {place.where}", len(speeds)) as progress:
        return scan_line(place.port, speeds, ids=ids, progress=progress)


def _show(places: Sequence[Place], scans: Sequence[LineScan]) -> None:
    for place, one in zip(places, scans, strict=True):
        if one.sightings:
            typer.echo(f"{place.where}:")
            Console().print(_table(place, one))
        for text in one.skipped:
            typer.echo(f"not tried on {place.where}: {text}")
        missing = _missing(place, one) if one.sightings else []
        if missing:
            typer.echo(f"missing on {place.where}: {', '.join(missing)}")


def _table(place: Place, one: LineScan) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("protocol", "baud", "id", "model", "firmware", "error", "clash", "profile"):
        table.add_column(heading, overflow="fold")
    for sighting in one.sightings:
        found, speed = sighting.found, sighting.speed
        clash = "two servos with this id" if found.clash else ""
        firmware = "-" if found.firmware is None else str(found.firmware)
        numbers = (f"{speed.protocol}.0", str(speed.baud), str(found.id))
        table.add_row(*numbers, sighting.model, firmware, sighting.alert, clash, known_as(place, sighting))
    return table


def known_as(place: Place, sighting: Sighting) -> str:
    """What the profile says of a servo: its joint, and what is not as it says; "" without a profile."""
    spec, found = place.spec, sighting.found
    if spec is None:
        return ""
    servo = next((servo for _, servo in place.servos if servo.id == found.id), None)
    if servo is None:
        return "a device of the bus" if found.id in spec.ids else "unknown"
    wrong = []
    if sighting.speed != (spec.protocol, spec.baud):
        wrong.append(f"should be {Speed(spec.protocol, spec.baud)}")
    if found.model is not None and sighting.model != servo.model.name:
        wrong.append(f"should be {servo.model.name}")
    return ": ".join((servo.joint, ", ".join(wrong))) if wrong else servo.joint


def _missing(place: Place, one: LineScan) -> list[str]:
    """Who of the profile answered nowhere."""
    if place.spec is None:
        return []
    there = {sighting.found.id for sighting in one.sightings}
    named = {servo.id: f"{servo.joint} (id {servo.id})" for _, servo in place.servos}
    return [named.get(device, f"device {device}") for device in place.spec.ids if device not in there]


def _ids_text(ids: Sequence[int] | None) -> str:
    return "all ids" if ids is None else f"ids {', '.join(map(str, ids))}"


def _speeds_text(speeds: Sequence[Speed]) -> str:
    parts = []
    for protocol in sorted({speed.protocol for speed in speeds}, reverse=True):
        rates = ", ".join(str(speed.baud) for speed in speeds if speed.protocol == protocol)
        parts.append(f"protocol {protocol}.0 with {rates} baud")
    return " and ".join(parts) or "no speed"
