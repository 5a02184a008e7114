"""Live validity: states of a stream's sensors, messages about changes, and the debounce of sensors and holds."""

from collections.abc import Sequence
from math import isfinite

import numpy as np

from retarget._solver import Validity
from retarget.frames import SensorSample
from retarget.human.pose_validation import LIMITS, StateArray, ValidityLimits, ValidityState, other_sides
from retarget.live.advice import advice
from retarget.sources.streams.stream_frame import Dropped
from retarget.types import BoolArray, FloatArray, IntArray, News

CAMERA_LIMITS = ValidityLimits(silent_after=0.2, stale_after=0.22)
"""For a camera of 15 to 30 pictures a second, as a busy browser leaves one out."""

UNTRACKED = "pose that the sender marks as lost"
OUT_OF_RANGE = "position outside the room"
UNREACHABLE = "position that no human can have reached"
# Reason of a refused pose, by the verdict of `Validity`.
REASONS = {
    1: UNTRACKED,
    2: "pose that is not finite",
    3: "orientation that is no unit quaternion",
    4: OUT_OF_RANGE,
    5: UNREACHABLE,
}
MOST_NAMED_SENSORS = 6  # if more sensors change alike, the message names none


class SensorValidity:
    """The validity of k sensors, by the limits of `retarget.human.pose_validation`. Outside data never raise.

    refused: counts of unused poses by reason.
    """

    def __init__(self, names: Sequence[str], limits: ValidityLimits = LIMITS) -> None:
        self.names, self.limits = tuple(names), limits
        self.refused = Dropped()
        self._others = other_sides(self.names)
        self._validity = Validity(self._others, limits)
        self._states: StateArray = np.full(len(self.names), ValidityState.STALE, dtype=np.uint8)
        self._reported = self._states.copy()
        self._was_fresh = np.zeros(len(self.names), dtype=bool)
        self._now = 0.0

    def restart(self, limits: ValidityLimits) -> None:
        """Judge by other limits from now on, as another input takes over."""
        self.limits, self._validity = limits, Validity(self._others, limits)

    def take(
        self, rows: IntArray, time: float, *, position: FloatArray, orientation: FloatArray, tracked: BoolArray
    ) -> BoolArray:
        """Judge m poses captured at `time`, s. Returns the mask (m,) of usable ones, until the next call.

        rows (m,): their sensors. position (m, 3) m, world. orientation (m, 4) wxyz, NaN where missing. tracked (m,):
        False where the sender marks them as lost.
        """
        if not isfinite(time):
            self.refused.reasons["pose at a time that is not finite"] += len(rows)
            return np.zeros(len(rows), dtype=bool)
        position, orientation = np.ascontiguousarray(position), np.ascontiguousarray(orientation)
        verdicts = self._validity.take(rows, time, position, orientation, tracked)
        if verdicts is None:  # all are valid
            return tracked
        usable: BoolArray = np.equal(verdicts, 0)
        for verdict in verdicts[~usable].tolist():
            self.refused.reasons[REASONS[verdict]] += 1
        return usable

    def judge(self, now: float) -> StateArray:
        """The ValidityState (k,) of each sensor at `now`, s; read-only."""
        states: StateArray = self._validity.judge(now)
        if states.tobytes() != self._states.tobytes():
            fresh = states == ValidityState.FRESH
            # The first reception of a sensor is no news.
            self._reported[fresh & ~self._was_fresh & (self._reported == ValidityState.STALE)] = ValidityState.FRESH
            self._was_fresh |= fresh
        states.flags.writeable = False
        self._states, self._now = states, now
        return states

    def messages(self) -> list[News]:
        """Changes since the last call, one sentence for all sensors that changed alike."""
        if self._states.tobytes() == self._reported.tobytes():
            return []
        alike: dict[tuple[ValidityState, ValidityState, bool], dict[str, float]] = {}
        for row in np.flatnonzero(self._states != self._reported).tolist():
            before, after = ValidityState(self._reported[row]), ValidityState(self._states[row])
            at, still, moved = self._validity.history(row)
            seconds = still if after is ValidityState.FROZEN else self._now - at
            change = before, after, moved and before is ValidityState.JUMPED and after is ValidityState.FRESH
            alike.setdefault(change, {})[self.names[row]] = seconds if isfinite(seconds) else 0.0
        self._reported = self._states.copy()
        news = []
        for (before, after, resettled), sensors in alike.items():
            names = "all sensors" if len(sensors) == len(self.names) > MOST_NAMED_SENSORS else ", ".join(sensors)
            symptom, seconds = after.name.lower(), max(sensors.values())
            if after is ValidityState.FRESH:
                symptom = "resettled" if resettled else "received" if before is ValidityState.NOT_IN_USE else "fresh"
            elif after is ValidityState.STALE and not seconds:
                symptom = "never"
            text = advice(f"sensor {symptom}", seconds=seconds).what
            news.append(News(f"{names}: {text}", f"{names}: {before.name} {after.name}"))
        return news

    def forget_recovered(self) -> None:
        """Send no message about sensors that are fresh now."""
        self._reported[self._states == ValidityState.FRESH] = ValidityState.FRESH


class Debounce:
    """True after `LIMITS.healthy` s of good without a break. good: the first state."""

    def __init__(self, *, good: bool = False) -> None:
        self.good = good  # result of the last step
        self.tries = 0  # times that it became good, but not for long enough
        self._since = -np.inf if good else np.inf

    def restart(self) -> None:
        """Wait anew from the next good step on."""
        self.good, self._since = False, np.inf

    def step(self, now: float, *, good: bool) -> bool:
        """True if it has been good for long enough at `now`, s."""
        self.tries += good and np.isinf(self._since)
        self._since = min(self._since, now) if good else np.inf
        self.good = now - self._since >= LIMITS.healthy
        self.tries *= not self.good
        return self.good


class Engagement:
    """Follows samples, or holds. It begins with a hold at the sample that the robot has approached."""

    def __init__(self, first: SensorSample, *, following: bool = False) -> None:
        self.engaged = True  # False while a pedal or key is released
        self.following = following  # else the last sample is held
        self.shown = first  # the last followed sample
        self.good = Debounce()  # its `tries` are of this hold

    def hold(self) -> None:
        """Hold from now on, until data are good for long enough."""
        self.following = False
        self.good.restart()

    def step(self, now: float, sample: SensorSample, *, good: bool) -> SensorSample | None:
        """The sample to follow at `now`, s; None: hold. good: True if the sensors are valid."""
        if not good or not self.engaged:
            self.hold()
            return None
        if not self.following and not self.good.step(now, good=True):
            return None
        self.following, self.shown = True, sample
        return sample


class SensorDebounce:
    """Selects the sensors that are used: valid ones, and lost ones after `LIMITS.healthy` s."""

    def __init__(self, states: StateArray) -> None:
        """Valid sensors are used at once, as the body does not move yet."""
        self._since = np.where(states == ValidityState.FRESH, -np.inf, np.inf)

    def step(self, states: StateArray, now: float) -> BoolArray:
        """The mask (k,) of used sensors, for the states (k,) at `now`, s."""
        self._since = np.where(states == ValidityState.FRESH, np.minimum(self._since, now), np.inf)
        return now - self._since >= LIMITS.healthy
