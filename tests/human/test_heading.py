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


@pytest.mark.parametrize("angle", [0.0, 1.0, pi / 2, 3.0, -2.0])
def test_starts_facing_where_the_performer_faces(angle: float) -> None:
    heading = Heading(HeadingSettings())
    heading.start(moved(STANDING, angle), {})
    assert heading.forward == pytest.approx((cos(angle), sin(angle)))


@pytest.mark.parametrize("rate", [24.0, 60.0, 120.0, 125.0])
def test_follows_with_its_time_constant_at_any_rate(rate: float) -> None:
    heading = Heading(HeadingSettings(settle=0.2, velocity=0.0))
    heading.start(STANDING, {})
    for _ in range(round(0.2 * rate)):
        heading.step(moved(STANDING, pi / 2), {}, dt=1.0 / rate)
    follows = 1.0 - exp(-round(0.2 * rate) / rate / 0.2)
    assert heading.forward[1] / heading.forward[0] == pytest.approx(follows / (1.0 - follows), rel=1e-6)


def test_walking_faces_where_the_head_moves() -> None:
    """Feet and hands swing as far as in a stride; only the way of the head says where it goes."""
    stride = {**STANDING, "l_ankle": (0.3, 0.08, 0.1), "r_ankle": (-0.3, -0.08, 0.1)}
    stride |= {"l_wrist": (-0.15, 0.25, 0.9), "r_wrist": (0.25, -0.25, 0.9)}
    heading, still = Heading(HeadingSettings()), Heading(HeadingSettings())
    heading.start(stride, {})
    still.start(stride, {})
    for k in range(120):
        heading.step(moved(stride, x=1.3 * k / 120.0), {}, dt=1.0 / 120.0)
    assert abs(heading.forward[1]) < 0.8 * abs(still.forward[1])


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
