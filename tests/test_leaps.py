"""Late poses, leaps to and fro, and exchanges told in two datagrams."""

import numpy as np

from retarget.live.last_poses import LastPoses
from retarget.live.leaps import Leaps
from retarget.live.trust_limits import TrustLimits
from retarget.live.trust_state import TrustState

PLACES = np.array([[0.0, 0.3, 1.0], [0.0, -0.3, 1.0], [0.0, 0.0, 1.0]])
NAMES = ("l_wrist", "r_wrist", "pelvis")


class Line:
    """Leaps with the last poses that they are judged against."""

    def __init__(self) -> None:
        self.last = LastPoses(3)
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
