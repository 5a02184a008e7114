"""`retarget servo scan`: the servos that answer on a port, at any speed, in either protocol."""

import sys
from collections.abc import Sequence
from functools import partial

from hardware.dynamixel import opencr
from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.found_servos import is_powered
from hardware.dynamixel.line_scan import LIKELY_IDS, LineScan, Sighting, Speed, likely_speeds
from hardware.dynamixel.serial_port import ECHOES
from hardware.dynamixel.single_requests import OneOff
from hardware.errors import BusError
from retarget.cli.exit import echo
from retarget.cli.servo.places import (
    Only,
    ServoPort,
    Where,
    chosen_speeds,
    find_places,
    ids_of,
    opened,
    quick_search,
    search,
)

USUAL_IDS = f"all ids by one ping (protocol 1.0: {LIKELY_IDS[0]} to {LIKELY_IDS[-1]}, and those of a profile)"
"""Ids of a quick look, in words."""
LOOK_EVERYWHERE = "--all looks at every speed and id, for about a minute"
CHECK = "Check the servos' power, the wiring (data, ground), and that this is the right port; one servo alone says more"


def scan(where: Where, only: Only, ids: str = "", everywhere: bool = False, dry_run: bool = False) -> None:
    """Find the servos on a port, at the usual speeds of both protocols, in seconds. Nothing is written to a servo.

    Each servo is printed when found; Ctrl-C ends it with those found so far. --all, --ids and --baud look at every
    speed and id that they mean. With --robot the ids of its profile are compared with what answers.

    Options:
        ids 1,2,5-9: Only these ids.
        everywhere (--all): Every speed and id; about a minute.
    """
    selected = ids_of(ids, highest=MAX_ID + (only.protocol != 2))
    quick = not everywhere and selected is None and only.baud is None
    places = find_places(where)
    speeds = [chosen_speeds(place, only) for place in places]
    whose = "all ids" if selected is None else f"ids {', '.join(map(str, selected))}"
    if quick:
        speeds, whose = [likely_speeds(some) for some in speeds], USUAL_IDS
    if dry_run:
        for place, some in zip(places, speeds, strict=True):
            echo(f"would ping {whose} on {place.where} at {_speeds_text(some)}; nothing is written")
        return
    rows = SightingTable()
    scans: list[LineScan] = []
    with opened(places):
        for place, some in zip(places, speeds, strict=True):
            try:
                show = partial(rows.add, place)
                scans.append(quick_search(place, some, show) if quick else search(place, some, selected, show))
            except KeyboardInterrupt:
                echo(f"not all was looked at; found so far: {rows.count}")
                raise
            _conclude(place, scans[-1], selected)
    if not rows.count:
        tried = "; ".join(
            f"{whose} on {place.where} at {_speeds_text(one.tried)}" for place, one in zip(places, scans, strict=True)
        )
        then = f"{CHECK}. {LOOK_EVERYWHERE}" if quick else CHECK
        raise BusError("no servo answers", where="servo scan", found=f"silence of {tried}", then=then)
    if quick:
        echo(f"note: looked at the usual speeds; {LOOK_EVERYWHERE}", err=True)


class SightingTable:
    """A table of which each line is printed at once, in a pipe too."""

    def __init__(self) -> None:
        self.count = 0
        self._place: ServoPort | None = None
        # The progress bar on stderr redirects prints, which is wrong for a pipe.
        self._out = None if sys.stdout.isatty() else sys.stdout

    def add(self, place: ServoPort, sighting: Sighting) -> None:
        """Print one servo, after a heading for a new port."""
        if place is not self._place:
            echo(f"{place.where}:", file=self._out)
            echo(_row("protocol", "baud", "id", "model", "firmware", "remarks"), file=self._out)
            self._place = place
        self.count += 1
        found, speed = sighting.found, sighting.speed
        firmware = "-" if found.firmware is None else str(found.firmware)
        clash = "two servos with this id" if found.clash else ""
        remarks = "; ".join(text for text in (known_as(place, sighting), clash, sighting.alert) if text)
        numbers = (f"{speed.protocol}.0", str(speed.baud), str(found.id))
        echo(_row(*numbers, sighting.model, firmware, remarks), file=self._out)


def _row(protocol: str, baud: str, device: str, model: str, firmware: str, remarks: str) -> str:
    return f"{protocol:8}  {baud:>7}  {device:>3}  {model:13}  {firmware:>8}  {remarks}".rstrip()


def _conclude(place: ServoPort, one: LineScan, selected: Sequence[int] | None) -> None:
    if one.echoes:
        echo(f"note: {place.where}: {ECHOES}", err=True)
    for text in one.skipped:
        echo(f"not tried on {place.where}: {text}")
    missing: list[str] = []  # devices of the profile that were looked for and did not answer
    if place.spec is not None and one.sightings:
        there = {sighting.found.id for sighting in one.sightings}
        named = {servo.id: f"{servo.joint} (id {servo.id})" for _, servo in place.servos}
        absent = [device for device in place.spec.ids if device not in there]
        missing = [named.get(device, f"device {device}") for device in absent if selected is None or device in selected]
    if missing:
        echo(f"missing on {place.where}: {', '.join(missing)}")
    switch = None if place.spec is None else place.spec.power
    seen = next((seen for seen in one.sightings if switch is not None and seen.found.id == switch.id), None)
    if missing and switch is not None and seen is not None:
        place.port.set_baud(seen.speed.baud)
        if not is_powered(OneOff(place.port, seen.speed.protocol), switch):
            echo(
                f"device {switch.id} has the servos' power switched off: `retarget servo home` asks, and switches it on"
            )


def known_as(place: ServoPort, sighting: Sighting) -> str:
    """Joint of a servo in the profile, and differences from the profile; "" without a profile."""
    spec, found = place.spec, sighting.found
    if spec is None:
        return ""
    servo = next((servo for _, servo in place.servos if servo.id == found.id), None)
    if servo is None:
        device = "the board: the servos' power, and an IMU" if found.model == opencr.NUMBER else "a device of the bus"
        return device if found.id in spec.ids else "unknown"
    wrong = []
    if sighting.speed != (spec.protocol, spec.baud):
        wrong.append(f"should be {Speed(spec.protocol, spec.baud)}")
    if found.model is not None and sighting.model != servo.model.name:
        wrong.append(f"should be {servo.model.name}")
    return ": ".join((servo.joint, ", ".join(wrong))) if wrong else servo.joint


def _speeds_text(speeds: Sequence[Speed]) -> str:
    parts = []
    for protocol in sorted({speed.protocol for speed in speeds}, reverse=True):
        rates = ", ".join(str(speed.baud) for speed in speeds if speed.protocol == protocol)
        parts.append(f"protocol {protocol}.0 with {rates} baud")
    return " and ".join(parts) or "no speed"
