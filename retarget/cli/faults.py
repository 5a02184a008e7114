"""`retarget faults`: inject every fault of the table into a live run, and judge whether the robot reacts as it must."""

from collections.abc import Iterable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from retarget.cli.application import console
from retarget.cli.exit import echo
from retarget.errors import UsageError, suggest

if TYPE_CHECKING:
    from sim.faults.cases import Case
    from sim.faults.judge import Verdict

MOST_LINES = 5
"""Lines about the faults of one run."""


def faults(
    listed: bool = False,
    row: str | None = None,
    seeds: Annotated[int, typer.Option(help="Also so many long runs with random faults.", metavar="N", min=0)] = 0,
    first_seed: Annotated[int, typer.Option(help="Of the random runs.", metavar="S", min=0)] = 0,
    seconds: Annotated[float, typer.Option(help="Virtual, of each random run.", metavar="S", min=1.0)] = 60.0,
    pairs: bool = False,
    rows: bool = True,
    jobs: Annotated[int, typer.Option(help="Processes that share the work.", metavar="N", min=1, max=256)] = 1,
) -> None:
    """Inject every fault of the table into a live run of OP3 on emulated servos: idle, approaching, moving, stopping.

    Pipeline, gate, guard and driver are the real ones, on virtual time; goals are judged from the bytes on the wire.
    Exit code 1 when anything was not as it has to be.

    Options:
        listed (--list): Only show the table.
        row NAME: Only this row.
        pairs: Every two rows together, too.
        rows: Every row alone.
    """
    from sim.faults.cases import pair_cases, row_cases, seed_cases
    from sim.faults.rows import ROWS

    names = [one.name for one in ROWS]
    if row is not None and row not in names:
        raise UsageError(
            "no such row", where="--row", found=repr(row), allowed=", ".join(names), next_step=suggest(row, names)
        )
    if listed:
        table = Table(box=None, pad_edge=False)
        for heading in ("fault", "a robot that moves", "within", "a run that is to begin"):
            table.add_column(heading)
        for one in ROWS:
            if row in (None, one.name):
                table.add_row(one.name, one.reaction.value, f"{one.limit:g} s" if one.limit else "-", one.idle.value)
        console().print(table)
        return
    work: list[Case] = []
    if rows or row is not None:
        work += [case for case in row_cases() if row is None or case.name == row]
    work += pair_cases() if pairs else []
    work += seed_cases(range(first_seed, first_seed + seeds), seconds=seconds)
    raise typer.Exit(_run(work, jobs))


def _run(work: "list[Case]", jobs: int) -> int:
    from multiprocessing import get_context

    from sim.faults.cases import judged_case

    bad = 0
    with ExitStack() as stack:
        results: Iterable[Verdict] = map(judged_case, work)
        if jobs > 1:
            pool = get_context("spawn").Pool(min(jobs, len(work) or 1), maxtasksperchild=200)
            results = stack.enter_context(pool).imap(judged_case, work)
        for result in results:
            took = "" if result.took is None else f", after {result.took:.3f} s"
            echo(f"{'BAD' if result.wrong else 'ok '} {result.name}{took}")
            for line in result.wrong[:MOST_LINES]:
                echo(f"    {line}")
            bad += bool(result.wrong)
    echo(f"{bad} of {len(work)} bad" if bad else f"all {len(work)} as it has to be")
    return 1 if bad else 0
