"""Two faults in one run: a missing reaction is found; the stronger of two is required, and by when."""

from unittest.mock import patch

import pytest

from messages import shows
from retarget.live.performer import LivePerformer
from retarget.types import RunState
from row_runs import always, pair_wrongs, row
from sim.faults.bench import Tick, Trace
from sim.faults.cases import judged_seed
from sim.faults.judge import Struck, least, missing, outdone, reached
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


def held_from(time: float) -> Trace:
    """Following from 0 s on, and holding from a time on to 1 s."""
    trace = seen(*((0.01 * k, MOVING if 0.01 * k < time else HOLDING, False) for k in range(100)))
    trace.began = 0.0
    return trace


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


@pytest.mark.parametrize(
    ("other", "at", "held", "expected"),
    [
        ("stream silent for a while", 0.498, 0.64, False),  # without data no swap is detected
        ("stream silent for a while", 0.55, 0.64, False),
        ("stream silent for a while", 0.2, 0.64, True),
        ("stream silent for a while", 0.498, 0.7, True),
        ("wrist lost", 0.498, 0.64, True),  # requires less
    ],
)
def test_a_third_fault_may_hide_one_of_two(other: str, at: float, held: float, expected: bool) -> None:
    swapped, later = Struck(row("left and right swapped"), 0.5), Struck(row("second source"), 0.9)
    assert bool(missing(held_from(held), swapped, later, [Struck(row(other), at)])) is expected


def test_other_signs_of_a_reaction() -> None:
    trace = seen((1.0, MOVING, False))
    trace.out = [(1.1, frozenset({"l_wrist"}))]
    trace.rebased, trace.let_go = 1.1, [(1.05, 1), (1.15, 2)]
    lost, jumped, killed = (row(name) for name in ("wrist lost", "sender's clock jumps forward", "kill -9"))
    assert all(reached(trace, least(one), 1.0, 1.2) for one in (lost, jumped, killed))
    assert not reached(trace, least(lost), 1.0, 1.05) and not reached(trace, least(killed), 1.0, 1.1)


@pytest.mark.parametrize(
    ("first", "second", "late"), [(0.2, 0.4, True), (0.2, 0.34, True), (0.36, 0.38, False), (2.0, 2.1, False)]
)
def test_the_first_is_judged_alone_where_its_time_is_over_before_the_second(
    first: float, second: float, late: bool
) -> None:
    wrong = missing(held_from(0.495), Struck(row("stream silent"), first), Struck(row("wrist lost"), second))
    assert wrong == (["stream silent: not held in time"] if late else [])


@pytest.mark.parametrize(("acted", "late"), [([0.305], True), ([0.305, 0.432], False), ([0.305, 0.428], True)])
def test_each_of_two_that_wait_for_an_event_is_timed_from_its_own(acted: list[float], late: bool) -> None:
    trace = held_from(0.455)
    trace.acted = acted
    wrong = missing(trace, Struck(row("solver not finite once"), 0.3), Struck(row("deadline missed"), 0.42))
    assert wrong == (["deadline missed: not held in time"] if late else [])
