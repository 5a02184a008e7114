"""Two faults in one run: a missing reaction is found; the stronger of two is required, and by when."""

from unittest.mock import patch

import pytest

from messages import shows
from retarget.live.performer import LivePerformer
from retarget.types import RunState
from row_runs import always, pair_wrongs, row
from sim.faults.bench import Tick, Trace
from sim.faults.cases import judged_seed
from sim.faults.judge import least, outdone, reached
from sim.faults.rows import Reaction

BLIND_SEED = 11
"""A random run whose harsh fault is one of the stream."""
BLIND = always(LivePerformer, True, "_is_good")
"""Sensor validity that accepts everything."""


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("stream silent", "wrist frozen", "stream silent: not held in time"),
        ("left and right swapped", "deadline missed", "left and right swapped: not held in time"),
    ],
)
def test_a_missing_reaction_to_two_faults_is_found(first: str, second: str, expected: str) -> None:
    assert expected in pair_wrongs(first, second, gap=0.05, before=BLIND)


def test_a_random_run_without_a_reaction_is_found() -> None:
    with patch.object(LivePerformer, "_is_good", lambda self, heard, now: True):
        shows(judged_seed(BLIND_SEED, seconds=1.0).wrong)


@pytest.mark.parametrize("gap", [0.0, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("names", [("wrist lost", "left and right swapped"), ("left and right swapped", "wrist lost")])
def test_a_wrist_that_is_lost_and_sides_that_change_places_are_a_swap(names: tuple[str, str], gap: float) -> None:
    """The sensor that is sent is where the other was: the robot must not follow it."""
    assert pair_wrongs(*names, gap=gap) == ()


@pytest.mark.parametrize(
    ("first", "second", "reaction", "limit"),
    [
        ("stream silent", "servo unplugged", Reaction.STOP, 0.1),
        ("servo unplugged", "stream silent", Reaction.STOP, 0.1),
        ("adapter unplugged", "servo unplugged", Reaction.TORQUE_OFF, 0.05),
        ("kill -9", "adapter unplugged", Reaction.GONE, 0.12),
        ("wrist lost", "servo warm", Reaction.SLOW, 1.1),
        ("wrist lost", "second source", Reaction.OUT, 0.3),
        ("stream silent", "ankle lost", Reaction.HOLD, 0.3),
        ("stream silent for ever", "wrist lost", Reaction.HOLD, 0.15),
        ("deadline missed", "30 % of answers damaged", Reaction.STOP, 0.44),
        ("deadline missed", "stream silent for a while", Reaction.HOLD, 0.33),
        ("30 % of packets damaged", "stream silent", Reaction.STOP, 0.2),
        ("servo warm", "servo too hot", Reaction.STOP, 1.1),
        ("servo too hot", "servo warm", Reaction.SLOW, 1.1),
        ("wrist lost", "left and right swapped", Reaction.HOLD, 0.1),
        ("left and right swapped", "wrist lost", Reaction.HOLD, 0.1),
        ("servo unplugged", "stopped for a second", Reaction.STOP, 2.04),
    ],
)
def test_the_stronger_of_two_is_asked_for(first: str, second: str, reaction: Reaction, limit: float) -> None:
    need = outdone(row(first), row(second), apart=0.05)
    assert need.reaction is reaction and need.limit == pytest.approx(limit)


def seen(*states: tuple[float, RunState, bool]) -> Trace:
    """Ticks: time (s), state, whether a stop is latched."""
    return Trace(ticks=[Tick(time, state, latched, 1.0) for time, state, latched in states], torque=[1, 1])


MOVING, HOLDING, STOPPING = RunState.FOLLOW, RunState.HOLD, RunState.STOPPING


@pytest.mark.parametrize(
    ("name", "trace", "came"),
    [
        ("stream silent", seen((1.0, MOVING, False), (1.1, MOVING, False)), False),
        ("stream silent", seen((1.0, MOVING, False), (1.1, HOLDING, False)), True),
        ("stream silent", seen((0.5, HOLDING, False), (1.1, MOVING, False)), False),
        ("stream silent", seen((1.3, HOLDING, False)), False),
        ("stream silent", seen((1.1, STOPPING, True)), True),
        ("stream silent", seen((1.1, STOPPING, False)), False),
        ("servo unplugged", seen((1.1, HOLDING, False)), False),
        ("servo unplugged", seen((1.1, STOPPING, True)), True),
        ("adapter unplugged", seen((1.1, STOPPING, True)), False),
        ("adapter unplugged", seen((1.1, RunState.OFF, True)), True),
        ("kill -9", seen((1.0, MOVING, False)), False),
        ("sender's clock jumps forward", seen((1.0, MOVING, False)), False),
        ("servo warm", seen((1.0, MOVING, False)), False),
        ("wrist lost", seen((1.0, MOVING, False)), False),
        ("second source", seen((1.0, MOVING, False)), True),
    ],
)
def test_a_reaction_is_as_strong_as_needed_and_in_time(name: str, trace: Trace, came: bool) -> None:
    assert reached(trace, least(row(name)), 1.0, 1.2) is came
