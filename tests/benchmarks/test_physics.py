"""The benchmarks of a robot with mass run, and their numbers mean what they say."""

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks import reports, robustness, stops
from benchmarks.kept import add_kept, read_kept, run_cases
from benchmarks.physics_runs import Stood
from benchmarks.robustness import Case
from sim.performer import synthetic_performer


@pytest.mark.long
def test_every_case_is_played_in_order() -> None:
    cases = [Case("op3", "synthetic", 1.0, 0.05, perturbation, 1) for perturbation in ("none", "push")]
    ends = [end for ends in run_cases(cases, robustness.run_case, Stood, jobs=1, keep=None).values() for end in ends]
    assert [(end.perturbation, end.seed) for end in ends] == [("none", 1), ("push", 1)]
    assert ends[0].fallen_at is None


def test_runs_that_are_kept_are_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, made = tmp_path / "kept.jsonl", list[Case]()
    stood = Stood("push", 0, None, "", False, "", 12.5, 0.5, 0.1)
    first = Case("op3", "synthetic", 0.5, None, "push", 0)
    add_kept(kept, first, [stood])

    def run_case(case: Case) -> list[Stood]:
        made.append(case)
        return [replace(stood, seed=case.seed, fallen_at=1.5)]

    monkeypatch.setattr(robustness, "run_case", run_case)
    words = ["--source", "synthetic", "--perturb", "push", "--seeds", "2", "--jobs", "1", "--keep", str(kept)]
    monkeypatch.setattr(sys, "argv", ["robustness", *words])
    robustness.main()
    assert made == [replace(first, seed=1)]
    assert "1 of 2" in capsys.readouterr().out
    assert read_kept(kept, Case, Stood) == {first: [stood], made[0]: [replace(stood, seed=1, fallen_at=1.5)]}


def test_a_report_is_kept_and_its_row_has_a_cell_for_each_head(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    limbs = {limb: {"mean": 3.0} for limb in ("upper_arms", "forearms", "thighs", "shanks")}
    stands = {"sole_tilt_max_deg": 0.5, "foot_slip_mm": {"total": 1.5}}
    report = {"physics": stands, "fallen": False, "hand_path_ratio": 1.0, "lag_s": 0.1, "likeness_deg": limbs}
    report |= {"trunk_lean_deg": {"mean": 2.0}, "reachable_hands_mm": {"worse": 9.0}, "gated_frames": 1, "ticks": 8}
    for file in reports.IN_PLACE:
        (tmp_path / file).touch()
    monkeypatch.setattr(reports, "report_of", lambda run: [reports.Found(report)])
    monkeypatch.setattr(sys, "argv", ["reports", "robots", "--mocap", str(tmp_path), "--keep", str(tmp_path / "kept")])
    reports.main()
    table = capsys.readouterr().out
    assert table.count("| no | 0.5 | 1.5 | 1.00 | 0.10 | 3.0 | 3.0 | 3.0 | 3.0 | 2.0 | 9 | 12.50 |") == 32
    monkeypatch.setattr(reports, "report_of", lambda run: pytest.fail("it is kept"))
    reports.main()
    assert capsys.readouterr().out == table


CALM = stops.Case("op3", robustness.SYNTHETIC, None, "planned", 3, 2.0, 5, disturbed=True, own_loop=True)


def test_disturbances_come_within_the_motion_and_move_wrists_and_head() -> None:
    frames = synthetic_performer()
    found = stops.disturbances(replace(CALM, end=1000.0), frames)
    assert {one.kind for one in found} == {stops.LOST, stops.JUMP}
    assert all(before.end < after.begin for before, after in pairwise(found)) and found[-1].begin < frames.duration_s
    moved = (stops.disturb(CALM, frames, found).position != frames.position).any(axis=2)
    jumps = [(frames.time >= one.begin) & (frames.time < one.end) for one in found if one.kind == stops.JUMP]
    assert {name for name, ever in zip(frames.names, moved.any(axis=0), strict=True) if ever} == {
        *("head", "l_wrist", "r_wrist")
    }
    assert (moved.any(axis=1) == np.any(jumps, axis=0)).all()
    assert stops.disturbances(replace(CALM, disturbed=False), frames) == []


@pytest.mark.long
@pytest.mark.parametrize("own_loop", [False, True])
def test_each_stop_is_a_child_of_its_run(own_loop: bool) -> None:
    case = replace(CALM, own_loop=own_loop, stops=2, disturbed=False, seed=1)
    motion, *ends = stops.run_case(case)
    assert motion.kind == stops.MOTION and [end.kind for end in ends] == [stops.FOLLOW] * 2
    assert all(end.at < motion.at and end.before == "follow" for end in ends)
    for end in (motion, *ends):
        assert end.state == ("standing" if own_loop else "off") and not end.how and not end.touched
        assert end.stands_s is not None and 0.0 < end.stands_s < 0.5 < end.ends_s
        assert 0.0 <= end.slid_mm <= end.rest_slid_mm < 2.0 and end.lifted_mm < 2.0
    assert motion.on_slid_mm is None and all(end.on_slid_mm is not None for end in ends)
    assert stops.run_case(case) == [motion, *ends]
