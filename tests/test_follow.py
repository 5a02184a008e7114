"""The robot's stage: what it keeps whatever comes, and what it reaches."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import (
    DT,
    Followed,
    assert_within_limits,
    collect,
    follow,
    follower,
    op3,
    performance,
    performer,
    postures,
    sole_errors,
)
from retarget.gate import Gate
from retarget.metrics.reach import reachable_hands
from retarget.metrics.tracking import excursion_ratio, path_ratio
from retarget.robot_reader import standing_dofs


@cache
def run(speed: float, parts: str = "whole") -> Followed:
    return follow(follower(parts=parts), postures(performer(), speed=speed))


@pytest.mark.parametrize("speed", [0.5, 1.0])
def test_limits_soles_and_balance_hold(speed: float) -> None:
    done = run(speed)
    assert_within_limits(done.joints)
    off, tilt = sole_errors(follower(), done.q)
    assert off < 0.0015 and tilt < np.deg2rad(0.5)
    assert done.support.min() > 0.003


def test_at_half_speed_the_robot_does_what_is_asked() -> None:
    done = run(0.5)
    hands = [done.names.index("l_hand"), done.names.index("r_hand")]
    ratio = path_ratio(done.asked[:, hands], done.reached[:, hands])
    asked, reached = done.track("pelvis")
    crouch = excursion_ratio(asked[:, 2], reached[:, 2])
    human = postures(performer(), speed=0.5)
    within = reachable_hands(op3(), performance([human[0], *human], done.names, done.asked), done.reached)
    assert ratio is not None and 0.9 < ratio < 1.1
    assert crouch is not None and crouch > 0.8
    for hand in within.values():
        assert hand.share > 0.2 and hand.error is not None and hand.error < 0.010


def test_the_gate_has_nothing_to_change() -> None:
    done = run(1.0)
    gate = Gate.for_servos(op3().joint_map, dt=DT)
    gate.seed(done.joints[0])
    for goal in done.joints[1:]:
        assert gate.admit(goal).tolist() == goal.tolist()


def test_a_halt_at_any_tick_stops_on_the_soles_and_following_goes_on_from_there() -> None:
    robot, human = follower(), postures(performer())
    q = [robot.start(human[0]).q]
    for tick, posture in enumerate(human[:900]):
        q.append(robot.step(posture, DT).q)
        if tick % 150 == 149:
            before = len(q)
            while len(q) < before + 3 or np.abs(q[-1] - q[-2]).max() > 0.0:
                now = robot.halt(DT)
                assert now is not None and len(q) < before + 30
                q.append(now)
    whole = np.array(q)
    assert_within_limits(whole[:, op3().servo_columns])
    off, tilt = sole_errors(robot, whole)
    assert off < 0.0015 and tilt < np.deg2rad(0.5)


def test_where_no_soles_carry_the_robot_no_way_is_known() -> None:
    robot = follower(parts="upper")
    robot.start(postures(performer())[0])
    assert robot.halt(DT) is None


def test_legs_are_still_to_the_bit_when_only_the_upper_part_follows() -> None:
    done = run(1.0, "upper")
    body = op3().body
    address = [body.joint_qpos[body.joint_index(joint)] for joint in op3().joint_map.joints]
    standing = standing_dofs(op3())
    legs = [i for i, joint in enumerate(op3().joint_map.joints) if standing[body.dof_index(joint)]]
    assert len(legs) == 12 and len(address) == 20
    assert (done.joints[:, legs] == done.joints[0, legs]).all()
    assert (done.q[:, :7] == done.q[0, :7]).all()
    assert np.ptp(done.joints, axis=0).max() > 1.0
    assert_within_limits(done.joints)


def test_a_still_performer_is_a_still_robot() -> None:
    human = postures(performer())
    done = follow(follower(), [human[250]] * 700)
    assert np.abs(np.diff(done.joints[-100:], axis=0)).max() / DT < 2e-3


def test_the_way_to_the_performer_is_slow_and_does_not_overshoot() -> None:
    human = postures(performer())
    done = follow(follower(), [human[150]] * 600)
    hand_speed = np.linalg.norm(np.diff(done.track("r_hand")[1], axis=0), axis=1) / DT
    assert 0.05 < hand_speed[:60].max() < 0.2
    assert np.abs(np.diff(done.joints[:15], n=2, axis=0)).max() / DT**2 < 20.0  # no lurch
    for name in ("l_hand", "r_hand", "pelvis"):
        asked, reached = done.track(name)
        towards = asked[-1] - reached[0]
        length = np.linalg.norm(towards)
        if length > 0.01:
            assert ((reached - reached[0]) @ towards / length**2).max() < 1.05


def test_a_jump_of_the_performer_is_caught_up_with_and_not_overshot() -> None:
    human = postures(performer())
    done = follow(follower(), [human[10]] * 400 + [human[150]] * 600)
    after = done.track("r_hand")[1][400:]
    way = after[-1] - after[0]
    assert np.linalg.norm(way) > 0.05
    assert ((after - after[0]) @ way / (way @ way)).max() < 1.03
    assert np.abs(np.diff(done.joints[-50:], axis=0)).max() / DT < 0.02
    assert_within_limits(done.joints)


def test_left_and_right_are_alike() -> None:
    frames = performer()
    straight = run(0.5)
    mirrored = follow(follower(frames.mirror()), postures(frames.mirror(), speed=0.5))
    for left, right in (("l_hand", "r_hand"), ("pelvis", "pelvis"), ("head", "head")):
        reached = straight.track(left)[1] * np.array([1.0, -1.0, 1.0])
        difference = np.linalg.norm(reached - mirrored.track(right)[1], axis=1)
        assert difference.mean() < 0.002, left


def test_the_same_bits_every_time() -> None:
    human = postures(performer())[:200]
    robot = follower()
    first, again = follow(robot, human), follow(robot, human)
    assert (first.q == again.q).all()


def test_it_goes_on_from_where_the_gate_left_it() -> None:
    human, robot = postures(performer()), follower()
    done = [robot.start(human[0]), *(robot.step(posture, DT) for posture in human[:100])]
    still = done[-1].q
    robot.reseed(still, np.zeros(op3().body.nv))
    done = [*[done[-1]] * 3, *(robot.step(posture, DT) for posture in human[100:300])]
    assert_within_limits(collect(done).joints)
    assert sole_errors(robot, collect(done).q)[0] < 0.0015


@settings(max_examples=6)
@given(st.lists(st.tuples(st.integers(0, 2000), st.integers(1, 40)), min_size=5, max_size=12))
def test_whatever_comes_limits_soles_and_balance_hold(jumps: list[tuple[int, int]]) -> None:
    human = postures(performer())
    robot = follower()
    done = follow(robot, [human[place] for place, ticks in jumps for _ in range(ticks)])
    assert_within_limits(done.joints)
    off, tilt = sole_errors(robot, done.q)
    assert off < 0.0015 and tilt < np.deg2rad(1.0)
    assert done.support.min() > 0.0
