"""`retarget import FILE`: draft a robot profile from any URDF or MJCF."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from hardware.errors import counted
from retarget.cli.application import progress_bar
from retarget.setup.import_robot import DEFAULT_SAMPLES, Imported, import_robot
from retarget.setup.servo_guess import NO_TORQUE

STEPS = 1000
"""Steps of the progress bar, which shows a share."""


def import_body(
    body: Annotated[Path, typer.Argument(help="The robot's body: URDF or MJCF.", metavar="FILE.urdf|xml")],
    out: Annotated[
        Path | None, typer.Option(help="New folder for it; absent: the robot's name, here.", metavar="DIR")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Of the robot; absent: that in the file.", metavar="NAME")] = None,
    no_meshes: Annotated[bool, typer.Option("--no-meshes", help="Leave out meshes that cannot be read.")] = False,
    samples: Annotated[
        int, typer.Option(help="Postures that are looked at for observers.", metavar="N")
    ] = DEFAULT_SAMPLES,
) -> None:
    """Draft a robot profile from its body alone: servo table, limbs, soles, postures, observers and landmarks.

    Writes a new folder with robot.yaml and the body; what only you can know is marked DRAFT there.
    """
    with progress_bar("looking at postures", STEPS) as show:
        done = import_robot(
            body,
            out,
            no_meshes=no_meshes,
            name=name,
            samples=samples,
            progress=lambda share: show(int(STEPS * share)),
        )
    typer.echo(_summary(done))


def _summary(done: Imported) -> str:
    """What was found, what was not, and what to do next."""
    draft, folder = done.draft, done.folder
    arms = sum(f"{side}_hand" in draft.frames for side in "lr")
    models = [servo.entry.model for servo in draft.servos]
    unknown = sum(servo.why == NO_TORQUE for servo in draft.servos)
    guessed = ", ".join(f"{models.count(model)} x {model}" for model in dict.fromkeys(models))
    facts = {
        "root": f"{draft.root}, {_count(len(draft.feet), 'sole')}, {_count(arms, 'hand')}",
        "front": draft.facing,
        "servos": guessed + (f" ({unknown} of them without a hint in the file)" if unknown else ""),
        "stand": _stands(done),
        "rest": done.rest or "not known",
    }
    width = max(map(len, facts)) + 2
    lines = [f"{folder}: profile of {draft.name}, drafted from {draft.source}"]
    lines += [f"  {key + ':':<{width}}{value}" for key, value in facts.items()]
    lines += [f"  missing: {text}" for text in draft.missing]
    lines += [f"  note: {text}" for text in draft.notes]
    profile = shlex.quote(str(folder / "robot.yaml"))
    if done.problems:
        lines += ["  not complete yet, says retarget check:", *(f"    {text}" for text in done.problems)]
        return "\n".join([*lines, f"Next: fix {profile}, then retarget check {profile}"])
    drafts = f"{counted(done.drafts, 'line')} marked DRAFT must be checked before it moves a real robot"
    return "\n".join([*lines, f"Next: retarget demo --robot {profile} --bus mock", f"      {drafts}"])


def _stands(done: Imported) -> str:
    if done.margin is not None:
        return f"centre of mass {1e3 * done.margin:.0f} mm inside the edge of the soles"
    return "on no soles" if not done.draft.feet else "not yet"


def _count(number: int, what: str) -> str:
    return counted(number, what) if number else f"no {what}s"
