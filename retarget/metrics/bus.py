"""What the bus's own clock and the guard say of a run."""

import numpy as np

from hardware.guard_state import StopCause
from retarget.report import BusReport, Percentiles, ServoExtreme
from retarget.rotations import FloatArray
from retarget.run_result import RunResult

__all__ = ["bus_report", "fault_count", "longest_period", "missed_ticks", "percentiles", "tick_rate"]

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


def bus_report(run: RunResult) -> BusReport | None:
    """What the bus said; None without one."""
    sent = run.record.robot
    if sent is None or not run.has_bus:
        return None
    longest = longest_period(sent.bus_time)
    return BusReport(
        rate_hz=tick_rate(sent.bus_time),
        cycle_ms=percentiles(run.record.timing.cycle, 1e3),
        faults=fault_count(run),
        longest_period_ms=None if longest is None else 1e3 * longest,
        missed_ticks=missed_ticks(sent.bus_time, run.clip.dt),
        retries=int(sent.retries.max(initial=0)),
        hottest=_extreme(run, sent.temperature),
        lowest_voltage=_extreme(run, -sent.voltage, sign=-1.0),
    )


def percentiles(seconds: FloatArray, scale: float) -> Percentiles:
    """Of those that are known, times `scale`."""
    seconds = seconds[np.isfinite(seconds)]  # a stage that did not run in a tick has no cost there
    if not seconds.size:
        return Percentiles(float("nan"), float("nan"), float("nan"))
    p50, p99 = np.percentile(seconds, [50, 99])
    return Percentiles(scale * float(p50), scale * float(p99), scale * float(seconds.max()))


def _extreme(run: RunResult, values: FloatArray, *, sign: float = 1.0) -> ServoExtreme | None:
    """The servo with the largest of the values (T, n), which are told times `sign`."""
    if run.robot is None or not np.isfinite(values).any():
        return None
    column = int(np.nanargmax(values)) % values.shape[1]
    return ServoExtreme(run.robot.joint_map.joints[column], sign * float(np.nanmax(values)))
