"""Performers from recordings in which sensors jump, and from single samples. Jumps hold the robot."""

from dataclasses import replace
from itertools import compress
from typing import ClassVar

import numpy as np

from retarget._solver import PoseFilter
from retarget.frames import SensorSample, on_grid
from retarget.human.pose_validation import JumpDetection, ValidityState
from retarget.human.samples import Clip
from retarget.live.performer import TOO_SHORT, lost_words
from retarget.live.sensor_validity import Debounce, Engagement
from retarget.types import BoolArray


def _jumped_words(names: tuple[str, ...], jumped: BoolArray) -> str:
    return lost_words(dict.fromkeys(compress(names, jumped.tolist()), ValidityState.JUMPED))


class RecordedPerformer:
    """`retarget.human.samples.Samples` of a clip in which sensors jump. The clip goes on while the robot holds."""

    paused: ClassVar[bool] = False
    over: ClassVar[bool] = False

    def __init__(self, clip: Clip) -> None:
        """clip: one `with_jumps`."""
        self._clip = clip
        self.ticks, self.kept, self.dt, self.motion_dt = clip.ticks, clip.kept, clip.dt, clip.motion_dt
        self._engagement = Engagement(clip.sample(0), following=True)
        self._words = ""

    @property
    def hold_reason(self) -> str:
        """Why the performer is not followed, in a few words."""
        return self._words or TOO_SHORT

    def may_approach(self) -> bool:
        """True: the clip waits."""
        return True

    def poll(self) -> None:
        """Do nothing: all samples are there."""

    def hold(self) -> None:
        """Hold until the data are good."""
        self._engagement.hold()

    def sample(self, tick: int) -> SensorSample | None:
        """The sensors at a tick, on the grid; None: hold."""
        sample = self._clip.sample(tick)
        self._words = _jumped_words(sample.names, self._clip.jumped(tick))
        followed = self._engagement.step(tick * self.dt, sample, good=not self._words)
        return None if followed is None else on_grid(followed)

    def recorded(self) -> Clip:
        """The clip."""
        return self._clip


REPEATED_S = 0.1
"""[s] A repeated sample is the same capture for this long: a caller's loop may be faster than the tracker."""


class SteppedPerformer:
    """A `retarget.human.samples.Performing` whose samples come by `take`. seen: the smoothed sample without jumps, if
    valid."""

    paused: ClassVar[bool] = True

    def __init__(self, first: SensorSample, smooth: PoseFilter | None = None) -> None:
        """first: the sample that the robot approaches. smooth: filter of the later ones."""
        self._first, self._engagement = first, Engagement(first)
        self._approaching = Debounce(good=True)
        self._jumps, self._smooth = JumpDetection(first.names), smooth
        if smooth is not None:
            smooth.reset(np.ones(len(first.names), dtype=bool))
        self._lost = ""  # what is missing while there is no valid sample
        self._now, self._changed = 0.0, 0.0  # [s] of the last sample, and of the last one that was another
        self._given: SensorSample | None = first  # the last one, and without what jumps
        self._judged = self._jumps.step(0.0, first)
        self.seen: SensorSample | None = first

    def take(self, now: float, sample: SensorSample | None, *, lost: str = "no sample") -> None:
        """Take the sample of the tick at `now`, s, if valid. lost: describes what is missing."""
        self._now, self._lost = now, lost
        if sample is not None and (now - self._changed > REPEATED_S or not _is_repeated(self._given, sample)):
            self._judged, self._changed = self._jumps.step(now, sample), now
        self._given = sample
        self.seen = self._smoothed(None if sample is None else self._judged)

    def _smoothed(self, sample: SensorSample | None) -> SensorSample | None:
        """The filtered sample; a sensor that comes back restarts its filter."""
        if self._smooth is None:
            return sample
        valid = np.zeros(len(self._first.names), dtype=bool) if sample is None else sample.valid
        if not valid.all():
            self._smooth.reset(~valid)
        if sample is None:
            return None
        now = np.full(len(valid), self._now)
        position, orientation = self._smooth.step(now, sample.position, sample.orientation)
        return replace(sample, position=position, orientation=orientation)

    @property
    def hold_reason(self) -> str:
        """Why the performer is not followed, in a few words."""
        if self.seen is None:
            return self._lost
        return _jumped_words(self._first.names, self._jumps.jumped) or TOO_SHORT

    def may_approach(self) -> bool:
        """True if the robot may go on with its approach."""
        return self._approaching.step(self._now, good=self._followable is not None)

    def hold(self) -> None:
        """Hold until samples come."""
        self._engagement.hold()

    def sample(self, tick: int) -> SensorSample | None:
        """The sample to follow; None: hold. It blends from the approached one, of tick 0, to those of the caller."""
        if tick == 0:
            self._engagement.hold()
            return self._first
        sample = self._followable
        if sample is None:
            self._engagement.hold()
            return None
        return self._engagement.step(self._now, sample, good=True)

    @property
    def _followable(self) -> SensorSample | None:
        return None if self._jumps.jumped.any() else self.seen


def _is_repeated(before: SensorSample | None, sample: SensorSample) -> bool:
    return before is not None and all(
        np.array_equal(one, other, equal_nan=True)
        for one, other in (
            (before.position, sample.position),
            (before.orientation, sample.orientation),
            (before.valid, sample.valid),
        )
    )
