"""`retarget robots`: the robots known by name, shipped and the user's own."""

import shlex

from rich.table import Table

from retarget.cli.application import console
from retarget.cli.exit import echo
from retarget.errors import RefusedError
from retarget.schema.catalogue import HUMAN, Entry, Kind, entries, user_folder
from retarget.schema.profile import read_profile


def robots() -> None:
    """List the robots known by name: shipped ones and those in the user's configuration folder."""
    table = Table(box=None, pad_edge=False)
    for heading, width in (("robot", 10), ("servos", 17), ("root", 4), ("priorities", 12), ("from", 7)):
        table.add_column(heading, overflow="fold", min_width=width)
    for entry in entries(Kind.ROBOT):
        table.add_row(*_row(entry))
    console().print(table)
    echo(f"\n--robot {HUMAN} drives none: it only reconstructs the performer.")
    echo(f"Your own: {user_folder() / Kind.ROBOT.value}/NAME/robot.yaml, or give --robot a path.")


def _row(entry: Entry) -> tuple[str, ...]:
    origin = "shipped" if entry.shipped else str(entry.path.parent)
    try:
        profile = read_profile(entry.path)
    except RefusedError:
        return entry.name, "-", "-", f"not usable: see retarget check {shlex.quote(entry.name)}", origin
    models = [servo.model for servo in profile.servos.values()]
    servos = ", ".join(f"{models.count(model)} x {model}" for model in dict.fromkeys(models))
    return entry.name, servos, profile.root, f"{profile.reconstruct}, {profile.retarget}", origin
