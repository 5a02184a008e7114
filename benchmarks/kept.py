"""Cases of a benchmark, each run by itself, and a file of JSON lines that keeps what each has found."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

C = TypeVar("C", bound=Any)
"""A case: a frozen dataclass of plain values."""
F = TypeVar("F", bound=Any)
"""A finding: a dataclass of plain values."""


def run_cases(
    cases: Sequence[C], run: Callable[[C], list[F]], kind: type[F], *, jobs: int, keep: Path | None
) -> dict[C, list[F]]:
    """What `run` finds in each case, a list of `kind`. jobs: processes. keep: a file to which each case is added when
    it has ended; a case that it holds is not run again."""
    held = read_kept(keep, type(cases[0]), kind) if cases and keep is not None and keep.is_file() else {}
    new = [case for case in cases if case not in held]
    for case, found in zip(new, _each(new, run, jobs), strict=True):
        held[case] = found
        if keep is not None:
            add_kept(keep, case, found)
    return {case: held[case] for case in cases}


def read_kept(path: Path, of: type[C], kind: type[F]) -> dict[C, list[F]]:
    """The findings that a file holds, by their cases."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {of(**case): [kind(**one) for one in found] for case, found in lines}


def add_kept(path: Path, case: C, found: Sequence[F]) -> None:
    """Add a case to a file."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps([asdict(case), [asdict(one) for one in found]]) + "\n")


def _each(cases: Sequence[C], run: Callable[[C], list[F]], jobs: int) -> Iterator[list[F]]:
    """The findings of the cases, in their order."""
    if jobs == 1:
        yield from map(run, cases)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(run, cases)
