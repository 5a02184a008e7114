"""The fault table: every row in every state, streams and stops on the approach too; random runs; and a judge."""

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import pytest

from messages import shows
from retarget.live.admission import Admission
from sim.faults.bench import Bench
from sim.faults.cases import judged_seed
from sim.faults.judge import When, judged, run_row, verdict_of
from sim.faults.reactions import Idle, Reaction, Row
from sim.faults.rows import APPROACHED, ROWS


def row(name: str) -> Row:
    return next(one for one in ROWS if one.name == name)


RUNS = [(one, when) for one in ROWS for when in When if when is not When.APPROACHING or one in APPROACHED]


@pytest.mark.parametrize(("one", "when"), RUNS, ids=[f"{one.name}-{when.value}" for one, when in RUNS])
def test_the_robot_does_what_it_has_to(one: Row, when: When) -> None:
    verdict = judged(one, when=when)
    assert verdict.wrong == ()


@pytest.mark.parametrize("seed", range(10))
def test_random_runs_harm_nothing(seed: int) -> None:
    verdict = judged_seed(seed, seconds=2.0)
    assert verdict.wrong == (), verdict.row


@pytest.mark.parametrize("name", ["second source", "unlisted source"])
def test_following_another_sender_is_found(name: str) -> None:
    """Another sender sends positions that are far off, and only its address differs."""
    with patch.object(Admission, "admit", return_value=True), patch.object(Admission, "confirm", return_value=True):
        wrong = judged(row(name)).wrong
    shows(wrong)
    shows(wrong)


@cache
def ran(name: str, when: When) -> Bench:
    return run_row(row(name), when=when)


def test_names_are_once() -> None:
    assert len({one.name for one in ROWS}) == len(ROWS)


@pytest.mark.parametrize(
    ("name", "when", "claimed", "expected"),
    [
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
    ],
)
def test_the_judge_says_no(name: str, when: When, claimed: dict[str, object], expected: str) -> None:
    verdict = verdict_of(replace(row(name), **claimed), ran(name, when), when=when)  # type: ignore[arg-type]
    assert any(expected in line for line in verdict.wrong), verdict.wrong
