"""A robot that stopped goes to a stand, then home; where something is in the way, once more; in the end it stays."""

from functools import cache

import numpy as np
import pytest

from followers import DT, op3
from retarget.parking import PACE, SETTLE_S, Parking
from retarget.rotations import FloatArray
from retarget.stance import plant
from retarget.ways_home import ways_home
from rig import StubFollower

SETTLES = round(SETTLE_S / DT)
COLUMNS = op3().servo_columns


@cache
def standing() -> FloatArray:
    return plant(op3(), op3().profile.postures.stand).q


def angles(name: str) -> FloatArray:
    return op3().posture(getattr(op3().profile.postures, name))[COLUMNS]


class Lander(StubFollower):
    """Lands in so many ticks, the first joint by 0.01 rad each, then in so many the next time: `lasts`."""

    def __init__(self, *lasts: int) -> None:
        super().__init__(op3(), np.zeros((1, len(COLUMNS))))
        self.left = list(lasts)
        self.landed = self.halted = 0
        self.q = standing().copy()

    def halt(self, dt: float) -> FloatArray | None:
        self.halted += 1
        return self.q

    def land(self, dt: float) -> FloatArray | None:
        if self.left[0] == 0:
            self.landed += 1
            self.left.pop(0)
            return None
        self.left[0] -= 1
        self.q = self.q.copy()
        self.q[COLUMNS[0]] += 0.01
        return self.q


class Bench:
    """Parks, tick by tick; what `refuses` names by number of the goal is not sent, and the robot stands there."""

    def __init__(self, follower: Lander, refuses: "range | set[int]" = range(0)) -> None:
        self.follower, self.refuses = follower, refuses
        self.parking = Parking(op3(), follower, dt=DT)
        self.q = standing().copy()
        self.sent: list[FloatArray] = []
        self.passed = True

    def run(self, ticks: int) -> "Bench":
        for _ in range(ticks):
            there = self.parking.next(self.q, passed=self.passed, stands=True)
            if there is None:
                return self
            waits = np.array_equal(there, self.q)
            self.passed = waits or len(self.sent) not in self.refuses
            self.sent.append(there[COLUMNS].copy())
            if self.passed:
                self.q = there
        raise AssertionError("it goes on and on")


def test_it_lands_slowly_then_goes_straight_home() -> None:
    follower = Lander(20)
    assert not Bench(follower).parking.begun
    bench = Bench(follower).run(1000)
    assert bench.parking.begun and follower.paces == [PACE]
    (begun,) = follower.reseeded
    assert np.array_equal(begun, standing()[COLUMNS])  # from where it stands, whether it has followed or not
    way = np.array(bench.sent)
    assert way[19, 0] == pytest.approx(standing()[COLUMNS[0]] + 0.2)
    assert np.array_equal(way[-1], angles("rest"))
    home = way[20:]
    assert np.linalg.matrix_rank(home - home[-1], tol=1e-6) == 1  # straight
    assert follower.landed == 1
    assert bench.parking.next(bench.q, passed=False, stands=True) is None, "nobody sets off again"


def test_soles_stay_where_they_are_on_the_way_home() -> None:
    bench = Bench(Lander(0, 0)).run(1000)
    soles = op3().points(np.array([standing(), bench.q]), ("l_sole", "r_sole"))
    lower = soles[0, :, 2].argmin()
    assert np.abs(soles[1, lower] - soles[0, lower]).max() < 1e-9


def test_where_something_is_in_the_way_it_waits_and_lands_once_more_then_takes_its_arms_aside() -> None:
    follower = Lander(5, 7)
    refused = 5 + 30
    bench = Bench(follower, {refused}).run(2000)
    assert follower.landed == 2
    waited = np.array(bench.sent[refused + 1 : refused + 1 + SETTLES])
    assert (waited == bench.sent[refused - 1]).all()
    assert np.array_equal(bench.sent[-1], angles("rest"))
    attractor = np.abs(np.array(bench.sent)[:, :2] - angles("attractor")[:2]).max(axis=1)
    assert attractor.min() < 1e-9


def test_a_landing_that_is_refused_waits_and_parts_limbs_then_waits_and_goes_on_once_more() -> None:
    follower = Lander(20)
    bench = Bench(follower, {10, 12 + SETTLES}).run(2000)  # and again, where it stands
    assert follower.halted == 1 and follower.landed == 1
    waited = (np.array(bench.sent)[10:] == bench.sent[9]).all(axis=1)
    assert np.count_nonzero(waited) == 2 * SETTLES + 2
    assert np.array_equal(bench.sent[-1], angles("rest"))


def test_one_refusal_alone_does_not_end_a_landing() -> None:
    follower = Lander(30)
    Bench(follower, {10}).run(2000)
    assert follower.halted == 1 and follower.landed == 1


def test_while_it_moves_a_refused_way_home_waits_for_the_brakes() -> None:
    parking = Parking(op3(), Lander(0, 0), dt=DT)
    q = standing()
    for _ in range(2):
        there = parking.next(q, passed=True, stands=True)
        assert there is not None
        q = there
    for _ in range(5):
        assert parking.next(q, passed=False, stands=False) is None
    there = parking.next(q, passed=False, stands=True)
    assert there is not None and np.array_equal(there, q)


def test_where_there_is_no_way_it_stays() -> None:
    follower = Lander(0, 0)
    bench = Bench(follower, range(10**6)).run(10**5)
    assert np.array_equal(bench.q, standing())
    asked = np.abs(np.array(bench.sent) - standing()[COLUMNS]).max(axis=1) > 0.0
    assert np.count_nonzero(asked) == len(list(ways_home(op3(), dt=DT)))  # the first goal of each
    assert np.count_nonzero(~asked) == np.count_nonzero(asked) * (SETTLES + 1)  # and waits after each
