"""Set up one servo on an open port: show its settings, ask, write and read back."""

from dataclasses import replace

import typer

from hardware.dynamixel.checks import profile_values
from hardware.dynamixel.control_table import usual_table
from hardware.dynamixel.found_servos import LEVEL, PINGS_ONLY, answers_pings_only
from hardware.dynamixel.line_scan import Sighting, Speed, write_setting
from hardware.dynamixel.settings import (
    ANSWER_ALL,
    ServoImage,
    Setting,
    SetupRequest,
    in_units,
    plan,
    read_image,
    settings_of,
)
from hardware.dynamixel.single_requests import OneOff
from hardware.errors import BusError
from retarget.cli.exit import echo, stop_on_signals
from retarget.cli.servo.places import Only, ServoPort, ServoTarget, agreed, chosen_speeds, search


def completed_request(target: ServoTarget, request: SetupRequest, seen: Sighting, image: ServoImage) -> SetupRequest:
    """The request, completed by the profile. Status Return Level in RAM is left out, because every run sets it.

    Raises BusError for a servo that is not of the profile's model and protocol.
    """
    registers = dict(request.registers)
    if image.table[LEVEL].address >= image.table.eeprom_end:
        registers.pop(LEVEL, None)
    servo, bus = target.servo, target.place.spec
    if servo is None or bus is None or target.needed is None:
        return replace(request, registers=registers)
    if (seen.model, seen.speed.protocol) != (servo.model.name, bus.protocol):
        raise BusError(
            f"id {target.device} is not the servo of {servo.joint} by its model or protocol",
            where=target.place.where,
            found=f"{seen.model}, protocol {seen.speed.protocol}.0",
            allowed=f"{servo.model.name}, protocol {bus.protocol}.0",
            then="Check which servo it is, or correct the profile",
        )
    profiled = profile_values(servo, bus, image, target.needed)
    return SetupRequest(
        servo.id if request.new_id is None else request.new_id,
        bus.baud if request.baud is None else request.baud,
        bus.return_delay if request.return_delay is None else request.return_delay,
        profiled | registers,
    )


def set_up(target: ServoTarget, request: SetupRequest, seen: Sighting, *, yes: bool, dry_run: bool) -> bool:
    """Write the settings of a servo that was seen on the open port of the target. True if it then holds all of them.

    Shows them and asks first, unless `yes`. Raises BusError.
    """
    place = target.place
    answering = _make_responsive(target, request, seen, yes=yes, dry_run=dry_run)
    if answering is None:
        return False
    if answering.table is None:
        what = f"id {answering.found.id} is a model that is not known here ({answering.model})"
        raise BusError(what, where=place.where, then="See `retarget servo scan`")
    place.port.set_baud(answering.speed.baud)
    image = read_image(OneOff(place.port, answering.speed.protocol), target.device, answering.table)
    echo(f"id {target.device}: {answering.model}, firmware {answering.found.firmware}, {answering.speed}")
    completed = completed_request(target, request, answering, image)
    due = plan(image, settings_of(image.table, completed))
    if not due:
        echo("it has all of this already: nothing to write")
        return True
    _preview(image, due)
    new_id = target.device if completed.new_id is None else completed.new_id
    _refuse_taken(place, answering, new_id, completed.baud or answering.speed.baud)
    if dry_run:
        echo("dry run: nothing was written")
        return False
    if not agreed("Write this?", yes=yes):
        return False
    _write(place, answering, due)
    return True


def _preview(image: ServoImage, due: list[Setting]) -> None:
    for one in due:
        name = one.register.name
        meaning = in_units(image.table, name, one.value)
        echo(f"  {name}: {image.value(name)} -> {one.value}" + (f" ({meaning})" if meaning else ""))


def _make_responsive(
    target: ServoTarget, request: SetupRequest, seen: Sighting, *, yes: bool, dry_run: bool
) -> Sighting | None:
    """The servo, made to answer all instructions if an option or the profile says so. None: the set-up ends here.

    Raises BusError for a servo that answers pings only, where neither says so.
    """
    place, device = target.place, target.device
    place.port.set_baud(seen.speed.baud)
    client = OneOff(place.port, seen.speed.protocol)
    if not answers_pings_only(client, device):
        return seen
    if request.registers.get(LEVEL, None if target.servo is None else ANSWER_ALL) != ANSWER_ALL:
        then = f"Add --register {LEVEL}={ANSWER_ALL}: that is written without its answer, and read back"
        raise BusError(f"id {device} {PINGS_ONLY}", where=place.where, then=then)
    echo(f"id {device}: {PINGS_ONLY}, {seen.speed}")
    echo(f"  {LEVEL}: 0 -> {ANSWER_ALL}, without its answer; all else afterwards")
    if dry_run:
        echo("dry run: nothing was written")
        return None
    if not agreed("Write this?", yes=yes):
        return None
    table = seen.table or usual_table(client.protocol)  # one of protocol 1.0 does not say its model
    client.write(device, table[LEVEL], ANSWER_ALL, verify=True)
    echo(f"written and read back: {LEVEL}")
    return find_one(place, device, seen.speed.protocol)


def find_one(place: ServoPort, device: int, protocol: int | None) -> Sighting:
    """The only servo with this id, at any speed. Raises BusError."""
    scan = search(place, chosen_speeds(place, Only(protocol=protocol)), [device])
    seen = [one for one in scan.sightings if one.found.id == device]
    if len(seen) != 1 or seen[0].found.clash:
        what = f"several servos have id {device}" if seen else f"no servo answers to id {device} at any speed"
        then = "Connect one servo at a time; `retarget servo scan` shows the servos on the port"
        raise BusError(what, where=place.where, then=then)
    return seen[0]


def _refuse_taken(place: ServoPort, seen: Sighting, new_id: int, baud: int) -> None:
    try:
        for rate in (seen.speed.baud, baud):
            if (new_id, rate) == (seen.found.id, seen.speed.baud):
                continue
            place.port.set_baud(rate)
            if OneOff(place.port, seen.speed.protocol).ping(new_id) is not None:
                then = "Choose another id, or take that servo off the bus"
                what = f"id {new_id} is taken"
                raise BusError(what, where=f"{place.where}, {rate} baud", then=then)
    finally:
        place.port.set_baud(seen.speed.baud)


def _write(place: ServoPort, seen: Sighting, due: list[Setting]) -> None:
    """Write all settings. If it ends early, print which were written."""
    assert seen.table is not None
    device, speed = seen.found.id, Speed(*seen.speed)
    done: list[str] = []
    try:
        with stop_on_signals() as stop:
            for one in due:
                if stop():
                    left = ", ".join(later.register.name for later in due[len(done) :])
                    echo(f"interrupted; written: {', '.join(done) or 'nothing'}; not written: {left}", err=True)
                    raise typer.Exit(1 if done else 130)
                device, speed = write_setting(place.port, seen.table, device, speed, one)
                done.append(one.register.name)
    except BusError as error:
        raise BusError(f"{error} Written before: {', '.join(done) or 'nothing'}.") from error
    echo(f"written and read back: {', '.join(done)}; it answers as id {device}, {speed}")
