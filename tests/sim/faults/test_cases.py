"""What `retarget faults` may run, as data, and its command line; pairs and long random runs, which take hours."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.reduction import ForkingPickler
from pathlib import Path

import pytest

from hardware.dynamixel.serial_port import SerialPort
from messages import shows
from retarget import cli
from retarget.cli.exit import REFUSED
from retarget.schema.catalogue import Kind, find
from sim.faults import cases
from sim.faults.cases import Case, file_cases, judged_case, pair_cases, row_cases, seed_cases
from sim.faults.judge import Verdict, When
from sim.faults.malformed_files import MALFORMED, Malformed, judged_file
from sim.faults.rows import APPROACHED, ROWS

JOBS = max((os.cpu_count() or 1) - 1, 1)


def test_every_pair_is_there_once_in_every_state() -> None:
    pairs = pair_cases()
    assert len(pairs) == len(set(pairs)) == 3 * len(ROWS) * (len(ROWS) + 1) // 2
    assert len(row_cases()) == 3 * len(ROWS) + len(APPROACHED)
    assert len(file_cases()) == len(MALFORMED) == len({one.name for one in MALFORMED}) == 30


def test_cases_and_results_can_go_to_another_process() -> None:
    every = [Case("second source", when=When.IDLE), Case("empty"), *seed_cases(range(2), seconds=1.0)]
    found = [judged_case(Case("sign 0")), judged_case(Case("servo unplugged", "adapter unplugged", When.IDLE))]
    assert [one.name for one in found] == ["robot file: sign 0", "servo unplugged + adapter unplugged, idle"]
    assert all(one.wrong == () for one in found)
    assert len(ForkingPickler.dumps([*every, *found])) > 0


def _wrong(cases: list[Case]) -> dict[str, tuple[str, ...]]:
    with ProcessPoolExecutor(JOBS, mp_context=get_context("spawn")) as pool:
        return {result.name: result.wrong for result in pool.map(judged_case, cases, chunksize=4) if result.wrong}


def test_limbs_that_press_together_do_not_keep_a_stop_from_its_end() -> None:
    """The return to stance ends as near to it as they come."""
    verdict = judged_case(Case("clearance below margin", "person stops it", When.MOVING))
    assert verdict.wrong == (), verdict.name


@pytest.mark.long
def test_every_pair_harms_nothing() -> None:
    assert _wrong(pair_cases()) == {}


@pytest.mark.long
def test_a_thousand_long_random_runs_harm_nothing() -> None:
    assert _wrong(seed_cases(range(1000), seconds=60.0)) == {}


def leave(*words: str) -> object:
    with pytest.raises(SystemExit) as leaving:
        cli.main(["faults", *words])
    return leaving.value.code


def test_the_table_is_listed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert leave("--list") == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in [*(row.name for row in ROWS), *(file.name for file in MALFORMED)])


def test_one_row_is_run_in_all_states(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert leave("--row", "robot file: sign 0") == 0
    shows(capsys.readouterr().out)

    def judged(case: Case) -> Verdict:
        assert case.when is not None
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


# Malformed robot files from the command line: exit code 2, one message, and no port is opened.


@pytest.mark.parametrize("file", MALFORMED, ids=lambda one: one.name)
def test_a_malformed_file_is_refused(
    file: Malformed, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[int] = []
    monkeypatch.setattr(SerialPort, "open", lambda self, baud: opened.append(baud))
    path = file.write(find(Kind.ROBOT, "op3"), tmp_path)
    words = ["run", "--robot", str(path), "--source", "json://127.0.0.1:14150", "--bus", str(tmp_path / "port")]
    with pytest.raises(SystemExit) as leaving:
        cli.main(words)
    message = capsys.readouterr().err
    assert (leaving.value.code, opened) == (REFUSED, [])
    assert message.startswith("error: ") and file.reason in message
    assert "Traceback" not in message


def test_the_judge_says_no(tmp_path: Path) -> None:
    sound = Malformed("sound", lambda text, folder: text, "")
    assert judged_file(sound) == ("the run went on",)
    other = Malformed("other", lambda text, folder: b"", "Elvis")
    shows(judged_file(other)[0], "'Elvis'")

    def raising(text: bytes, folder: Path) -> bytes:
        (folder / "body.xml").unlink()
        (folder / "body.xml").mkdir()
        return text

    assert judged_file(Malformed("folder", raising, "a folder")) == ()
