"""A robot of one's own. `retarget import FILE`: draft a profile from any URDF or MJCF; `retarget fit-observers ROBOT`:
propose collision observers and pairs to ignore from its body."""

import shlex
from pathlib import Path

from hardware.errors import counted
from retarget.cli.application import Overwrite, progress_bar
from retarget.cli.exit import echo
from retarget.errors import UsageError
from retarget.schema.files import check_place, refuse_existing, write_atomic
from retarget.setup.fit_observers import DEFAULT_SAMPLES as FIT_SAMPLES
from retarget.setup.fit_observers import Fit, Subject, find_subject, fit
from retarget.setup.import_robot import DEFAULT_SAMPLES, Imported, import_robot
from retarget.setup.servo_guess import NO_TORQUE
from retarget.setup.shape_fit import Zones

STEPS = 1000
"""Steps of the progress bar, which shows a share."""


def import_body(
    body: Path,
    out: Path | None = None,
    name: str | None = None,
    no_meshes: bool = False,
    samples: int = DEFAULT_SAMPLES,
) -> None:
    """Draft a robot profile from its body alone: servo table, limbs, soles, postures, observers and landmarks.

    Writes a new folder with robot.yaml and the body; what only you can know is marked DRAFT there.

    Arguments:
        body FILE.urdf|xml: The robot's body: URDF or MJCF.

    Options:
        out DIR: New folder for it; absent: the robot's name, here.
        name NAME: Of the robot; absent: that in the file.
        no_meshes (--no-meshes): Leave out meshes that cannot be read.
        samples N: Postures that are looked at for observers.
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
    echo(_drafted(done))


def _drafted(done: Imported) -> str:
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


def fit_observers(
    robot: str,
    out: Path | None = None,
    samples: int = FIT_SAMPLES,
    seed: int = 0,
    influence: float = 0.03,
    margin: float = 0.005,
    overwrite: Overwrite = False,
) -> None:
    """Propose observers (the smallest capsule around each link) and pairs to ignore, as a part of a profile in YAML.

    Arguments:
        robot: A robot's name, its profile, or its body: MJCF or URDF.

    Options:
        out FILE.yaml: Write it here instead of printing it.
        samples N: Postures that are looked at.
        seed S: Of the postures: the same seed, the same proposal.
        influence M: Distance at which an observer acts, m.
        margin M: Distance that it keeps, m.
    """
    zones = Zones(influence, margin)
    subject = find_subject(robot)
    if out is not None:
        _check_out(out, subject)
        if not overwrite:
            refuse_existing(out, option="--out")
    with progress_bar("looking at postures", STEPS) as show:
        found = fit(subject, zones, samples=samples, seed=seed, progress=lambda share: show(int(STEPS * share)))
    if out is None:
        echo(found.text, end="")
        return
    write_atomic(out, found.text.encode(), option="--out")
    echo(f"{out}: {_proposed(found)}")


def _check_out(out: Path, subject: Subject) -> None:
    """The file that the proposal was made from is never written anew."""
    check_place(out, option="--out")
    if any(out.exists() and out.samefile(path) for path in subject.inputs):
        raise UsageError(
            "this file is what the proposal is made from", where="--out", found=str(out), next_step="Give another name"
        )


def _proposed(found: Fit) -> str:
    kinds = [verdict.kind for verdict in found.ignored]
    ignored = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "none"
    return f"{len(found.observers)} observers; {len(kinds)} of {len(found.records)} pairs to ignore ({ignored})"
