"""Where the centre of mass belongs, what carries the pelvis, how a body gets down, where feet without sensors are."""

from itertools import pairwise

import numpy as np
import pytest

from retarget.human.posture_prior import (
    HEAD_AHEAD_M,
    LIFT_M,
    REACH_M,
    SLACK_M,
    Balance,
    Carried,
    Crouch,
    VirtualFeet,
)
from retarget.model.human import PostureReader, build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.schema.priorities import CentreOfMassTask

TASK = CentreOfMassTask(type="centre_of_mass", mode="over_feet", forward=0.07, fade_speed=0.5)
LEFT, RIGHT = [0.0, 0.1, 0.1], [0.0, -0.1, 0.1]
AT = (0.0, 0.0, 0.9)
SHARES = {"head": 0.66, "l_ankle": 0.17, "r_ankle": 0.17}


def test_balance_is_ahead_of_the_middle_of_the_feet_or_over_the_one_that_stays_down() -> None:
    balance = Balance(TASK)
    balance.step([LEFT, RIGHT], (0.0, 1.0), dt=0.01)
    assert balance.goal[:2] == pytest.approx([0.0, 0.07])
    assert balance.weight == 1.0
    balance = Balance(TASK)
    balance.step([LEFT, [0.0, -0.1, 0.1 + LIFT_M]], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(0.1 / 3.0)
    balance.step([LEFT, [0.0, -0.1, 0.9]], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(0.1, abs=0.003)
    balance.step([RIGHT], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(-0.1)


def test_a_raised_heel_carries_in_a_deep_crouch() -> None:
    """A person who kneels on the right knee sits on the right foot, the ankle of which is high."""
    balance = Balance(TASK)
    kneeling = [LEFT, [0.0, -0.1, 0.1 + LIFT_M]]
    balance.step(kneeling, (1.0, 0.0), dt=0.01, lowered=1.0)
    assert balance.goal[1] < 0.1 / 10.0
    balance.step(kneeling, (1.0, 0.0), dt=0.01, lowered=0.3)
    assert balance.goal[1] > 0.1 / 3.5


@pytest.mark.parametrize("rate", [24.0, 120.0])
def test_balance_fades_in_a_jump_and_with_the_speed_of_travel(rate: float) -> None:
    balance = Balance(TASK)
    for k in range(30):
        balance.step([[0.0, 0.1, 0.02 * k], [0.0, -0.1, 0.02 * k]], (1.0, 0.0), dt=0.01)
    assert balance.weight < 0.05
    balance = Balance(TASK)
    for k in range(round(2.0 * rate)):
        x = 0.5 * k / rate
        balance.step([[x, 0.1, 0.1], [x, -0.1, 0.1]], (1.0, 0.0), dt=1.0 / rate)
    assert balance.weight == pytest.approx(0.5, abs=0.01)
    balance.start()
    balance.step([LEFT, RIGHT], (1.0, 0.0), dt=1.0 / rate)
    assert balance.weight == 1.0


def test_a_crouch_lowers_with_the_head_and_a_bend_has_it_ahead_of_the_feet() -> None:
    human = build_human(proportional_dimensions(1.75))
    crouch = Crouch(human, upright="natural", lowered="crouch")
    upright, lowered = human.posture("natural"), human.posture("crouch")
    assert (crouch.posture(0.0) == upright).all()
    assert crouch.posture(1.0) == pytest.approx(lowered)
    shares = [crouch.share(away) for away in np.linspace(0.3, 1.6, 50)]
    assert all(np.diff(shares) <= 0.0) and shares[0] == 1.0 and shares[-1] == 0.0
    assert crouch.posture(0.5) == pytest.approx(0.5 * (upright + lowered))
    joints = PostureReader(human).joints(np.stack([upright, lowered]))
    heights = joints[:, POINTS.index("head"), 2] - joints[:, POINTS.index("l_ankle"), 2]
    assert [crouch.share_by_height(height) for height in heights.tolist()] == pytest.approx([0.0, 1.0], abs=0.01)
    assert crouch.bent(0.5, 0.7) == 1.0
    assert crouch.bent(0.5, 0.0) == crouch.bent(0.5, -0.3) == crouch.bent(0.0, 0.7) == 0.0
    assert 0.0 < crouch.bent(0.1, 0.3) < crouch.bent(0.2, 0.3) < crouch.bent(0.2, 0.4) < 1.0


@pytest.mark.parametrize("shares", [SHARES, dict(reversed(SHARES.items()))])
def test_the_pelvis_goes_with_head_and_feet_but_not_with_feet_that_fly(shares: dict[str, float]) -> None:
    """In a walk the feet go like the head on average; legs drawn up in a jump do not lift the pelvis."""
    points = {"head": [0.0, 0.0, 1.6], "l_ankle": [0.0, 0.1, 0.1], "r_ankle": [0.0, -0.1, 0.1]}

    def way(head: float, left: float, right: float, axis: int) -> float:
        carried, after = Carried(shares), {name: list(point) for name, point in points.items()}
        assert carried.step(AT, points, 0.01) == AT
        for name, speed in (("head", head), ("l_ankle", left), ("r_ankle", right)):
            after[name][axis] += 0.01 * speed
        return (carried.step(AT, after, 0.01)[axis] - AT[axis]) / 0.01

    assert way(1.3, 2.6, 0.0, axis=0) == pytest.approx(1.3)
    assert way(0.6, 0.0, 0.0, axis=2) == pytest.approx(0.4, abs=0.02)
    assert way(0.5, 5.0, 5.0, axis=2) < 1.3


def test_a_sensor_that_is_not_there_does_not_carry() -> None:
    carried = Carried(SHARES)
    carried.step(AT, {"head": [0.0, 0.0, 1.6]}, 0.01)
    after = carried.step(AT, {"head": [0.01, 0.0, 1.6], "l_ankle": [0.0, 0.0, 0.1]}, 0.01)
    assert after == pytest.approx((AT[0] + 0.01, AT[1], AT[2]))
    assert carried.step(AT, {}, 0.01) == AT


def standing() -> VirtualFeet:
    feet = VirtualFeet(proportional_dimensions(1.75))
    feet.start([HEAD_AHEAD_M[0], 0.0, 1.6], (1.0, 0.0), crouch=0.0)
    return feet


def test_they_stay_while_the_head_sways_and_while_it_goes_down() -> None:
    feet = standing()
    before = feet.ankles.copy()
    for share in np.linspace(0.0, 1.0, 20):
        feet.step([HEAD_AHEAD_M[0] + share * 0.9 * REACH_M, 0.0, 1.6], (1.0, 0.0), crouch=0.0, dt=0.05)
    for share in np.linspace(0.3, 1.0, 20):
        ahead = HEAD_AHEAD_M[0] + share * (HEAD_AHEAD_M[1] - HEAD_AHEAD_M[0])
        feet.step([ahead, 0.0, 1.6 - 0.8 * share], (1.0, 0.0), crouch=share, dt=0.05)
    assert (feet.ankles == before).all()


def test_of_a_walk_they_step_in_turn_and_do_not_slide() -> None:
    feet, dt, seen = standing(), 0.01, []
    for k in range(300):
        feet.step([HEAD_AHEAD_M[0] + 1.2 * dt * k, 0.0, 1.5], (1.0, 0.0), crouch=0.0, dt=dt)
        seen.append(feet.ankles.copy())
    ankles = np.array(seen)[100:]  # its first steps hurry after a head that sets off in no time
    moved = np.linalg.norm(np.diff(ankles, axis=0), axis=2) > 1e-9  # (T, 2)
    assert not moved.all(axis=1).any()
    begins = np.argwhere(np.diff(moved.astype(int), axis=0) == 1)  # (steps, 2): tick and foot
    assert len(begins) >= 6 and all(one != other for one, other in pairwise(begins[1:, 1]))
    assert 0.02 < ankles[..., 2].max() - feet.ankle_height < 0.1
    assert np.abs(ankles[-100:, :, 0].mean() - 1.2 * dt * np.arange(200, 300).mean()) < 0.1  # they stay below the head


def test_in_a_jump_they_leave_the_floor_on_legs_that_bend_a_little() -> None:
    feet, floor = standing(), standing().ankles[0, 2]
    heads = np.linspace(1.5, 2.2, 140)  # [m] up from a crouch; the last ones are a jump
    heights, lengths = [], []
    for head in heads:
        feet.step([HEAD_AHEAD_M[0], 0.0, head], (1.0, 0.0), crouch=0.0, dt=0.01)
        heights.append(feet.ankles[0, 2])
        lengths.append(np.linalg.norm(feet.ankles[0] - [HEAD_AHEAD_M[0], 0.0, head]))
    off = np.array(heights) > floor
    assert off.any() and not off.all() and (np.diff(heights) >= 0.0).all()
    longest = max(lengths)
    assert longest - lengths[-1] == pytest.approx(SLACK_M, abs=4e-3)
    assert max(np.diff(heights)) < 2.1 * (heads[1] - heads[0])  # at most twice as fast as the head, as they leave it
