"""Late poses, leaps to and fro, and exchanges told in two datagrams."""

import warnings

import numpy as np
import pytest

from retarget.live.leaps import Leaps
from retarget.live.trust_limits import TrustLimits
from retarget.live.trust_state import TrustState
from retarget.live.watched_sensors import watched_sensors

PLACES = np.array([[0.0, 0.3, 1.0], [0.0, -0.3, 1.0], [0.0, 0.0, 1.0]])
NAMES = ("l_wrist", "r_wrist", "pelvis")


class Line:
    """Leaps with the last poses that they are judged against."""

    def __init__(self) -> None:
        self.last = watched_sensors(3, TrustLimits())
        self.leaps = Leaps(NAMES, self.last, TrustLimits())
        self.tell(0.0, {row: PLACES[row] for row in range(3)})

    def tell(self, time: float, places: dict[int, np.ndarray]) -> list[bool]:
        rows = np.array(list(places))
        position = np.array(list(places.values()))
        usable, stored = self.leaps.take(rows, time, position)
        assert not (stored & ~usable).any()
        pose = np.column_stack([position, np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))])
        self.last.put(rows[stored], time, pose[stored])
        return list(map(bool, usable))


def test_a_late_pose_may_be_used_but_is_not_gone_on_from() -> None:
    line = Line()
    line.tell(0.1, {0: PLACES[0] + 0.1})
    assert line.tell(0.05, {0: PLACES[0] + 0.05}) == [True]
    assert line.last.at[0] == 0.1 and np.allclose(line.last.pose[0, :3], PLACES[0] + 0.1)
    assert line.tell(0.1, {0: PLACES[0] + 1.0}) == [False] and not line.leaps.any_doubted


def test_as_fast_as_a_human_and_faster() -> None:
    for metres, usable in ((0.7, True), (0.8, False)):
        assert Line().tell(0.05, {0: PLACES[0] + [metres, 0.0, 0.0]}) == [usable]


def test_jitter_of_stamps_is_no_leap() -> None:
    assert Line().tell(0.0001, {0: PLACES[0] + [0.2, 0.0, 0.0]}) == [True]


def test_a_leap_back_is_believed_and_a_leap_on_waits_anew() -> None:
    line = Line()
    assert line.tell(0.01, {0: PLACES[0] + [2.0, 0.0, 0.0]}) == [False]
    assert line.leaps.state[0] == TrustState.FRESH
    assert line.tell(0.02, {0: PLACES[0] + [2.0, 0.0, 0.0]}) == [False]
    assert line.leaps.state[0] == TrustState.JUMPED
    assert line.tell(0.03, {0: PLACES[0]}) == [True] and not line.leaps.any_doubted
    assert line.leaps.state[0] == TrustState.FRESH
    for i in range(4, 30):
        assert line.tell(0.01 * i, {0: PLACES[0] + [2.0, 0.0, 0.0]}) == [False]
    for i in range(30, 78):
        assert line.tell(0.01 * i, {0: PLACES[0] + [5.0, 0.0, 0.0]}) == [False]
    line.tell(0.79, {0: PLACES[0] + [5.0, 0.0, 0.0]})
    assert line.tell(0.81, {0: PLACES[0] + [5.0, 0.0, 0.0]}) == [True] and line.leaps.resettled[0]


def test_a_leap_that_falls_silent_waits_anew() -> None:
    line = Line()
    for time in (0.01, 0.02, 0.03, 0.6):
        assert line.tell(time, {0: PLACES[0] + [9.0, 0.0, 0.0]}) == [False]


def test_an_exchange_in_two_datagrams() -> None:
    line = Line()
    assert line.tell(0.01, {0: PLACES[1]}) == [False] and line.tell(0.02, {1: PLACES[0]}) == [False]
    assert line.leaps.state.tolist() == [TrustState.SWAPPED, TrustState.SWAPPED, TrustState.FRESH]


def test_two_leaps_to_elsewhere_are_no_exchange() -> None:
    line = Line()
    for time in (0.01, 0.02):
        line.tell(time, {0: PLACES[1], 1: PLACES[1] + [1.0, 0.0, 0.0]})
    assert line.leaps.state.tolist() == [TrustState.JUMPED, TrustState.JUMPED, TrustState.FRESH]


def test_a_clock_that_was_set_back_starts_anew() -> None:
    line = Line()
    assert line.tell(-3.0, {0: PLACES[0] + 2.0}) == [True] and line.last.at[0] == -3.0


def test_a_leap_to_a_third_place_is_no_way_back() -> None:
    for third in ([-1.3, 0.0, 0.0], [1.2, 0.0, 0.0]):
        line = Line()
        line.tell(0.01, {0: PLACES[0] + [2.0, 0.0, 0.0]})
        assert line.tell(0.09, {0: PLACES[0] + third}) == [False]
    line = Line()
    for i in range(1, 40):
        line.tell(0.01 * i, {0: PLACES[0] + [9.0, 0.0, 0.0]})
    assert line.tell(0.4, {0: PLACES[0] + [2.0, 0.0, 0.0]}) == [False]


def test_to_walk_through_the_old_place_is_no_way_back() -> None:
    line = Line()
    for i in range(1, 30):
        assert line.tell(0.01 * i, {0: PLACES[0] + [0.3 - 0.02 * (i - 1), 0.0, 0.0]}) == [False]


def test_an_exchange_in_one_datagram() -> None:
    line = Line()
    assert line.tell(0.01, {0: PLACES[1], 1: PLACES[0], 2: PLACES[2]}) == [False, False, True]
    assert line.leaps.state.tolist() == [TrustState.SWAPPED, TrustState.SWAPPED, TrustState.FRESH]
    assert line.tell(0.02, {0: PLACES[0], 1: PLACES[1]}) == [True, True] and not line.leaps.any_doubted


def swapped_at(line: Line, time: float, to: float) -> None:
    """Both wrists are told at each other's places, wherever they go: the hands rise by `to`, m."""
    up = np.array([0.0, 0.0, to])
    assert line.tell(time, {0: PLACES[1] + up, 1: PLACES[0] + up}) == [False, False]
    assert line.leaps.state.tolist() == [TrustState.SWAPPED, TrustState.SWAPPED, TrustState.FRESH]


def test_where_sides_are_known_a_swap_ends_only_by_swapping_back() -> None:
    line = Line()
    line.leaps.keep_sides()
    for i in range(1, 1000):
        swapped_at(line, 0.01 * i, 0.001 * min(i, 500))
    up = np.array([0.0, 0.0, 0.5])
    assert line.tell(10.0, {0: PLACES[0] + up, 1: PLACES[1] + up}) == [True, True] and not line.leaps.any_doubted
    assert not line.leaps.resettled.any() and np.allclose(line.last.pose[0, :3], PLACES[0] + up)


def test_silence_does_not_make_a_swap_right() -> None:
    line = Line()
    line.leaps.keep_sides()
    for time in (0.01, 0.02, 3.0, 3.01, 9.0, 9.6):
        swapped_at(line, time, 0.0)
    assert line.tell(20.0, {0: PLACES[0], 1: PLACES[1]}) == [True, True]


def test_swapping_back_may_be_told_in_two_datagrams_and_one_side_alone_is_not_enough() -> None:
    line = Line()
    line.leaps.keep_sides()
    swapped_at(line, 0.01, 0.0)
    swapped_at(line, 0.02, 0.0)
    assert line.tell(0.03, {0: PLACES[0], 1: PLACES[0]}) == [False, False]
    swapped_at(line, 0.04, 0.0)
    assert line.tell(0.05, {0: PLACES[0]}) == [True] and line.tell(0.051, {1: PLACES[1]}) == [True]
    assert not line.leaps.any_doubted


def test_a_swap_before_sides_are_known_is_a_leap_that_settles() -> None:
    line = Line()
    swapped_at(line, 0.01, 0.0)
    line.leaps.keep_sides()
    told = [line.tell(0.01 * i, {0: PLACES[1], 1: PLACES[0]}) for i in range(2, 60)]
    assert told[0] == [False, False] and told[-1] == [True, True]


def taken_over(line: Line, first: float) -> None:
    """The left wrist is told where the right one was, which is not told; twice."""
    for time in (first, first + 0.01):
        assert line.tell(time, {0: PLACES[1], 2: PLACES[2]}) == [False, True]
    assert line.leaps.state.tolist() == [TrustState.SWAPPED, TrustState.SWAPPED, TrustState.FRESH]


@pytest.mark.parametrize("lost", [0.0, 0.05, 0.1, 0.5, 2.0])
def test_one_that_takes_the_place_of_the_other_has_changed_places(lost: float) -> None:
    """Lost for a while, and told at the place of the other side from when that one is not told."""
    line = Line()
    line.leaps.keep_sides()
    told = [0.01 * i for i in range(1, round(100.0 * lost) + 1)]
    for time in told:
        assert line.tell(time, {1: PLACES[1], 2: PLACES[2]}) == [True, True]
    taken_over(line, lost + 0.01)
    for i in range(3, 300):  # no time makes it right
        assert line.tell(lost + 0.01 * i, {0: PLACES[1], 2: PLACES[2]}) == [False, True]
    assert line.tell(lost + 3.0, {0: PLACES[0], 1: PLACES[1], 2: PLACES[2]}) == [True] * 3
    assert not line.leaps.any_doubted


def test_it_ends_when_the_other_is_told_at_its_own_place() -> None:
    """However far the one that was not seen has gone: then each is itself."""
    line = Line()
    line.leaps.keep_sides()
    taken_over(line, 0.01)
    far = PLACES[0] + [0.3, 0.3, 0.5]
    assert line.tell(0.1, {0: far, 1: PLACES[1]}) == [True, True] and not line.leaps.any_doubted
    line = Line()
    line.leaps.keep_sides()
    taken_over(line, 0.01)
    assert line.tell(0.1, {1: PLACES[1]}) == [True]  # one after the other
    assert line.tell(0.105, {0: PLACES[0] + [9.0, 0.0, 0.0]}) == [False]  # no human goes so far
    assert line.leaps.state[0] == TrustState.JUMPED


def test_both_told_at_each_others_places_go_on_as_a_swap() -> None:
    line = Line()
    line.leaps.keep_sides()
    taken_over(line, 0.01)
    for i in range(3, 100):
        swapped_at(line, 0.01 * i, 0.0)
    assert line.tell(1.1, {0: PLACES[0], 1: PLACES[0]}) == [False, False]  # one side alone is not enough
    swapped_at(line, 1.11, 0.0)
    assert line.tell(1.12, {0: PLACES[0], 1: PLACES[1]}) == [True, True]


def test_hands_that_meet_one_told_after_the_other_have_not_changed_places() -> None:
    """Each sensor in a datagram of its own: the left one comes back beside the right one, which is told next."""
    line = Line()
    line.leaps.keep_sides()
    for i in range(1, 20):
        line.tell(0.01 * i, {1: PLACES[1]})
    beside = PLACES[1] + [0.05, 0.0, 0.0]
    line.tell(0.2, {0: beside})
    assert line.tell(0.202, {1: PLACES[1]}) == [True]
    assert line.tell(0.21, {0: beside}) == [True]
    assert not line.leaps.any_doubted and (line.leaps.state == TrustState.FRESH).all()


@pytest.mark.parametrize("row", [0, 1])
def test_a_swap_of_one_that_was_lost_for_long_is_seen_whichever_it_was(row: int) -> None:
    line = Line()
    line.leaps.keep_sides()
    for i in range(1, 150):
        line.tell(0.01 * i, {1 - row: PLACES[1 - row]})
    for i in range(150, 300):
        swapped_at(line, 0.01 * i, 0.0)


def test_one_that_was_never_heard_takes_nobodys_place() -> None:
    last = watched_sensors(3, TrustLimits())
    leaps = Leaps(NAMES, last, TrustLimits())
    rows, pose = np.array([1]), np.array([[*PLACES[1], 1.0, 0.0, 0.0, 0.0]])
    last.put(rows, 0.0, pose)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        usable, _ = leaps.take(np.array([0]), 0.01, PLACES[1:2])
        assert usable.tolist() == [True]
        usable, _ = leaps.take(np.array([0, 1]), 0.01, PLACES[[1, 0]])
        assert usable.tolist() == [True, False] and leaps.state[0] == TrustState.FRESH
