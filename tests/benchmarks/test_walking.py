"""A robot with mass walks through the whole program."""

from benchmarks.robustness import SYNTHETIC
from benchmarks.walking import Case, run_case


def test_it_walks_stops_and_still_stands() -> None:
    """With noise, play, a late bus and masses that are not those of the plan."""
    (found,) = run_case(Case("op3", SYNTHETIC, seconds=9.0, seed=7, forward=0.1))
    assert found.stood and not found.reason
    assert found.steps >= 4 and found.slip < 0.002 and found.sway < 0.1
    assert found.gated < 0.1
