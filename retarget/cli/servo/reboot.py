"""`retarget servo reboot`: latched errors are shown, explained, and cleared by a restart."""

from collections.abc import Sequence

import typer

from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.found_servos import Look
from hardware.dynamixel.torque import restart
from hardware.errors import BusError, counted
from retarget.cli.exit import echo, stop_on_signals
from retarget.cli.servo.places import (
    Only,
    Where,
    agreed,
    find_places,
    find_target,
    ids_of,
    look_at,
    names,
    opened,
)
from retarget.errors import UsageError


def reboot(
    where: Where,
    only: Only,
    ids: str = "",
    joint: str | None = None,
    everyone: bool = False,
    yes: bool = False,
    dry_run: bool = False,
) -> None:
    """Restart servos, which clears their latched errors; their torque goes off, and their RAM is the maker's again.

    Shows the latched errors and their meaning, and checks afterwards that the servos are back, without errors and limp.
    Ctrl-C ends it before the next servo, and the servos restarted so far are printed.

    Options:
        ids (--id) 1,2,5-9: These servos.
        joint NAME: The servo of this joint of the robot.
        everyone (--all): Every servo that is found.
        yes: Do not ask; also where torque is on.
    """
    selected = ids_of(ids, option="--id", highest=MAX_ID)
    if [selected is not None, joint is not None, everyone].count(True) != 1:
        raise UsageError("which servos", where="servo reboot", allowed="one of --id 1,2, --joint NAME and --all")
    if joint is None:
        places = find_places(where)
    else:
        target = find_target(where, joint)
        places, selected = [target.place], [target.device]
    if dry_run:
        servos = "all servos" if selected is None else f"ids {', '.join(map(str, selected))}"
        for place in places:
            echo(f"would read errors and torque of {servos} on {place.where}, and after a question restart them")
        return
    with opened(places):
        looks = look_at(places, only, ids=selected)
        chosen = [(one, [each for each in one.line.images if selected is None or each in selected]) for one in looks]
        _refuse(chosen, selected, yes=yes)
        for one, some in chosen:
            for device in some:
                echo(_latched(one, device))
        count = sum(len(some) for _, some in chosen)
        if not agreed(f"Restart {counted(count, 'servo')}? Their torque goes off.", yes=yes):
            return
        problems = _restart(chosen)
    if problems:
        raise BusError("\n  ".join(["problems after the restart:", *problems]))
    echo(f"{count} servo{'s are' if count > 1 else ' is'} back, without errors, torque off")


def _restart(chosen: Sequence[tuple[Look, list[int]]]) -> list[str]:
    """Restart, and return the problems. An interrupt ends it between two servos, and prints those restarted."""
    done: list[str] = []
    left: list[str] = []
    problems: list[str] = []
    with stop_on_signals() as stop:
        for one, some in chosen:
            restarted = restart(one.line, some, stop)
            problems += restarted.problems
            done += [names(one, [device]) for device in restarted.ids]
            left += [names(one, [device]) for device in some if device not in restarted.ids]
        if left:
            echo(f"interrupted; restarted: {', '.join(done) or 'no servo'}; not: {', '.join(left)}", err=True)
            for problem in problems:
                echo(problem, err=True)
            raise typer.Exit(1 if done else 130)
    return problems


def _refuse(chosen: list[tuple[Look, list[int]]], selected: list[int] | None, *, yes: bool) -> None:
    there = {device for _, some in chosen for device in some}
    absent = sorted(set(selected or ()) - there)
    if absent:
        raise BusError(
            f"no servo answers to id {', '.join(map(str, absent))}",
            where="servo reboot",
            then="See `retarget servo scan`; nothing was restarted",
        )
    for one, some in chosen:
        where = f"bus {one.line.spec.name}"
        if some and one.line.spec.protocol == 1:
            then = "Switch their power off and on"
            raise BusError("servos of protocol 1.0 have no reboot instruction", where=where, then=then)
        driven = [device for device in some if one.line.images[device].value("torque_enable")]
        if driven and not yes:
            raise BusError(
                "torque is on, and a restart drops what these servos hold",
                where=where,
                found=names(one, driven),
                then="Secure the robot, then `retarget servo rest`, or agree with --yes",
            )


def _latched(one: Look, device: int) -> str:
    image = one.line.images[device]
    bits = image.value("hardware_error_status") if image.has("hardware_error_status") else 0
    torque = ", torque on" if image.value("torque_enable") else ""
    return f"{names(one, [device])}, {image.table.model}: {alert_text(bits) or 'no error'}{torque}"
