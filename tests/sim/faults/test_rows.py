"""The fault table: every row in every state, streams and stops on the approach too; random runs; and a judge.

The first row of each reaction, moving and idle, is run always, in the most telling state: idle if no run may begin
with it, else moving. The others are marked `long` (also: `retarget faults`).
"""

from functools import cache
from typing import Any

import pytest

from hardware.guard_state import StopCause
from row_runs import wrongs
from sim.faults.cases import judged_seed
from sim.faults.judge import When
from sim.faults.rows import APPROACHED, ROWS, Idle, Reaction, Row


def states(one: Row) -> list[When]:
    """The states in which a row is run, the most telling one first."""
    first = When.IDLE if one.refusal else When.MOVING
    others = [when for when in When if when is not first]
    return [first, *(when for when in others if when is not When.APPROACHING or one in APPROACHED)]


@cache
def judged_as(name: str, when: When) -> list[tuple[dict[str, Any], tuple[str, ...]]]:
    """The violations of a run by the row itself, and by each claim of CLAIMS about it."""
    claims = [{}, *(claim for other, state, claim, _ in CLAIMS if (other, state) == (name, when))]
    return list(zip(claims, wrongs(name, when, claims), strict=True))


FIRST = {(one.reaction, one.idle): one.name for one in reversed(ROWS) if not one.alone}.values()
"""Rows that run in a few seconds: one that needs a robot for itself tries to get to rest for 24 s."""


@pytest.mark.parametrize(
    ("name", "when"),
    [
        pytest.param(one.name, when, marks=() if one.name in FIRST and when == states(one)[0] else pytest.mark.long)
        for one in ROWS
        for when in states(one)
    ],
)
def test_a_robot_does_what_it_has_to(name: str, when: When) -> None:
    assert judged_as(name, when)[0][1] == ()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_random_runs_harm_nothing(seed: int) -> None:
    verdict = judged_seed(seed, seconds=2.0)
    assert verdict.wrong == (), verdict.name


def test_names_are_once_and_without_commas() -> None:
    names = [one.name for one in ROWS]
    assert len(set(names)) == len(names) and not any("," in name for name in names)


IN_THE_WAY = ("operator stops it", When.APPROACHING)
CLAIMS: list[tuple[str, When, dict[str, Any], str]] = [
    ("stream silent", When.MOVING, {"reaction": Reaction.NONE}, "it reacted"),
    ("stream silent", When.MOVING, {"limit": 0.05}, "held after 0.1"),
    ("stream silent", When.MOVING, {"reaction": Reaction.STAND, "limit": -0.35}, "still moves"),
    ("stream silent for a while", When.MOVING, {"back": 0.8}, "it went on after"),
    ("second source", When.MOVING, {"reaction": Reaction.STOP}, "not latched"),
    ("second source", When.MOVING, {"reaction": Reaction.REBASE}, "not rebased"),
    ("second source", When.MOVING, {"said": "Elvis"}, "no message says"),
    ("second source", When.MOVING, {"counted": "Elvis"}, "nothing was counted as 'Elvis'"),
    ("second source", When.MOVING, {"when": When.IDLE, "idle": Idle.REFUSES}, "it began"),
    (*IN_THE_WAY, {"reaction": Reaction.HOLD}, "not held"),
    (*IN_THE_WAY, {"reaction": Reaction.NONE}, "it reacted"),
    (*IN_THE_WAY, {"reaction": Reaction.TORQUE_OFF, "limit": 0.005}, "torque off after"),
    ("wrist lost", When.MOVING, {"limit": 0.05}, "left out after 0.1"),
    ("servo warm", When.MOVING, {"limit": 0.1}, "slow after"),
    ("operator stops it", When.MOVING, {"ends": 0.1}, "it ended after"),
    ("operator stops it", When.MOVING, {"watchdog": 0.05}, "20 servos still drove"),
    (
        "operator stops it",
        When.MOVING,
        {"when": When.STOPPING, "reaction": Reaction.TORQUE_OFF, "limit": 0.05},
        "torque",
    ),
    ("servo too hot", When.IDLE, {"idle": Idle.ONLY_READS}, "instruction 0x"),
    ("wrong model", When.IDLE, {"refusal": ("r_hip_roll", "Elvis")}, "does not name 'Elvis'"),
    ("kill -9", When.MOVING, {"watchdog": 0.02}, "20 servos still drove"),
    ("adapter unplugged", When.MOVING, {"reaction": Reaction.HOLD}, "it stopped"),
    ("adapter unplugged", When.MOVING, {"cause": StopCause.BUS_SILENT}, "cause is bus, not bus silent"),
    ("stopped for a second", When.MOVING, {"then": StopCause.BUS}, "cause is servo limp, not bus"),
    ("bus silent for 40 ms", When.MOVING, {"held": 0.005}, "held after 0.0"),
]
"""Rows with a wrong claim, and the violation that the judge must find."""


@pytest.mark.long
@pytest.mark.parametrize(("name", "when", "claimed", "expected"), CLAIMS)
def test_the_judge_says_no(name: str, when: When, claimed: dict[str, Any], expected: str) -> None:
    wrong = next(lines for claim, lines in judged_as(name, when) if claim == claimed)
    assert any(expected in line for line in wrong), wrong
