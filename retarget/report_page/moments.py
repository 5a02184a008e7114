"""The moments at which a run went wrong, on the time of the run: what stopped it, and a fall."""

from dataclasses import dataclass

import numpy as np

from retarget.record import Phase
from retarget.run_result import RunResult

__all__ = ["Moment", "moments"]


@dataclass(frozen=True)
class Moment:
    """what: "Stopped" or "Fell". time: s on the run's time. text: why, in words. more: what else there is to say."""

    what: str
    time: float
    text: str
    more: tuple[str, ...] = ()


def moments(run: RunResult) -> tuple[Moment, ...]:
    """In the order of their time; none of a run that went on to its end.

    A stop is at the first tick that braked, or at the last that was sent.
    """
    found = []
    if run.reason is not None and len(run.record):
        braking = np.flatnonzero(run.record.phase == Phase.BRAKE)
        row = int(braking[0]) if braking.size else len(run.record) - 1
        found.append(Moment("Stopped", float(run.record.time[row]), run.reason, _more(run)))
    fall = None if run.physics is None else run.physics.fall
    if fall is not None:
        found.append(Moment("Fell", fall.time, fall.how))
    return tuple(sorted(found, key=lambda moment: moment.time))


def _more(run: RunResult) -> tuple[str, ...]:
    stop = run.stop
    if stop is None:
        return ()
    said = [f"Cause, as the guard latched it: {stop.cause.value}."]
    if stop.then is not None:
        said.append(f"The braking was ended by: {stop.then.value}.")
    if stop.powered:
        said.append("Not every servo confirmed that its torque is off.")
    return tuple(said)
