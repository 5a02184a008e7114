"""Servos that are not well yet not so bad that the robot must stop: told once, and slowing it where that helps them."""

from collections.abc import Sequence

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from hardware.servo import ServoSpec
from hardware.servo_levels import ServoLevels
from hardware.servo_watched import Watched, name_servos

RAMP_S = 0.4
"""How long the robot takes from full speed to slow, and back."""
CALM_S = 1.0
"""How long all must be well before a warning ends."""
MOST_NEWS = 100
"""So many texts are kept for somebody who does not ask for them."""


class ServoWarnings:
    """The warnings about one robot's servos. share: of its speed that is left to a robot that spares its servos.

    slow: the share of all speeds that is right now, from 1 down to `share`; it changes smoothly.
    """

    def __init__(self, servos: Sequence[ServoSpec], rows: Sequence[Watched], share: float) -> None:
        self._servos, self._rows = tuple(servos), tuple(rows)
        self._share = share
        bounds, ease = [row.warn for row in rows], np.array([[row.ease] for row in rows])
        self.levels = ServoLevels(bounds, [row.patience for row in rows], len(servos))
        self._calm_least, self._calm_most = self.levels.least + ease, self.levels.most - ease
        self._slows = np.array([row.slows for row in rows])
        self._active = np.zeros(self.levels.least.shape, dtype=np.bool_)
        self._rough_at = np.full(self._active.shape, -np.inf)  # [s] when each was last not well
        self._at: float | None = None  # [s] of the last look
        self._news: list[str] = []
        self.slow = 1.0
        self.busy = False
        """Whether there is a warning, or one may come, or the robot is not back at its full speed."""

    @property
    def active(self) -> BoolArray:
        """Who is warned of, (rows, n)."""
        return self._active

    def pass_over(self, now: float) -> None:
        """A look, at `now`, s, at which all was well and nothing was to do."""
        self._at = now

    def look(self, seen: FloatArray, now: float) -> None:
        """Judge values (rows, n) at `now`, s."""
        began = self.levels.beyond(seen, now) & ~self._active
        calm = (seen >= self._calm_least) & (seen <= self._calm_most)
        self._rough_at = np.where(calm, self._rough_at, now)
        ended = self._active & (now - self._rough_at >= CALM_S)
        self._active = (self._active | began) & ~ended
        if began.any():
            self._tell(began, seen, "warning: servo {warning} {names}{slower}")
        if ended.any():
            self._tell(ended, seen, "over: servo {warning} {names} now")
        self._change_speed(now)
        self.busy = self.slow < 1.0 or self.levels.waiting or bool(self._active.any())

    def take_news(self) -> list[str]:
        """What began and what ended since somebody last asked, a sentence each."""
        news, self._news = self._news, []
        return news

    def _change_speed(self, now: float) -> None:
        elapsed = 0.0 if self._at is None else max(now - self._at, 0.0)
        self._at = now
        goal = self._share if self._active[self._slows].any() else 1.0
        step = (1.0 - self._share) * elapsed / RAMP_S
        self.slow = max(goal, self.slow - step) if goal < self.slow else min(goal, self.slow + step)

    def _tell(self, which: BoolArray, seen: FloatArray, form: str) -> None:
        for row, mask, values in zip(self._rows, which, seen, strict=True):
            if mask.any():
                names = name_servos(self._servos, mask, row.tell, values)
                slower = f"; the robot goes at {self._share:.0%} of its speed" if row.slows else ""
                self._news.append(form.format(warning=row.warning, names=names, slower=slower))
        del self._news[:-MOST_NEWS]
