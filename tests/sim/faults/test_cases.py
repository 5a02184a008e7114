"""The cases of `retarget faults`, and its command line; pairs and long random runs, which take hours."""

from collections.abc import Iterable
from multiprocessing.reduction import ForkingPickler

import pytest

from messages import shows
from retarget import cli
from sim.faults import cases
from sim.faults.cases import LIVE, Case, judged_case, pair_cases, row_cases, seed_cases
from sim.faults.judge import Verdict, When
from sim.faults.rows import APPROACHED, ROWS


def test_every_pair_is_there_once_in_every_state() -> None:
    pairs = pair_cases()
    assert len(pairs) == len(set(pairs)) == 3 * len(LIVE) * (len(LIVE) + 1) // 2
    assert len(row_cases()) == 3 * len(ROWS) + len(APPROACHED)


@pytest.mark.long
def test_cases_and_results_can_go_to_another_process() -> None:
    every = [Case("second source", when=When.IDLE), Case("flood"), *seed_cases(range(2), seconds=1.0)]
    found = [
        judged_case(Case("servo too hot", when=When.IDLE)),
        judged_case(Case("servo unplugged", "adapter unplugged", When.IDLE)),
    ]
    assert [one.name for one in found] == ["servo too hot, idle", "servo unplugged + adapter unplugged, idle"]
    assert all(one.wrong == () for one in found)
    assert len(ForkingPickler.dumps([*every, *found])) > 0


def wrong(cases: Iterable[Case]) -> dict[str, tuple[str, ...]]:
    return {result.name: result.wrong for result in map(judged_case, cases) if result.wrong}


PAIRS_A_TEST, SEEDS_A_TEST = 40, 4
"""Runs of one test: together they take a minute."""


@pytest.mark.long
@pytest.mark.parametrize("first", range(0, len(pair_cases()), PAIRS_A_TEST))
def test_every_pair_harms_nothing(first: int) -> None:
    assert wrong(pair_cases()[first : first + PAIRS_A_TEST]) == {}


@pytest.mark.long
@pytest.mark.parametrize("first", range(0, 1000, SEEDS_A_TEST))
def test_a_thousand_long_random_runs_harm_nothing(first: int) -> None:
    assert wrong(seed_cases(range(first, first + SEEDS_A_TEST), seconds=60.0)) == {}


def leave(*words: str) -> object:
    with pytest.raises(SystemExit) as leaving:
        cli.main(["faults", *words])
    return leaving.value.code


def test_the_table_is_listed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert leave("--list") == 0
    shown = capsys.readouterr().out
    assert all(row.name in shown for row in ROWS)


def test_one_row_is_run_in_all_states(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def judged(case: Case) -> Verdict:
        """A verdict on an idle robot; the others take seconds, and are made up."""
        if case.when is When.IDLE:
            return judged_case(case)
        return Verdict(f"{case.name}, {case.when.value}", (), 0.048 if case.when is When.MOVING else None)

    monkeypatch.setattr(cases, "judged_case", judged)
    assert leave("--row", "servo unplugged") == 0
    shown = capsys.readouterr().out
    assert [line.split(",")[1].split()[0] for line in shown.splitlines()[:3]] == ["idle", "moving", "stopping"]
    shows(shown, 3)


def test_a_violation_is_reported(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "judged_case", lambda case: Verdict("seed 5: x", ("on fire",)))
    assert leave("--no-rows", "--seeds", "1", "--first-seed", "5", "--seconds", "1") == 1
    assert capsys.readouterr().out == "BAD seed 5: x\n    on fire\n1 of 1 bad\n"


def test_an_unknown_row_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert leave("--row", "servo unpluged") == 2
    shows(capsys.readouterr().err)
