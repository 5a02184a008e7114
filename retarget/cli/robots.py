"""`retarget robots` lists robots, `retarget import` drafts a profile from a URDF or MJCF, and `retarget fit-observers`
proposes collision observers and pairs to ignore."""

import shlex
import sys
from pathlib import Path

from rich.table import Table

from hardware.errors import counted
from retarget.cli.application import answered, console
from retarget.cli.check import wide_ranges
from retarget.cli.exit import echo
from retarget.errors import RefusedError, UsageError
from retarget.schema.catalogue import HUMAN, Entry, Kind, entries, user_folder
from retarget.schema.files import check_place, refuse_existing, write_atomic
from retarget.schema.profile import read_profile
from retarget.setup.fit_observers import Zones, fit
from retarget.setup.import_robot import Imported, UnknownRobot, import_robot, read_robot
from retarget.setup.links import PARTS, PartLinks, completed, read_links
from retarget.setup.servo_guess import NO_TORQUE, STRONGER


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


NO_ANSWER = "Give --yes to take what is proposed, or --links FILE.yaml"


def import_body(
    body: Path,
    out: Path | None = None,
    name: str | None = None,
    links: Path | None = None,
    servo: str = "",
    yes: bool = False,
    no_meshes: bool = False,
) -> None:
    """Draft a robot profile from its body: servo table, limbs, soles, postures, observers and landmarks.

    Asks which link is what, as far as it is not given. Writes a new folder with robot.yaml and the body; what only you
    can know is marked DRAFT there.

    Arguments:
        body FILE.urdf|xml: The robot's body: URDF or MJCF.

    Options:
        out DIR: New folder for it; absent: the robot's name, here.
        name NAME: Name of the robot; absent: that in the file.
        links FILE.yaml: The links of its parts (l_hand: LINK, ...); what is left out is proposed.
        servo MODEL: Model of all servos (XL330-M288); absent: as the file says.
        yes: Take the links that are proposed, without asking.
        no_meshes (--no-meshes): Leave out meshes that cannot be read.
    """
    robot = read_robot(body, no_meshes=no_meshes)
    given = PartLinks() if links is None else read_links(links, robot.tree)
    if links is None and not yes and is_interactive():
        given = _confirmed_links(robot)
    echo(_drafted(import_robot(robot, out, links=given, name=name, servo=servo)))


def is_interactive() -> bool:
    """True in a terminal. Elsewhere the proposed links are taken."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _confirmed_links(robot: UnknownRobot) -> PartLinks:
    given = PartLinks()
    while True:
        links = completed(robot.proposed, given, robot.tree)
        rows = [(part, getattr(links, part)) for part in PARTS]
        joints = {link: robot.tree.nodes[node].joint for link, node in robot.tree.links.items()}
        echo("  part      link, and the joint that moves it")
        for part, link in rows:
            echo(f"  {part:<9} {link or '-'}{f'  ({joints[link]})' if link and joints[link] else ''}")
        answer = answered("ENTER if this is right, else PART=LINK (PART= for none, ? for all links): ", step=NO_ANSWER)
        if not answer:
            return given
        part, _, link = (word.strip() for word in answer.partition("="))
        if part in PARTS:
            try:
                new = given.model_copy(update={part: link or None})  # `completed` looks at the name
                completed(robot.proposed, new, robot.tree)
                given = new
            except RefusedError as error:
                echo(f"error: {error}")
        else:
            echo(f"parts: {', '.join(PARTS)}; links: {', '.join(robot.tree.links)}")


def _drafted(done: Imported) -> str:
    draft, folder = done.draft, done.folder
    arms = sum(f"{side}_hand" in draft.frames for side in "lr")
    models = [servo.entry.model for servo in draft.servos]
    unknown = sum(servo.why == NO_TORQUE for servo in draft.servos)
    strong = sum(servo.why.startswith(STRONGER) for servo in draft.servos)
    doubts = [f"no known one is strong enough for {strong} of them, these only stand for it"] if strong else []
    doubts += [f"{unknown} of them without a hint in the file: give --servo MODEL"] if unknown else []
    stand = "not yet" if draft.feet else "on no soles"
    if done.margin is not None:
        stand = f"centre of mass {1e3 * done.margin:.0f} mm inside the edge of the soles"
    guessed = ", ".join(f"{models.count(model)} x {model}" for model in dict.fromkeys(models))
    facts = {
        "root": f"{draft.root}, {_count(len(draft.feet), 'sole')}, {_count(arms, 'hand')}",
        "links": ", ".join(f"{part} {link}" for part, link in draft.links.model_dump().items() if link),
        "servos": guessed + (f" ({'; '.join(doubts)})" if doubts else ""),
        "stand": stand,
        "rest": done.rest or "not known",
    }
    width = max(map(len, facts)) + 2
    lines = [f"{folder}: profile of {draft.name}, drafted from {draft.source}"]
    lines += [f"  {key + ':':<{width}}{value}" for key, value in facts.items()]
    lines += [f"  missing: {text}" for text in draft.missing]
    lines += [f"  note: {text}" for text in (*draft.notes, *([wide_ranges(done.wide)] if done.wide else ()))]
    profile = shlex.quote(str(folder / "robot.yaml"))
    if done.again:
        return "\n".join([*lines, f"Next: correct {draft.source}, and import it again"])
    if done.problems:
        lines += ["  not complete yet, says retarget check:", *(f"    {text}" for text in done.problems)]
        return "\n".join([*lines, f"Next: fix {profile}, then retarget check {profile}"])
    drafts = f"{counted(done.drafts, 'line')} marked DRAFT must be checked before it moves a real robot"
    return "\n".join([*lines, f"good, next: retarget demo --robot {profile} --bus mock", f"      {drafts}"])


def _count(number: int, what: str) -> str:
    return counted(number, what) if number else f"no {what}s"


def fit_observers(
    robot: str,
    out: Path | None = None,
    influence: float = 0.03,
    margin: float = 0.005,
    overwrite: bool = False,
) -> None:
    """Propose observers (of a capsule and a box around each link the smaller one) and pairs to ignore, as a part of a
    profile in YAML.

    Arguments:
        robot: A robot's name, its profile, or its body: MJCF or URDF.

    Options:
        out FILE.yaml: Write it here instead of printing it.
        influence M: Distance at which an observer acts, m.
        margin M: Distance that it keeps, m.
    """
    found = fit(robot, Zones(influence, margin))
    if out is None:
        echo(found.text, end="")
        return
    check_place(out, option="--out")
    if any(out.exists() and out.samefile(path) for path in found.inputs):
        raise UsageError(
            "this file is what the proposal is made from", where="--out", found=str(out), next_step="Give another name"
        )
    if not overwrite:
        refuse_existing(out, option="--out")
    write_atomic(out, found.text.encode(), option="--out")
    echo(f"{out}: {len(found.shapes)} observers; {counted(len(found.ignored), 'pair')} to ignore")
