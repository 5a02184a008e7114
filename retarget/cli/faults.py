"""`retarget faults`: what may go wrong in a live run, done to one, and whether the robot does what it has to."""

from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from retarget.errors import UsageError, suggest

if TYPE_CHECKING:
    from sim.faults.rows import Row


def faults(
    listed: Annotated[bool, typer.Option("--list", help="Only show the table.")] = False,
    row: Annotated[str | None, typer.Option(help="Only this row.", metavar="NAME")] = None,
    seeds: Annotated[int, typer.Option(help="Also so many runs with random pairs of faults.", metavar="N")] = 0,
    first_seed: Annotated[int, typer.Option(help="Of the random runs.", metavar="S")] = 0,
) -> None:
    """Hurt a live run of OP3 on emulated servos in every way of the table, idle, moving and stopping.

    Pipeline, gate, guard and driver are the real ones, on virtual time; goals are judged from the bytes on the wire.
    Exit code 1 when anything was not as it has to be.
    """
    from sim.faults.rows import ROWS

    rows = [one for one in ROWS if row is None or one.name == row]
    if not rows:
        names = [one.name for one in ROWS]
        raise UsageError(
            "no such row", where="--row", found=repr(row), allowed=", ".join(names), next_step=suggest(row or "", names)
        )
    if listed:
        table = Table(box=None, pad_edge=False)
        for heading in ("fault", "the robot", "within"):
            table.add_column(heading)
        for one in rows:
            table.add_row(one.name, one.reaction.value, f"{one.limit:g} s" if one.limit else "-")
        Console().print(table)
        return
    raise typer.Exit(_run(rows, range(first_seed, first_seed + seeds)))


def _run(rows: "list[Row]", seeds: range) -> int:
    from sim.faults.judge import When, judged
    from sim.faults.seeds import judged_seed

    bad = 0
    for one in rows:
        for when in When:
            verdict = judged(one, when=when)
            took = "" if verdict.took is None else f", after {verdict.took:.3f} s"
            typer.echo(f"{'ok ' if not verdict.wrong else 'BAD'} {one.name}, {when.value}{took}")
            bad += _tell(verdict.wrong)
    for seed in seeds:
        verdict = judged_seed(seed)
        typer.echo(f"{'ok ' if not verdict.wrong else 'BAD'} seed {seed}: {verdict.row}")
        bad += _tell(verdict.wrong)
    typer.echo(f"{bad} bad" if bad else "all as it has to be")
    return 1 if bad else 0


def _tell(wrong: tuple[str, ...]) -> bool:
    for line in wrong[:5]:
        typer.echo(f"    {line}")
    return bool(wrong)
