"""The heading from a few sensors: what hints at it, how fast it follows, that it does not depend on the rate."""

from math import cos, degrees, exp, pi, sin

import numpy as np
import pytest

from retarget.human.heading import Heading
from retarget.human.posture_prior import Point
from retarget.schema.priorities import HeadingSettings, load_priorities

ABOVE = 1.5
"""Height of the head above the ankles, m."""
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


def angle_of(heading: Heading) -> float:
    """To the left of x, degrees."""
    return degrees(np.arctan2(heading.forward[1], heading.forward[0]))


def human_heading(points: dict[str, Point], *, feet: bool = True) -> Heading:
    heading = Heading(load_priorities("human").heading, ABOVE, feet=feet)
    heading.start(points, {})
    return heading


def stay(heading: Heading, points: dict[str, Point], ticks: int) -> None:
    for _ in range(ticks):
        heading.step(points, {}, dt=0.01)


def test_a_still_performer_s_heading_stays() -> None:
    """Hints of moving parts and of a pelvis that faces elsewhere, from the first instant on."""
    heading, facing = human_heading(STANDING), {"pelvis": (0.0, 1.0)}
    heading.start(STANDING, facing)
    begun = angle_of(heading)
    assert 10.0 < begun < 80.0
    for _ in range(300):
        heading.step(STANDING, facing, dt=0.008)
        assert angle_of(heading) == pytest.approx(begun, abs=1e-6)


@pytest.mark.parametrize("rate", [24.0, 60.0, 120.0, 125.0])
def test_follows_with_its_time_constant_at_any_rate(rate: float) -> None:
    heading = Heading(HeadingSettings(settle=0.2, velocity=0.0), ABOVE)
    heading.start(STANDING, {})
    for _ in range(round(0.2 * rate)):
        heading.step(moved(STANDING, pi / 2), {}, dt=1.0 / rate)
    follows = 1.0 - exp(-round(0.2 * rate) / rate / 0.2)
    assert heading.forward[1] / heading.forward[0] == pytest.approx(follows / (1.0 - follows), rel=1e-6)


def test_an_oriented_sensor_counts_and_without_any_hint_the_heading_stays() -> None:
    heading = Heading(HeadingSettings(), ABOVE)
    heading.start({"head": STANDING["head"]}, {"head": (0.0, 0.9)})
    assert heading.forward == pytest.approx((0.0, 1.0))
    heading.start(moved(STANDING, 1.0), {})
    stay(heading, {}, 2000)
    assert heading.forward == pytest.approx((cos(1.0), sin(1.0)))


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_the_heading_turns_with_the_body_wherever_it_stands(turn: float) -> None:
    heading, size = human_heading(moved(STANDING, turn, x=3.0, y=-1.0)), 0.7
    assert heading.forward == pytest.approx((cos(turn), sin(turn)))
    smaller = Heading(load_priorities("human").heading, size * ABOVE)
    reaching = STANDING | {"l_wrist": (0.5, 0.0, 1.2)}
    heading.start(moved(reaching), {})
    smaller.start({name: tuple(size * c for c in point) for name, point in reaching.items()}, {})
    assert angle_of(smaller) == pytest.approx(angle_of(heading), abs=1.0)  # lines between the ankles weigh by the metre


def test_a_mirrored_body_has_the_mirrored_heading() -> None:
    left = human_heading(STANDING | {"l_wrist": (0.5, 0.1, 0.3)})
    right = human_heading(STANDING | {"r_wrist": (0.5, -0.1, 0.3)})
    assert angle_of(left) == pytest.approx(-angle_of(right)) != 0.0


def test_one_hand_that_reaches_forward_turns_the_body_little() -> None:
    """The line between the wrists turns by 45 degrees, the body of a person by about 10."""
    assert abs(angle_of(human_heading(STANDING | {"r_wrist": (0.6, -0.25, 1.2)}))) < 25.0


def test_planted_feet_keep_the_heading_while_the_trunk_bends_to_the_side() -> None:
    """Head and hands go half a metre to the side and back, as in a side bend; its own direction is 90 degrees off."""
    bent = {name: p if "ankle" in name else (p[0], p[1] + 0.5, p[2] - 0.4) for name, p in STANDING.items()}

    def turned_by(settings: HeadingSettings) -> float:
        heading = Heading(settings, ABOVE)
        heading.start(STANDING, {})
        stay(heading, STANDING, 500)
        stay(heading, bent, 150)
        return abs(angle_of(heading))

    settings = load_priorities("human").heading
    assert turned_by(settings) < 0.7 * turned_by(settings.model_copy(update={"stance": 0.0}))


@pytest.mark.parametrize("rate", [1.0, 6.0])
def test_a_body_that_turns_on_its_feet_is_followed(rate: float) -> None:
    """By steps, or by shuffling so slowly that both feet seem planted. rate: rad/s, ankles 0.1 m from the middle."""
    heading = human_heading(STANDING)
    stay(heading, STANDING, 1000)
    angle = 0.0
    while angle < pi:
        angle += 0.01 * rate
        heading.step(moved(STANDING, angle), {}, dt=0.01)
    stay(heading, moved(STANDING, angle), 80)
    assert np.cos(np.radians(angle_of(heading)) - angle) > 0.95


def test_without_feet_the_heading_follows_the_hands_at_once() -> None:
    worn = {name: point for name, point in STANDING.items() if "ankle" not in name}
    heading = human_heading(worn, feet=False)
    stay(heading, worn, 1000)
    stay(heading, moved(worn, 1.0), 100)
    assert np.radians(angle_of(heading)) == pytest.approx(1.0, abs=0.02)
