"""The fault table: every row in every state, streams and stops on the approach too; random runs; and a judge.

Each row is run always in the state that tells most: idle if no run may begin with it, else moving. The rest takes
minutes and is marked `long` (also: `retarget faults`).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import inf
from typing import Any
from unittest.mock import patch

import pytest

from hardware import servo_health
from hardware.guard_state import GuardLimits, StopCause
from hardware.servo_health import ANYTHING, BusHealth, ServoHealth, Watched, watched
from hardware.servo_health import Row as Quantity
from messages import shows
from retarget.live.admission import Admission
from retarget.live.performer import LivePerformer
from row_runs import row, wrongs
from sim.faults.bench import BEFORE_ARMING, Bench
from sim.faults.cases import judged_seed
from sim.faults.judge import When, judged
from sim.faults.reactions import Idle, Reaction, Row
from sim.faults.rows import APPROACHED, ROWS


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


TOLD = [(one.name, states(one)[0]) for one in ROWS]
OTHERS = [(one.name, when) for one in ROWS for when in states(one)[1:]]


@pytest.mark.parametrize(("name", "when"), TOLD, ids=[f"{name}-{when.value}" for name, when in TOLD])
def test_a_robot_does_what_it_has_to(name: str, when: When) -> None:
    assert judged_as(name, when)[0][1] == ()


@pytest.mark.long
@pytest.mark.parametrize(("name", "when"), OTHERS, ids=[f"{name}-{when.value}" for name, when in OTHERS])
def test_a_robot_in_another_state_does_what_it_has_to(name: str, when: When) -> None:
    assert judged_as(name, when)[0][1] == ()


@pytest.mark.parametrize("seed", range(2))
def test_random_runs_harm_nothing(seed: int) -> None:
    verdict = judged_seed(seed, seconds=2.0)
    assert verdict.wrong == (), verdict.name


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 20))
def test_more_random_runs_harm_nothing(seed: int) -> None:
    verdict = judged_seed(seed, seconds=2.0)
    assert verdict.wrong == (), verdict.name


@pytest.mark.parametrize("name", ["second source", "unlisted source"])
def test_following_another_sender_is_found(name: str) -> None:
    """Another sender sends positions that are far off, and only its address differs."""
    with patch.object(Admission, "admit", return_value=True), patch.object(Admission, "confirm", return_value=True):
        wrong = judged(row(name)).wrong
    shows(wrong)
    shows(wrong)


def test_names_are_once() -> None:
    assert len({one.name for one in ROWS}) == len(ROWS)


CLAIMS: list[tuple[str, When, dict[str, Any], str]] = [
    ("stream silent", When.MOVING, {"reaction": Reaction.NONE}, "it reacted"),
    ("stream silent", When.MOVING, {"limit": 0.05}, "held after 0.1"),
    ("stream silent", When.MOVING, {"reaction": Reaction.STAND, "limit": -0.35}, "still moves"),
    ("stream silent for a while", When.MOVING, {"back": 0.8}, "it went on after"),
    ("second source", When.MOVING, {"reaction": Reaction.STOP}, "not latched"),
    ("second source", When.MOVING, {"reaction": Reaction.REBASE}, "not rebased"),
    ("second source", When.MOVING, {"said": "Elvis"}, "no message says"),
    ("second source", When.MOVING, {"counted": "Elvis"}, "nothing was counted as 'Elvis'"),
    ("second source", When.IDLE, {"idle": Idle.REFUSES}, "it began"),
    ("second source", When.APPROACHING, {"reaction": Reaction.HOLD}, "not held"),
    ("stream silent", When.APPROACHING, {"reaction": Reaction.NONE}, "it reacted"),
    ("person stops it", When.APPROACHING, {"reaction": Reaction.TORQUE_OFF, "limit": 0.005}, "torque off after"),
    ("wrist lost", When.MOVING, {"limit": 0.05}, "left out after 0.1"),
    ("servo warm", When.MOVING, {"limit": 0.1}, "slow after"),
    ("person stops it", When.MOVING, {"ends": 0.1}, "it ended after"),
    ("person stops it", When.MOVING, {"watchdog": 0.05}, "20 servos still drove"),
    ("person stops it", When.STOPPING, {"reaction": Reaction.TORQUE_OFF, "limit": 0.05}, "torque off after"),
    ("servo too hot", When.IDLE, {"idle": Idle.ONLY_READS}, "instruction 0x"),
    ("wrong model", When.IDLE, {"refusal": ("r_hip_roll", "Elvis")}, "does not name 'Elvis'"),
    ("kill -9", When.MOVING, {"watchdog": 0.02}, "20 servos still drove"),
    ("adapter unplugged", When.MOVING, {"reaction": Reaction.HOLD}, "it stopped"),
    ("adapter unplugged", When.MOVING, {"cause": StopCause.BUS_SILENT}, "cause is bus, not bus silent"),
    ("stopped for a second", When.MOVING, {"then": StopCause.BUS}, "cause is servo limp, not bus"),
    ("bus silent for 40 ms", When.MOVING, {"held": 0.005}, "held after 0.01"),
]
"""Rows that claim something else than is so, and what the judge must say to that."""


@pytest.mark.parametrize(("name", "when", "claimed", "expected"), CLAIMS)
def test_the_judge_says_no(name: str, when: When, claimed: dict[str, Any], expected: str) -> None:
    wrong = next(lines for claim, lines in judged_as(name, when) if claim == claimed)
    assert any(expected in line for line in wrong), wrong


def unwatched(quantity: Quantity) -> Callable[[GuardLimits], tuple[Watched, ...]]:
    """The watched quantities, without bounds for one of them."""

    def without(limits: GuardLimits) -> tuple[Watched, ...]:
        rows = list(watched(limits))
        rows[quantity] = replace(rows[quantity], stop=ANYTHING)
        return tuple(rows)

    return without


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("stopped for a second", Quantity.LIMP),
        ("reset of a servo, soon back", Quantity.LIMP),
        ("brown-out of a servo", Quantity.AGE),
        ("supply of a servo too low", Quantity.VOLTAGE),
    ],
    ids=lambda one: getattr(one, "name", one),
)
def test_a_row_fails_without_its_protection(name: str, quantity: Quantity) -> None:
    with patch.object(servo_health, "watched", unwatched(quantity)):
        shows(judged(row(name)).wrong)


def test_a_stopped_host_is_distinguished_from_a_limp_servo() -> None:
    one = row("stopped for a second")

    def with_any_pause(bench: Bench, at: float) -> None:
        def allow() -> None:
            bench.guard.limits = replace(bench.guard.limits, max_pause=inf)

        bench.at(BEFORE_ARMING, allow)
        one.inject(bench, at)

    shows(judged(replace(one, inject=with_any_pause)).wrong)


def test_a_robot_that_does_not_hold_while_the_bus_is_silent_is_found() -> None:
    with patch.object(ServoHealth, "silent_for", lambda self, states: 0.0):
        shows(judged(row("bus silent for 40 ms")).wrong)


def test_a_bus_that_stays_silent_unseen_is_found() -> None:
    with patch.object(BusHealth, "silence", lambda self, states: None):
        shows(judged(row("bus silent for 70 ms")).wrong)


def test_sides_that_are_swapped_must_be_noticed() -> None:
    with patch.object(LivePerformer, "_is_good", lambda self, heard, now: True):
        shows(judged(row("left and right swapped")).wrong)
