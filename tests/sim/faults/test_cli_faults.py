"""`retarget faults` from the command line."""

import pytest

from messages import shows
from retarget import cli
from sim.faults.judge import Verdict
from sim.faults.malformed_files import MALFORMED
from sim.faults.rows import ROWS


def leave(*words: str) -> object:
    with pytest.raises(SystemExit) as leaving:
        cli.main(["faults", *words])
    return leaving.value.code


def test_the_table_is_listed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert leave("--list") == 0
    shown = capsys.readouterr().out
    assert all(row.name in shown for row in ROWS)
    assert all(file.name in shown for file in MALFORMED)


def test_one_row_is_run_in_all_states(capsys: pytest.CaptureFixture[str]) -> None:
    assert leave("--row", "servo unplugged") == 0
    shown = capsys.readouterr().out
    assert [line.split(",")[1].split()[0] for line in shown.splitlines()[:3]] == ["idle", "moving", "stopping"]
    shows(shown, 3)


def test_a_violation_is_reported(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    from sim.faults import cases

    monkeypatch.setattr(cases, "judged_case", lambda case: Verdict("seed 5: x", ("on fire",)))
    assert leave("--no-rows", "--seeds", "1", "--first-seed", "5", "--seconds", "1") == 1
    assert capsys.readouterr().out == "BAD seed 5: x\n    on fire\n1 of 1 bad\n"


def test_an_unknown_row_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert leave("--row", "servo unpluged") == 2
    shows(capsys.readouterr().err)
