"""How often joints are at their limits: by joints that are put there."""

from dataclasses import replace

import numpy as np

from retarget.batch.clip import limit_shares
from retarget.run.run_result import RunResult
from rig import scripted_run


def moved(run: RunResult, track: np.ndarray) -> RunResult:
    """The run in which the first servo moves like this (T,) while it follows, rad, and all others stand still."""
    assert run.robot is not None and run.record.robot is not None
    q = np.tile(run.record.q[run.record.following.start], (len(run.record), 1))
    q[run.record.following, run.robot.servo_columns[0]] = track
    return replace(run, record=replace(run.record, q=q))


def test_shares_of_ticks_at_a_limit() -> None:
    run = scripted_run()
    assert run.robot is not None
    limits, dt, ticks = run.robot.limits, run.clip.dt, run.ticks_followed
    middle = 0.5 * (limits.lower[0] + limits.upper[0])
    assert limit_shares(moved(run, np.full(ticks, middle))) == {
        "at_position_limit": 0.0,
        "at_velocity_limit": 0.0,
        "at_acceleration_limit": 0.0,
    }
    at_end = np.full(ticks, middle)
    at_end[: ticks // 3] = limits.upper[0]
    found = limit_shares(moved(run, at_end))
    assert found["at_position_limit"] == (ticks // 3) / ticks
    assert found["at_velocity_limit"] == 1 / (ticks - 1) and found["at_acceleration_limit"] == 2 / (ticks - 2)
    fast = middle + limits.max_velocity[0] * dt * np.where(np.arange(ticks) < ticks // 2, 0, 1).cumsum() * 0.9995
    fast = np.minimum(fast, limits.upper[0] - 0.1)
    found = limit_shares(moved(run, fast))
    assert found["at_position_limit"] == 0.0 and found["at_velocity_limit"] > 0.05


def test_what_has_no_shares() -> None:
    run = scripted_run()
    assert limit_shares(replace(run, record=run.record[:1])) == {}
