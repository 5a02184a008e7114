"""Profiles of goal positions: continuous, within their limits, at the goal at the end."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.emulator.profile_path import RECTANGLE, TRAPEZOID, TRIANGLE, ProfilePath, path_by_time, path_by_velocity

_ticks = st.floats(-5000.0, 5000.0)
_speeds = st.floats(-800.0, 800.0)


def continuous(path: ProfilePath, position: float, velocity: float, *, jumps: bool = False, rate: float = 0.0) -> None:
    """The path starts where it should, and positions are what velocities add up to."""
    count = 400
    times = [5.0 + (path.end - 5.0) * index / count for index in range(count + 1)]
    step = (path.end - 5.0) / count
    points = [path.at(time) for time in times]
    assert points[0].position == pytest.approx(position, abs=1e-6) or step == 0.0
    if not jumps and step > 0.0:
        assert points[0].velocity == pytest.approx(velocity, abs=1e-6)
    fastest = max(abs(point.velocity) for point in points)
    steepest = max(rate, *(abs(point.acceleration) for point in points))
    for before, after in pairwise(points):
        assert abs(after.position - before.position) <= 1.001 * fastest * step + 1e-6
        assert jumps or abs(after.velocity - before.velocity) <= 1.001 * steepest * step + 1e-6
    assert path.at(path.end).position == path.goal and path.at(path.end + 1.0).velocity == 0.0
    assert path.at(path.end - 1e-9).position == pytest.approx(path.goal, abs=1e-3)


@settings(max_examples=60, deadline=None)
@given(position=_ticks, goal=_ticks, velocity=_speeds, top=st.floats(5.0, 800.0), rate=st.floats(50.0, 5000.0))
def test_by_velocity(position: float, goal: float, velocity: float, top: float, rate: float) -> None:
    path = path_by_velocity(goal, position=position, velocity=velocity, top=top, acceleration=rate, now=5.0)
    continuous(path, position, velocity, rate=rate)
    assert all(abs(path.at(5.0 + 0.01 * k).velocity) <= max(top, abs(velocity)) + 1e-6 for k in range(200))


@settings(max_examples=60, deadline=None)
@given(position=_ticks, goal=_ticks, velocity=_speeds, total=st.floats(0.1, 5.0), share=st.floats(0.05, 1.0))
def test_by_time(position: float, goal: float, velocity: float, total: float, share: float) -> None:
    path = path_by_time(goal, position=position, velocity=velocity, total=total, ramp=share * total, now=5.0)
    continuous(path, position, velocity)
    assert path.end == pytest.approx(5.0 + total)


def test_kinds() -> None:
    def by(top: float, rate: float) -> int:
        return path_by_velocity(1000.0, position=0.0, velocity=0.0, top=top, acceleration=rate, now=0.0).kind

    assert (by(100.0, 0.0), by(100.0, 1000.0), by(5000.0, 1000.0)) == (RECTANGLE, TRAPEZOID, TRIANGLE)


def test_a_rectangle_runs_at_its_speed() -> None:
    path = path_by_velocity(-300.0, position=0.0, velocity=0.0, top=100.0, acceleration=0.0, now=5.0)
    assert path.end == 8.0 and path.at(6.0) == (-100.0, -100.0, 0.0)
    continuous(path, 0.0, 0.0, jumps=True)
