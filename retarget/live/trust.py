"""Trust per sensor: which poses of a sender may be used, and what is thought of each sensor."""

from collections import deque
from collections.abc import Sequence
from math import isfinite

import numpy as np

from retarget.body import IntArray
from retarget.frames import BoolArray
from retarget.live.last_poses import LastPoses
from retarget.live.leaps import Leaps
from retarget.live.sound_poses import UNTRACKED, SoundPoses
from retarget.live.stillness import Stillness
from retarget.live.trust_limits import TrustLimits
from retarget.live.trust_state import StateArray, TrustState
from retarget.live.trust_words import TrustChange, lasting, sentences
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
        self._sound = SoundPoses(self.limits)
        self._last = LastPoses(count)
        self._leaps = Leaps(self.names, self._last, self.limits)
        self._stillness = Stillness(self._last, self.limits)
        self._outside_at = np.full(count, -np.inf)
        self._states: StateArray = np.full(count, TrustState.STALE, dtype=np.uint8)
        self._began: float | None = None
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
        return self._take(rows, time, np.concatenate((position, orientation), axis=1), tracked)

    def _take(self, rows: IntArray, time: float, pose: FloatArray, tracked: BoolArray) -> BoolArray:
        missing = self._sound.missing_turns(pose, tracked)
        if missing is None:
            vouched = int(np.count_nonzero(tracked))
            if 0 < vouched < len(rows):
                return self._take_tracked(rows, time, pose, tracked)
            return self._take_sound_ones(rows, time, pose, tracked)
        usable = self._take_sound(rows, time, pose)
        if missing.size:
            self._last.forget_turn(rows[missing])
        return usable

    def _take_tracked(self, rows: IntArray, time: float, pose: FloatArray, tracked: BoolArray) -> BoolArray:
        """Where some are not vouched for, which may last."""
        usable: BoolArray = np.array(tracked)
        rows, pose = rows[tracked], pose[tracked]
        self.refused.reasons[UNTRACKED] += len(usable) - len(rows)
        usable[tracked] = self._take(rows, time, pose, np.ones(len(rows), dtype=bool))
        return usable

    def _take_sound_ones(self, rows: IntArray, time: float, pose: FloatArray, tracked: BoolArray) -> BoolArray:
        """Where some are not sound."""
        verdict = self._sound.judge(pose[:, :3], pose[:, 3:], tracked)
        for reason, count in verdict.reasons:
            self.refused.reasons[reason] += count
        self._outside_at[rows[verdict.outside]] = time
        usable = verdict.sound
        usable[usable] = self._take_sound(rows[usable], time, pose[usable])
        self._last.forget_turn(rows[usable & ~verdict.oriented])
        return usable

    def _take_sound(self, rows: IntArray, time: float, pose: FloatArray) -> BoolArray:
        where = self._last.rows(rows)
        step = pose - self._last.pose[where]
        if self._leaps.are_calm(time, step):
            self._last.go_on(where, time, pose, step)
            usable: BoolArray = np.ones(len(rows), dtype=bool)
        else:
            usable, stored = self._leaps.take(rows, time, pose[:, :3])
            if leapt := len(rows) - int(np.count_nonzero(usable)):
                self.refused.reasons[LEAPT] += leapt
            self._last.put(rows[stored], time, pose[stored])
        self._stillness.remember(time)
        return usable

    def keep_sides(self) -> None:
        """From now on left and right that have changed places are not believed before they change back."""
        self._leaps.keep_sides()

    def judge(self, now: float) -> StateArray:
        """What is thought of each sensor at `now`: a TrustState each, (k,), read-only."""
        if self._began is None:
            self._began = now
        if not isfinite(now):
            now = np.inf
        # A capture that lies far ahead is no more recent than one far back.
        stale = np.abs(now - self._last.at) > self.limits.stale_after
        states: StateArray = stale.astype(np.uint8)  # FRESH is 0, STALE is 1
        frozen = self._stillness.frozen(now)
        if frozen is not None:
            states[frozen & ~stale] = TrustState.FROZEN
        if np.count_nonzero(stale):
            self._explain(states, stale, now)
        if self._leaps.any_doubted:
            doubted = self._leaps.state != TrustState.FRESH
            doubted &= np.abs(now - self._leaps.doubted_at) <= self.limits.stale_after
            states[doubted] = self._leaps.state[doubted]
        if states.tobytes() != self._states.tobytes():
            self._note(np.flatnonzero(states != self._states), states, now)
        states.flags.writeable = False
        self._states = states
        return states

    def messages(self) -> list[str]:
        """What has changed since the last call, in sentences for a person."""
        told = sentences(lasting(self._changes))
        self._changes.clear()
        return told

    def forget_mended(self) -> None:
        """Say nothing of sensors that are believed by now, whatever was wrong with them before."""
        fresh = {name for name, state in zip(self.names, self._states, strict=True) if state == TrustState.FRESH}
        kept = [change for change in self._changes if change.name not in fresh]
        self._changes.clear()
        self._changes.extend(kept)

    def _explain(self, states: StateArray, stale: BoolArray, now: float) -> None:
        """Why nothing was accepted: never heard, or outside the room."""
        assert self._began is not None
        if now - self._began >= self.limits.not_worn_after:
            states[~np.isfinite(self._last.at)] = TrustState.NOT_WORN
        outside = np.abs(now - self._outside_at) <= self.limits.stale_after
        states[stale & outside] = TrustState.OUT_OF_RANGE

    def _note(self, rows: IntArray, states: StateArray, now: float) -> None:
        still = self._stillness.still_for()
        for row in rows.tolist():
            before, after = TrustState(self._states[row]), TrustState(states[row])
            first = not self._heard_before[row]
            self._heard_before[row] |= after is TrustState.FRESH
            if first and before is TrustState.STALE and after is TrustState.FRESH:
                continue
            since = now - self._last.at[row]
            seconds = float(still[row] if after is TrustState.FROZEN else since) if isfinite(since) else 0.0
            resettled = bool(self._leaps.resettled[row]) and before in (TrustState.JUMPED, TrustState.SWAPPED)
            self._changes.append(
                TrustChange(now, self.names[row], before, after, seconds, resettled and after is TrustState.FRESH)
            )
