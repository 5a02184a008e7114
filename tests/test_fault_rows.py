"""The fault table, whole: every row idle, moving and stopping; random pairs; and a judge that can say no."""

from dataclasses import replace

import pytest

from sim.faults.judge import When, judged
from sim.faults.rows import ROWS, Reaction, Row
from sim.faults.seeds import judged_seed


def row(name: str) -> Row:
    return next(one for one in ROWS if one.name == name)


@pytest.mark.parametrize("when", list(When))
@pytest.mark.parametrize("one", ROWS, ids=lambda one: one.name)
def test_the_robot_does_what_it_has_to(one: Row, when: When) -> None:
    verdict = judged(one, when=when)
    assert verdict.wrong == ()


@pytest.mark.parametrize("seed", range(10))
def test_random_pairs_harm_nothing(seed: int) -> None:
    assert judged_seed(seed).wrong == ()


@pytest.mark.parametrize(
    ("name", "claimed", "limit", "told"),
    [
        ("stream silent", Reaction.NONE, 0.0, "it reacted"),
        ("second source", Reaction.HOLD, 0.1, "not held"),
        ("second source", Reaction.STOP, 0.1, "not latched"),
        ("stream silent", Reaction.HOLD, 0.05, "held after 0.1"),
        ("wrist lost", Reaction.OUT, 0.05, "left out after 0.1"),
        ("flood", Reaction.OUT, 0.3, "not left out"),
    ],
)
def test_the_judge_says_no(name: str, claimed: Reaction, limit: float, told: str) -> None:
    verdict = judged(replace(row(name), reaction=claimed, limit=limit, sensor="l_wrist"))
    assert any(told in line for line in verdict.wrong)


@pytest.mark.long
@pytest.mark.parametrize("first", range(0, 1000, 50))
def test_many_random_pairs_harm_nothing(first: int) -> None:
    for seed in range(first, first + 50):
        assert judged_seed(seed).wrong == (), seed
