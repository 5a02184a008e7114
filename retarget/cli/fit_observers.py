"""`retarget fit-observers ROBOT`: propose collision observers and pairs to ignore from a robot's body."""

from pathlib import Path
from typing import Annotated

import typer

from retarget.cli.application import Overwrite, progress_bar
from retarget.errors import UsageError
from retarget.schema.files import check_place, refuse_existing, write_atomic
from retarget.setup.fit_observers import DEFAULT_SAMPLES, Fit, Subject, find_subject, fit
from retarget.setup.shape_fit import Zones

STEPS = 1000
"""Steps of the progress bar, which shows a share."""


def fit_observers(
    robot: Annotated[str, typer.Argument(help="A robot's name, its profile, or its body: MJCF or URDF.")],
    out: Annotated[Path | None, typer.Option(help="Write it here instead of printing it.", metavar="FILE.yaml")] = None,
    samples: Annotated[int, typer.Option(help="Postures that are looked at.", metavar="N")] = DEFAULT_SAMPLES,
    seed: Annotated[int, typer.Option(help="Of the postures: the same seed, the same proposal.", metavar="S")] = 0,
    influence: Annotated[float, typer.Option(help="Distance at which an observer acts, m.", metavar="M")] = 0.03,
    margin: Annotated[float, typer.Option(help="Distance that it keeps, m.", metavar="M")] = 0.005,
    overwrite: Overwrite = False,
) -> None:
    """Propose observers (the smallest capsule around each link) and pairs to ignore, as a part of a profile in YAML."""
    zones = Zones(influence, margin)
    subject = find_subject(robot)
    if out is not None:
        _check_out(out, subject)
        if not overwrite:
            refuse_existing(out, option="--out")
    with progress_bar("looking at postures", STEPS) as show:
        found = fit(subject, zones, samples=samples, seed=seed, progress=lambda share: show(int(STEPS * share)))
    if out is None:
        typer.echo(found.text, nl=False)
        return
    write_atomic(out, found.text.encode(), option="--out")
    typer.echo(f"{out}: {_summary(found)}")


def _check_out(out: Path, subject: Subject) -> None:
    """The file that the proposal was made from is never written anew."""
    check_place(out, option="--out")
    if any(out.exists() and out.samefile(path) for path in subject.inputs):
        raise UsageError(
            "this file is what the proposal is made from", where="--out", found=str(out), next_step="Give another name"
        )


def _summary(found: Fit) -> str:
    kinds = [verdict.kind for verdict in found.ignored]
    ignored = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "none"
    return f"{len(found.observers)} observers; {len(kinds)} of {len(found.records)} pairs to ignore ({ignored})"
