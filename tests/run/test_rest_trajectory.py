"""A stopped robot returns to its stance, then goes to rest; where the gate refuses that, it tries again, then holds."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from followers import DT, op3
from hardware.guard_state import Stop, StopCause
from messages import shows
from retarget.ik.support_polygon import plant
from retarget.robot.posture_reader import standing_dofs
from retarget.run.rest_trajectory import (
    ALONE_RAD,
    LONGEST_RETURN_S,
    LONGEST_TO_REST_S,
    NEAR_REST,
    REST_WITHIN_S,
    RETURN_OVERRIDE,
    SETTLE_S,
    RestTrajectory,
    Trajectory,
    not_at_rest,
    rest_trajectories,
)
from retarget.types import FloatArray
from rig import StubFollower

SETTLES = round(SETTLE_S / DT)
COLUMNS = op3().servo_columns


@cache
def standing() -> FloatArray:
    return plant(op3(), op3().profile.postures.stand).q


def angles(name: str) -> FloatArray:
    return op3().posture(getattr(op3().profile.postures, name))[COLUMNS]


class ReturningFollower(StubFollower):
    """Returns to stance in the ticks that `lasts` has for each time, the first joint by `step` rad a tick."""

    def __init__(self, *lasts: int, fails: int = 10**9, step: float = 0.01) -> None:
        super().__init__(op3(), np.zeros((1, len(COLUMNS))))
        self.left, self.fails, self.advance = list(lasts), fails, step
        self.returned = self.halted = 0
        self.q = standing().copy()

    def halt(self, dt: float) -> FloatArray | None:
        self.halted += 1
        return self.q

    def begin_return_to_stance(self, q: FloatArray) -> None:
        super().begin_return_to_stance(q)
        self.q = q

    def return_to_stance(self, dt: float) -> FloatArray | None:
        self.fails -= 1
        if self.fails < 0:
            raise ArithmeticError("no posture was found")
        if self.left[0] == 0:
            self.returned += 1
            self.left.pop(0)
            return None
        self.left[0] -= 1
        self.q = self.q.copy()
        self.q[COLUMNS[0]] += self.advance
        return self.q


class Bench:
    """Goes to rest, tick by tick. Goals whose numbers are in `refuses` are not sent, and the robot stands there.

    moves: numbers of goals that are refused while it moves: it is at rest `brakes` ticks later.
    """

    def __init__(
        self,
        follower: ReturningFollower,
        refuses: "range | set[int]" = range(0),
        *,
        moves: "range | set[int]" = range(0),
        brakes: int = 3,
        **known: bool | float,
    ) -> None:
        self.follower, self.refuses, self.moves, self.known = follower, refuses, moves, known
        self.notes: list[str] = []
        self.rest_trajectory = RestTrajectory(op3(), follower, dt=DT, notify=self.notes.append)
        self.q = standing().copy()
        self.sent: list[FloatArray] = []
        self.passed = bool(known.pop("passed", True))
        self._brakes, self._rests = brakes, 0

    def run(self, ticks: int) -> "Bench":
        for _ in range(ticks):
            self._rests = max(self._rests - 1, 0)
            stands = self._rests == 0
            there = self.rest_trajectory.next(self.q, passed=self.passed, stands=stands, **self.known)  # type: ignore[arg-type]
            if there is None and stands:
                return self
            number = len(self.sent)
            if there is None:
                self.passed = False
                continue
            waits = np.array_equal(there, self.q)
            self.passed = waits or (number not in self.refuses and number not in self.moves)
            if number in self.moves:
                self._rests = self._brakes + 1
            self.sent.append(there[COLUMNS].copy())
            if self.passed:
                self.q = there
        raise AssertionError("it goes on and on")


def waited(bench: Bench) -> int:
    """Ticks that it stood, between the first goal and the last."""
    return sum(np.array_equal(a, b) for a, b in pairwise(bench.sent))


def test_it_returns_to_stance_slowly_then_goes_straight_to_rest() -> None:
    follower = ReturningFollower(20)
    assert not Bench(follower).rest_trajectory.begun
    bench = Bench(follower).run(1000)
    assert bench.rest_trajectory.begun and set(follower.overrides) == {RETURN_OVERRIDE}
    (begun,) = follower.returns
    assert np.array_equal(begun, standing()[COLUMNS])  # from where it stands, whether it has followed or not
    path = np.array(bench.sent)
    assert path[19, 0] == pytest.approx(standing()[COLUMNS[0]] + 0.2)
    assert np.array_equal(path[-1], angles("rest"))
    to_rest = path[20:]
    assert np.linalg.matrix_rank(to_rest - to_rest[-1], tol=1e-6) == 1  # straight
    assert follower.returned == 1 and not waited(bench)
    assert bench.rest_trajectory.next(bench.q, passed=False, stands=True) is None, "it does not begin again"


def test_one_that_has_not_risen_yet_goes_straight_to_rest() -> None:
    follower = ReturningFollower()
    bench = Bench(follower, returns_to_stance=False).run(1000)
    assert not follower.returns and not bench.rest_trajectory.returns_to_stance
    path = np.array(bench.sent)
    assert np.linalg.matrix_rank(path - path[-1], tol=1e-6) == 1 and np.array_equal(path[-1], angles("rest"))


def test_a_warm_robot_returns_to_stance_no_faster_than_its_override() -> None:
    follower = ReturningFollower(20)
    Bench(follower, speed_override=0.25).run(1000)
    assert set(follower.overrides) == {0.25}


def test_a_stop_out_of_a_hold_is_no_refusal() -> None:
    """Nothing was asked for, so nothing was sent as asked."""
    bench = Bench(ReturningFollower(20), passed=False).run(1000)
    assert not waited(bench) and not bench.follower.separated


def test_soles_stay_where_they_are_on_the_rest_trajectory() -> None:
    bench = Bench(ReturningFollower(0, 0)).run(1000)
    soles = op3().points(np.array([standing(), bench.q]), ("l_sole", "r_sole"))
    lower = soles[0, :, 2].argmin()
    assert np.abs(soles[1, lower] - soles[0, lower]).max() < 1e-9


def test_a_refused_rest_trajectory_waits_returns_to_stance_once_more_then_takes_the_arms_aside() -> None:
    follower = ReturningFollower(5, 7)
    refused = 5 + 30
    bench = Bench(follower, {refused}).run(2000)
    assert follower.returned == 2
    assert np.array_equal(follower.returns[1], bench.sent[refused - 1]), "from where it stands then"
    stood = np.array(bench.sent[refused + 1 : refused + 1 + SETTLES])
    assert (stood == bench.sent[refused - 1]).all()
    assert np.array_equal(bench.sent[-1], angles("rest"))
    attractor = np.abs(np.array(bench.sent)[:, :2] - angles("attractor")[:2]).max(axis=1)
    assert attractor.min() < 1e-9


def test_a_refused_return_waits_and_separates_limbs_and_if_refused_again_begins_once_more() -> None:
    follower = ReturningFollower(20, 20)
    bench = Bench(follower, {10, 11 + SETTLES}).run(2000)  # and again, where it stands
    assert follower.separated == 1 and len(follower.returns) == 2
    stood = (np.array(bench.sent)[10:] == bench.sent[9]).all(axis=1)
    assert np.count_nonzero(stood) == 2 * SETTLES
    assert np.array_equal(bench.sent[-1], angles("rest"))


def test_one_refusal_alone_does_not_end_a_return_nor_do_two_apart() -> None:
    follower = ReturningFollower(60)
    Bench(follower, {10}, moves={20 + SETTLES}).run(2000)
    assert follower.separated == 1 and follower.returned == 1 and len(follower.returns) == 1
    follower = ReturningFollower(60)
    Bench(follower, {10, 30 + SETTLES}, moves={20 + SETTLES}).run(2000)
    assert follower.separated == 2 and len(follower.returns) == 1, "it moved between them"


def test_a_return_that_is_refused_while_it_moves_goes_on() -> None:
    follower = ReturningFollower(60)
    bench = Bench(follower, moves=range(10, 40, 5), brakes=2).run(2000)
    assert not follower.separated and follower.returned == 1 and not waited(bench)


def test_a_rest_trajectory_that_is_refused_while_it_moves_waits_for_the_brakes() -> None:
    rest_trajectory = RestTrajectory(op3(), ReturningFollower(0, 0), dt=DT)
    q = standing()
    for _ in range(2):
        there = rest_trajectory.next(q, passed=True, stands=True)
        assert there is not None
        q = there
    for _ in range(5):
        assert rest_trajectory.next(q, passed=False, stands=False) is None
    there = rest_trajectory.next(q, passed=False, stands=True)
    assert there is not None and np.array_equal(there, q)


def test_a_return_that_does_not_end_stops_and_goes_to_rest_from_there() -> None:
    follower = ReturningFollower(10**6, step=1e-6)
    rest_trajectory, q = RestTrajectory(op3(), follower, dt=DT), standing()
    ticks = 0
    while not follower.halted:
        there = rest_trajectory.next(q, passed=True, stands=ticks == 0)
        assert there is not None
        q, ticks = there, ticks + 1
    assert ticks * DT == pytest.approx(LONGEST_RETURN_S, abs=2 * DT)
    for _ in range(4):  # on the follower's stopping trajectory
        assert rest_trajectory.next(q, passed=True, stands=False) is follower.q
    path = [q]
    while (there := rest_trajectory.next(path[-1], passed=True, stands=len(path) == 1)) is not None:
        path.append(there)
    assert np.array_equal(path[-1][COLUMNS], angles("rest")) and len(follower.returns) == 1
    assert len(path) * DT <= REST_WITHIN_S + 2 * DT


@pytest.mark.parametrize("every", [3, 6, 12])
def test_a_return_that_is_refused_again_and_again_ends_in_time(every: int) -> None:
    """It waits, moves a little, and is refused where it stands."""
    follower = ReturningFollower(10**6, 10**6, step=1e-6)
    rest_trajectory, q, passed, stands = RestTrajectory(op3(), follower, dt=DT), standing(), True, True
    ticks = moved = 0
    while rest_trajectory.returns_to_stance or not ticks:
        there = rest_trajectory.next(q, passed=passed, stands=stands)
        if there is None:
            break
        waits = np.array_equal(there, q)
        moved = moved if waits else moved + 1
        passed = waits or moved % every != 0
        stands = waits or not passed
        q, ticks = there if passed else q, ticks + 1
    assert ticks * DT <= LONGEST_RETURN_S + SETTLE_S


def test_a_second_return_has_all_its_time() -> None:
    half = round(0.6 * LONGEST_RETURN_S / DT)
    follower = ReturningFollower(half, half)
    Bench(follower, {half + 30}).run(10**5)
    assert follower.returned == 2 and not follower.halted


def test_the_longest_course_fits_into_its_time() -> None:
    straight, around = REST_WITHIN_S, 4.0 * REST_WITHIN_S  # one joint, arms, `stand`, `rest`
    assert 2.0 * LONGEST_RETURN_S + straight + around + 4 * SETTLE_S <= LONGEST_TO_REST_S


def test_a_failed_return_is_reported_and_it_goes_to_rest_without() -> None:
    follower = ReturningFollower(40, fails=10)
    bench = Bench(follower).run(2000)
    shows(bench.notes, "no posture was found")
    assert np.array_equal(bench.sent[-1], angles("rest"))


def test_after_a_failure_it_does_not_return_again_whatever_is_refused() -> None:
    follower = ReturningFollower(40, fails=10)
    bench = Bench(follower, {10 + 30}).run(2000)
    assert len(follower.returns) == 1 and np.array_equal(bench.sent[-1], angles("rest"))


@pytest.mark.parametrize("call", ["begin_return_to_stance", "separate_limbs"])
def test_whatever_fails_of_the_follower_it_goes_to_rest(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*given: object) -> None:
        raise ArithmeticError("no posture was found")

    follower = ReturningFollower(40)
    monkeypatch.setattr(follower, call, fails)
    bench = Bench(follower, {10}).run(2000)
    assert len(bench.notes) == 1 and np.array_equal(bench.sent[-1], angles("rest"))


def test_a_lost_terminal_keeps_no_robot_from_rest() -> None:
    def lost(text: str) -> None:
        raise BrokenPipeError(text)

    bench = Bench(ReturningFollower(40, fails=10))
    bench.rest_trajectory = RestTrajectory(op3(), bench.follower, dt=DT, notify=lost)
    assert np.array_equal(bench.run(2000).sent[-1], angles("rest"))


def test_obstacles_move_on_in_every_tick_in_which_the_follower_does_not_lead() -> None:
    follower = ReturningFollower(5, 7)
    bench = Bench(follower, {5 + 30}).run(2000)
    led_by_it = 5 + 7
    last = 1  # the tick in which the return is found to be over
    assert follower.passed_s == pytest.approx((len(bench.sent) + last - led_by_it) * DT)


def test_where_every_trajectory_is_refused_it_holds() -> None:
    follower = ReturningFollower(0, 0)
    bench = Bench(follower, range(10**6)).run(10**5)
    assert np.array_equal(bench.q, standing())
    asked = np.abs(np.array(bench.sent) - standing()[COLUMNS]).max(axis=1) > 0.0
    assert np.count_nonzero(asked) == len(list(rest_trajectories(op3(), dt=DT)))  # the first goal of each
    assert np.count_nonzero(~asked) == np.count_nonzero(asked) * SETTLES  # and waits after each


TICKS = round(REST_WITHIN_S / DT)
DOFS = [op3().body.dof_index(joint) for joint in op3().joint_map.joints]
LEGS = standing_dofs(op3())[DOFS]


def rest_trajectory_angles(name: str) -> FloatArray:
    posture = getattr(op3().profile.postures, name)
    return op3().posture(posture)[op3().servo_columns]


def trajectories() -> list[Callable[[FloatArray], Trajectory]]:
    return list(rest_trajectories(op3(), dt=DT))


def goals_of(number: int, here: FloatArray) -> FloatArray:
    """The goals (k, n) of one trajectory from `here` (n,), which is the first row."""
    return np.array([here, *trajectories()[number](here)])


def test_the_first_leads_straight_to_the_rest_posture_in_time() -> None:
    here = rest_trajectory_angles("rest") + 0.3
    path = goals_of(0, here)
    assert np.array_equal(path[-1], rest_trajectory_angles("rest")) and 10 < len(path) <= TICKS + 1
    share = (path - here) / (rest_trajectory_angles("rest") - here)
    assert np.ptp(share, axis=1).max() < 1e-9  # straight
    assert len(goals_of(0, rest_trajectory_angles("rest"))) == 1  # it is there


@pytest.mark.parametrize(("number", "aside"), [(1, "attractor"), (2, "stand"), (3, "neutral")])
def test_the_next_take_the_arms_aside_first_and_go_by_the_stand(number: int, aside: str) -> None:
    here = rest_trajectory_angles("stand") + 0.1
    path = goals_of(number, here)
    assert np.array_equal(path[-1], rest_trajectory_angles("rest"))
    there = int(np.argmax(np.abs(path - np.where(LEGS, here, rest_trajectory_angles(aside))).max(axis=1) < 1e-12))
    assert there > 10
    assert not np.abs(path[: there + 1, LEGS] - here[LEGS]).any()  # legs wait
    assert (np.abs(path[there:] - rest_trajectory_angles("stand")).max(axis=1) < 1e-12).any()


def test_then_one_joint_of_an_arm_goes_first_the_outermost_before_all_others() -> None:
    here = rest_trajectory_angles("stand") + 0.1
    moved = [np.flatnonzero(next(begin(here)) != here).tolist() for begin in trajectories()]
    assert all(len(joints) > 1 for joints in moved[:4])
    assert sorted(joint for (joint,) in moved[4:]) == np.flatnonzero(~LEGS).tolist()
    elbows = {op3().joint_map.joints.index(joint) for joint in ("l_el", "r_el")}
    assert {moved[4][0], moved[5][0]} == elbows
    path = goals_of(4, here)
    alone = here[moved[4][0]] - path[:, moved[4][0]]
    assert np.abs(alone[: np.flatnonzero((path != here).sum(axis=1) > 1)[0]]).max() <= ALONE_RAD + 1e-12
    assert np.array_equal(path[-1], rest_trajectory_angles("rest"))


@pytest.mark.parametrize("number", [0, 1, 3, 6])
def test_every_trajectory_keeps_the_speeds_of_the_servos_and_ends_in_time(number: int) -> None:
    steps = np.diff(goals_of(number, rest_trajectory_angles("stand") + 0.2), axis=0)
    assert (np.abs(steps).max(axis=0) <= op3().joint_map.max_velocity * DT + 1e-12).all()
    assert len(steps) * DT <= 4 * REST_WITHIN_S < LONGEST_TO_REST_S


def test_a_robot_that_does_not_reach_rest_is_reported() -> None:
    rest, stand = rest_trajectory_angles("rest"), rest_trajectory_angles("stand")
    assert not_at_rest(op3(), rest + 0.9 * NEAR_REST, None) == ()
    (note,) = not_at_rest(op3(), stand, None)
    knees = {op3().joint_map.joints[joint] for joint in np.flatnonzero(np.abs(stand - rest) > 1.5)}
    assert any(f"{knee} 1.84 rad" in note for knee in knees)
    assert not_at_rest(op3(), stand, Stop(StopCause.REQUESTED, "asked", 0.0)) == (note,)
    assert not_at_rest(op3(), stand, Stop(StopCause.REQUESTED, "forced", 0.0, then=StopCause.REQUESTED)) == ()
    assert not_at_rest(op3(), stand, Stop(StopCause.TEMPERATURE, "hot", 0.0)) == (), "it stays, and the reason says so"
