"""Two faults in one run: a missing reaction is found; the stronger of two is required, and by when."""

from collections.abc import Iterator
from unittest.mock import patch

import pytest

from messages import shows
from retarget.live.performer import LivePerformer
from retarget.types import RunState
from sim.faults.bench import Tick, Trace
from sim.faults.cases import judged_seed
from sim.faults.judge import Struck, judged_pair, missing, need_of, outdone, reached
from sim.faults.reactions import Reaction, Row
from sim.faults.rows import ROWS

BLIND_SEED = 11
"""A random run whose harsh fault is one of the stream."""


def row(name: str) -> Row:
    return next(one for one in ROWS if one.name == name)


@pytest.fixture
def blind() -> Iterator[None]:
    """Sensor validity that accepts everything."""
    with patch.object(LivePerformer, "_is_good", lambda self, heard, now: True):
        yield


PAIRS = [
    ("stream silent", "wrist frozen", "stream silent: not held in time"),
    ("left and right swapped", "deadline missed", "left and right swapped: not held in time"),
]


@pytest.mark.parametrize(("first", "second", "expected"), PAIRS)
def test_a_missing_reaction_to_two_faults_is_found(first: str, second: str, expected: str, blind: None) -> None:
    assert expected in judged_pair(row(first), row(second), at=0.3, gap=0.05, seed=0).wrong


@pytest.mark.parametrize(("first", "second", "expected"), PAIRS[:1])
def test_a_reaction_to_two_faults_is_not_reported(first: str, second: str, expected: str) -> None:
    assert judged_pair(row(first), row(second), at=0.3, gap=0.05, seed=0).wrong == ()


@pytest.mark.parametrize("gap", [0.0, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("names", [("wrist lost", "left and right swapped"), ("left and right swapped", "wrist lost")])
def test_a_wrist_that_is_lost_and_sides_that_change_places_are_a_swap(names: tuple[str, str], gap: float) -> None:
    """The sensor that is sent is where the other was: the robot must not follow it."""
    first, second = map(row, names)
    assert judged_pair(first, second, at=0.3, gap=gap, seed=1).wrong == ()


def test_a_random_run_without_a_reaction_is_found(blind: None) -> None:
    shows(judged_seed(BLIND_SEED, seconds=1.0).wrong)


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
    trace = Trace(ticks=[Tick(time, state, latched, 1.0) for time, state, latched in states])
    trace.torque = [1, 1]
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
    assert reached(trace, need_of(row(name)), 1.0, 1.2) is came


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
    trace = seen(*((0.01 * k, MOVING, False) for k in range(100)))
    trace.ticks = [tick if tick.time < held else Tick(tick.time, HOLDING, False, 1.0) for tick in trace.ticks]
    trace.began = 0.0
    swapped, later = Struck(row("left and right swapped"), 0.5), Struck(row("second source"), 0.9)
    wrong = missing(trace, swapped, later, [Struck(row(other), at)])
    assert bool(wrong) is expected


def test_other_signs_of_a_reaction() -> None:
    trace = seen((1.0, MOVING, False))
    trace.out = [(1.1, frozenset({"l_wrist"}))]
    trace.rebased, trace.let_go = 1.1, [(1.05, 1), (1.15, 2)]
    assert reached(trace, need_of(row("wrist lost")), 1.0, 1.2)
    assert not reached(trace, need_of(row("wrist lost")), 1.0, 1.05)
    assert reached(trace, need_of(row("sender's clock jumps forward")), 1.0, 1.2)
    assert reached(trace, need_of(row("kill -9")), 1.0, 1.2)
    assert not reached(trace, need_of(row("kill -9")), 1.0, 1.1)


def test_the_first_is_judged_alone_where_its_time_is_over_before_the_second() -> None:
    ticks = [(0.01 * k, MOVING if k < 50 else HOLDING, False) for k in range(100)]
    trace = seen(*ticks)
    trace.began = 0.0
    silent, lost = row("stream silent"), row("wrist lost")
    assert missing(trace, Struck(silent, 0.2), Struck(lost, 0.4)) == ["stream silent: not held in time"]
    assert missing(trace, Struck(silent, 0.2), Struck(lost, 0.34)) == ["stream silent: not held in time"]
    assert missing(trace, Struck(silent, 0.36), Struck(lost, 0.38)) == []
    assert missing(trace, Struck(silent, 2.0), Struck(lost, 2.1)) == []


def test_each_of_two_that_wait_for_an_event_is_timed_from_its_own() -> None:
    trace = seen(*((0.01 * k, MOVING if k < 46 else HOLDING, False) for k in range(100)))
    trace.began = 0.0
    two = Struck(row("solver not finite once"), 0.3), Struck(row("deadline missed"), 0.42)
    trace.acted = [0.305]
    assert missing(trace, *two) == ["deadline missed: not held in time"]
    trace.acted = [0.305, 0.432]
    assert missing(trace, *two) == []
    trace.acted = [0.305, 0.428]
    assert missing(trace, *two) == ["deadline missed: not held in time"]
