"""Everything that `retarget faults` may run, as data that can be sent to another process."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations_with_replacement

from sim.faults.judge import When, judged
from sim.faults.judge_files import judged_file
from sim.faults.judge_pair import judged_pair
from sim.faults.malformed_files import MALFORMED
from sim.faults.rows import APPROACHED, ROWS
from sim.faults.seeds import judged_seed

__all__ = ["Case", "Result", "file_cases", "judged_case", "pair_cases", "row_cases", "seed_cases"]

PAIRED = (When.IDLE, When.MOVING, When.STOPPING)
PAIR_AT, PAIR_GAP = 0.3, 0.1
"""When the first fault of a pair begins, s of following, and how much later the second one."""


@dataclass(frozen=True)
class Case:
    """One run. name: of its row, or of the first of two; second: of the other; when: state of the robot.

    seed: of a random run of `seconds`; None: it is none. A name without `when` is that of a malformed file.
    """

    name: str = ""
    second: str | None = None
    when: When | None = None
    seed: int | None = None
    seconds: float = 0.0


@dataclass(frozen=True)
class Result:
    """name: of the case; wrong: what was not as it has to be, a line each; took: s to the reaction, where there is
    one."""

    name: str
    wrong: tuple[str, ...]
    took: float | None = None


def row_cases() -> list[Case]:
    """Every row idle, moving and stopping, and on the approach what may come there."""
    return [
        Case(row.name, when=when) for row in ROWS for when in When if when is not When.APPROACHING or row in APPROACHED
    ]


def file_cases() -> list[Case]:
    """Every malformed robot file; they are read before anything moves, and only then."""
    return [Case(file.name) for file in MALFORMED]


def pair_cases() -> list[Case]:
    """Every two rows, one twice included, in the states of `PAIRED`."""
    return [Case(a.name, b.name, when) for a, b in combinations_with_replacement(ROWS, 2) for when in PAIRED]


def seed_cases(seeds: Iterable[int], *, seconds: float) -> list[Case]:
    """Random runs."""
    return [Case(seed=seed, seconds=seconds) for seed in seeds]


def judged_case(case: Case) -> Result:
    """Run and judge it."""
    if case.seed is not None:
        found = judged_seed(case.seed, seconds=case.seconds)
        return Result(f"seed {case.seed}: {found.row}", found.wrong)
    if case.when is None:
        file = next(one for one in MALFORMED if one.name == case.name)
        return Result(f"robot file: {file.name}", judged_file(file))
    row = next(one for one in ROWS if one.name == case.name)
    if case.second is None:
        found = judged(row, when=case.when)
        return Result(f"{found.row}, {case.when.value}", found.wrong, found.took)
    other = next(one for one in ROWS if one.name == case.second)
    found = judged_pair(row, other, at=PAIR_AT, gap=PAIR_GAP, seed=0, when=case.when)
    return Result(f"{found.row}, {case.when.value}", found.wrong)
