"""Where the centre of mass belongs: over the feet that carry, less so while travelling."""

from math import cos, exp, pi, sin

import numpy as np
import pytest

from retarget.human.posture_prior import (
    HEAD_LEAD_M,
    LIFT_M,
    REACH_M,
    SLACK_M,
    Balance,
    Crouch,
    Heading,
    Point,
    VirtualFeet,
)
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions
from retarget.schema.priorities import CentreOfMassTask, HeadingSettings

TASK = CentreOfMassTask(type="centre_of_mass", mode="over_feet", forward=0.07, fade_speed=0.5)
LEFT, RIGHT = [0.0, 0.1, 0.1], [0.0, -0.1, 0.1]


def test_ahead_of_the_middle_of_the_feet() -> None:
    balance = Balance(TASK)
    balance.step([LEFT, RIGHT], (0.0, 1.0), dt=0.01)
    assert balance.goal[:2] == pytest.approx([0.0, 0.07])
    assert balance.weight == 1.0


def test_over_the_foot_that_stays_down() -> None:
    balance = Balance(TASK)
    balance.step([LEFT, [0.0, -0.1, 0.1 + LIFT_M]], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(0.1 / 3.0)
    balance.step([LEFT, [0.0, -0.1, 0.9]], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(0.1, abs=0.003)
    balance.step([RIGHT], (1.0, 0.0), dt=0.01)
    assert balance.goal[1] == pytest.approx(-0.1)


@pytest.mark.parametrize("rate", [24.0, 120.0])
def test_fades_with_the_speed_of_travel(rate: float) -> None:
    balance = Balance(TASK)
    for k in range(round(2.0 * rate)):
        x = 0.5 * k / rate
        balance.step([[x, 0.1, 0.1], [x, -0.1, 0.1]], (1.0, 0.0), dt=1.0 / rate)
    assert balance.weight == pytest.approx(0.5, abs=0.01)
    balance.start()
    balance.step([LEFT, RIGHT], (1.0, 0.0), dt=1.0 / rate)
    assert balance.weight == 1.0


def test_from_upright_to_lowered_with_the_head() -> None:
    human = build_human(proportional_dimensions(1.75))
    crouch = Crouch(human, upright="natural", lowered="crouch")
    upright, lowered = human.posture("natural"), human.posture("crouch")
    assert (crouch.posture(3.0) == upright).all()
    assert crouch.posture(0.1) == pytest.approx(lowered)
    heights = np.linspace(0.3, 1.6, 50)
    shares = [crouch.share(height) for height in heights]
    assert all(np.diff(shares) <= 0.0) and shares[0] == 1.0 and shares[-1] == 0.0
    middle = heights[np.argmin(np.abs(np.array(shares) - 0.5))]
    assert crouch.posture(middle) == pytest.approx(0.5 * (upright + lowered), abs=0.05)


def standing() -> VirtualFeet:
    feet = VirtualFeet(proportional_dimensions(1.75))
    feet.start([HEAD_LEAD_M[0], 0.0, 1.6], (1.0, 0.0), crouch=0.0)
    return feet


def test_they_stay_while_the_head_sways_and_while_it_goes_down() -> None:
    feet = standing()
    before = feet.ankles.copy()
    for share in np.linspace(0.0, 1.0, 20):
        feet.step([HEAD_LEAD_M[0] + share * 0.9 * REACH_M, 0.0, 1.6], (1.0, 0.0), crouch=0.0, dt=0.05)
    for share in np.linspace(0.3, 1.0, 20):
        ahead = HEAD_LEAD_M[0] + share * (HEAD_LEAD_M[1] - HEAD_LEAD_M[0])
        feet.step([ahead, 0.0, 1.6 - 0.8 * share], (1.0, 0.0), crouch=share, dt=0.05)
    assert (feet.ankles == before).all()


def test_in_a_jump_they_leave_the_floor_on_legs_that_bend_a_little() -> None:
    feet, floor = standing(), standing().ankles[0, 2]
    heads = np.linspace(1.5, 2.2, 140)  # [m] up from a crouch; the last ones are a jump
    heights, lengths = [], []
    for head in heads:
        feet.step([HEAD_LEAD_M[0], 0.0, head], (1.0, 0.0), crouch=0.0, dt=0.01)
        heights.append(feet.ankles[0, 2])
        lengths.append(np.linalg.norm(feet.ankles[0] - [HEAD_LEAD_M[0], 0.0, head]))
    off = np.array(heights) > floor
    assert off.any() and not off.all() and (np.diff(heights) >= 0.0).all()
    longest = max(lengths)
    assert longest - lengths[-1] == pytest.approx(SLACK_M, abs=4e-3)
    assert max(np.diff(heights)) < 2.1 * (heads[1] - heads[0])  # at most twice as fast as the head, as they leave it


# The heading from a few sensors: what hints at it, how fast it follows, that it does not depend on the rate.

STANDING: dict[str, Point] = {
    "head": (0.0, 0.0, 1.6),
    "l_wrist": (0.1, 0.25, 0.9),
    "r_wrist": (0.1, -0.25, 0.9),
    "l_ankle": (0.0, 0.1, 0.1),
    "r_ankle": (0.0, -0.1, 0.1),
}


def moved(points: dict[str, Point], angle: float = 0.0, x: float = 0.0, y: float = 0.0) -> dict[str, Point]:
    return {
        name: (x + cos(angle) * p[0] - sin(angle) * p[1], y + sin(angle) * p[0] + cos(angle) * p[1], p[2])
        for name, p in points.items()
    }


@pytest.mark.parametrize("rate", [24.0, 60.0, 120.0, 125.0])
def test_follows_with_its_time_constant_at_any_rate(rate: float) -> None:
    heading = Heading(HeadingSettings(settle=0.2, velocity=0.0))
    heading.start(STANDING, {})
    for _ in range(round(0.2 * rate)):
        heading.step(moved(STANDING, pi / 2), {}, dt=1.0 / rate)
    follows = 1.0 - exp(-round(0.2 * rate) / rate / 0.2)
    assert heading.forward[1] / heading.forward[0] == pytest.approx(follows / (1.0 - follows), rel=1e-6)


def test_sensors_that_know_where_they_look_count() -> None:
    heading = Heading(HeadingSettings())
    heading.start({"head": STANDING["head"]}, {"head": (0.0, 0.9)})
    assert heading.forward == pytest.approx((0.0, 1.0))


def test_without_any_hint_the_heading_stays() -> None:
    heading = Heading(HeadingSettings())
    heading.start(moved(STANDING, 1.0), {})
    for _ in range(2000):
        heading.step({}, {}, dt=0.01)
    assert heading.forward == pytest.approx((cos(1.0), sin(1.0)))
