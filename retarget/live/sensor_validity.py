"""Live validity: the state of each sensor of a stream and the messages about its changes, and when a performer is
followed: debounce, reacquisition blends, weights of sensors.

Limits and states are those of `retarget.human.pose_validation`, which looks at recordings too.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import isfinite

import numpy as np

from retarget import rotations
from retarget._solver import Validity
from retarget.arithmetic import norms
from retarget.frames import SensorSample
from retarget.human.pose_validation import LIMITS, StateArray, ValidityLimits, ValidityState, other_sides
from retarget.sources.streams.stream_frame import Dropped
from retarget.types import BoolArray, FloatArray, IntArray

CAMERA_LIMITS = ValidityLimits(silent_after=0.2, stale_after=0.22)
"""Of a camera: it gives 15 to 30 pictures a second, and a busy browser leaves one out."""

UNTRACKED = "pose that the sender marks as lost"
NOT_FINITE = "pose that is not finite"
NOT_A_ROTATION = "orientation that is no unit quaternion"
OUT_OF_RANGE = "position outside the room"
UNREACHABLE = "position that no human can have reached"
REASONS = {1: UNTRACKED, 2: NOT_FINITE, 3: NOT_A_ROTATION, 4: OUT_OF_RANGE, 5: UNREACHABLE}
"""Why a pose is refused, by the verdict of `Validity`: the first reason where several hold."""
MOST_NAMED = 6
"""Sensors that are named when all have changed alike; of more it says that all did."""
NO_TIME = "pose at a time that is not finite"


def change_text(before: ValidityState, after: ValidityState, seconds: float, *, resettled: bool) -> str:
    """What has changed, for the user. seconds: how long it has been in the new state, 0 where that is not known.
    resettled: it is valid again at another place than before its jump."""
    if after is ValidityState.FRESH:
        if resettled:
            return "accepted again at its new place"
        return "received now" if before is ValidityState.NOT_IN_USE else "back"
    return {
        ValidityState.STALE: f"nothing that can be used for {seconds:.1f} s" if seconds else "not received yet",
        ValidityState.FROZEN: f"frozen since {seconds:.1f} s (tracker lost?)",
        ValidityState.JUMPED: "jumped farther than a human can",
        ValidityState.NOT_IN_USE: "not received since the start (not worn?)",
        ValidityState.OUT_OF_RANGE: "position outside the room",
    }[after]


class SensorValidity:
    """The validity of k sensors. Times are s of the local clock; memory is bounded; no data from outside raise.

    refused: poses that were not used, by reason. A pose that may be used is finite and a rotation, inside the room,
    tracked by the sender, and within reach of the last one.
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
        """Judge by other limits from now on, as if nothing had come so far: another input takes over."""
        self.limits, self._validity = limits, Validity(self._others, limits)

    def take(
        self, rows: IntArray, time: float, *, position: FloatArray, orientation: FloatArray, tracked: BoolArray
    ) -> BoolArray:
        """Judge m poses of one capture at `time`. Returns which may be used, (m,), until the next call.

        rows (m,): their sensors, indices into names, each once. position (m, 3) m, world, needed. orientation (m, 4)
        wxyz, all NaN where it is missing. tracked (m,): False where the sender marks them as lost.
        """
        if not isfinite(time):
            self.refused.reasons[NO_TIME] += len(rows)
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
        """Return the ValidityState (k,) of each sensor at `now`, s; read-only."""
        states: StateArray = self._validity.judge(now)
        if states.tobytes() != self._states.tobytes():
            fresh = states == ValidityState.FRESH
            # That a sensor is received at all is no news.
            self._reported[fresh & ~self._was_fresh & (self._reported == ValidityState.STALE)] = ValidityState.FRESH
            self._was_fresh |= fresh
        states.flags.writeable = False
        self._states, self._now = states, now
        return states

    def messages(self) -> list[str]:
        """What has changed since the last call, in sentences for the user, one for all sensors that changed alike. What
        came and went between needs none."""
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
        return [
            f"{self._named(sensors)}: {change_text(before, after, max(sensors.values()), resettled=resettled)}"
            for (before, after, resettled), sensors in alike.items()
        ]

    def _named(self, sensors: Collection[str]) -> str:
        return "all sensors" if len(sensors) == len(self.names) > MOST_NAMED else ", ".join(sensors)

    def forget_recovered(self) -> None:
        """No message about sensors that are fresh now."""
        self._reported[self._states == ValidityState.FRESH] = ValidityState.FRESH


# Whether something has been good for long enough to be used again.


class Debounce:
    """Becomes true after `LIMITS.healthy` s of good without a break. good: whether it begins as true."""

    def __init__(self, *, good: bool = False) -> None:
        self.good = good
        """The answer of the last step."""
        self.tries = 0
        """How often it began to be good since it was good for long enough."""
        self._since = -np.inf if good else np.inf

    def restart(self) -> None:
        """Wait anew from the next good step on."""
        self.good, self._since = False, np.inf

    def step(self, now: float, *, good: bool) -> bool:
        """Whether it has been good for long enough at `now`, s."""
        self.tries += good and np.isinf(self._since)
        self._since = min(self._since, now) if good else np.inf
        self.good = now - self._since >= LIMITS.healthy
        self.tries *= not self.good
        return self.good


PEAK = 1.5
"""Peak speed of a smoothstep over its mean."""


class Engagement:
    """Follows samples, or holds the last one. After a hold it blends back to the performer without a jump.

    It begins as after a hold, with the sample that the robot has approached; or, `following`, at full speed.
    """

    def __init__(self, first: SensorSample, *, following: bool = False) -> None:
        self.wanted = True
        """Whether the robot is to follow: False while a pedal or key is released."""
        self.settled = float(following)
        """Share of its speed that the robot may use beyond that of its slow approach: 0 until the blend back is over,
        then rising to 1 over the duration of that blend."""
        self.following = following
        """Whether samples are followed; else the last one is held."""
        self._held = self.shown = first
        """`shown`: the sample that was followed last."""
        self._good = Debounce()
        self._began = -np.inf  # [s] of the blend back
        self._duration = 1.0

    @property
    def tries(self) -> int:
        """How often data were good during this hold, but not for long enough."""
        return self._good.tries

    def hold(self) -> None:
        """Hold from now on, until data are good for long enough."""
        if self.following:
            self._held = self.shown
        self.following, self.settled = False, 0.0
        self._good.restart()

    def step(self, now: float, sample: SensorSample, *, good: bool) -> SensorSample | None:
        """The sample to follow at `now`, s; None: hold. good: whether the sensors are valid."""
        if not good or not self.wanted:
            self.hold()
            return None
        if not self.following:
            if not self._good.step(now, good=True):
                return None
            self.following, self._began, self._duration = True, now, self._blend_time(sample)
        share = (now - self._began) / self._duration
        self.settled = min(max((now - self._began) / self._duration - 1.0, 0.0), 1.0)
        self.shown = sample if share >= 1.0 else _blend(self._held, sample, share * share * (3.0 - 2.0 * share))
        return self.shown

    def _blend_time(self, sample: SensorSample) -> float:
        """Duration of the blend from the held sample to the present one, s."""
        both = self._held.valid & sample.valid
        distance = norms(sample.position[both] - self._held.position[both])
        turned = _turned(self._held, sample)
        angle = rotations.angle_between(self._held.orientation[turned], sample.orientation[turned])
        slowest = max(
            float(distance.max(initial=0.0)) / LIMITS.blend_speed, float(angle.max(initial=0.0)) / LIMITS.blend_turn
        )
        return max(LIMITS.blend, PEAK * slowest)


def _turned(held: SensorSample, sample: SensorSample) -> BoolArray:
    """Which sensors are valid and have an orientation in both samples, (k,)."""
    known = np.isfinite(held.orientation[:, 0]) & np.isfinite(sample.orientation[:, 0])
    return np.asarray(held.valid & sample.valid & known)


def _blend(held: SensorSample, sample: SensorSample, share: float) -> SensorSample:
    """Blend from the held sample (share 0) to the present one. Sensors that were not held are not blended."""
    both = held.valid & sample.valid
    position: FloatArray = sample.position.copy()
    position[both] += (1.0 - share) * (held.position[both] - sample.position[both])
    orientation = sample.orientation.copy()
    turned = _turned(held, sample)
    if turned.any():
        orientation[turned] = rotations.slerp(held.orientation[turned], sample.orientation[turned], share)
    return replace(sample, position=position, orientation=orientation)


# The weight of each sensor: it fades when the sensor becomes invalid, and comes back by a reacquisition blend.

LONGEST_STEP = 0.02
"""s; a tick that took longer changes the weights as if it had taken this: they never jump."""


class ReacquisitionBlend:
    """The `weights` (k,), 0 to 1, of k sensors; 0 at first. They rise and fall by smoothsteps, and may turn midway.

    The orientation of a sensor that comes back is blended by its weight from the last one of full weight; its position
    is, by `human.sensor_intake`, from where the body has it.
    """

    def __init__(self, count: int, limits: ValidityLimits = LIMITS) -> None:
        self._limits = limits
        self._share = np.zeros(count)
        self._fresh_for = np.zeros(count)
        self._last: FloatArray = np.full((count, 4), np.nan)
        self.weights: FloatArray = np.zeros(count)
        self._all_full = False

    def start(self, states: StateArray) -> None:
        """Give every valid sensor full weight at once: for a body that does not move yet."""
        self._share = (states == ValidityState.FRESH).astype(np.float64)
        self._fresh_for = self._share * self._limits.healthy
        self.weights, self._all_full = self._share.copy(), bool((self._share == 1.0).all())

    def step(self, states: StateArray, dt: float) -> FloatArray:
        """Weights (k,) `dt` s later, for the states (k,) of now."""
        if self._all_full and not np.count_nonzero(states):
            return self.weights
        dt = min(max(dt, 0.0), LONGEST_STEP)
        self._fresh_for = np.where(states == ValidityState.FRESH, self._fresh_for + dt, 0.0)
        back = self._fresh_for > self._limits.healthy
        # A sensor that was invalid fades out whole before it comes back, unless it is valid for long enough by then.
        change = np.where(back, dt / self._limits.blend, -dt / self._limits.leave)
        self._share = np.clip(self._share + change, 0.0, 1.0)
        self.weights = self._share * self._share * (3.0 - 2.0 * self._share)
        self._all_full = bool((self._share == 1.0).all())
        return self.weights

    def turned(self, orientation: FloatArray) -> FloatArray:
        """Orientations (k, 4) wxyz, blended by the present weights from the last ones of full weight."""
        if self._all_full:
            self._last = orientation
            return orientation
        whole = self.weights == 1.0
        self._last = np.where(whole[:, None], orientation, self._last)
        known = ~whole & np.isfinite(self._last[:, 0]) & np.isfinite(orientation[:, 0])
        blended = orientation.copy()
        blended[known] = rotations.slerp(self._last[known], orientation[known], self.weights[known])
        return blended
