"""A robot with mass that is pushed: falls alone are recognised, and before the trunk meets the floor."""

import pytest

from benchmarks.falls import ASKED_S, Case, Outcome, run_case
from benchmarks.robustness import SYNTHETIC


def pushed(force: float, seed: int, robot: str = "op3") -> Outcome:
    return run_case(Case(robot, SYNTHETIC, 3.0, (force, force), seed))[0]


def test_a_fall_is_recognised_in_time() -> None:
    found = pushed(25.0, 1)
    assert found.recognised is not None and found.landed is not None
    assert found.landed - found.recognised >= ASKED_S


def test_a_robot_that_is_not_pushed_hard_follows_to_the_end() -> None:
    found = pushed(2.0, 1)
    assert not found.fell and found.recognised is None and found.landed is None and found.most_tilt_deg < 2.0


@pytest.mark.long
@pytest.mark.parametrize("robot", ["op3", "wolfgang"])
def test_falls_of_many_pushes(robot: str) -> None:
    found = [pushed(40.0 if robot == "wolfgang" else 20.0, seed, robot) for seed in range(12)]
    fell = [one for one in found if one.fell]
    assert len(fell) >= 6 and all(one.recognised is not None for one in fell)
    early = [one.landed - one.recognised for one in fell if one.landed is not None and one.recognised is not None]
    assert min(early) >= ASKED_S
    assert not [one for one in found if not one.fell and one.recognised is not None]
