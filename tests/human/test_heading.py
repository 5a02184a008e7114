"""The heading from a few sensors: what hints at it, how fast it follows, that it does not depend on the rate."""

from math import cos, exp, pi, sin

import pytest

from retarget.human.posture_prior import Heading, Point
from retarget.schema.priorities import HeadingSettings

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
