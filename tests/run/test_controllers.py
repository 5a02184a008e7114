"""Controllers: slow moves in joint space, the approach, the return to stance, and the way to rest."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from followers import DT, follower, op3, performer, postures
from hardware.errors import RetargetError
from messages import refuses
from retarget.human.samples import PerformerInput
from retarget.ik.support_polygon import plant
from retarget.ik.whole_body_stop import StopPath
from retarget.report.motion_metrics import limit_violations
from retarget.run.controllers import (
    REST_WITHIN_S,
    RETRY_S,
    SPEED_UP_S,
    Approach,
    ApproachPart,
    ComeToRest,
    Follow,
    GoToRest,
    ReturnToStance,
    SlowMove,
    Target,
    first_commanded,
    next_commanded,
    require_finite,
    rest_joints,
)
from retarget.safety.gate import Gate
from retarget.types import FloatArray, HumanPosture, RobotPosture
from rig import StubFollower, StubReconstructor, person, short_clip

SHARE = 0.2
STANDS_S = 0.35
"""Longest time from a hold until the robot stands, s."""


@cache
def standing() -> FloatArray:
    return plant(op3(), op3().profile.postures.stand).q


def stand() -> FloatArray:
    return standing()[op3().servo_columns]


class Driven:
    """A robot that is driven by targets through a gate. path: the postures (n,) rad that were commanded."""

    def __init__(self, *, script: FloatArray | None = None, present: FloatArray | None = None) -> None:
        self.follower = StubFollower(op3(), np.zeros((1, 20)) if script is None else script)
        self.gate = Gate(op3().joint_map, dt=DT)
        self.refuses = False
        self.path = [stand() if present is None else present]
        self.commanded = first_commanded(op3(), self.gate.begin(self.path[0]), standing())

    def take(self, target: Target | None) -> bool:
        """One tick; whether the target was sent."""
        last = self.commanded.goal
        passed = None if target is None or self.refuses else self.gate.check(last, target.joints)
        goal = passed or self.gate.brake(last)
        self.commanded = next_commanded(op3(), self.commanded, goal, target, dt=DT, on_soles=True)
        self.path.append(goal.posture)
        return passed is not None

    def speeds(self) -> FloatArray:
        """Shares of the servos' greatest speeds, (T, n)."""
        return np.asarray(np.abs(np.diff(self.path, axis=0)) / DT / op3().joint_map.max_velocity)

    def assert_within_limits(self) -> None:
        counted = limit_violations(np.array(self.path), op3().limits, DT)
        assert (counted.velocity, counted.acceleration) == (0, 0)

    def assert_straight(self, first: int = 0) -> None:
        path = np.array(self.path[first:])
        assert np.linalg.matrix_rank(path - path[-1], tol=1e-6) <= 1


# Slow moves.


def there() -> FloatArray:
    joints, far = op3().joint_map, np.random.default_rng(1).uniform(-1.0, 1.0, 20)
    return np.asarray(np.clip(stand() + far, joints.lower, joints.upper))


def slow_move(driven: Driven) -> SlowMove:
    move = SlowMove(op3(), share=SHARE, dt=DT)
    move.begin(driven.commanded)
    return move


def test_a_slow_move_is_straight_and_ends_exactly_at_its_goal_at_its_share_of_speed() -> None:
    driven, goal = Driven(), there()
    move = slow_move(driven)
    while not move.is_at(goal, driven.commanded):
        assert driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    np.testing.assert_array_equal(driven.path[-1], goal)
    assert 0.9 * SHARE < driven.speeds().max() <= SHARE * (1.0 + 1e-9)
    driven.assert_straight()
    driven.assert_within_limits()


def test_a_warm_robot_moves_more_slowly() -> None:
    ticks = []
    for override in (1.0, 0.5):
        driven, goal = Driven(), there()
        move = slow_move(driven)
        while not move.is_at(goal, driven.commanded):
            driven.take(move.towards(goal, driven.commanded, speed_override=override))
        assert driven.speeds().max() <= override * SHARE * (1.0 + 1e-9)
        ticks.append(len(driven.path))
    assert ticks[1] > 1.3 * ticks[0]


@pytest.mark.parametrize("after", [3, 40, 70])
def test_it_brakes_on_its_line_and_stands_soon(after: int) -> None:
    driven, goal = Driven(), there()
    move = slow_move(driven)
    for _ in range(after):
        driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    for _ in range(round(STANDS_S / DT)):
        assert driven.take(move.brake(driven.commanded))
    assert driven.commanded.stands and not move.is_at(goal, driven.commanded)
    driven.assert_straight()
    driven.assert_within_limits()


def test_a_refused_move_stands_for_a_moment_and_tries_again_from_there() -> None:
    driven, goal = Driven(), there()
    move = slow_move(driven)
    for _ in range(60):
        driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    driven.refuses = True
    while not driven.commanded.stands:
        driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    stood = driven.path[-1]
    driven.refuses, waited = False, 0
    while np.array_equal(driven.path[-1], stood):
        driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
        waited += 1
    assert waited * DT == pytest.approx(RETRY_S, abs=3 * DT)
    while not move.is_at(goal, driven.commanded):
        assert driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    np.testing.assert_array_equal(driven.path[-1], goal)
    driven.assert_within_limits()


def test_a_move_goes_on_after_a_hold_of_a_robot_that_stands_and_not_after_another_goal() -> None:
    driven, goal = Driven(), there()
    move = slow_move(driven)
    for _ in range(20):
        driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    while not driven.commanded.stands:
        driven.take(move.brake(driven.commanded))
    for held in (driven.commanded.target, None):
        driven.take(held)
        assert not move.is_refused(driven.commanded)
    assert driven.take(move.towards(goal, driven.commanded, speed_override=1.0))
    driven.take(Target(driven.commanded.joints + 1e-4))
    assert move.is_refused(driven.commanded) and move.brake(driven.commanded) is None


# The approach.


class SettlingFollower(StubFollower):
    """Settles in `lasts` ticks."""

    lasts = 10

    def settle(self, human: HumanPosture, dt: float) -> RobotPosture | None:
        self.lasts -= 1
        return None if self.lasts < 0 else self._made(0)


def approaching(driven: Driven) -> Approach:
    return Approach(op3(), driven.follower, postures(performer())[0], dt=DT)


def test_the_approach_goes_straight_to_the_first_posture_then_settles_on_its_soles() -> None:
    present = stand() - 0.2
    driven = Driven(present=present)
    driven.follower = SettlingFollower(op3(), np.zeros((1, 20)))
    approach, parts = approaching(driven), []
    assert not driven.follower.overrides and approach.first.joint_positions.tolist() == stand().tolist()
    while not approach.arrived:
        target = approach.target(driven.commanded, PerformerInput(), speed_override=0.5)
        if target is not None:
            driven.take(target)
            parts.append((approach.part, target.q is not None))
    assert parts.count((ApproachPart.SETTLING, True)) == 10 and (ApproachPart.STRAIGHT, True) not in parts
    cap = op3().profile.safety.speed_caps.approach
    assert driven.speeds().max() <= 0.5 * cap * (1.0 + 1e-9)
    assert set(driven.follower.overrides) == {0.5 * cap}, "no joint is led faster than the profile's share"
    straight = sum(part is ApproachPart.STRAIGHT for part, _ in parts)
    assert driven.follower.passed_s == pytest.approx(straight * DT), "obstacles move on"
    np.testing.assert_array_equal(driven.path[-1], stand())


def test_an_approach_that_is_not_finite_is_refused() -> None:
    posture = follower().start(postures(performer())[0])
    assert require_finite(posture) is posture
    with refuses(RetargetError):
        require_finite(replace(posture, q=np.full_like(posture.q, np.nan)))


def test_a_stop_on_the_straight_part_keeps_its_line_and_one_on_the_soles_is_the_one_that_was_verified() -> None:
    present = stand() - 0.3
    driven = Driven(present=present)
    approach = approaching(driven)
    stop = ComeToRest(op3(), driven.follower, approach, driven.gate, dt=DT)
    for _ in range(60):
        driven.take(approach.target(driven.commanded, PerformerInput(), speed_override=1.0))
    while not driven.commanded.stands:
        target = stop.target(driven.commanded, PerformerInput(), speed_override=1.0)
        assert target is not None and target.q is None and driven.take(target)
    stays = stop.target(driven.commanded, PerformerInput(), speed_override=1.0)
    assert stays is driven.commanded.target and np.array_equal(stays.joints, driven.commanded.joints)
    driven.assert_straight()
    moving = StopPath(np.array([standing(), standing() + 1e-3]))
    driven.commanded = replace(driven.commanded, target=Target(stays.joints, stop=moving))
    assert driven.take(stop.target(driven.commanded, PerformerInput(), speed_override=1.0))
    assert driven.commanded.target.stop is None, "where it stands nothing leads on"
    approach.part = ApproachPart.SETTLING
    driven.commanded = replace(driven.commanded, stood_s=0.0, waited_s=0.0)
    before = driven.follower.passed_s
    assert stop.target(driven.commanded, PerformerInput(), speed_override=1.0) is None
    assert driven.follower.passed_s == pytest.approx(before + DT), "obstacles move on"


# Following.


@pytest.mark.parametrize(("warm", "away"), [(1.0, 0.0), (0.3, 0.0), (1.0, 0.05)])
def test_following_begins_slowly_after_a_hold(warm: float, away: float) -> None:
    driven, reconstructor, sample = Driven(), StubReconstructor(person()), short_clip().sample(0)
    assert sample is not None
    human = reconstructor.start(sample)
    follow = Follow(reconstructor, driven.follower, human, dt=DT, motion_dt=DT, slow=0.2)
    performer = PerformerInput(sample=sample)
    for _ in range(2):
        follow.begin(driven.commanded)
        assert follow.target(driven.commanded, performer, speed_override=warm) is not None
    assert reconstructor.resumed == 1, "the first time the body stands at the first sample"
    reconstructor.off = away
    for _ in range(round(0.5 * SPEED_UP_S / DT) - 1):
        follow.target(driven.commanded, performer, speed_override=warm)
    begun, after, *_, half = driven.follower.overrides
    assert begun == warm and after == pytest.approx(min(0.2 + 0.8 * DT / SPEED_UP_S, warm))
    assert half == pytest.approx(min(after if away else 0.6, warm), abs=0.02)


# The return to stance.


class ReturningFollower(StubFollower):
    """Returns to stance in 20 ticks, the first joint by 0.002 rad a tick."""

    left = 20

    def return_to_stance(self, dt: float) -> FloatArray | None:
        self.left -= 1
        q = standing().copy()
        q[self.robot.servo_columns[0]] += 0.002 * (20 - self.left)
        return None if self.left < 0 else q


@pytest.mark.parametrize("warm", [1.0, 0.25])
def test_it_returns_to_stance_from_where_it_stands(warm: float) -> None:
    driven, robot = Driven(), ReturningFollower(op3(), np.zeros((1, 20)))
    to_stance = ReturnToStance(op3(), robot, dt=DT)
    to_stance.begin(driven.commanded)
    targets = list[Target]()
    while not to_stance.has_arrived(driven.commanded):
        targets.append(to_stance.target(driven.commanded, PerformerInput(), speed_override=warm))
    *led, last = targets
    assert len(led) == 20 and all(target.q is not None for target in led)
    assert last.q is None and np.array_equal(last.joints, driven.commanded.joints)
    assert set(robot.overrides) == {warm}
    assert len(robot.returns) == 1 and np.array_equal(robot.returns[0], stand())


# The way to rest.


def going(driven: Driven, *keyframes: str) -> GoToRest:
    rest = GoToRest(op3(), keyframes or ("rest",), dt=DT, pass_time=driven.follower.pass_time)
    assert not rest.has_arrived(driven.commanded)
    rest.begin(driven.commanded)
    return rest


def arrive(driven: Driven, rest: GoToRest) -> int:
    """Ticks until the robot is at rest."""
    ticks = 0
    while not rest.has_arrived(driven.commanded):
        driven.take(rest.target(driven.commanded, PerformerInput(), speed_override=1.0))
        ticks += 1
        assert ticks < 10**4
    return ticks


def test_it_goes_straight_to_rest_in_time_with_its_soles_where_they_are() -> None:
    driven = Driven()
    ticks = arrive(driven, going(driven))
    np.testing.assert_array_equal(driven.path[-1], rest_joints(op3()))
    assert 1.0 < ticks * DT <= REST_WITHIN_S + 5 * DT
    driven.assert_straight()
    driven.assert_within_limits()
    soles = op3().points(np.array([standing(), driven.commanded.q]), ("l_sole", "r_sole"))
    lower = soles[0, :, 2].argmin()
    assert np.abs(soles[1, lower] - soles[0, lower]).max() < 1e-9
    assert driven.follower.passed_s == pytest.approx(ticks * DT), "obstacles move on"


def test_it_passes_the_keyframes_of_the_profile_in_their_order() -> None:
    driven = Driven()
    arrive(driven, going(driven, "attractor", "stand", "rest"))
    aside = op3().posture(op3().profile.postures.attractor)[op3().servo_columns]
    at = [int(np.abs(np.array(driven.path) - goal).max(axis=1).argmin()) for goal in (aside, rest_joints(op3()))]
    assert np.array_equal(driven.path[at[0]], aside) and 0 < at[0] < at[1]
    back = np.abs(np.array(driven.path[at[0] :]) - stand()).max(axis=1)
    assert back.min() == 0.0
    np.testing.assert_array_equal(driven.path[-1], rest_joints(op3()))
    driven.assert_within_limits()


def test_where_the_gate_refuses_the_way_it_holds_and_goes_on_when_it_is_clear() -> None:
    driven = Driven()
    rest = going(driven)
    for tick in range(400):
        driven.refuses = tick >= 60
        driven.take(rest.target(driven.commanded, PerformerInput(), speed_override=1.0))
    assert driven.commanded.stood_s > 1.0 and not rest.has_arrived(driven.commanded)
    driven.refuses = False
    arrive(driven, rest)
    np.testing.assert_array_equal(driven.path[-1], rest_joints(op3()))
    driven.assert_within_limits()


# Where the robot was commanded to.


def test_a_goal_that_is_refused_is_where_the_gate_brakes_to() -> None:
    driven = Driven()
    far = standing().copy()
    far[op3().servo_columns] += 1.0
    driven.take(Target(stand() + 1.0, far))
    np.testing.assert_array_equal(driven.commanded.joints, stand())
    assert driven.commanded.stands and not driven.commanded.velocity.any()
    q = standing().copy()
    q[op3().servo_columns[0]] += 1e-4
    assert driven.take(Target(q[op3().servo_columns], q))
    np.testing.assert_array_equal(driven.commanded.q, q)
    assert driven.commanded.velocity.any()
    assert not driven.commanded.stands
