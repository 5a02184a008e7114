"""Whether a motion kept its limits, by finite differences of what was sent."""

from dataclasses import dataclass

import numpy as np

from retarget.joint_limits import JointLimits
from retarget.rotations import FloatArray

__all__ = ["TOLERANCE", "LimitViolations", "jerk_p95", "limit_violations"]

TOLERANCE = 1e-8
"""A position may miss a limit by this, rad or m, before it counts; a displacement of one tick by this too, and the
change of a displacement by twice this. It is the round-off of two programs that agree."""


@dataclass(frozen=True)
class LimitViolations:
    """How many values, of all joints and ticks, were beyond a limit."""

    position: int
    velocity: int
    acceleration: int


def limit_violations(
    positions: FloatArray, limits: JointLimits, dt: float, *, from_rest: bool = True, to_rest: bool = False
) -> LimitViolations:
    """Count violations in joint positions (T, n), `dt` s apart; limits (n,). The first row is where the motion starts.

    from_rest: it starts there at rest; otherwise the first displacement is taken as it comes, without acceleration.
    to_rest: it stands still after the last row, so a motion that is cut shows as a change of speed. A joint that starts
    beyond a position limit counts only from where it has come inside.
    """
    step = np.diff(positions, axis=0)  # (T-1, n) [rad or m]
    before = np.zeros_like(step[:1]) if from_rest else step[:1]
    after = np.zeros_like(step[:1] if to_rest else step[:0])
    change = np.diff(np.vstack([before, step, after]), axis=0)
    outside = (positions < limits.lower - TOLERANCE) | (positions > limits.upper + TOLERANCE)
    came_in = np.logical_or.accumulate(~outside, axis=0)
    return LimitViolations(
        position=int(np.count_nonzero(outside & came_in)),
        velocity=int(np.count_nonzero(np.abs(step) > limits.max_velocity * dt + TOLERANCE)),
        acceleration=int(np.count_nonzero(np.abs(change) > limits.max_acceleration * dt**2 + 2.0 * TOLERANCE)),
    )


def jerk_p95(positions: FloatArray, dt: float) -> float | None:
    """95th percentile of the size of the jerk of joint positions (T, n), rad/s^3; None for fewer than four ticks."""
    if len(positions) < 4 or positions.shape[1] == 0:
        return None
    return float(np.percentile(np.abs(np.diff(positions, n=3, axis=0)), 95) / dt**3)
