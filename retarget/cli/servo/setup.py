"""`retarget servo setup`: one servo gets its id, its speed and other settings that it keeps."""

from typing import Annotated

import typer

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.line_scan import Sighting, Speed, scan_line
from hardware.dynamixel.muted import LEVEL, PINGS_ONLY, answers_pings_only, unmute
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.servo_image import read_image
from hardware.dynamixel.settings import ANSWER_ALL, Setting
from hardware.dynamixel.setup_plan import plan
from hardware.dynamixel.setup_write import write_setting
from hardware.errors import BusError, describe
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.progress import progress_bar
from retarget.cli.servo.places import Faults, Place, Port, Protocol, Robot, Yes, chosen_speeds, find_places, opened
from retarget.cli.servo.question import agreed
from retarget.errors import UsageError


def setup(
    device: Annotated[int, typer.Option("--id", help="Its id as it is.", metavar="N")],
    robot: Robot = None,
    port: Port = None,
    protocol: Protocol = None,
    new_id: Annotated[int | None, typer.Option(help="Its id as it is to be.", metavar="N")] = None,
    baud: Annotated[int | None, typer.Option(help="Its speed as it is to be.", metavar="BAUD")] = None,
    return_delay: Annotated[float | None, typer.Option(help="Pause before it answers, us.", metavar="US")] = None,
    drive_mode: Annotated[int | None, typer.Option(help="Bits of its drive mode.", metavar="BITS")] = None,
    register: Annotated[list[str] | None, typer.Option(help="Any other of its EEPROM.", metavar="NAME=VALUE")] = None,
    yes: Yes = False,
    faults: Faults = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Read and show, write nothing.")] = False,
) -> None:
    """Write settings into one servo, at whatever speed it is found. Each is read back; id and speed come last.

    Shows what it has and what it gets, and asks. Ctrl-C ends it after the value that is being written.
    """
    if not 0 <= device <= 252:
        raise UsageError("no servo has this id", where="--id", found=device, allowed="0 to 252: 254 is everybody")
    registers = _registers(register or []) | ({} if drive_mode is None else {"drive_mode": drive_mode})
    places = find_places(robot, port, faults=faults)
    if len(places) != 1:
        raise UsageError("which bus", where="--robot", found=f"{len(places)} buses", allowed="--port PATH alone")
    place = places[0]
    with opened(places):
        heard = _voice(place, device, _find(place, device, protocol), registers, yes=yes, dry_run=dry_run)
        if heard is None:
            return
        seen, table = _known(place, heard)
        place.port.set_baud(seen.speed.baud)
        image = read_image(OneOff(place.port, seen.speed.protocol), device, table)
        delay = None if return_delay is None else 1e-6 * return_delay
        due = plan(image, new_id=new_id, baud=baud, return_delay=delay, registers=registers)
        typer.echo(f"id {device}: {seen.model}, firmware {seen.found.firmware}, {seen.speed}")
        if not due:
            typer.echo("it has all of this already: nothing to write")
            return
        for one in due:
            typer.echo(f"  {one.register.name}: {image.value(one.register.name)} -> {one.value}")
        _refuse_taken(place, seen, device if new_id is None else new_id, baud or seen.speed.baud)
        if dry_run:
            typer.echo("dry run: nothing was written")
        elif agreed("Write this?", yes=yes):
            _write(place, seen, due)


def _voice(
    place: Place, device: int, seen: Sighting, registers: dict[str, int], *, yes: bool, dry_run: bool
) -> Sighting | None:
    """The servo as it talks: one that answers pings only is written blind, where that is asked for; None: all is done.

    Takes what it wrote out of `registers`. Raises BusError where it is not asked for.
    """
    place.port.set_baud(seen.speed.baud)
    client = OneOff(place.port, seen.speed.protocol)
    if not answers_pings_only(client, device):
        return seen
    name = LEVEL[client.protocol].name
    if registers.get(name) != ANSWER_ALL:
        then = f"Add --register {name}={ANSWER_ALL}: that is written without its answer, and read back"
        raise BusError(describe(what=f"id {device} {PINGS_ONLY}", where=place.where, then=then))
    del registers[name]
    typer.echo(f"id {device}: {PINGS_ONLY}, {seen.speed}")
    typer.echo(f"  {name}: 0 -> {ANSWER_ALL}, without its answer; all else afterwards")
    if dry_run:
        typer.echo("dry run: nothing was written")
        return None
    if not agreed("Write this?", yes=yes):
        return None
    unmute(client, device)
    typer.echo(f"written and read back: {name}")
    return _find(place, device, seen.speed.protocol)


def _registers(words: list[str]) -> dict[str, int]:
    """What NAME=VALUE means. Raises UsageError."""
    found = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            found[name.strip()] = int(value, 0)
        except ValueError:
            raise UsageError(
                "this is no setting", where="--register", found=repr(word[:80]), allowed="NAME=VALUE"
            ) from None
    return found


def _find(place: Place, device: int, protocol: int | None) -> Sighting:
    """The only servo with this id, at any speed. Raises BusError."""
    speeds = chosen_speeds(place, protocol, None, everywhere=True)
    with progress_bar(f"looking for id {device}", len(speeds)) as progress:
        scan = scan_line(place.port, speeds, ids=[device], progress=progress)
    seen = [one for one in scan.sightings if one.found.id == device]
    what = ""
    if not seen:
        what = f"no servo answers to id {device} at any speed"
    elif len(seen) > 1 or seen[0].found.clash:
        what = f"several servos have id {device}"
    if what:
        then = "Connect one servo at a time; `retarget servo scan` shows who is there"
        raise BusError(describe(what=what, where=place.where, then=then))
    return seen[0]


def _known(place: Place, seen: Sighting) -> tuple[Sighting, ControlTable]:
    """A servo and its registers. Raises BusError for a model that is not known."""
    if seen.table is None:
        what = f"id {seen.found.id} is a model that is not known here ({seen.model})"
        raise BusError(describe(what=what, where=place.where, then="See `retarget servo scan`"))
    return seen, seen.table


def _refuse_taken(place: Place, seen: Sighting, new_id: int, baud: int) -> None:
    """Raise BusError where another servo has the id, at the present or the new speed."""
    try:
        for rate in (seen.speed.baud, baud):
            if (new_id, rate) == (seen.found.id, seen.speed.baud):
                continue
            place.port.set_baud(rate)
            if OneOff(place.port, seen.speed.protocol).ping(new_id) is not None:
                then = "Choose another id, or take that servo off the bus"
                what = f"id {new_id} is taken"
                raise BusError(describe(what=what, where=f"{place.where}, {rate} baud", then=then))
    finally:
        place.port.set_baud(seen.speed.baud)


def _write(place: Place, seen: Sighting, due: list[Setting]) -> None:
    """Write all, each whole; says what was written if it ends early."""
    assert seen.table is not None
    device, speed = seen.found.id, Speed(*seen.speed)
    done: list[str] = []
    try:
        with stop_on_signals() as stop:
            for one in due:
                if stop():
                    left = ", ".join(later.register.name for later in due[len(done) :])
                    typer.echo(f"interrupted; written: {', '.join(done) or 'nothing'}; not written: {left}", err=True)
                    raise typer.Exit(1 if done else 130)
                device, speed = write_setting(place.port, seen.table, device, speed, one)
                done.append(one.register.name)
    except BusError as error:
        raise BusError(f"{error} Written before: {', '.join(done) or 'nothing'}.") from error
    typer.echo(f"written and read back: {', '.join(done)}; it answers as id {device}, {speed}")
