"""`retarget servo setup`: one servo gets its id, its speed and other settings that it keeps."""

from typing import Annotated

import typer

from hardware.dynamixel.control_table import ControlTable
from hardware.dynamixel.in_units import in_units
from hardware.dynamixel.line_scan import Sighting, Speed, scan_line
from hardware.dynamixel.muted import LEVEL, PINGS_ONLY, answers_pings_only, unmute
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.servo_image import ServoImage, read_image
from hardware.dynamixel.settings import ANSWER_ALL, Setting
from hardware.dynamixel.setup_plan import plan
from hardware.dynamixel.setup_write import write_setting
from hardware.errors import BusError, describe
from retarget.cli.interrupt import stop_on_signals
from retarget.cli.progress import progress_bar
from retarget.cli.servo.places import Faults, Place, Port, Protocol, Robot, Yes, chosen_speeds, opened
from retarget.cli.servo.question import agreed
from retarget.cli.servo.setup_options import Asked, check_asked, check_device, registers_of
from retarget.cli.servo.setup_wanted import wanted_of
from retarget.cli.servo.target import Target, find_target
from retarget.errors import UsageError


def setup(
    robot: Robot = None,
    joint: Annotated[str | None, typer.Option(help="The servo of this joint of the robot.", metavar="NAME")] = None,
    device: Annotated[int | None, typer.Option("--id", help="Its id as it is.", metavar="N")] = None,
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

    With --robot and --joint (or --id of the profile) it gets everything in which it differs from the profile; --joint
    with --id makes the servo with that id the joint's own. Other options come before the profile. Shows what it has and
    what it gets, and asks. Ctrl-C ends it after the value that is being written.
    """
    if device is not None:
        check_device(device, protocol)
    asked = Asked(new_id, baud, return_delay, drive_mode, registers_of(register or []))
    target = find_target(robot, port, joint, device, faults)
    _check(target, asked, protocol)
    place = target.place
    with opened([place]):
        heard = _voice(target, asked, _find(place, target.device, protocol), yes=yes, dry_run=dry_run)
        if heard is None:
            return
        seen, table = _known(place, heard)
        place.port.set_baud(seen.speed.baud)
        image = read_image(OneOff(place.port, seen.speed.protocol), target.device, table)
        typer.echo(f"id {target.device}: {seen.model}, firmware {seen.found.firmware}, {seen.speed}")
        wanted = wanted_of(target, asked, seen, image)
        pause = None if wanted.return_delay is None else 1e-6 * wanted.return_delay
        due = plan(image, new_id=wanted.new_id, baud=wanted.baud, return_delay=pause, registers=wanted.registers)
        if not due:
            typer.echo("it has all of this already: nothing to write")
            return
        _preview(image, due)
        new_id = target.device if wanted.new_id is None else wanted.new_id
        _refuse_taken(place, seen, new_id, wanted.baud or seen.speed.baud)
        if dry_run:
            typer.echo("dry run: nothing was written")
        elif agreed("Write this?", yes=yes):
            _write(place, seen, due)


def _check(target: Target, asked: Asked, protocol: int | None) -> None:
    """Raise UsageError for what is impossible, before a port is opened."""
    servo, spec = target.servo, target.place.spec
    if servo is None:
        check_asked(asked, protocol, None)
        if spec is not None and not asked.anything:
            known = ", ".join(str(one.id) for _, one in target.place.servos)
            raise UsageError(
                "no servo of the profile has this id, so it says nothing of it",
                where="--id",
                found=target.device,
                allowed=known,
                next_step="Say with --joint NAME whose servo it is to be",
            )
        return
    assert spec is not None
    check_asked(asked, spec.protocol, servo.model.name)


def _preview(image: ServoImage, due: list[Setting]) -> None:
    for one in due:
        name = one.register.name
        meaning = in_units(image.table, name, one.value)
        typer.echo(f"  {name}: {image.value(name)} -> {one.value}" + (f" ({meaning})" if meaning else ""))


def _voice(target: Target, asked: Asked, seen: Sighting, *, yes: bool, dry_run: bool) -> Sighting | None:
    """The servo as it talks: one that answers pings only is written blind, where somebody (or the profile) wants it.

    None: no more is to be done. Raises BusError where nobody asked for it.
    """
    place, device = target.place, target.device
    place.port.set_baud(seen.speed.baud)
    client = OneOff(place.port, seen.speed.protocol)
    if not answers_pings_only(client, device):
        return seen
    name = LEVEL[client.protocol].name
    if asked.registers.get(name, None if target.servo is None else ANSWER_ALL) != ANSWER_ALL:
        then = f"Add --register {name}={ANSWER_ALL}: that is written without its answer, and read back"
        raise BusError(describe(what=f"id {device} {PINGS_ONLY}", where=place.where, then=then))
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
