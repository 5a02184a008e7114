"""What the bus's own clock and the guard say of a run."""

import numpy as np

from hardware.guard_state import StopCause
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["fault_count", "longest_period", "missed_ticks", "tick_rate"]

LATE = 1.5
"""Periods between two ticks from which on one is missing between them."""
SERVO_CAUSES = (StopCause.SERVO_LOST, StopCause.SERVO_ALERT, StopCause.SERVO_LIMP)


def fault_count(run: RunResult) -> int:
    """Servos silent or alarmed, summed over ticks, and failures that ended ticks before they had a row.

    A tick in which the bus fails sends nothing, nor does one in which a robot that stands is stopped: of these only the
    guard's stop tells.
    """
    sent = run.record.robot
    seen = 0 if sent is None else int(sent.faults.sum())
    if run.stop is None:
        return seen
    if run.stop.cause in SERVO_CAUSES:
        seen = max(seen, 1)
    return seen + (run.stop.cause, run.stop.then).count(StopCause.BUS)


def tick_rate(times: FloatArray) -> float | None:
    """Ticks per second, of the times (T,) s at which servos were read; None where that was not measured."""
    known = times[np.isfinite(times)]
    lasted = float(known[-1] - known[0]) if known.size > 1 else 0.0
    return (known.size - 1) / lasted if lasted > 0.0 else None


def longest_period(times: FloatArray) -> float | None:
    """Longest time (s) from one tick to the next: a single stall shows here, where a long run hides it in the rate."""
    known = times[np.isfinite(times)]
    return float(np.diff(known).max()) if known.size > 1 else None


def missed_ticks(times: FloatArray, dt: float) -> int | None:
    """Deadlines that passed without a tick, of the times (T,) s of ticks that should be `dt` s apart; None where they
    were not measured."""
    known = times[np.isfinite(times)]
    if known.size < 2:
        return None
    periods = np.diff(known) / dt
    return int(np.rint(periods[periods > LATE] - 1.0).sum())
