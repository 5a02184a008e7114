"""The benchmarks of a robot with mass run, and their numbers mean what they say."""

from benchmarks.robustness import Case, run_all


def test_every_case_is_played_in_order() -> None:
    cases = [Case("op3", "synthetic", 1.0, 0.05, perturbation, 1) for perturbation in ("none", "push")]
    ends = list(run_all(cases, jobs=1))
    assert [(end.perturbation, end.seed) for end in ends] == [("none", 1), ("push", 1)]
    assert ends[0].fallen_at is None
