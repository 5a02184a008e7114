"""Trust per sensor: which poses of a sender may be used, and what is thought of each sensor."""

from collections import deque
from collections.abc import Sequence
from math import isfinite

import numpy as np

from retarget.body import IntArray
from retarget.frames import BoolArray
from retarget.live.leaps import Leaps
from retarget.live.sound_poses import REASONS, SOUND
from retarget.live.trust_limits import TrustLimits
from retarget.live.trust_state import StateArray, TrustState
from retarget.live.trust_words import TrustChange, lasting, sentences
from retarget.live.watched_sensors import watched_sensors
from retarget.rotations import FloatArray
from retarget.sources.stream_frame import Dropped

__all__ = ["MAX_CHANGES", "Trust"]

MAX_CHANGES = 64
"""Changes that wait to be told; the oldest are forgotten."""
NO_TIME = "pose at a time that is not finite"
LEAPT = "position that no human can have reached"


class Trust:
    """Of k sensors. Times are s of the local clock; memory is bounded; nothing from outside raises.

    refused: poses that were not used, by reason. A pose that may be used is finite and a rotation, inside the room,
    vouched for by the sender, and within reach of the last one.
    """

    def __init__(self, names: Sequence[str], limits: TrustLimits | None = None) -> None:
        self.names = tuple(names)
        self.limits = limits or TrustLimits()
        self.refused = Dropped()
        count = len(self.names)
        self._watched = watched_sensors(count, self.limits)
        self._leaps = Leaps(self.names, self._watched, self.limits)
        self._states: StateArray = np.full(count, TrustState.STALE, dtype=np.uint8)
        self._told = self._states.tobytes()
        self._heard_before = np.zeros(count, dtype=bool)
        self._changes: deque[TrustChange] = deque(maxlen=MAX_CHANGES)

    def take(
        self, rows: IntArray, time: float, *, position: FloatArray, orientation: FloatArray, tracked: BoolArray
    ) -> BoolArray:
        """Which of m poses of one capture at `time` may be used, (m,); valid until the next call.

        rows (m,): their sensors, indices into names, each once. position (m, 3) m, world, needed. orientation (m, 4)
        wxyz, all NaN where it is missing. tracked (m,): whether the sender vouches for them.
        """
        if not isfinite(time):
            self.refused.reasons[NO_TIME] += len(rows)
            return np.zeros(len(rows), dtype=bool)
        position, orientation = np.ascontiguousarray(position), np.ascontiguousarray(orientation)
        found = self._watched.take(rows, time, position, orientation, tracked, self._leaps.any_doubted)
        if found is None:  # all are sound and calm
            return tracked
        verdicts, taken = found
        usable: BoolArray = np.equal(verdicts, SOUND)
        for verdict in verdicts[~usable].tolist():
            self.refused.reasons[REASONS[verdict]] += 1
        if not taken:
            usable[usable] = self._take_leaps(rows[usable], time, position[usable], orientation[usable])
        return usable

    def _take_leaps(self, rows: IntArray, time: float, position: FloatArray, orientation: FloatArray) -> BoolArray:
        """Where some sound ones are not calm."""
        usable, stored = self._leaps.take(rows, time, position)
        if leapt := len(rows) - int(np.count_nonzero(usable)):
            self.refused.reasons[LEAPT] += leapt
        self._watched.put(rows[stored], time, np.concatenate((position, orientation), axis=1)[stored])
        self._watched.forget_turn(rows[usable & np.isnan(orientation[:, 0])])
        return usable

    def keep_sides(self) -> None:
        """From now on left and right that have changed places are not believed before they change back."""
        self._leaps.keep_sides()

    def judge(self, now: float) -> StateArray:
        """What is thought of each sensor at `now`: a TrustState each, (k,), read-only."""
        states: StateArray = self._watched.judge(now)
        if not isfinite(now):
            now = np.inf
        if self._leaps.any_doubted:
            doubted = self._leaps.state != TrustState.FRESH
            doubted &= np.abs(now - self._leaps.doubted_at) <= self.limits.stale_after
            states[doubted] = self._leaps.state[doubted]
        if (told := states.tobytes()) != self._told:
            self._note(np.flatnonzero(states != self._states), states, now)
        states.flags.writeable = False
        self._states, self._told = states, told
        return states

    def messages(self) -> list[str]:
        """What has changed since the last call, in sentences for a person."""
        if not self._changes:
            return []
        told = sentences(lasting(self._changes))
        self._changes.clear()
        return told

    def forget_mended(self) -> None:
        """Say nothing of sensors that are believed by now, whatever was wrong with them before."""
        fresh = {name for name, state in zip(self.names, self._states, strict=True) if state == TrustState.FRESH}
        kept = [change for change in self._changes if change.name not in fresh]
        self._changes.clear()
        self._changes.extend(kept)

    def _note(self, rows: IntArray, states: StateArray, now: float) -> None:
        still, at = self._watched.still_for, self._watched.at
        for row in rows.tolist():
            before, after = TrustState(self._states[row]), TrustState(states[row])
            first = not self._heard_before[row]
            self._heard_before[row] |= after is TrustState.FRESH
            if first and before is TrustState.STALE and after is TrustState.FRESH:
                continue
            since = now - at[row]
            seconds = float(still[row] if after is TrustState.FROZEN else since) if isfinite(since) else 0.0
            resettled = bool(self._leaps.resettled[row]) and before in (TrustState.JUMPED, TrustState.SWAPPED)
            self._changes.append(
                TrustChange(now, self.names[row], before, after, seconds, resettled and after is TrustState.FRESH)
            )
