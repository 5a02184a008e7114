"""The benchmark of stability compares a run with itself, and names the ticks that are far off."""

import numpy as np

from benchmarks.robustness import SYNTHETIC
from benchmarks.stability import LIMITS_MM, Case, named, run_case


def test_noise_is_measured_from_the_run_without() -> None:
    clean, little, much = run_case(Case("op3", SYNTHETIC, 0.5, 1))
    assert [one.noise_mm for one in (clean, little, much)] == [*LIMITS_MM]
    assert max(clean.off_mm) == 0.0 < little.off_mm[0] < much.off_mm[0]
    assert clean.ticks == little.ticks == much.ticks > 50 and clean.jerk_p95 < much.jerk_p95
    for one in (clean, little, much):
        assert list(one.off_mm) == sorted(one.off_mm)
        assert 0.0 <= one.accelerating <= 1.0 and one.gated == 0.0


def test_ticks_that_are_far_off_are_named_by_spans() -> None:
    off = np.zeros((40, 2))
    off[5:8, 0], off[9, 1], off[30, 0] = 6.0, 8.4, 7.0
    assert named(off, 5.0, ("hand", "head"), 4) == ("5-9: head 8 mm", "30-30: hand 7 mm")
    assert named(off, 10.0, ("hand", "head"), 4) == ()
