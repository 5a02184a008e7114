"""`retarget servo rest`: torque off on every servo, confirmed by each."""

from collections.abc import Sequence
from contextlib import suppress

from hardware.dynamixel.control_table import find_table
from hardware.dynamixel.found_servos import Look, broadcast_torque_off
from hardware.dynamixel.line_scan import Speed
from hardware.dynamixel.torque import not_limp, off_everywhere
from hardware.errors import BusError, TorqueError
from retarget.cli.exit import echo, stop_on_signals
from retarget.cli.servo.places import Only, ServoPort, Where, agreed, chosen_speeds, find_places, look_at, names, opened

UNCONFIRMED = (
    "Torque off was sent to all servos, and no servo has confirmed it: run it again, or cut the power by hand."
)


def rest(where: Where, only: Only, yes: bool = False, dry_run: bool = False) -> None:
    """Switch torque off on all servos at once, wherever they are: a robot that stands falls, so hold it.

    Broadcasts at all speeds come first, that of the profile before the others: this takes 0.5 s. No servo confirms a
    broadcast, so the servos are then looked for, switched off again and read back, also those of unknown models. A
    servo that does not confirm is named, and the exit code is 1. Nothing else is written but the bus watchdog, which is
    cleared. Without a profile the look takes up to a minute. Ctrl-C does not end the writing half way.
    """
    places = find_places(where)
    protocols = [place.spec.protocol if place.spec and only.protocol is None else only.protocol for place in places]
    speeds = [chosen_speeds(place, Only(only.baud, own)) for place, own in zip(places, protocols, strict=True)]
    if dry_run:
        for place in places:
            echo(f"would send torque off to all on {place.where} after a question, at all speeds, and look for servos")
        echo("torque_enable := 0 and bus_watchdog := 0, and read torque_enable back")
        return
    with opened(places):
        sent = yes
        if not yes and not all(place.spec for place in places):  # the look would take longer than a fall
            if not agreed("Switch torque off on all servos? A robot that stands falls.", yes=False):
                return
            sent = True
        if sent:
            _broadcast(places, speeds)
        try:
            looks = look_at(places, only, unknown_too=True)
        except BusError as error:
            raise BusError(f"{error} {UNCONFIRMED if sent else ''}".rstrip()) from error
        except KeyboardInterrupt:
            if sent:
                raise TorqueError(f"interrupted. {UNCONFIRMED}") from None
            raise
        count = sum(len(_answering(one)) for one in looks)
        if not sent:
            if not _is_due(looks, count):
                return
            if not agreed(f"Switch torque off on {count} servos? A robot that stands falls.", yes=False):
                return
            _broadcast(places, speeds)
        else:
            _print_missing(looks)
        with stop_on_signals():  # signals wait: a robot half of whose servos have torque is the worst case
            _switch_off(looks)
    echo(f"torque is off on all {count} servos")


def _broadcast(places: Sequence[ServoPort], speeds: Sequence[Sequence[Speed]]) -> None:
    """Send torque off by broadcast on all ports, also after one fails; each is left at its first speed."""
    with stop_on_signals():
        for place, own in zip(places, speeds, strict=True):
            with suppress(BusError):  # the servos are read back afterwards
                version = 2 if place.spec is None else place.spec.protocol  # without a profile no servo is known
                tables = [find_table(one.model.name, version) for _, one in place.servos]
                broadcast_torque_off(place.port, own, tables)
                place.port.set_baud(own[0].baud)
    echo("torque off was sent to all servos; now each is looked for and read back")


def _is_due(looks: Sequence[Look], count: int) -> bool:
    """True if any servo has torque or does not answer. Prints which."""
    driven = [names(one, on) for one in looks if (on := not_limp(one.line, _answering(one)))]
    if not driven and not any(one.missing for one in looks):
        echo(f"torque is off already on all {count} servos")
        return False
    echo(f"torque is on: {', '.join(driven) or 'no servo that answers'}")
    _print_missing(looks)
    return True


def _print_missing(looks: Sequence[Look]) -> None:
    for one in looks:
        if one.missing:
            echo(f"no answer: {names(one, one.missing)}")


def _answering(one: Look) -> list[int]:
    return [*one.line.images, *(sighting.found.id for sighting in one.unknown)]


def _switch_off(looks: Sequence[Look]) -> None:
    """Switch torque off, also on servos that did not answer. Raises TorqueError with those that did not confirm."""
    unsure = off_everywhere({one.line: (*_answering(one), *one.missing) for one in looks})
    if unsure:
        raise TorqueError(
            f"{', '.join(unsure)} did not confirm that torque is off",
            where="servo rest",
            then="Cut the power by hand",
        )
