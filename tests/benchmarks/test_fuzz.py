"""Whole files of the corpus are read; damaged ones are read or refused. More of them: `make fuzz`."""

from pathlib import Path

import pytest

from benchmarks.fuzz import Outcome, corpus, try_case

CASES = 300


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_damaged_files_are_read_or_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds, done = corpus(tmp_path), Outcome()
    for kind in kinds:
        for content in kind.files:
            path = tmp_path / f"whole{kind.suffix}"
            path.write_bytes(content)
            kind.read(path)
    monkeypatch.chdir(tmp_path)
    for number in range(CASES):
        done += try_case(kinds, number, seed=0, folder=tmp_path)
    assert not done.failed and CASES // 4 < done.refused < CASES
