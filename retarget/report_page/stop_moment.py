"""What ended a run, and when, on the time of the run."""

from dataclasses import dataclass

import numpy as np

from retarget.record import Phase
from retarget.run_result import RunResult

__all__ = ["StopMoment", "stop_moment"]


@dataclass(frozen=True)
class StopMoment:
    """time: s on the run's time, of the first tick that braked, or of the last. cause: the guard's, None without one.
    powered: torque could not be switched off everywhere."""

    reason: str
    time: float
    cause: str | None
    powered: bool


def stop_moment(run: RunResult) -> StopMoment | None:
    """None of a run that went on to its end."""
    if run.reason is None or not len(run.record):
        return None
    braking = np.flatnonzero(run.record.phase == Phase.BRAKE)
    row = int(braking[0]) if braking.size else len(run.record) - 1
    stop = run.stop
    return StopMoment(
        reason=run.reason,
        time=float(run.record.time[row]),
        cause=None if stop is None else stop.cause.value,
        powered=stop is not None and stop.powered,
    )
