"""The benchmarks of a robot with mass run, and their numbers mean what they say."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import robustness
from benchmarks.physics_runs import Stood
from benchmarks.robustness import Case, append, read, run_all


@pytest.mark.long
def test_every_case_is_played_in_order() -> None:
    cases = [Case("op3", "synthetic", 1.0, 0.05, perturbation, 1) for perturbation in ("none", "push")]
    ends = list(run_all(cases, jobs=1))
    assert [(end.perturbation, end.seed) for end in ends] == [("none", 1), ("push", 1)]
    assert ends[0].fallen_at is None


def test_runs_that_are_kept_are_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, made = tmp_path / "kept.jsonl", list[Case]()
    stood = Stood("push", 0, None, "", False, "", 12.5, 0.5, 0.1)
    first = Case("op3", "synthetic", 0.5, None, "push", 0)
    append(kept, first, stood)

    def run_case(case: Case) -> Stood:
        made.append(case)
        return replace(stood, seed=case.seed, fallen_at=1.5)

    monkeypatch.setattr(robustness, "run_case", run_case)
    words = ["--source", "synthetic", "--perturb", "push", "--seeds", "2", "--jobs", "1", "--keep", str(kept)]
    monkeypatch.setattr(sys, "argv", ["robustness", *words])
    robustness.main()
    assert made == [replace(first, seed=1)]
    assert "1 of 2" in capsys.readouterr().out
    assert read(kept) == {first: stood, made[0]: replace(stood, seed=1, fallen_at=1.5)}
