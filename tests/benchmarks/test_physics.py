"""The benchmarks of a robot with mass run, and their numbers mean what they say."""

import pytest

from benchmarks.physics import show as show_costs
from benchmarks.physics_runs import Stood, cost_of_run
from benchmarks.robustness import Case, row, run_all
from retarget.human.samples import Playback
from retarget.run.options import RunOptions
from sim.performer import synthetic_performer


def test_a_cost_adds_up(capsys: pytest.CaptureFixture[str]) -> None:
    options = RunOptions(robot="op3", bus="physics", playback=Playback(end=0.2))
    cost = cost_of_run("a bit", synthetic_performer(), options)
    assert cost.seconds == pytest.approx(cost.ticks * 0.008) and cost.real_time == pytest.approx(
        cost.seconds / cost.cpu_s
    )
    parts = cost.physics_us + cost.human_us + cost.robot_us + cost.rest_us
    assert parts == pytest.approx(cost.tick_us) and min(cost.physics_us, cost.robot_us, cost.rest_us) > 0.0
    assert cost.tick_us * cost.ticks == pytest.approx(1e6 * cost.cpu_s)
    show_costs([cost])
    assert "| a bit |" in capsys.readouterr().out


def test_every_case_is_played_in_order() -> None:
    cases = [Case("op3", "synthetic", 1.0, 0.05, perturbation, 1) for perturbation in ("none", "push")]
    ends = list(run_all(cases, jobs=1))
    assert [(end.perturbation, end.seed) for end in ends] == [("none", 1), ("push", 1)]
    assert ends[0].fallen_at is None


def ended(seed: int, fallen_at: float | None, *, late: bool = False, stopped: str = "") -> Stood:
    return Stood("push", seed, fallen_at, "", late, stopped, 3.0 - seed, 1.0 * seed, 0.5)


def test_a_row_counts_who_stands() -> None:
    fell = [ended(1, 4.25), ended(2, 9.0, late=True), ended(3, 8.0, late=True, stopped="a servo")]
    cells = row("push", [ended(0, None), *fell])
    assert cells == ["push", "1 of 4", "1", "1", "1", "1", "0.0", "3.0", "0.5", "4.2 (1), 9.0 (2), 8.0 (3)"]
