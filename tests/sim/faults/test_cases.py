"""What may be run, as data; pairs and long random runs, which take hours."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.reduction import ForkingPickler

import pytest

from sim.faults.cases import Case, file_cases, judged_case, pair_cases, row_cases, seed_cases
from sim.faults.judge import When
from sim.faults.malformed_files import MALFORMED
from sim.faults.rows import APPROACHED, ROWS

JOBS = max((os.cpu_count() or 1) - 1, 1)


def test_every_pair_is_there_once_in_every_state() -> None:
    pairs = pair_cases()
    assert len(pairs) == len(set(pairs)) == 3 * len(ROWS) * (len(ROWS) + 1) // 2
    assert len(row_cases()) == 3 * len(ROWS) + len(APPROACHED)
    assert len(file_cases()) == len(MALFORMED) == 30


def test_cases_and_results_can_go_to_another_process() -> None:
    cases = [Case("second source", when=When.IDLE), Case("empty"), *seed_cases(range(2), seconds=1.0)]
    result = judged_case(Case("sign 0"))
    assert result.name == "robot file: sign 0" and result.wrong == ()
    assert len(ForkingPickler.dumps([*cases, result])) > 0


def test_a_pair_is_run() -> None:
    result = judged_case(Case("servo unplugged", "adapter unplugged", When.MOVING))
    assert result.name == "servo unplugged + adapter unplugged, moving"
    assert result.wrong == ()


def _wrong(cases: list[Case]) -> dict[str, tuple[str, ...]]:
    with ProcessPoolExecutor(JOBS, mp_context=get_context("spawn")) as pool:
        return {result.name: result.wrong for result in pool.map(judged_case, cases, chunksize=4) if result.wrong}


@pytest.mark.long
def test_every_pair_harms_nothing() -> None:
    assert _wrong(pair_cases()) == {}


@pytest.mark.long
def test_a_thousand_long_random_runs_harm_nothing() -> None:
    assert _wrong(seed_cases(range(1000), seconds=60.0)) == {}
